#include "v2v3d/optics/psf_figures.h"

#include "optics/moments.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/optics/psf.h"
#include <math.h>

static double largest_of(const float *x, int64_t count)
{
    double largest = 0.0;
    for (int64_t i = 0; i < count; i++) {
        largest = fmax(largest, x[i]);
    }
    return largest;
}

/* Pixels that hold 99.9 % of the energy: those above the highest of 4096 logarithmic levels (24
 * octaves, float32's resolution) that leaves at most 0.1 % below it. */
static int64_t support_of(const float *slice, int64_t count, double energy)
{
    enum { LEVELS = 4096, OCTAVES = 24 };
    double held[LEVELS] = {0};
    int64_t pixels[LEVELS] = {0};
    double top = largest_of(slice, count);
    for (int64_t i = 0; i < count; i++) {
        if (slice[i] > 0.0f) {
            double down = log2(top / slice[i]) * (LEVELS / OCTAVES);
            int level = down < LEVELS - 1 ? (int)down : LEVELS - 1;
            held[level] += slice[i];
            pixels[level]++;
        }
    }
    double sum = 0.0;
    int64_t support = 0;
    for (int level = 0; level < LEVELS && sum < 0.999 * energy; level++) {
        sum += held[level];
        support += pixels[level];
    }
    return support;
}

struct v2v_slice_figures v2v_slice_figures_of(const float *slice, int64_t height, int64_t width)
{
    struct v2v_slice_figures figures = {0};
    double moment[3];
    v2v_slice_moments(moment, slice, height, width);
    figures.energy = moment[0];
    for (int64_t y = 0; y < height; y++) {
        for (int64_t x = 0; x < width; x++) {
            const int on_border = y == 0 || x == 0 || y == height - 1 || x == width - 1;
            figures.border += on_border ? (double)slice[y * width + x] : 0.0;
        }
    }
    if (figures.energy > 0.0) {
        figures.y = moment[1] / moment[0] - (double)v2v_psf_centre(height);
        figures.x = moment[2] / moment[0] - (double)v2v_psf_centre(width);
        figures.support = support_of(slice, height * width, figures.energy);
    }
    return figures;
}

static double darkest_on_border(const float *slice, int64_t height, int64_t width)
{
    double darkest = INFINITY;
    for (int64_t y = 0; y < height; y++) {
        const int64_t step = y == 0 || y == height - 1 ? 1 : v2v_larger(width - 1, 1);
        for (int64_t x = 0; x < width; x += step) {
            darkest = fmin(darkest, (double)slice[y * width + x]);
        }
    }
    return darkest;
}

double v2v_psf_pedestal(const struct v2v_psf_file *psf)
{
    const double least = 0.05;
    const int64_t narrow = 16; /* pixels of a window that light may fill */
    const int64_t pixels = psf->height * psf->width;
    const int64_t slices = psf->views * psf->slices;
    double light = 0.0, background = 0.0;
    if (psf->height < narrow || psf->width < narrow) {
        return 0.0;
    }
    for (int64_t i = 0; i < slices; i++) {
        const double darkest = darkest_on_border(psf->data + i * pixels, psf->height, psf->width);
        background += fmax(darkest, 0.0) * (double)pixels;
    }
    for (int64_t i = 0; i < slices && background > 0.0; i++) { /* of most sets it is 0 */
        double moment[3];
        v2v_slice_moments(moment, psf->data + i * pixels, psf->height, psf->width);
        light += moment[0];
    }
    return background > least * light ? background / light : 0.0;
}

double v2v_psf_correlation(const float *a, const float *b, int64_t count)
{
    double ab = 0, aa = 0, bb = 0;
    for (int64_t i = 0; i < count; i++) {
        ab += (double)a[i] * b[i];
        aa += (double)a[i] * a[i];
        bb += (double)b[i] * b[i];
    }
    return aa > 0 && bb > 0 ? ab / sqrt(aa * bb) : 0;
}
