#include "io/tiff_internal.h"
#include "v2v3d/base/text.h"

#include <math.h>
#include <string.h>

/* The value of the line "key=value"; 0 when there is none or it is longer than any that counts. */
static int find_value(char *value, size_t bytes, const char *description, const char *key)
{
    size_t length = strlen(key);

    for (const char *line = description; line != NULL && *line != '\0';) {
        size_t line_length = strcspn(line, "\r\n");
        if (line_length > length && strncmp(line, key, length) == 0 && line[length] == '=') {
            size_t value_length = line_length - length - 1;
            if (value_length == 0 || value_length >= bytes) {
                return 0;
            }
            memcpy(value, line + length + 1, value_length);
            value[value_length] = '\0';
            return 1;
        }
        line += line_length;
        line += strspn(line, "\r\n");
    }
    return 0;
}

static int64_t find_count(const char *description, const char *key)
{
    char text[64];
    int64_t count = 1;

    /* A count that is no number is as good as none: the pages themselves decide. */
    if (!find_value(text, sizeof text, description, key) ||
        v2v_text_to_i64(&count, text, 1, INT32_MAX, key, V2V_E_INPUT) != V2V_OK) {
        return 1;
    }
    return count;
}

static int find_signed(double *number, const char *description, const char *key)
{
    char text[64];

    return find_value(text, sizeof text, description, key) &&
           v2v_text_to_f64(number, text, -1e12, 1e12, key, V2V_E_INPUT) == V2V_OK;
}

static double find_number(const char *description, const char *key)
{
    double number = 0;

    (void)find_signed(&number, description, key);
    return fabs(number);
}

/* How many micrometres or seconds; 0: a unit that is not known. */
static double find_unit(const char *description, const char *key,
                        double (*factor)(const char *unit), double otherwise)
{
    char unit[256];

    return find_value(unit, sizeof unit, description, key) ? factor(unit) : otherwise;
}

static int is_imagej(const char *description)
{
    return description != NULL && strncmp(description, "ImageJ=", strlen("ImageJ=")) == 0;
}

enum v2v_imagej_values v2v_imagej_values(double *zero, double *scale, const char *description)
{
    char unit[64];
    double function = 0; /* which ImageJ takes for a straight line */

    if (!is_imagej(description) || !find_value(unit, sizeof unit, description, "vunit")) {
        return V2V_IMAGEJ_AS_STORED; /* as ImageJ has it without a unit */
    }
    (void)find_signed(&function, description, "cf");
    if (function != 0) {
        return V2V_IMAGEJ_CURVED;
    }
    return find_signed(zero, description, "c0") && find_signed(scale, description, "c1") &&
                   *scale != 0
               ? V2V_IMAGEJ_STRAIGHT
               : V2V_IMAGEJ_AS_STORED;
}

void v2v_imagej_parse(struct v2v_imagej *imagej, const char *description)
{
    *imagej = (struct v2v_imagej){.channels = 1, .slices = 1, .frames = 1};
    if (!is_imagej(description)) {
        return;
    }
    imagej->images = find_count(description, "images");
    imagej->channels = find_count(description, "channels");
    imagej->slices = find_count(description, "slices");
    imagej->frames = find_count(description, "frames");
    imagej->unit_um = find_unit(description, "unit", v2v_tiff_length_um, 0);
    imagej->unit_y_um = find_unit(description, "yunit", v2v_tiff_length_um, imagej->unit_um);
    imagej->spacing_um = find_number(description, "spacing") *
                         find_unit(description, "zunit", v2v_tiff_length_um, imagej->unit_um);
    imagej->frame_interval_s = find_number(description, "finterval") *
                               find_unit(description, "tunit", v2v_tiff_seconds, 1);
}

enum v2v_status v2v_imagej_format(char *text, size_t bytes, const struct v2v_tiff_info *info)
{
    enum v2v_status rc = V2V_OK;
    char unit[16] = "";
    char spacing[48] = "";
    char interval[48] = "";
    char step[96] = "";

    if (info->pixel_size_um > 0 || info->slice_spacing_um > 0) {
        V2V_TRY(v2v_text_format(unit, sizeof unit, "unit=micron\n"));
    }
    if (info->slice_spacing_um > 0) {
        V2V_TRY(v2v_text_format(spacing, sizeof spacing, "spacing=%.9g\n", info->slice_spacing_um));
    }
    if (info->frame_interval_s > 0) {
        V2V_TRY(
            v2v_text_format(interval, sizeof interval, "finterval=%.9g\n", info->frame_interval_s));
    }
    if (info->step > 0) { /* a straight line from integers to values, which ImageJ then shows */
        V2V_TRY(
            v2v_text_format(step, sizeof step, "cf=0\nc0=0\nc1=%.9g\nvunit=counts\n", info->step));
    }
    /* The version is one that ImageJ itself has written: it picks the reader's rules. */
    V2V_TRY(v2v_text_format(text, bytes,
                            "ImageJ=1.53k\nimages=%lld\nchannels=%lld\nslices=%lld\nframes=%lld\n"
                            "hyperstack=true\nmode=grayscale\n%s%s%s%sloop=false\n",
                            (long long)info->pages, (long long)info->channels,
                            (long long)info->slices, (long long)info->frames, unit, spacing,
                            interval, step));
done:
    return rc;
}
