#include "method/photons.h"

#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

/* Samples that are brighter than `bright`. */
static const double brighter_part = 1e-3;

/* The variance is four times as large in the light as in the dark: below, weights by it gained
 * nothing. It grows by five times what its growth is known to. The noise is white: else it isn't
 * noise. And so many samples are brighter than the percentile: else it may be a hot pixel. */
static const double least_contrast = 3.0, least_certain = 5.0, most_colour = 2.0,
                    least_brighter = 4.0;

struct v2v_photons v2v_photons_find(float *scratch, const float *views, int64_t count,
                                    int64_t height, int64_t width)
{
    const int64_t samples = count * height * width;
    const double brighter = (double)samples * brighter_part;
    struct v2v_photons found = {0};
    memcpy(scratch, views, (size_t)samples * sizeof *views);
    found.bright = (double)v2v_select(scratch, samples, samples - 1 - (int64_t)brighter);
    if (found.bright > 0.0) {
        const struct v2v_noise_line line =
            v2v_noise_line_of_images(views, count, height, width, found.bright);
        found.gain = line.gain;
        found.variance = fmax(line.variance, 0.0);
        found.is_clear = line.gain * found.bright > least_contrast * found.variance &&
                         line.gain > least_certain * line.gain_error && line.colour < most_colour &&
                         brighter >= least_brighter;
    }
    return found;
}
