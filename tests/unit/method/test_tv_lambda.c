/* The weight of total variation, settled without a truth. */
#include "method/tv.h"
#include "method/tv_lambda.h"
#include "small_tv.h"

#include "v2v3d/base/random.h"
#include "v2v3d/optics/projector.h"

#include <math.h>
#include <string.h>

enum { SIDE = 64, PIXELS = SIDE * SIDE };

/* Weights that are left to be settled; they are settled to the same bits once more. */
static struct v2v_deconv_settings both_settled(int mode, const struct v2v_problem *problem,
                                               const float *views)
{
    struct v2v_deconv_settings deconv = problem->config->deconv, again;
    deconv.lambda = (struct v2v_number){mode, 0.03};
    again = deconv;
    assert_ok(v2v_tv_settle_weights(&deconv, problem, views, NULL, NULL));
    assert_ok(v2v_tv_settle_weights(&again, problem, views, NULL, NULL));
    assert_int_equal(deconv.lambda.mode, V2V_NUMBER_GIVEN);
    assert_int_equal(deconv.sparsity.mode, V2V_NUMBER_GIVEN);
    assert_true(deconv.lambda.value == again.lambda.value);
    assert_true(deconv.sparsity.value == again.sparsity.value);
    return deconv;
}

static double settled(int mode, const struct v2v_problem *problem, const float *views)
{
    return both_settled(mode, problem, views).lambda.value;
}

/* Optics and views that are three times as bright want the same weight. */
static void check_light(double usual, const struct v2v_problem *problem, const float *views)
{
    static float brighter[VIEWS * PIXELS], data[VIEWS * SLICES * KERNEL_HEIGHT * KERNEL_WIDTH];
    struct v2v_psf_file psf = *problem->psf;
    struct v2v_problem own = *problem;
    for (int64_t i = 0; i < VIEWS * SLICES * KERNEL_HEIGHT * KERNEL_WIDTH; i++) {
        data[i] = 3.0f * psf.data[i];
    }
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        brighter[i] = 3.0f * views[i];
    }
    psf.data = data;
    own.psf = &psf;
    assert_float_equal(settled(V2V_NUMBER_NONE, &own, brighter), usual, 1e-5 * usual);
}

/* What the views show of a volume, with normal noise. */
static void show(float *views, const float *truth, const struct v2v_psf_file *psf, double noise,
                 uint64_t seed)
{
    struct v2v_projector *projector = NULL;
    assert_ok(v2v_projector_create(&projector, psf, SIDE, SIDE, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, views, truth, NULL, VIEWS, 1.0f);
    v2v_projector_destroy(&projector);
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] += (float)(noise * v2v_random_normal(seed, 0, (uint64_t)i));
    }
}

/* The weight found without the truth is that of the best volume, within a factor of two. By default
 * it goes by the noise, but is searched for where views are missed by more. */
static void the_weight_is_found_by_views_left_out(void **state)
{
    (void)state;
    static float truth[SLICES * PIXELS], views[VIEWS * PIXELS], volume[SLICES * PIXELS];
    struct v2v_psf_file psf = small_psf();
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
    struct v2v_deconv_settings of_two_views = config.deconv;
    double least = INFINITY, best = 0.0;
    for (int64_t i = 0; i < SLICES * PIXELS; i++) { /* boxes */
        const int64_t z = i / PIXELS, y = i / SIDE % SIDE, x = i % SIDE;
        truth[i] = (float)((y / 6 + 2 * (x / 7) + z / 2) % 5 == 0);
    }
    show(views, truth, &psf, 0.05, 47);
    for (double weight = 0.01; weight < 0.3; weight *= 1.5) {
        config.deconv.lambda = (struct v2v_number){V2V_NUMBER_GIVEN, weight};
        assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
        const double error = test_relative_l2(volume, truth, SLICES * PIXELS);
        best = error < least ? weight : best;
        least = fmin(error, least);
    }
    config.deconv.lambda.mode = V2V_NUMBER_AUTO;
    assert_int_equal(estimate(volume, views, &psf, SIDE, SIDE), V2V_E_CONFIG); /* not settled */
    const double chosen = settled(V2V_NUMBER_AUTO, &problem, views);
    assert_true(chosen > 0.5 * best && chosen < 2.0 * best);
    const double usual = settled(V2V_NUMBER_NONE, &problem, views);
    assert_true(chosen > 0.2 * usual); /* PSFs of few slices: boxes do not want far less .. */
    assert_true(chosen < 0.6 * usual); /* .. and are weighed by the noise */
    memmove(views, views + 2, (PIXELS - 2) * sizeof *views);
    const double moved = settled(V2V_NUMBER_NONE, &problem, views);
    assert_true(moved != usual && moved == settled(V2V_NUMBER_AUTO, &problem, views));
    psf.views = 2;
    of_two_views.lambda.mode = V2V_NUMBER_AUTO;
    assert_int_equal(v2v_tv_settle_weights(&of_two_views, &problem, views, NULL, NULL),
                     V2V_E_CONFIG);
    const double of_two = settled(V2V_NUMBER_NONE, &problem, views); /* too few to leave some out */
    assert_true(of_two > 2.0 * best);                                /* by the noise */
    check_light(of_two, &problem, views);
    v2v_psf_file_fini(&psf);
}

/* Points of light as sharp PSFs show them want less than noise says, and get it. */
static void few_sharp_points_are_weighed_by_views_left_out(void **state)
{
    (void)state;
    enum { POINTS = 200 };
    static float truth[SLICES * PIXELS], views[VIEWS * PIXELS], volume[SLICES * PIXELS];
    struct v2v_psf_file psf = point_psf();
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
    assert_true(v2v_tv_noise_seen(&psf) > 3.0);
    for (uint64_t k = 0; k < POINTS; k++) {
        truth[(int64_t)(v2v_random_uniform(5, 0, k) * SLICES * PIXELS)] = 1.0f;
    }
    show(views, truth, &psf, 0.0, 0);
    const double weight = settled(V2V_NUMBER_NONE, &problem, views);
    assert_true(weight == settled(V2V_NUMBER_AUTO, &problem, views));
    config.deconv.lambda = (struct v2v_number){V2V_NUMBER_GIVEN, weight};
    assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
    const double error = test_relative_l2(volume, truth, SLICES * PIXELS);
    assert_true(error < 0.1); /* by the noise: 0.7 */
    v2v_psf_file_fini(&psf);
}

/* PSFs that show a voxel of 3 x 3 pixels where small_psf shows one: less of the noise is seen. */
static struct v2v_psf_file broad_psf(void)
{
    struct v2v_psf_file psf = small_psf();
    const struct v2v_psf_file sharp = small_psf();
    for (int64_t i = 0; i < VIEWS * SLICES * KERNEL_HEIGHT * KERNEL_WIDTH; i++) {
        const int64_t y = i / KERNEL_WIDTH % KERNEL_HEIGHT, x = i % KERNEL_WIDTH;
        double sum = 0.0;
        for (int64_t near = 0; near < 9; near++) {
            const int64_t dy = near / 3 - 1, dx = near % 3 - 1;
            const int is_inside =
                y + dy >= 0 && y + dy < KERNEL_HEIGHT && x + dx >= 0 && x + dx < KERNEL_WIDTH;
            sum += is_inside ? sharp.data[i + dy * KERNEL_WIDTH + dx] : 0.0;
        }
        psf.data[i] = (float)sum;
    }
    v2v_mem_free(sharp.data);
    v2v_psf_normalize_views(&psf);
    return psf;
}

/* Of points the volume itself gets a weight, too, unless it is given. */
static void few_points_give_the_volume_a_weight(void **state)
{
    (void)state;
    enum { POINTS = 100 };
    static float truth[SLICES * PIXELS], views[VIEWS * PIXELS], volume[SLICES * PIXELS];
    struct v2v_psf_file psf = broad_psf();
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
    double error[2];
    for (uint64_t k = 0; k < POINTS; k++) {
        truth[(int64_t)(v2v_random_uniform(6, 0, k) * SLICES * PIXELS)] = 1.0f;
    }
    show(views, truth, &psf, 0.002, 49);
    for (int open = 0; open < 2; open++) {
        config.deconv.sparsity.mode = open ? V2V_NUMBER_AUTO : V2V_NUMBER_GIVEN;
        config.deconv.sparsity.value = 0.0;
        config.deconv.lambda = (struct v2v_number){V2V_NUMBER_NONE, 0.03};
        config.deconv = both_settled(V2V_NUMBER_NONE, &problem, views);
        assert_true((config.deconv.sparsity.value > 0.0) == open);
        assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
        error[open] = test_relative_l2(volume, truth, SLICES * PIXELS);
    }
    assert_true(error[1] < 0.5 * error[0]);
    v2v_psf_file_fini(&psf);
}

/* Thin lines want less than noise says, of PSFs of any sharpness, and get it. */
static void lines_are_weighed_by_views_left_out(void **state)
{
    (void)state;
    static float truth[SLICES * PIXELS], views[VIEWS * PIXELS], volume[SLICES * PIXELS];
    struct v2v_psf_file psf = broad_psf();
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
    double weight[2] = {0.05, 0.0}, error[2]; /* as noise says, about, and as is settled */
    assert_true(v2v_tv_noise_seen(&psf) < 3.0);
    for (int64_t i = 0; i < SLICES * PIXELS; i++) {
        const int64_t z = i / PIXELS, x = i % SIDE;
        truth[i] = (float)(z == 2 && x % 10 == 3);
    }
    show(views, truth, &psf, 0.01, 48);
    weight[1] = settled(V2V_NUMBER_NONE, &problem, views);
    assert_true(weight[1] == settled(V2V_NUMBER_AUTO, &problem, views));
    assert_true(weight[1] < 0.5 * weight[0]);
    for (int k = 0; k < 2; k++) {
        config.deconv.lambda = (struct v2v_number){V2V_NUMBER_GIVEN, weight[k]};
        assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
        error[k] = test_relative_l2(volume, truth, SLICES * PIXELS);
    }
    assert_true(error[1] < 0.85 * error[0]);
    v2v_psf_file_fini(&psf);
}

/* Noise of views, of their brightness. */
static double noise_of(const struct v2v_problem *problem, const float *views)
{
    struct v2v_estimator *estimator = NULL;
    assert_ok(v2v_estimator_create(&estimator, &v2v_estimator_tv, problem, NULL));
    estimator->ops->measure(estimator, views);
    const double noise = v2v_tv_noise(estimator).part;
    v2v_estimator_destroy(&estimator);
    return noise;
}

/* The weight that it says. */
static double by_noise(double noise, double seen)
{
    return 0.03 * pow(10.0 * noise, 0.15) * sqrt(seen);
}

/* Broad light in much noise wants more than that, of few slices, and gets it. */
static void broad_light_of_few_slices_gets_more(void **state)
{
    (void)state;
    static float truth[SLICES * PIXELS], views[VIEWS * PIXELS], volume[SLICES * PIXELS];
    struct v2v_psf_file psf = point_psf();
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
    for (int64_t i = 0; i < SLICES * PIXELS; i++) {
        truth[i] =
            (float)(1.0 + sin((double)(i / SIDE % SIDE) / 9.0) * sin((double)(i % SIDE) / 9.0));
    }
    show(views, truth, &psf, 1.0, 51);
    const double weight[2] = {by_noise(noise_of(&problem, views), v2v_tv_noise_seen(&psf)),
                              settled(V2V_NUMBER_NONE, &problem, views)};
    double error[2];
    for (int k = 0; k < 2; k++) {
        config.deconv.lambda = (struct v2v_number){V2V_NUMBER_GIVEN, weight[k]};
        assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
        error[k] = test_relative_l2(volume, truth, SLICES * PIXELS);
    }
    assert_true(weight[1] > 1.2 * weight[0]);
    assert_true(error[1] < 0.5 * error[0]); /* found 0.14 and 0.34 */
    v2v_psf_file_fini(&psf);
}

/* Of one view none can be left out: the noise says, and that there is a single slice. */
static void a_single_slice_has_twice_the_weight_by_the_noise(void **state)
{
    (void)state;
    static float views[PIXELS];
    struct v2v_psf_file all = small_psf(), one = all;
    one.views = one.slices = 1;
    const struct v2v_problem problem = {
        .config = &config, .psf = &one, .height = SIDE, .width = SIDE};
    for (int64_t i = 0; i < PIXELS; i++) {
        views[i] = (float)((i / SIDE / 8 + i % SIDE / 8) % 2 + /* a chess board */
                           0.05 * v2v_random_normal(5, 0, (uint64_t)i));
    }
    const double noise = noise_of(&problem, views);
    const double weight = 2.0 * by_noise(noise, fmax(v2v_tv_noise_seen(&one), 1.0));
    assert_true(noise > 0.02 && noise < 0.1);
    assert_float_equal(settled(V2V_NUMBER_NONE, &problem, views), weight, 1e-12 * weight);
    v2v_psf_file_fini(&all);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(the_weight_is_found_by_views_left_out, setup),
        cmocka_unit_test_setup(few_sharp_points_are_weighed_by_views_left_out, setup),
        cmocka_unit_test_setup(few_points_give_the_volume_a_weight, setup),
        cmocka_unit_test_setup(lines_are_weighed_by_views_left_out, setup),
        cmocka_unit_test_setup(broad_light_of_few_slices_gets_more, setup),
        cmocka_unit_test_setup(a_single_slice_has_twice_the_weight_by_the_noise, setup),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
