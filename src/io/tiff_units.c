#include "io/tiff_internal.h"

#include <strings.h>

struct unit {
    const char *name;
    double factor;
};

/* In micrometres. ImageJ escapes the micro sign; others write it as UTF-8, as Latin-1, or as the
 * Greek letter; the last but one is Angstrom's. */
static const struct unit lengths[] = {
    {"micron", 1},      {"microns", 1},    {"um", 1},          {"\\u00B5m", 1},
    {"\xc2\xb5m", 1},   {"\xb5m", 1},      {"\xce\xbcm", 1},   {"micrometer", 1},
    {"micrometers", 1}, {"micrometre", 1}, {"micrometres", 1}, {"nm", 1e-3},
    {"mm", 1e3},        {"cm", 1e4},       {"m", 1e6},         {"inch", 25400},
    {"\xc3\x85", 1e-4}, {"pm", 1e-6},
};

/* In seconds; the micro sign as above. */
static const struct unit times[] = {
    {"s", 1},
    {"sec", 1},
    {"secs", 1},
    {"second", 1},
    {"seconds", 1},
    {"ms", 1e-3},
    {"msec", 1e-3},
    {"msecs", 1e-3},
    {"millisecond", 1e-3},
    {"milliseconds", 1e-3},
    {"us", 1e-6},
    {"usec", 1e-6},
    {"\\u00B5s", 1e-6},
    {"\xc2\xb5s", 1e-6},
    {"\xb5s", 1e-6},
    {"\xce\xbcs", 1e-6},
    {"microsecond", 1e-6},
    {"microseconds", 1e-6},
    {"ns", 1e-9},
    {"min", 60},
    {"mins", 60},
    {"minute", 60},
    {"minutes", 60},
    {"h", 3600},
    {"hr", 3600},
    {"hrs", 3600},
    {"hour", 3600},
    {"hours", 3600},
    {"d", 86400},
    {"day", 86400},
    {"days", 86400},
};

static double unit_factor(const struct unit *units, size_t count, const char *name)
{
    for (size_t i = 0; i < count; i++) {
        if (strcasecmp(units[i].name, name) == 0) {
            return units[i].factor;
        }
    }
    return 0;
}

double v2v_tiff_length_um(const char *unit)
{
    return unit_factor(lengths, sizeof lengths / sizeof *lengths, unit);
}

double v2v_tiff_seconds(const char *unit)
{
    return unit_factor(times, sizeof times / sizeof *times, unit);
}
