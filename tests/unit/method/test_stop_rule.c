/* --stop heldout on noisy views of a known scene. */
#include "small_optics.h"

#include "v2v3d/base/random.h"
#include "v2v3d/method/estimator.h"
#include "v2v3d/optics/projector.h"

#include <math.h>
#include <string.h>

enum { SIDE = 64, PIXELS = SIDE * SIDE, VOXELS = SLICES * PIXELS, MOST = 72, BLOBS = 30 };

static float truth[VOXELS], clean[VIEWS * PIXELS], views[VIEWS * PIXELS];
static struct v2v_psf_file psf;

/* A ball of light, 1 in its middle, 2 pixels in standard deviation. */
static void add_blob(double z, double y, double x)
{
    for (int64_t i = 0; i < VOXELS; i++) {
        double dz = (double)(i / PIXELS) + 0.5 - z, dy = (double)(i / SIDE % SIDE) + 0.5 - y;
        double dx = (double)(i % SIDE) + 0.5 - x;
        truth[i] += (float)exp(-(dz * dz + dy * dy + dx * dx) / (2.0 * 2.0 * 2.0));
    }
}

static int setup(void **state)
{
    (void)state;
    struct v2v_projector *projector = NULL;
    psf = small_psf();
    for (uint64_t k = 0; k < BLOBS; k++) {
        add_blob(v2v_random_uniform(5, 0, k) * SLICES, v2v_random_uniform(5, 1, k) * SIDE,
                 v2v_random_uniform(5, 2, k) * SIDE);
    }
    assert_ok(v2v_projector_create(&projector, &psf, SIDE, SIDE, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, clean, truth, NULL, VIEWS, 1.0f);
    v2v_projector_destroy(&projector);
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    v2v_psf_file_fini(&psf);
    return v2v_mem_held() != 0;
}

struct errors {
    double of[MOST + 1]; /* relative L2, by iteration */
    int64_t last;
};

static int judge(void *context, int64_t iteration, const struct v2v_iterate *iterate)
{
    static float volume[VOXELS];
    struct errors *errors = context;
    v2v_iterate_slices(iterate, volume);
    errors->of[iteration] = test_relative_l2(volume, truth, VOXELS);
    errors->last = iteration;
    return 0;
}

static void run(struct errors *errors, const char *method, int64_t most, enum v2v_stop stop)
{
    static float volume[VOXELS];
    float *volumes = volume;
    struct v2v_config config;
    const struct v2v_estimator_ops *ops = NULL;
    struct v2v_estimator *estimator = NULL;
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
    v2v_config_defaults(&config);
    config.deconv.iterations = most;
    config.deconv.stop = stop;
    assert_ok(v2v_estimator_find(&ops, method));
    assert_ok(v2v_estimator_create(&estimator, ops, &problem, NULL));
    assert_ok(ops->run(estimator, &volumes, views, &(struct v2v_monitor){judge, errors}));
    v2v_estimator_destroy(&estimator);
}

/* The rule looks at one of four views: it may miss the best iteration, but not what stopping is
 * for, the rise from there, or four fifths of it. */
static void check(const char *method, int64_t most, double noise)
{
    struct errors all = {.last = 0}, stopped = {.last = 0};
    int64_t best = 1;
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] = clean[i] + (float)(noise * v2v_random_normal(6, 0, (uint64_t)i));
    }
    run(&all, method, most, V2V_STOP_FIXED);
    run(&stopped, method, most, V2V_STOP_HELDOUT);
    for (int64_t i = 2; i <= most; i++) {
        best = all.of[i] < all.of[best] ? i : best;
    }
    double error = stopped.of[stopped.last];
    print_message("%s, noise %g: best %lld (%.3f), heldout %lld (%.3f), %lld (%.3f)\n", method,
                  noise, (long long)best, all.of[best], (long long)stopped.last, error,
                  (long long)most, all.of[most]);
    assert_int_equal(all.last, most);
    assert_true(error == all.of[stopped.last]); /* all views, and only the number is the rule's */
    assert_true(error - all.of[best] <= 0.2 * (all.of[most] - all.of[best]));
}

static void views_held_out_stop_the_iterations_near_the_best_one(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        int64_t iterations;
    } methods[] = {{"rl", MOST}, {"rld", 24}, {"frl", 24}};
    for (size_t i = 0; i < sizeof methods / sizeof *methods; i++) {
        check(methods[i].name, methods[i].iterations, 0.02);
        check(methods[i].name, methods[i].iterations, 0.05);
        check(methods[i].name, methods[i].iterations, 0.3);
    }
}

/* `rl` is judged after 5 iterations for the first time, when there is none to compare with. */
static void what_the_rule_does_not_end_goes_on_to_the_last(void **state)
{
    (void)state;
    enum { ITERATIONS = 7 };
    struct errors errors = {.last = 0};
    memcpy(views, clean, sizeof views);
    run(&errors, "rl", ITERATIONS, V2V_STOP_HELDOUT);
    assert_int_equal(errors.last, ITERATIONS);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(views_held_out_stop_the_iterations_near_the_best_one),
        cmocka_unit_test(what_the_rule_does_not_end_goes_on_to_the_last),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
