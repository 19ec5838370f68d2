/* What a first frame settles for total variation. */
#include "small_optics.h"

#include "v2v3d/base/random.h"
#include "v2v3d/method/estimator.h"

#include <dlfcn.h>
#include <unistd.h>

enum { HEIGHT = 24, WIDTH = 28, PIXELS = HEIGHT * WIDTH };
enum { VOXELS = SLICES * PIXELS, SAMPLES = VIEWS * PIXELS };

/* A host of few processors has no two ranks share a volume of views left out: this one has more. */
long sysconf(int name)
{
    enum { PROCESSORS = 8 };
    long (*real)(int);
    *(void **)&real = dlsym(RTLD_NEXT, "sysconf");
    return name == _SC_NPROCESSORS_ONLN ? PROCESSORS : real(name);
}

static struct v2v_psf_file psf;
static float truth[VOXELS], views[SAMPLES];

/* A few bright points. */
static int setup(void **state)
{
    (void)state;
    psf = small_psf();
    for (int64_t i = 0; i < VOXELS; i++) {
        const int bright = v2v_random_below(11, 0, (uint64_t)i, 60) == 0;
        truth[i] = bright ? (float)(1 + v2v_random_uniform(11, 1, (uint64_t)i)) : 0;
    }
    small_views(views, truth, &psf, HEIGHT, WIDTH);
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    v2v_psf_file_fini(&psf);
    return 0;
}

/* As the method leaves them open: kind of noise, and the weight by views left out or by noise. */
static enum v2v_status settle(struct v2v_config *settled, enum v2v_number_mode lambda,
                              const float *recorded, const struct v2v_comm *world)
{
    const struct v2v_estimator_ops *tv = NULL;
    const struct v2v_problem problem = {
        .config = settled, .psf = &psf, .height = HEIGHT, .width = WIDTH};
    v2v_config_defaults(settled);
    settled->parallel.split = V2V_SPLIT_SLABS;
    settled->parallel.transform = V2V_TRANSFORM_OWN;
    settled->deconv.tolerance = 0.0;
    settled->deconv.noise = V2V_NOISE_MODEL_AUTO;
    settled->deconv.lambda.mode = lambda;
    assert_ok(v2v_estimator_find(&tv, "tv"));
    assert_true(v2v_estimator_is_open(tv, settled));
    return v2v_estimator_settle(settled, tv, &problem, recorded, NULL, world);
}

static void make_noisy(float *recorded, double light, double noise)
{
    for (int64_t i = 0; i < SAMPLES; i++) {
        recorded[i] = (float)(light + noise * v2v_random_normal(12, 0, (uint64_t)i));
    }
}

static void any_number_of_ranks_settles_alike(void **state)
{
    (void)state;
    static float recorded[SAMPLES];
    static const enum v2v_number_mode modes[] = {V2V_NUMBER_AUTO, V2V_NUMBER_NONE};
    struct v2v_config alone, together;
    for (int m = 0; m < 2; m++) {
        make_noisy(recorded, 0.0, 0.02);
        for (int64_t i = 0; i < SAMPLES; i++) {
            recorded[i] += views[i];
        }
        assert_ok(settle(&alone, modes[m], recorded, NULL));
        assert_ok(settle(&together, modes[m], recorded, test_world()));
        assert_true((together.deconv.lambda.value < 0.01) ==
                    (modes[m] == V2V_NUMBER_AUTO)); /* points */
        assert_int_equal(together.deconv.lambda.mode, V2V_NUMBER_GIVEN);
        assert_true(together.deconv.lambda.value == alone.deconv.lambda.value);
        assert_true(together.deconv.sparsity.value == alone.deconv.sparsity.value);
        assert_int_equal(together.deconv.noise, alone.deconv.noise);
        recorded[PIXELS + 2 * WIDTH + 7] = NAN;
        assert_int_equal(settle(&together, modes[m], recorded, test_world()), V2V_E_NUMERIC);
    }
}

static void the_usual_weight_goes_by_a_power_of_the_noise(void **state)
{
    (void)state;
    static float recorded[SAMPLES];
    struct v2v_config little, more;
    psf.views = 3; /* of so few none is asked whether it wants another weight */
    make_noisy(recorded, 10.0, 0.05);
    assert_ok(settle(&little, V2V_NUMBER_NONE, recorded, NULL));
    make_noisy(recorded, 10.0, 0.2); /* its brightest samples are a twentieth brighter */
    assert_ok(settle(&more, V2V_NUMBER_NONE, recorded, NULL));
    const double times = more.deconv.lambda.value / little.deconv.lambda.value;
    assert_true(times > pow(3.5, 0.15) && times < pow(4.0, 0.15));
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(any_number_of_ranks_settles_alike, setup, teardown),
        cmocka_unit_test_setup_teardown(the_usual_weight_goes_by_a_power_of_the_noise, setup,
                                        teardown),
    };
    return test_mpi_main(tests, argc, argv);
}
