/* Broken pixels in RLD: what they may reach, and what they may not.
 *
 * An update with one view moves what a pixel does by the kernel's reach r into the volume and by r
 * back into the views: after n iterations over V views a pixel that first counts in update f has
 * reached (2 (n V - f) - 1) r pixels at most, f = 0 for view 0. Two recordings that differ in where
 * a few pixels are broken, and in nothing else, have the same mean and so the same start: beyond
 * the reach of either place their volumes differ by round-off alone. An update's round-off is that
 * of two transforms, 2 u sqrt(3 log2(n) + 4) each, u = 2^-24, of an image of ratios R whose norm
 * the broken pixels may dominate, for either recording; w = 1/2 of it enters, n V times,
 * independently: 1/2 sqrt(2 n V) 4 u sqrt(3 log2(n) + 4) ||R|| / sqrt(pixels), R that of the first
 * update, the largest. */
#include "hard_input.h"
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/method/estimator.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { VIEWS = 3, SLICES = 3, KERNEL = 3, REACH = 1, SIDE = 96, MOST_ITERATIONS = 4 };
enum { PIXELS = SIDE * SIDE, VOXELS = SLICES * PIXELS, SAMPLES = VIEWS * PIXELS };

/* Places of the broken pixels in view 0, far apart. */
struct place {
    int64_t y, x;
};
static const struct place here = {20, 24}, there = {72, 70};

static struct v2v_psf_file psf;

static int setup(void **state)
{
    (void)state;
    psf =
        (struct v2v_psf_file){.views = VIEWS, .slices = SLICES, .height = KERNEL, .width = KERNEL};
    assert_ok(V2V_ALLOC(psf.data, "test", VIEWS * SLICES * KERNEL * KERNEL));
    for (int64_t i = 0; i < VIEWS * SLICES * KERNEL * KERNEL; i++) {
        psf.data[i] = (float)(0.5 + v2v_random_uniform(79, 0, (uint64_t)i));
    }
    v2v_psf_normalize_views(&psf);
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    v2v_psf_file_fini(&psf);
    return v2v_mem_held() != 0;
}

/* side x side pixels of view 0 at `value` times the mean. */
struct outlier {
    const char *name;
    double value;
    int64_t side;
};
static const struct outlier outliers[] = {
    {"hot pixel", 1e4, 1}, {"saturated", 65.535, 9}, {"dead pixels", 0.0, 3}};

static void record(float *views, const struct outlier *outlier, struct place place)
{
    for (int64_t i = 0; i < SAMPLES; i++) {
        views[i] = test_hard_sample(TEST_HARD_1, i, SIDE, 0);
    }
    /* both places look alike before: the recordings' means are the same */
    for (int64_t i = 0; i < outlier->side * outlier->side; i++) {
        int64_t y = i / outlier->side, x = i % outlier->side;
        views[(here.y + y) * SIDE + here.x + x] = 1.0f;
        views[(there.y + y) * SIDE + there.x + x] = 1.0f;
    }
    for (int64_t i = 0; i < outlier->side * outlier->side; i++) {
        int64_t y = place.y + i / outlier->side, x = place.x + i % outlier->side;
        views[y * SIDE + x] = (float)outlier->value;
    }
}

static int64_t distance(int64_t voxel, struct place place, int64_t side)
{
    int64_t y = voxel / SIDE % SIDE, x = voxel % SIDE;
    int64_t dy = y < place.y ? place.y - y : y - (place.y + side - 1);
    int64_t dx = x < place.x ? place.x - x : x - (place.x + side - 1);
    return dy > dx ? dy : dx;
}

static double bound_of(const float *views, double mean, int64_t iterations)
{
    double stages = 3.0 * log2((double)((SIDE + KERNEL) * (SIDE + KERNEL))) + 4.0;
    double ratios = sqrt(v2v_sum_of_squares(views, PIXELS) / PIXELS) / mean;
    return 0.5 * sqrt(2.0 * (double)(iterations * VIEWS)) * 4.0 * 0x1p-24 * sqrt(stages) *
           fmax(ratios, 1.0);
}

static double mean_of(const float *views)
{
    double sum = 0.0;
    for (int64_t i = 0; i < SAMPLES; i++) {
        sum += (double)views[i];
    }
    return sum / SAMPLES;
}

/* One row of the table. */
static void check(const struct outlier *outlier, int64_t iterations)
{
    static float views[SAMPLES], one[VOXELS], other[VOXELS];
    const struct v2v_estimator_ops *ops = NULL;
    struct v2v_estimator *rld = NULL;
    struct v2v_config config;
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
    float *one_volume = one, *other_volume = other;
    double within = 0.0, beyond = 0.0, squares = 0.0, size = 0.0;
    int64_t reach = (2 * iterations * VIEWS - 1) * REACH, counted = 0;
    v2v_config_defaults(&config);
    config.deconv.iterations = iterations;
    assert_ok(v2v_estimator_find(&ops, "rld"));
    assert_ok(v2v_estimator_create(&rld, ops, &problem, NULL));
    record(views, outlier, there);
    assert_ok(ops->run(rld, &other_volume, views, NULL));
    record(views, outlier, here);
    assert_ok(ops->run(rld, &one_volume, views, NULL));
    for (int64_t i = 0; i < VOXELS; i++) {
        int64_t near = distance(i, here, outlier->side), far = distance(i, there, outlier->side);
        double d = fabs((double)one[i] - (double)other[i]);
        if (near <= reach || far <= reach) {
            within = fmax(within, d);
            continue;
        }
        beyond = fmax(beyond, d / (double)other[i]);
        squares += d * d;
        size += (double)other[i] * (double)other[i];
        counted++;
    }
    double bound = bound_of(views, mean_of(views), iterations);
    print_message("%-12s %10lld %6lld | %9.2e | %9.1e %9.1e %9.1e\n", outlier->name,
                  (long long)iterations, (long long)reach, within, beyond, sqrt(squares / size),
                  bound);
    assert_int_equal(v2v_first_not_finite(one, VOXELS), -1);
    assert_true(counted > VOXELS / 10);
    assert_true(within > 1e-3); /* it was there */
    assert_true(sqrt(squares / size) <= bound);
    v2v_estimator_destroy(&rld);
}

static void broken_pixels_spoil_nothing_beyond_the_kernels_reach(void **state)
{
    (void)state;
    print_message("%-12s %10s %6s | %9s | %9s %9s %9s\n", "", "iterations", "reach", "within",
                  "beyond", "in norm", "bound");
    for (size_t o = 0; o < sizeof outliers / sizeof *outliers; o++) {
        for (int64_t n = 1; n <= MOST_ITERATIONS; n++) {
            check(&outliers[o], n);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(broken_pixels_spoil_nothing_beyond_the_kernels_reach),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
