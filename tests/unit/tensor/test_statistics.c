#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/tensor/statistics.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static float *normal_numbers(int64_t count, uint64_t stream)
{
    float *x = NULL;
    assert_ok(V2V_ALLOC(x, "test", count));
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)v2v_random_normal(1, stream, (uint64_t)i);
    }
    return x;
}

static void background_of_small_cases_is_the_edge_of_the_fullest_bin(void **state)
{
    (void)state;
    /* Mean 4: bins of width 1 from 0 to 4; 1 and 1.5 fill the second, all else is alone or above.
     */
    static const float peak[] = {0.0f, 1.0f, 1.5f, 2.5f, 3.5f, 15.5f};
    assert_true(v2v_background(peak, 6, 4, 0) == 1.0);
    assert_true(v2v_background(peak, 6, 4, 1) == 2.0);
    /* Two bins of equal height: the first counts. Mean 2, bins [0,1) and [1,2]. */
    static const float equal[] = {0.0f, 2.0f, 4.0f};
    assert_true(v2v_background(equal, 3, 2, 0) == 0.0);
    /* What equals the mean lies in the last bin: mean 4, bins of width 2 from 0. */
    static const float last[] = {0.0f, 4.0f, 4.0f, 4.0f, 8.0f};
    assert_true(v2v_background(last, 5, 2, 0) == 2.0);
    assert_true(v2v_background(last, 5, 2, 1) == 4.0);
    static const float constant[] = {7.0f, 7.0f, 7.0f};
    assert_true(v2v_background(constant, 3, 256, 0) == 7.0);
    assert_true(v2v_background(constant, 3, 100, 1) == 7.0);
    assert_true(v2v_background(constant, 0, 100, 1) == 0.0);
    static const float broken[] = {1.0f, NAN, 2.0f};
    assert_true(isnan(v2v_background(broken, 3, 100, 1)));
}

/** Background of a golden volume [39,64,64] with 10 pixels cut from each side in y and x. */
static double cut_background(const char *path, const char *name)
{
    enum { SIDE = 64, EDGE = 10, SLICES = 39 };
    int64_t count = 0, kept = 0;
    double *volume = test_h5_read(path, name, &count);
    float *cut = NULL;
    assert_int_equal(count, SLICES * SIDE * SIDE);
    assert_ok(V2V_ALLOC(cut, "test", count));
    for (int64_t z = 0; z < SLICES; z++) {
        for (int64_t y = EDGE; y < SIDE - EDGE; y++) {
            for (int64_t x = EDGE; x < SIDE - EDGE; x++) {
                cut[kept++] = (float)volume[(z * SIDE + y) * SIDE + x];
            }
        }
    }
    double background = v2v_background(cut, kept, 100, 1);
    v2v_mem_free(cut);
    test_release(volume);
    return background;
}

static void background_matches_the_golden_volumes(void **state)
{
    (void)state;
    const char *path = test_shared("golden/metrics.h5");
    if (path == NULL) {
        skip();
    }
    /* An edge is the minimum (exact) plus a share of (mean - minimum). The mean of n = 75504 floats
     * is summed in double here and perhaps pairwise in single precision there: log2(n) = 17
     * roundings of 2^-24 of a mean of the edge's order, 1e-6 of it. A bin is 1e-2 of the range:
     * another bin would be off by far more. */
    const double bound = 17.0 * 0x1p-24;
    double truth = test_h5_attribute(path, "/", "background_gt");
    double found = cut_background(path, "ground_truth");
    assert_true(fabs(found - truth) <= bound * fmax(fabs(truth), 0.1));
    truth = test_h5_attribute(path, "/", "background_reconstruction");
    found = cut_background(path, "reconstruction");
    assert_true(fabs(found - truth) <= bound * fmax(fabs(truth), 0.1));
}

static int ascending(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/** The twin: sort everything. */
static double sorted_percentile(const float *sorted, int64_t count, double p)
{
    double place = p / 100.0 * (double)(count - 1);
    int64_t below = (int64_t)floor(place);
    int64_t above = below + 1 < count ? below + 1 : below;
    double share = place - (double)below;
    return (double)sorted[below] * (1.0 - share) + (double)sorted[above] * share;
}

static void percentile_equals_that_of_the_sorted_numbers(void **state)
{
    (void)state;
    static const double place[] = {0.0, 0.1, 25.0, 33.3, 50.0, 75.0, 99.5, 99.99, 100.0};
    static const int64_t sizes[] = {1, 2, 3, 10, 1000, 4097};
    for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++) {
        for (int many_equal = 0; many_equal < 2; many_equal++) {
            int64_t count = sizes[s];
            float *x = normal_numbers(count, 10 + s);
            float *sorted = normal_numbers(count, 10 + s);
            for (int64_t i = 0; many_equal && i < count; i++) {
                x[i] = sorted[i] = roundf(x[i]);
            }
            qsort(sorted, (size_t)count, sizeof *sorted, ascending);
            for (size_t p = 0; p < sizeof place / sizeof place[0]; p++) {
                double value = NAN, twin = sorted_percentile(sorted, count, place[p]);
                assert_ok(v2v_percentile(&value, x, count, place[p]));
                /* Three double operations on numbers below 5, twice. */
                assert_true(fabs(value - twin) <= 6.0 * DBL_EPSILON * 5.0);
            }
            v2v_mem_free(x);
            v2v_mem_free(sorted);
        }
    }
}

static void percentile_is_exact_at_numbers_and_leaves_them_alone(void **state)
{
    (void)state;
    static const float x[] = {3.0f, 1.0f, 2.0f, 5.0f, 4.0f};
    float copy[5];
    double value = 0.0;
    memcpy(copy, x, sizeof copy);
    assert_ok(v2v_percentile(&value, copy, 5, 75.0));
    assert_true(value == 4.0);
    assert_ok(v2v_percentile(&value, copy, 5, 37.5));
    assert_true(value == 2.5);
    assert_memory_equal(copy, x, sizeof copy);
    copy[3] = NAN;
    assert_ok(v2v_percentile(&value, copy, 5, 50.0));
    assert_true(isnan(value));
    copy[3] = INFINITY;
    assert_ok(v2v_percentile(&value, copy, 5, 50.0));
    assert_true(value == 3.0);
    v2v_mem_set_limit(1);
    assert_int_equal(v2v_percentile(&value, copy, 5, 50.0), V2V_E_MEMORY);
    v2v_mem_set_limit(0);
}

static void sum_of_squares_matches_a_plain_loop_for_every_length(void **state)
{
    (void)state;
    enum { MOST = 2100000 }; /* enough that threads share the work */
    float *x = normal_numbers(MOST, 30);
    static const int64_t lengths[] = {0, 1, 7, 8, 9, 255, 256, 257, 4099, 2099999, MOST};
    for (size_t l = 0; l < sizeof lengths / sizeof lengths[0]; l++) {
        double plain = 0.0;
        for (int64_t i = 0; i < lengths[l]; i++) {
            plain += (double)x[i] * (double)x[i];
        }
        double sum = v2v_sum_of_squares(x, lengths[l]);
        /* Products are exact; each of at most n additions of positive terms rounds by eps/2 of the
         * sum, in both. */
        assert_true(fabs(sum - plain) <= (double)lengths[l] * DBL_EPSILON * plain);
        assert_true(v2v_sum_of_squares(x, lengths[l]) == sum);
    }
    x[12345] = NAN;
    assert_true(isnan(v2v_sum_of_squares(x, MOST)));
    v2v_mem_free(x);
    static const float large[] = {3e38f, 3e38f};
    assert_true(v2v_sum_of_squares(large, 2) == 2.0 * ((double)3e38f * (double)3e38f));
}

static void first_special_number_is_found_wherever_it_is(void **state)
{
    (void)state;
    enum { COUNT = 10000 };
    static const int64_t place[] = {0, 1, 4095, 4096, 8191, 9999};
    static const float special[] = {NAN, -NAN, INFINITY, -INFINITY};
    float *x = normal_numbers(COUNT, 40);
    x[17] = FLT_MAX;
    x[18] = FLT_TRUE_MIN;
    assert_int_equal(v2v_first_not_finite(x, COUNT), -1);
    assert_int_equal(v2v_first_not_finite(x, 0), -1);
    for (size_t p = 0; p < sizeof place / sizeof place[0]; p++) {
        for (size_t s = 0; s < sizeof special / sizeof special[0]; s++) {
            float before = x[place[p]], last = x[COUNT - 1];
            x[COUNT - 1] = NAN;
            x[place[p]] = special[s];
            assert_int_equal(v2v_first_not_finite(x, COUNT), place[p]);
            x[COUNT - 1] = last;
            x[place[p]] = before;
        }
    }
    v2v_mem_free(x);
}

static void one_value_is_told_from_two(void **state)
{
    (void)state;
    float x[] = {-0.0f, 0.0f, 0.0f};
    assert_true(v2v_is_of_one_value(x, 3));
    x[2] = FLT_TRUE_MIN;
    assert_true(v2v_is_of_one_value(x, 2));
    assert_false(v2v_is_of_one_value(x, 3));
    x[0] = NAN;
    assert_false(v2v_is_of_one_value(x, 2));
}

/* With and without a sample, which is taken of more than 600 values. */
static void selection_parts_an_array_at_its_kth_value(void **state)
{
    (void)state;
    enum { MOST = 60001, TURNS = 11 };
    const int64_t counts[] = {1, 2, 501, 5003, MOST};
    float *x = NULL;
    assert_ok(V2V_ALLOC(x, "test", MOST));
    for (size_t c = 0; c < sizeof counts / sizeof counts[0]; c++) {
        const int64_t count = counts[c];
        for (int64_t turn = 0; turn < TURNS; turn++) {
            const int64_t k = (count - 1) * turn / (TURNS - 1);
            for (int64_t i = 0; i < count; i++) {
                x[i] = (float)(i * 173 % count / 3); /* each value three times, in disorder */
            }
            assert_true(v2v_select(x, count, k) == (float)(k / 3) && x[k] == (float)(k / 3));
            for (int64_t i = 0; i < count; i++) {
                assert_true(i < k ? x[i] <= x[k] : x[i] >= x[k]);
            }
        }
    }
    v2v_mem_free(x);
}

/* As differences of values near the end of float32 are. */
static void selection_ends_among_nans(void **state)
{
    (void)state;
    enum { MOST = 2000 };
    float x[MOST];
    for (int64_t count = 1; count <= MOST; count = 2 * count + 1) {
        for (int64_t every = 1; every <= 4; every++) {
            int64_t left = 0;
            for (int64_t i = 0; i < count; i++) {
                x[i] = i % every == 0 ? NAN : (float)(i * 173 % count);
            }
            (void)v2v_select(x, count, count / 2);
            for (int64_t i = 0; i < count; i++) {
                left += isnan(x[i]);
            }
            assert_int_equal(left, (count + every - 1) / every);
        }
    }
}

/* Of noise that is the same everywhere, the slopes that are found lie about 0 by their standard
 * error: the mean of n squares is known to sqrt(2 / n), of which this allows five. */
static void slopes_of_even_noise_scatter_by_their_standard_error(void **state)
{
    (void)state;
    enum { TRIALS = 100, SIDE = 64, SAMPLES = SIDE * SIDE };
    double squares = 0.0;
    for (uint64_t trial = 0; trial < TRIALS; trial++) {
        float *image = normal_numbers(SAMPLES, 100 + trial);
        for (int i = 0; i < SAMPLES; i++) {
            image[i] += 0.5f * (float)(i % SIDE); /* levels, which second differences leave alone */
        }
        const struct v2v_noise_line line = v2v_noise_line_of_images(image, 1, SIDE, SIDE, SIDE);
        assert_true(line.gain_error > 0.0);
        squares += line.gain * line.gain / (line.gain_error * line.gain_error);
        v2v_mem_free(image);
    }
    assert_true(fabs(squares / TRIALS - 1.0) <= 5.0 * sqrt(2.0 / TRIALS));
}

/* Photons of squares of light, one in sixteen, on the dark, and readout everywhere: by its own
 * level the dark would be many levels of one variance, and the gain a fifth of what it is. */
static void noise_in_the_dark_hides_no_photons(void **state)
{
    (void)state;
    enum { WIDTH = 256, SQUARE = 16, PIXELS = WIDTH * WIDTH };
    const double gain = 0.02, read = 0.02;
    float *image = normal_numbers(PIXELS, 77);
    for (int i = 0; i < PIXELS; i++) {
        const int y = i / WIDTH / SQUARE, x = i % WIDTH / SQUARE;
        const double light = y % 4 == 1 && x % 4 == 1 ? 0.25 * (1 + (y + x) / 4 % 4) : 0.0;
        image[i] = (float)(gain * (double)v2v_random_poisson(78, 0, (uint64_t)i, light / gain) +
                           read * (double)image[i]);
    }
    const struct v2v_noise_line line = v2v_noise_line_of_images(image, 1, WIDTH, WIDTH, 1.0);
    assert_true(fabs(line.gain - gain) < 5.0 * line.gain_error && line.gain_error < 0.1 * gain);
    v2v_mem_free(image);
}

static void figures_of_parts_are_those_of_the_whole(void **state)
{
    (void)state;
    static const float x[] = {4.0f, -1.0f, 2.0f, 2.0f, 3.0f};
    struct v2v_figures figures = {0};
    assert_true(v2v_figures_mean(&figures) == 0.0 && v2v_figures_deviation(&figures) == 0.0);
    v2v_figures_add(&figures, x, 0);
    v2v_figures_add(&figures, x, 1);
    v2v_figures_add(&figures, x + 1, 4);
    assert_true(figures.least == -1.0 && figures.most == 4.0 && figures.count == 5);
    assert_true(v2v_figures_mean(&figures) == 2.0);
    assert_float_equal(v2v_figures_deviation(&figures), sqrt(14.0 / 5.0), 1e-15);
    figures = (struct v2v_figures){0};
    v2v_figures_add(&figures, x + 2, 2);
    assert_true(figures.least == 2.0 && figures.most == 2.0);
    assert_true(v2v_figures_deviation(&figures) == 0.0);
}

/* Noise of 10 about `dark`, and in a quarter of each image light of 1000. */
static struct v2v_dark dark_of(double dark, int64_t height, int64_t width)
{
    enum { IMAGES = 3, MOST = 64 * 80 };
    static float images[IMAGES * MOST], scratch[IMAGES * MOST];
    for (int64_t i = 0; i < IMAGES * height * width; i++) {
        const int is_lit = i / width % height < height / 2 && i % width < width / 2;
        images[i] =
            (float)(dark + (is_lit ? 1000.0 : 0.0) + 10.0 * v2v_random_normal(5, 0, (uint64_t)i));
    }
    return v2v_dark_of_images(scratch, images, IMAGES, height, width);
}

static double pedestal_of(double dark, int64_t height, int64_t width)
{
    return dark_of(dark, height, width).above;
}

static double deficit_of(double dark, int64_t height, int64_t width)
{
    return dark_of(dark, height, width).below;
}

static void a_pedestal_is_what_is_nowhere_dark(void **state)
{
    (void)state;
    const double error = 4.0 * 10.0 / 16.0; /* the least of some fifty means */
    assert_true(fabs(pedestal_of(100.0, 64, 80) - 100.0) < error);
    assert_true(fabs(pedestal_of(32767.0, 64, 80) - 32767.0) < error);
    assert_true(pedestal_of(0.0, 64, 80) == 0.0);
    assert_true(pedestal_of(-100.0, 64, 80) == 0.0);
    assert_true(pedestal_of(8.0, 64, 80) == 0.0);                            /* below a hundredth */
    assert_true(fabs(pedestal_of(100.0, 9, 80) - 100.0) < 4.0 * 10.0 / 9.0); /* squares of 9 x 9 */
    assert_true(pedestal_of(100.0, 1, 1) > 0.0);
}

static void a_deficit_is_what_no_light_can_be(void **state)
{
    (void)state;
    const double error = 4.0 * 10.0 / 16.0;
    assert_true(fabs(deficit_of(-100.0, 64, 80) - 100.0) < error);
    assert_true(fabs(deficit_of(-2000.0, 64, 80) - 2000.0) < error); /* none is above zero */
    assert_true(deficit_of(0.0, 64, 80) == 0.0);
    assert_true(deficit_of(100.0, 64, 80) == 0.0);
    assert_true(deficit_of(-8.0, 64, 80) == 0.0); /* below a hundredth */
    assert_true(deficit_of(-100.0, 1, 1) > 0.0);
}

/* Means of 2 x 2 pixels of noise, as resampling makes them, about zero: 2 x 2 differences see a
 * quarter of it. */
static void noise_that_neighbours_share_is_no_deficit(void **state)
{
    (void)state;
    enum { IMAGES = 13, SIDE = 96, PIXELS = SIDE * SIDE, DRAWS = 20 };
    static float images[IMAGES * PIXELS], scratch[IMAGES * PIXELS];
    for (uint64_t draw = 0; draw < DRAWS; draw++) {
        for (int64_t i = 0; i < IMAGES * PIXELS; i++) {
            const int64_t at[] = {i, i + 1, i + SIDE, i + SIDE + 1};
            images[i] = 0.0f;
            for (int k = 0; k < 4; k++) {
                images[i] += (float)v2v_random_normal(6, draw, (uint64_t)at[k]) / 4.0f;
            }
        }
        struct v2v_dark dark = v2v_dark_of_images(scratch, images, IMAGES, SIDE, SIDE);
        assert_true(dark.above == 0.0 && dark.below == 0.0);
        for (int64_t i = 0; i < IMAGES * PIXELS; i++) {
            images[i] -= 1.0f;
        }
        dark = v2v_dark_of_images(scratch, images, IMAGES, SIDE, SIDE);
        assert_true(dark.above == 0.0 && dark.below > 0.8 && dark.below < 1.2);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(figures_of_parts_are_those_of_the_whole),
        cmocka_unit_test(selection_parts_an_array_at_its_kth_value),
        cmocka_unit_test(selection_ends_among_nans),
        cmocka_unit_test(slopes_of_even_noise_scatter_by_their_standard_error),
        cmocka_unit_test(noise_in_the_dark_hides_no_photons),
        cmocka_unit_test(background_of_small_cases_is_the_edge_of_the_fullest_bin),
        cmocka_unit_test(a_pedestal_is_what_is_nowhere_dark),
        cmocka_unit_test(a_deficit_is_what_no_light_can_be),
        cmocka_unit_test(noise_that_neighbours_share_is_no_deficit),
        cmocka_unit_test(background_matches_the_golden_volumes),
        cmocka_unit_test(percentile_equals_that_of_the_sorted_numbers),
        cmocka_unit_test(percentile_is_exact_at_numbers_and_leaves_them_alone),
        cmocka_unit_test(sum_of_squares_matches_a_plain_loop_for_every_length),
        cmocka_unit_test(first_special_number_is_found_wherever_it_is),
        cmocka_unit_test(one_value_is_told_from_two),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
