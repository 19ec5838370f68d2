#include "support.h"

#include "method/sensitivity.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/projector.h"

#include <math.h>
#include <string.h>

/** A set of random taps: nothing symmetric, nothing normalised. */
static struct v2v_psf_file random_psf(int64_t height, int64_t width)
{
    struct v2v_psf_file psf = {2, 3, height, width, 0, 0, NULL};
    int64_t count = 2 * 3 * height * width;
    assert_ok(V2V_ALLOC(psf.data, "test", count));
    for (int64_t i = 0; i < count; i++) {
        psf.data[i] = (float)v2v_random_uniform(3, 0, (uint64_t)i);
    }
    return psf;
}

static void compare(int64_t height, int64_t width, int64_t kernel_height, int64_t kernel_width)
{
    struct v2v_psf_file psf = random_psf(kernel_height, kernel_width);
    struct v2v_projector *projector = NULL;
    struct v2v_sensitivity sensitivity;
    float *ones = NULL, *adjoint = NULL;
    double *row = NULL;
    assert_ok(v2v_projector_create(&projector, &psf, height, width, V2V_SPLIT_SLICES, NULL));
    struct v2v_part slices = v2v_projector_slices(projector);
    assert_ok(v2v_sensitivity_init(&sensitivity, &psf, slices, height, width));
    assert_ok(V2V_ALLOC(ones, "test", height * width));
    assert_ok(V2V_ALLOC(adjoint, "test", slices.count * height * width));
    assert_ok(V2V_ALLOC(row, "test", width));
    for (int64_t i = 0; i < height * width; i++) {
        ones[i] = 1;
    }
    for (int32_t v = 0; v < psf.views; v++) {
        v2v_projector_adjoint(projector, adjoint, ones, &v, 1, 1.0f);
        for (int64_t i = 0; i < slices.count * height; i++) {
            v2v_sensitivity_row(&sensitivity, row, v, i / height, i % height);
            for (int64_t x = 0; x < width; x++) {
                /* Two float32 transforms of at most 2^12 points, 12 levels of eps 6e-8 each, on
                 * sums of at most kernel_height * kernel_width taps below 1. */
                double bound = 24 * 6e-8 * (double)(kernel_height * kernel_width);
                assert_true(fabs(row[x] - (double)adjoint[i * width + x]) < bound);
            }
        }
    }
    v2v_mem_free(row);
    v2v_mem_free(adjoint);
    v2v_mem_free(ones);
    v2v_sensitivity_fini(&sensitivity);
    v2v_projector_destroy(&projector);
    v2v_psf_file_fini(&psf);
}

static void compare_pixels(int64_t height, int64_t width, int64_t kernel_height,
                           int64_t kernel_width)
{
    struct v2v_psf_file psf = random_psf(kernel_height, kernel_width);
    struct v2v_projector *projector = NULL;
    struct v2v_sensitivity sensitivity;
    float *ones = NULL, *projection = NULL;
    double *light = NULL, *table = NULL;
    assert_ok(v2v_projector_create(&projector, &psf, height, width, V2V_SPLIT_SLICES, NULL));
    struct v2v_part slices = v2v_projector_slices(projector);
    assert_ok(v2v_sensitivity_init(&sensitivity, &psf, slices, height, width));
    assert_ok(V2V_ALLOC(ones, "test", slices.count * height * width));
    assert_ok(V2V_ALLOC(projection, "test", psf.views * height * width));
    assert_ok(V2V_ALLOC(light, "test", height * width));
    assert_ok(V2V_ALLOC(table, "test", (kernel_height + 1) * (kernel_width + 1)));
    for (int64_t i = 0; i < slices.count * height * width; i++) {
        ones[i] = 1;
    }
    v2v_projector_forward(projector, projection, ones, NULL, psf.views, 1.0f);
    for (int64_t v = 0; v < psf.views; v++) {
        struct v2v_part lower = v2v_par_part(height, 2, 1); /* a rank's rows */
        const float *rows = projection + (v * height + lower.first) * width;
        v2v_sensitivity_light(&sensitivity, light, &psf, v, lower, table);
        for (int64_t i = 0; i < lower.count * width; i++) { /* as above, of three slices */
            double bound = 24 * 6e-8 * (double)(3 * kernel_height * kernel_width);
            assert_true(fabs(light[i] - (double)rows[i]) < bound);
        }
        v2v_sensitivity_light(&sensitivity, light, &psf, v, (struct v2v_part){0, height}, table);
        for (int64_t i = 0; i < height * width; i++) {
            double bound = 24 * 6e-8 * (double)(3 * kernel_height * kernel_width);
            assert_true(fabs(light[i] - (double)projection[v * height * width + i]) < bound);
        }
    }
    v2v_mem_free(table);
    v2v_mem_free(light);
    v2v_mem_free(projection);
    v2v_mem_free(ones);
    v2v_sensitivity_fini(&sensitivity);
    v2v_projector_destroy(&projector);
    v2v_psf_file_fini(&psf);
}

static void sensitivity_is_the_adjoint_of_ones(void **state)
{
    (void)state;
    compare(20, 24, 7, 7);
    compare(20, 24, 8, 5);
    compare(9, 6, 16, 13); /* kernels larger than the frame */
    compare(1, 30, 5, 4);
}

static void pixels_see_the_projection_of_ones(void **state)
{
    (void)state;
    compare_pixels(20, 24, 7, 7);
    compare_pixels(20, 24, 8, 5);
    compare_pixels(9, 6, 16, 13);
    compare_pixels(1, 30, 5, 4);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(sensitivity_is_the_adjoint_of_ones),
                                       cmocka_unit_test(pixels_see_the_projection_of_ones)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
