/* The example of estimator.h, of every method that needs no weights. */
#include "small_optics.h"

#include "v2v3d/base/random.h"
#include "v2v3d/method/estimator.h"

#include <string.h>

enum { SIDE = 32, VOXELS = SLICES * SIDE * SIDE };

static enum v2v_status estimate(float *volume, const float *views, const char *method,
                                const struct v2v_problem *problem, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_estimator_ops *ops = NULL;
    struct v2v_estimator *estimator = NULL;
    V2V_TRY(v2v_estimator_find(&ops, method));
    V2V_TRY(v2v_estimator_create(&estimator, ops, problem, comm));
    V2V_TRY(ops->run(estimator, &volume, views, NULL));
done:
    v2v_estimator_destroy(&estimator);
    return rc;
}

/* The light of a spot comes from within a kernel of it; the same views at another brightness give
 * the same volume at that brightness, to the bit as powers of two round nowhere. */
static void check(const struct v2v_estimator_ops *ops)
{
    static float volume[VOXELS], brighter[VOXELS], views[VIEWS * SIDE * SIDE];
    struct v2v_psf_file psf = small_psf();
    struct v2v_config config;
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
    v2v_config_defaults(&config);
    memset(views, 0, sizeof views);
    for (int v = 0; v < VIEWS; v++) {
        views[(v * SIDE + SIDE / 2) * SIDE + SIDE / 2] = 1.0f;
    }
    assert_ok(estimate(volume, views, ops->name, &problem, NULL));
    int brightest = 0;
    for (int i = 0; i < VOXELS; i++) {
        brightest = volume[i] > volume[brightest] ? i : brightest;
    }
    assert_in_range(brightest / SIDE % SIDE, SIDE / 2 - 5, SIDE / 2 + 5);
    assert_in_range(brightest % SIDE, SIDE / 2 - 5, SIDE / 2 + 5);
    for (int i = 0; i < VIEWS * SIDE * SIDE; i++) {
        views[i] *= 1024.0f;
    }
    assert_ok(estimate(brighter, views, ops->name, &problem, NULL));
    for (int i = 0; i < VOXELS; i++) {
        assert_true(brighter[i] == 1024.0f * volume[i]);
    }
    v2v_psf_file_fini(&psf);
}

static void every_method_finds_a_spot_at_any_brightness(void **state)
{
    (void)state;
    int checked = 0;
    for (int64_t i = 0; i < v2v_estimator_count(); i++) {
        const struct v2v_estimator_ops *ops = v2v_estimator_at(i);
        assert_non_null(ops->name);
        if (!ops->is_learned) {
            check(ops);
            checked++;
        }
    }
    assert_true(checked >= 2);
    assert_int_equal(v2v_mem_held(), 0);
}

/* Of a volume of noise. */
static void check_projection(const struct v2v_estimator_ops *ops)
{
    static float volume[VOXELS], views[VIEWS * SIDE * SIDE];
    struct v2v_psf_file psf = small_psf();
    struct v2v_config config;
    struct v2v_estimator *estimator = NULL;
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
    v2v_config_defaults(&config);
    assert_ok(v2v_config_set(&config, "model.method=unrolled"));
    for (int i = 0; i < VOXELS; i++) {
        volume[i] = (float)v2v_random_uniform(3, 0, (uint64_t)i);
    }
    assert_ok(v2v_estimator_create(&estimator, ops, &problem, NULL));
    ops->project(estimator, views, volume);
    assert_small_views(views, volume, &psf, SIDE, SIDE);
    v2v_estimator_destroy(&estimator);
    v2v_psf_file_fini(&psf);
}

static void methods_that_project_give_the_views_of_a_volume(void **state)
{
    (void)state;
    int checked = 0;
    for (int64_t i = 0; i < v2v_estimator_count(); i++) {
        if (v2v_estimator_at(i)->project != NULL) {
            check_projection(v2v_estimator_at(i));
            checked++;
        }
    }
    assert_int_equal(checked, 5); /* tv, unrolled, rl, rld, frl */
    assert_int_equal(v2v_mem_held(), 0);
}

static void what_is_not_offered_is_refused(void **state)
{
    (void)state;
    const struct v2v_estimator_ops *ops = NULL;
    struct v2v_grid_work work;
    struct v2v_psf_file psf = small_psf();
    struct v2v_config config;
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
    v2v_config_defaults(&config);
    assert_int_equal(v2v_estimator_find(&ops, "lucy"), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "none of rl|rld|frl|tv"));
    assert_ok(v2v_estimator_find(&ops, "rld"));
    assert_ok(ops->describe_work(&work, &problem));
    config.deconv.stop = V2V_STOP_HELDOUT;
    assert_ok(ops->describe_work(&work, &problem));
    psf.views = 2;
    assert_int_equal(ops->describe_work(&work, &problem), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "needs 3 views"));
    v2v_psf_file_fini(&psf);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_method_finds_a_spot_at_any_brightness),
        cmocka_unit_test(methods_that_project_give_the_views_of_a_volume),
        cmocka_unit_test(what_is_not_offered_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
