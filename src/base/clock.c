#include "v2v3d/base/clock.h"

#include <ctype.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

double v2v_clock_now(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

void v2v_clock_iso8601(char *text, size_t bytes)
{
    time_t now = time(NULL);
    struct tm utc;
    if (bytes == 0) {
        return;
    }
    if (gmtime_r(&now, &utc) == NULL || strftime(text, bytes, "%Y-%m-%dT%H:%M:%SZ", &utc) == 0) {
        text[0] = '\0';
    }
}

double v2v_clock_parse_duration(const char *text)
{
    static const struct {
        char letter;
        double seconds;
    } unit[] = {{'h', 3600.0}, {'m', 60.0}, {'s', 1.0}};
    enum { UNITS = sizeof unit / sizeof unit[0], MOST_DIGITS = 9 };
    double total = 0.0;
    size_t next = 0; /* units come from large to small, each at most once */

    if (*text == '\0') {
        return -1.0;
    }
    for (const char *c = text; *c != '\0';) {
        double value = 0.0;
        int digits = 0;
        for (; isdigit((unsigned char)*c); c++) {
            value = 10.0 * value + (*c - '0');
            digits++;
        }
        if (digits == 0 || digits > MOST_DIGITS) {
            return -1.0;
        }
        if (*c == '\0') {
            return next == 0 ? value : -1.0;
        }
        while (next < UNITS && unit[next].letter != *c) {
            next++;
        }
        if (next == UNITS) {
            return -1.0;
        }
        total += value * unit[next].seconds;
        next++;
        c++;
    }
    return total;
}
