#include "eval/fourier.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/pi.h"
#include "v2v3d/fft/fft2.h"

#include <math.h>
#include <string.h>

/* Of a side an eighth fades out at either end, of a short one as many pixels as there are, or all:
 * what fades over fewer pixels leaves a cross in the spectrum, which two halves share. */
enum { FADE = 8, LEAST_FADE = 8 };

enum { MOST_SHIFT = 16 }; /* pixels */

static const double threshold = 1.0 / 7.0; /* of correlation, for two halves of the data */

struct v2v_fourier {
    int64_t height, width; /* of an image */
    int64_t ny, nx;        /* of its transform */
    struct v2v_fft2 *fft;
    double *window_y, *window_x;
    float *image;                       /* [ny,nx] */
    struct v2v_complex *first, *second; /* [ny,nx/2+1] */
};

static void fill_window(double *window, int64_t size)
{
    const int64_t least = v2v_within(LEAST_FADE, 1, v2v_larger(size / 2, 1));
    const int64_t fade = v2v_larger(size / FADE, least);
    for (int64_t i = 0; i < size; i++) {
        const int64_t edge = v2v_smaller(i, size - 1 - i);
        window[i] =
            edge < fade ? 0.5 - 0.5 * cos(V2V_PI * ((double)edge + 0.5) / (double)fade) : 1.0;
    }
}

enum v2v_status v2v_fourier_create(struct v2v_fourier **fourier, int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_fourier *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "eval.fourier", 1));
    *self = (struct v2v_fourier){.height = height,
                                 .width = width,
                                 .ny = v2v_fft_good_size(height),
                                 .nx = v2v_fft_good_size(width)};
    const int64_t numbers = v2v_mem_product(self->ny, self->nx / 2 + 1, 1);
    V2V_TRY(V2V_ALLOC(self->window_y, "eval.fourier", height));
    V2V_TRY(V2V_ALLOC(self->window_x, "eval.fourier", width));
    V2V_TRY(V2V_ALLOC(self->image, "eval.fourier", v2v_mem_product(self->ny, self->nx, 1)));
    V2V_TRY(V2V_ALLOC(self->first, "eval.fourier", numbers));
    V2V_TRY(V2V_ALLOC(self->second, "eval.fourier", numbers));
    V2V_TRY(v2v_fft2_create(&self->fft, self->ny, self->nx));
    fill_window(self->window_y, height);
    fill_window(self->window_x, width);
done:
    if (rc != V2V_OK) {
        v2v_fourier_destroy(&self);
    }
    *fourier = self;
    return rc;
}

void v2v_fourier_destroy(struct v2v_fourier **fourier)
{
    struct v2v_fourier *self = *fourier;
    *fourier = NULL;
    if (self != NULL) {
        v2v_fft2_destroy(&self->fft);
        v2v_mem_free(self->second);
        v2v_mem_free(self->first);
        v2v_mem_free(self->image);
        v2v_mem_free(self->window_x);
        v2v_mem_free(self->window_y);
        v2v_mem_free(self);
    }
}

/* A power of two that brings the largest of the image's differences from `mean` near 1: products
 * of spectra stay within float32 at any brightness. */
static double scale_of(const struct v2v_fourier *self, const float *image, double mean)
{
    double largest = 0.0;
    for (int64_t i = 0; i < self->height * self->width; i++) {
        largest = fmax(largest, fabs((double)image[i] - mean));
    }
    return largest > 0.0 ? exp2(-ilogb(largest)) : 1.0;
}

/* The image without its mean under the window, windowed, times a power of two. @return that; 0
 * where nothing is left */
static double transform(struct v2v_fourier *self, struct v2v_complex *spectrum, const float *image)
{
    double sum = 0.0, weights = 0.0;
    int differs = 0;
    for (int64_t y = 0; y < self->height; y++) {
        for (int64_t x = 0; x < self->width; x++) {
            const double weight = self->window_y[y] * self->window_x[x];
            sum += weight * (double)image[y * self->width + x];
            weights += weight;
            differs |= image[y * self->width + x] != image[0];
        }
    }
    const double mean = sum / weights, scale = scale_of(self, image, mean);
    memset(self->image, 0, (size_t)(self->ny * self->nx) * sizeof *self->image);
    for (int64_t y = 0; y < self->height; y++) {
        for (int64_t x = 0; x < self->width; x++) {
            const double value = scale * ((double)image[y * self->width + x] - mean);
            self->image[y * self->nx + x] = (float)(value * self->window_y[y] * self->window_x[x]);
        }
    }
    v2v_fft2_forward(self->fft, spectrum, self->image);
    return differs ? scale : 0.0;
}

static float correlation_at(const struct v2v_fourier *self, int64_t y, int64_t x)
{
    return self->image[(y + self->ny) % self->ny * self->nx + (x + self->nx) % self->nx];
}

/* Where a parabola through three values has its top, from the middle one; 0 where that is not the
 * greatest, on the edge of what is searched. */
static double top_of(double before, double here, double behind)
{
    const double bend = before - 2.0 * here + behind;
    const int is_top = here >= before && here >= behind && bend < 0.0;
    return is_top ? 0.5 * (before - behind) / bend : 0.0;
}

void v2v_fourier_shift(struct v2v_fourier *self, double shift[2], const float *image,
                       const float *reference)
{
    const int64_t most_y = v2v_smaller(MOST_SHIFT, self->height / 4);
    const int64_t most_x = v2v_smaller(MOST_SHIFT, self->width / 4);
    int64_t top_y = 0, top_x = 0;
    shift[0] = shift[1] = NAN;
    if (transform(self, self->first, image) == 0.0 ||
        transform(self, self->second, reference) == 0.0) {
        return;
    }
    for (int64_t i = 0; i < self->ny * (self->nx / 2 + 1); i++) {
        const struct v2v_complex a = self->first[i], b = self->second[i];
        self->first[i] = (struct v2v_complex){a.re * b.re + a.im * b.im, a.im * b.re - a.re * b.im};
    }
    v2v_fft2_inverse(self->fft, self->image, self->first);
    for (int64_t y = -most_y; y <= most_y; y++) {
        for (int64_t x = -most_x; x <= most_x; x++) {
            if (correlation_at(self, y, x) > correlation_at(self, top_y, top_x)) {
                top_y = y;
                top_x = x;
            }
        }
    }
    const double here = (double)correlation_at(self, top_y, top_x);
    shift[0] = (double)top_y + top_of((double)correlation_at(self, top_y - 1, top_x), here,
                                      (double)correlation_at(self, top_y + 1, top_x));
    shift[1] = (double)top_x + top_of((double)correlation_at(self, top_y, top_x - 1), here,
                                      (double)correlation_at(self, top_y, top_x + 1));
}

int64_t v2v_fourier_rings(const struct v2v_fourier *self)
{
    return (v2v_smaller(self->height, self->width) + 1) / 2;
}

void v2v_fourier_correlate(struct v2v_fourier *self, struct v2v_ring *rings, const float *a,
                           const float *b)
{
    const int64_t count = v2v_fourier_rings(self), half = self->nx / 2;
    const double scale_a = transform(self, self->first, a);
    const double scale_b = transform(self, self->second, b);
    const double of_a = scale_a > 0.0 ? 1.0 / scale_a : 0.0;
    const double of_b = scale_b > 0.0 ? 1.0 / scale_b : 0.0;
    for (int64_t y = 0; y < self->ny; y++) {
        const double fy = (double)v2v_smaller(y, self->ny - y) / (double)self->ny;
        for (int64_t x = 0; x <= half; x++) {
            const double fx = (double)x / (double)self->nx;
            /* m / n times n may round below m */
            const int64_t r = (int64_t)(2.0 * (double)count * sqrt(fy * fy + fx * fx) + 1e-9);
            if (r < count) {
                const double twice = x == 0 || x == half ? 1.0 : 2.0; /* and its mirror image */
                const struct v2v_complex p = self->first[y * (half + 1) + x];
                const struct v2v_complex q = self->second[y * (half + 1) + x];
                const double pr = of_a * (double)p.re, pi = of_a * (double)p.im;
                const double qr = of_b * (double)q.re, qi = of_b * (double)q.im;
                rings[r].product += twice * (pr * qr + pi * qi);
                rings[r].first += twice * (pr * pr + pi * pi);
                rings[r].second += twice * (qr * qr + qi * qi);
            }
        }
    }
}

static double correlation_of(const struct v2v_ring *ring)
{
    const double scale = sqrt(ring->first) * sqrt(ring->second);
    return scale > 0.0 ? ring->product / scale : 0.0;
}

double v2v_fourier_resolution(const struct v2v_ring *rings, int64_t count)
{
    /* the first ring is the mean's, which was taken off */
    for (int64_t r = 1; r < count; r++) {
        const double here = correlation_of(&rings[r]);
        if (here < threshold) {
            const double before = correlation_of(&rings[r - 1]);
            const double place = (double)r - 0.5 + (before - threshold) / (before - here);
            return r > 1 ? 2.0 * (double)count / place : NAN;
        }
    }
    return count > 1 ? 2.0 : NAN;
}
