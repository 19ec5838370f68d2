#include "v2v3d/base/bounds.h"
#include "v2v3d/fft/fft2.h"
#include "v2v3d/optics/data_step.h"
#include "v2v3d/optics/psf.h"

#include <math.h>

/* Light of the pixels whose row or column is r from the kernel's centre, none farther. */
static double light_of_ring(const float *kernel, int64_t height, int64_t width, int64_t r)
{
    const int64_t cy = v2v_psf_centre(height), cx = v2v_psf_centre(width);
    double light = 0.0;
    for (int64_t y = v2v_larger(cy - r, 0); y <= v2v_smaller(cy + r, height - 1); y++) {
        const int is_whole = r == 0 || y == cy - r || y == cy + r; /* else its two ends */
        for (int64_t x = cx - r; x <= cx + r; x += is_whole ? 1 : 2 * r) {
            light += x >= 0 && x < width ? fabs((double)kernel[y * width + x]) : 0.0;
        }
    }
    return light;
}

/* Pixels from the kernel's centre to the edge of a square that holds all but LOST of its light. */
static int64_t reach_of(const float *kernel, int64_t height, int64_t width)
{
    const int64_t most = v2v_larger(height, width) - 1;
    double total = 0.0, inside = 0.0;
#pragma omp simd reduction(+ : total)
    for (int64_t i = 0; i < height * width; i++) {
        total += fabs((double)kernel[i]);
    }
    for (int64_t r = 0; r <= most; r++) {
        inside += light_of_ring(kernel, height, width, r);
        if (inside >= (1.0 - V2V_DATA_STEP_LOST) * total) {
            return r;
        }
    }
    return most;
}

struct v2v_torus v2v_data_step_torus_of(const struct v2v_psf_file *psf, int64_t height,
                                        int64_t width)
{
    int64_t reach = 0;
#pragma omp parallel for schedule(static) reduction(max : reach)
    for (int64_t i = 0; i < psf->views * psf->slices; i++) {
        const float *kernel = psf->data + i * psf->height * psf->width;
        reach = v2v_larger(reach, reach_of(kernel, psf->height, psf->width));
    }
    struct v2v_torus torus = {v2v_fft_good_size(v2v_larger(height + 2 * reach, psf->height)),
                              v2v_fft_good_size(v2v_larger(width + 2 * reach, psf->width)),
                              {0, 0}};
    torus.rows.count = torus.height;
    return torus;
}
