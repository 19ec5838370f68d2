#include "twin_projector.h"

/* The tap that light from pixel `from` needs to reach pixel `to`: outside the kernel there is none.
 */
static int64_t tap_of(int64_t to, int64_t from, int64_t kernel)
{
    return to - from + (kernel + 1) / 2 - 1;
}

static int has_tap(int64_t k, int64_t kernel)
{
    return k >= 0 && k < kernel;
}

static double weight_of(const float *psf, const struct twin_shape *s, int64_t z, int64_t ky,
                        int64_t kx)
{
    if (!has_tap(ky, s->kernel_height) || !has_tap(kx, s->kernel_width)) {
        return 0;
    }
    return psf[(z * s->kernel_height + ky) * s->kernel_width + kx];
}

void twin_project(double *view, const double *volume, const float *psf, const struct twin_shape *s)
{
    for (int64_t y = 0; y < s->height; y++) {
        for (int64_t x = 0; x < s->width; x++) {
            double sum = 0;
            for (int64_t z = 0; z < s->slices; z++) {
                for (int64_t y2 = 0; y2 < s->height; y2++) {
                    const int64_t ky = tap_of(y, y2, s->kernel_height);
                    for (int64_t x2 = 0; x2 < s->width; x2++) {
                        sum += volume[(z * s->height + y2) * s->width + x2] *
                               weight_of(psf, s, z, ky, tap_of(x, x2, s->kernel_width));
                    }
                }
            }
            view[y * s->width + x] = sum;
        }
    }
}

void twin_project_adjoint(double *volume, const double *view, const float *psf,
                          const struct twin_shape *s)
{
    for (int64_t z = 0; z < s->slices; z++) {
        for (int64_t y2 = 0; y2 < s->height; y2++) {
            for (int64_t x2 = 0; x2 < s->width; x2++) {
                double sum = 0;
                for (int64_t y = 0; y < s->height; y++) {
                    const int64_t ky = tap_of(y, y2, s->kernel_height);
                    for (int64_t x = 0; x < s->width; x++) {
                        sum += view[y * s->width + x] *
                               weight_of(psf, s, z, ky, tap_of(x, x2, s->kernel_width));
                    }
                }
                volume[(z * s->height + y2) * s->width + x2] += sum;
            }
        }
    }
}

double twin_pixel(const float *volume, const float *psf, const struct twin_shape *s, int64_t y,
                  int64_t x)
{
    double sum = 0;
    for (int64_t z = 0; z < s->slices; z++) {
        for (int64_t y2 = 0; y2 < s->height; y2++) {
            const int64_t ky = tap_of(y, y2, s->kernel_height);
            for (int64_t x2 = 0; x2 < s->width && has_tap(ky, s->kernel_height); x2++) {
                sum += volume[(z * s->height + y2) * s->width + x2] *
                       weight_of(psf, s, z, ky, tap_of(x, x2, s->kernel_width));
            }
        }
    }
    return sum;
}

double twin_voxel(const float *view, const float *psf, const struct twin_shape *s, int64_t z,
                  int64_t y2, int64_t x2)
{
    double sum = 0;
    for (int64_t y = 0; y < s->height; y++) {
        const int64_t ky = tap_of(y, y2, s->kernel_height);
        for (int64_t x = 0; x < s->width && has_tap(ky, s->kernel_height); x++) {
            sum +=
                view[y * s->width + x] * weight_of(psf, s, z, ky, tap_of(x, x2, s->kernel_width));
        }
    }
    return sum;
}
