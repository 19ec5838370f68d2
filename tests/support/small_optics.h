/** A small microscope for the tests of method and recon: V views that see depth under
 *  different angles, Gaussian spots that widen out of focus, kernels of even height. */
#ifndef TEST_SMALL_OPTICS_H
#define TEST_SMALL_OPTICS_H

#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/optics/psf.h"

#include <math.h>

enum { VIEWS = 4, SLICES = 6, KERNEL_HEIGHT = 10, KERNEL_WIDTH = 11 };

static struct v2v_psf_file small_psf(void)
{
    struct v2v_psf_file psf = {VIEWS, SLICES, KERNEL_HEIGHT, KERNEL_WIDTH, 0, 0, NULL};
    assert_ok(V2V_ALLOC(psf.data, "test", VIEWS * SLICES * KERNEL_HEIGHT * KERNEL_WIDTH));
    float *p = psf.data;
    for (int v = 0; v < VIEWS; v++) {
        for (int z = 0; z < SLICES; z++) {
            double depth = z - (SLICES - 1) / 2.0, angle = 2 * acos(-1) * v / VIEWS;
            double width = 0.8 + 0.15 * fabs(depth);
            for (int y = 0; y < KERNEL_HEIGHT; y++) {
                for (int x = 0; x < KERNEL_WIDTH; x++) {
                    double dy = y - 4 - depth * sin(angle), dx = x - 5 - depth * cos(angle);
                    *p++ = (float)exp(-(dy * dy + dx * dx) / (2 * width * width));
                }
            }
        }
    }
    v2v_psf_normalize_views(&psf);
    return psf;
}

/* A pixel of light a slice, where small_psf is brightest. */
static inline struct v2v_psf_file point_psf(void)
{
    struct v2v_psf_file psf = small_psf();
    const int64_t pixels = psf.height * psf.width;
    for (int64_t k = 0; k < VIEWS * SLICES; k++) {
        float *kernel = psf.data + k * pixels;
        int64_t brightest = 0;
        for (int64_t i = 0; i < pixels; i++) {
            brightest = kernel[i] > kernel[brightest] ? i : brightest;
        }
        for (int64_t i = 0; i < pixels; i++) {
            kernel[i] = i == brightest ? 1.0f / SLICES : 0.0f;
        }
    }
    return psf;
}

/* views [VIEWS,y,x] of a volume [SLICES,y,x], by one rank. */
static inline void small_views(float *views, const float *volume, const struct v2v_psf_file *psf,
                               int64_t height, int64_t width)
{
    struct v2v_projector *projector = NULL;
    assert_ok(v2v_projector_create(&projector, psf, height, width, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, views, volume, NULL, VIEWS, 1.0f);
    v2v_projector_destroy(&projector);
}

/* The views are those of the volume but for the rounding of float32 transforms: of their largest, a
 * few additions' for each of the slices. */
static inline void assert_small_views(const float *views, const float *volume,
                                      const struct v2v_psf_file *psf, int64_t height, int64_t width)
{
    const int64_t samples = VIEWS * height * width;
    float *projected = NULL, largest = 0.0f;
    assert_ok(V2V_ALLOC(projected, "test", samples));
    small_views(projected, volume, psf, height, width);
    for (int64_t i = 0; i < samples; i++) {
        largest = projected[i] > largest ? projected[i] : largest;
    }
    assert_true(largest > 0.0f);
    for (int64_t i = 0; i < samples; i++) {
        assert_true(fabsf(views[i] - projected[i]) <= 1e-6f * SLICES * largest);
    }
    v2v_mem_free(projected);
}

#endif
