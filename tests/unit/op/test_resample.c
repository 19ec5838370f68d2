#include "support.h"
#include "twin_conv.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/op/activation.h"
#include "v2v3d/op/resample.h"
#include <math.h>
#include <string.h>

static float *draw(int64_t count, uint64_t stream)
{
    float *array = v2v_mem_alloc("test", count, sizeof *array);
    assert_non_null(array);
    for (int64_t i = 0; i < count; i++) {
        array[i] = (float)(2.0 * v2v_random_uniform(5, stream, (uint64_t)i) - 1.0);
    }
    return array;
}

static void leaky_scales_what_is_not_positive(void **unused)
{
    (void)unused;
    const float in[] = {-2.0f, -0.0f, 0.0f, 3.0f, -INFINITY, INFINITY};
    const float expected[] = {-0.5f, -0.0f, 0.0f, 3.0f, -INFINITY, INFINITY};
    float out[6];
    v2v_leaky_forward(out, in, 6, 0.25f);
    assert_memory_equal(out, expected, sizeof out);
    float nan = NAN;
    v2v_leaky_forward(&nan, &nan, 1, 0.25f);
    assert_true(isnan(nan));
}

static void leaky_gradient_takes_input_or_output_in_place(void **unused)
{
    (void)unused;
    enum { COUNT = 200003 }; /* several blocks and a tail */
    float *x = draw(COUNT, 1), *y = draw(COUNT, 1), *gradient = draw(COUNT, 2);
    float *by_input = draw(COUNT, 3);
    v2v_leaky_forward(y, y, COUNT, 0.01f);
    v2v_leaky_backward(by_input, gradient, x, COUNT, 0.01f);
    v2v_leaky_backward(gradient, gradient, y, COUNT, 0.01f);
    assert_memory_equal(gradient, by_input, COUNT * sizeof(float));
    float *original = draw(COUNT, 2);
    for (int64_t i = 0; i < COUNT; i++) {
        float expected = x[i] > 0.0f ? original[i] : 0.01f * original[i];
        assert_true(gradient[i] == expected);
    }
    float *owned[] = {x, y, gradient, by_input, original};
    for (size_t i = 0; i < 5; i++) {
        v2v_mem_free(owned[i]);
    }
}

static void max_pooling_keeps_value_and_place_of_the_first_maximum(void **unused)
{
    (void)unused;
    /* 5 x 7: the odd row and column belong to no window. */
    const float in[] = {1, 2, 5, 5, 0, 0, 9, /**/ 4, 3, 5, 5, 0, 7, 9, /**/
                        0, 0, 1, 2, 8, 8, 9, /**/ 0, 0, 3, 4, 9, 8, 9, /**/
                        9, 9, 9, 9, 9, 9, 9};
    const float expected[] = {4, 5, 7, 0, 4, 9};
    const uint8_t places[] = {2, 0, 3, 0, 3, 2};
    float out[6];
    uint8_t which[6];
    v2v_maxpool2_forward(out, which, in, 1, 5, 7);
    assert_memory_equal(out, expected, sizeof out);
    assert_memory_equal(which, places, sizeof which);
    float without[6];
    v2v_maxpool2_forward(without, NULL, in, 1, 5, 7);
    assert_memory_equal(without, expected, sizeof without);

    float din[35];
    v2v_maxpool2_backward(din, expected, which, 1, 5, 7);
    float zeros = 0.0f;
    for (int i = 0; i < 35; i++) {
        zeros += din[i] == 0.0f;
    }
    assert_true(din[7] == 4 && din[2] == 5 && din[12] == 7 && din[24] == 4 && din[25] == 9);
    assert_true(zeros == 30.0f);
}

static void max_pooling_shows_a_nan_wherever_it_stands(void **unused)
{
    (void)unused;
    for (int at = 0; at < 4; at++) {
        float in[] = {1, 2, 3, 4};
        float out = 0;
        uint8_t which = 9;
        in[at] = NAN;
        v2v_maxpool2_forward(&out, &which, in, 1, 2, 2);
        assert_true(isnan(out));
        assert_int_equal(which, at);
    }
}

/** factor^2 terms of modulus 1 at most, and the division: (factor^2 + 1) * 2^-24. */
static void average_pooling_is_the_mean(void **unused)
{
    (void)unused;
    static const int64_t sizes[][2] = {{8, 8}, {16, 40}, {17, 9}, {37, 21}};
    for (size_t s = 0; s < 4; s++) {
        for (int factor = 2; factor <= 8; factor *= 2) {
            int64_t h = sizes[s][0], w = sizes[s][1], rows = h / factor, columns = w / factor;
            float *in = draw(2 * h * w, 1), *out = draw(2 * rows * columns, 2);
            v2v_avgpool_forward(out, in, 2, h, w, factor);
            for (int64_t i = 0; i < 2 * rows * columns; i++) {
                int64_t c = i / (rows * columns), y = i / columns % rows, x = i % columns;
                double sum = 0.0;
                for (int64_t k = 0; k < factor * factor; k++) {
                    sum +=
                        (double)in[(c * h + y * factor + k / factor) * w + x * factor + k % factor];
                }
                double bound = (factor * factor + 1) * ldexp(1.0, -24);
                assert_true(fabs((double)out[i] - sum / (factor * factor)) <= bound);
            }
            v2v_mem_free(in);
            v2v_mem_free(out);
        }
    }
}

static void nearest_upsampling_repeats_each_pixel(void **unused)
{
    (void)unused;
    const float in[] = {1, 2, 3, 4, 5, 6};
    const float expected[] = {1, 1, 2, 2, 3, 3, 1, 1, 2, 2, 3, 3,
                              4, 4, 5, 5, 6, 6, 4, 4, 5, 5, 6, 6};
    float out[24];
    v2v_nearest2_forward(out, in, 1, 2, 3);
    assert_memory_equal(out, expected, sizeof out);
}

/** Pixels of modulus 1: two blends, each with a weight rounded once, a difference of modulus 2 and
 *  a multiply-add: 2 * (2 * 2 + 2) * 2^-24 = 12 * 2^-24. Widths around the run of 512 columns. */
static void bilinear_upsampling_matches_the_hat_functions(void **unused)
{
    (void)unused;
    static const struct {
        int64_t height, width;
        int factor;
    } cases[] = {{4, 5, 2}, {3, 7, 4}, {2, 2, 8},  {1, 6, 2},   {6, 1, 4},
                 {1, 1, 8}, {5, 4, 1}, {2, 65, 8}, {2, 256, 2}, {3, 257, 2}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int64_t h = cases[i].height, w = cases[i].width;
        int64_t count = h * w * cases[i].factor * cases[i].factor;
        float *in = draw(3 * h * w, i), *out = draw(3 * count, 9);
        double *twin = v2v_mem_alloc("test", count, sizeof *twin);
        v2v_bilinear_forward(out, in, 3, h, w, cases[i].factor);
        for (int64_t c = 0; c < 3; c++) {
            twin_bilinear(twin, in + c * h * w, h, w, cases[i].factor);
            for (int64_t j = 0; j < count; j++) {
                assert_true(fabs((double)out[c * count + j] - twin[j]) <= 12 * ldexp(1.0, -24));
            }
        }
        v2v_mem_free(in);
        v2v_mem_free(out);
        v2v_mem_free(twin);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(leaky_scales_what_is_not_positive),
        cmocka_unit_test(leaky_gradient_takes_input_or_output_in_place),
        cmocka_unit_test(max_pooling_keeps_value_and_place_of_the_first_maximum),
        cmocka_unit_test(max_pooling_shows_a_nan_wherever_it_stands),
        cmocka_unit_test(average_pooling_is_the_mean),
        cmocka_unit_test(nearest_upsampling_repeats_each_pixel),
        cmocka_unit_test(bilinear_upsampling_matches_the_hat_functions),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
