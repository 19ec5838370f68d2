/* Samples that see nothing are unknown to total variation, as those beyond the frame are, and to
 * Richardson-Lucy. */
#include "small_tv.h"

#include "v2v3d/base/random.h"
#include "v2v3d/method/fusion.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/tensor/blind.h"

#include <string.h>

enum { SIDE = 48, PIXELS = SIDE * SIDE, VOXELS = SLICES * PIXELS, SAMPLES = VIEWS * PIXELS };
enum { DEAD = 1 };

static struct v2v_psf_file psf, without; /* of all views; of those that aren't dead */
static float truth[VOXELS], views[SAMPLES], masked[SAMPLES], volume[VOXELS];
static uint8_t marks[SAMPLES];

/* Spots of light, and views of them with noise of 0.03 of their brightest sample. */
static int setup_scene(void **state)
{
    struct v2v_projector *projector = NULL;
    float bright = 0.0f;
    psf = small_psf();
    for (int64_t i = 0; i < VOXELS; i++) {
        const int64_t z = i / PIXELS, y = i / SIDE % SIDE, x = i % SIDE;
        truth[i] = 0.0f;
        for (int64_t s = 0; s < 12; s++) {
            const double dz = (double)(z - s % SLICES);
            const double dy = (double)y - 6.0 - 36.0 * v2v_random_uniform(5, 0, (uint64_t)s);
            const double dx = (double)x - 6.0 - 36.0 * v2v_random_uniform(5, 1, (uint64_t)s);
            truth[i] += (float)exp(-(dz * dz + (dy * dy + dx * dx) / 4.0));
        }
    }
    assert_ok(v2v_projector_create(&projector, &psf, SIDE, SIDE, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, views, truth, NULL, VIEWS, 1.0f);
    v2v_projector_destroy(&projector);
    for (int64_t i = 0; i < SAMPLES; i++) {
        bright = fmaxf(bright, views[i]);
    }
    for (int64_t i = 0; i < SAMPLES; i++) {
        views[i] += 0.03f * bright * (float)v2v_random_normal(5, 2, (uint64_t)i);
    }
    memcpy(masked, views, sizeof masked);
    return setup(state);
}

static int teardown(void **state)
{
    (void)state;
    v2v_psf_file_fini(&psf);
    return v2v_mem_held() != 0;
}

static double psnr(void)
{
    double squares = 0.0, most = 0.0;
    for (int64_t i = 0; i < VOXELS; i++) {
        const double d = (double)volume[i] - (double)truth[i];
        squares += d * d;
        most = fmax(most, (double)truth[i]);
    }
    return 10.0 * log10(most * most * VOXELS / squares);
}

static double psnr_of(const float *of, const struct v2v_psf_file *by)
{
    assert_ok(estimate(volume, of, by, SIDE, SIDE));
    return psnr();
}

static void leave_blind(void)
{
    assert_true(v2v_blind_find(marks, masked, 0.0, VIEWS, SIDE, SIDE) > 0);
    v2v_blind_leave(masked, marks, SAMPLES);
}

/* Of the views that aren't dead. */
static double psnr_of_others(void)
{
    const int64_t kernels = SLICES * KERNEL_HEIGHT * KERNEL_WIDTH;
    static float fewer[SAMPLES], data[VIEWS * SLICES * KERNEL_HEIGHT * KERNEL_WIDTH];
    without = psf;
    without.views = VIEWS - 1;
    without.data = data;
    for (int64_t v = 0, to = 0; v < VIEWS; v++) {
        if (v != DEAD) {
            memcpy(fewer + to * PIXELS, views + v * PIXELS, PIXELS * sizeof *views);
            memcpy(data + to * kernels, psf.data + v * kernels, (size_t)kernels * sizeof *data);
            to++;
        }
    }
    return psnr_of(fewer, &without);
}

/* A dead view is as none: the minimum is the same, but for the level of the other views' noise, and
 * it is reached to the tolerance. Taken for data it costs more than a decibel. */
static void check_dead_view(enum v2v_noise_model model)
{
    config.deconv.noise = model;
    config.deconv.lambda.value = 0.03;
    config.deconv.lambda.mode = V2V_NUMBER_GIVEN;
    memset(masked + DEAD * PIXELS, 0, PIXELS * sizeof *masked);
    const double as_data = psnr_of(masked, &psf), expected = psnr_of_others();
    leave_blind();
    const double found = psnr_of(masked, &psf);
    if (!(fabs(found - expected) < 0.3 && as_data < expected - 1.0)) {
        fail_msg("%g dB, not %g; as data %g", found, expected, as_data);
    }
}

static void a_dead_view_is_as_none(void **state)
{
    (void)state;
    check_dead_view(V2V_NOISE_MODEL_GAUSSIAN);
}

static void a_dead_view_is_as_none_where_samples_have_weights(void **state)
{
    (void)state;
    check_dead_view(V2V_NOISE_MODEL_POISSON);
}

/* Outside of a circle about the light, which all views show: nothing is lost but noise. */
static void the_outside_of_an_aperture_costs_nothing(void **state)
{
    (void)state;
    config.deconv.lambda.value = 0.03;
    config.deconv.lambda.mode = V2V_NUMBER_GIVEN;
    const double whole = psnr_of(views, &psf);
    for (int64_t i = 0; i < SAMPLES; i++) {
        const double y = (double)(i / SIDE % SIDE) - 23.5, x = (double)(i % SIDE) - 23.5;
        masked[i] = y * y + x * x > 21.0 * 21.0 ? 0.0f : masked[i];
    }
    leave_blind();
    const double found = psnr_of(masked, &psf);
    if (!(found > whole - 0.5)) {
        fail_msg("%g dB, not %g", found, whole);
    }
}

/* They change nothing, so that a dead view is as none; taken for data it costs decibels. */
static void richardson_lucy_leaves_a_dead_view_out(void **state)
{
    (void)state;
    static const char *const methods[] = {"rl", "rld", "frl"};
    float *const dead = masked + DEAD * PIXELS;
    for (size_t i = 0; i < sizeof methods / sizeof *methods; i++) {
        method = methods[i];
        memset(dead, 0, PIXELS * sizeof *dead);
        const double as_data = psnr_of(masked, &psf), expected = psnr_of_others();
        for (int64_t p = 0; p < PIXELS; p++) {
            dead[p] = V2V_BLIND;
        }
        const double found = psnr_of(masked, &psf);
        print_message("%s: %.2f dB, without the view %.2f, as data %.2f\n", method, found, expected,
                      as_data);
        assert_true(fabs(found - expected) < 0.5 * (expected - as_data));
    }
}

/* Averaged with frames alike: the mark stays, and what is said of the noise is of the other
 * views. */
static void averaged_frames_keep_the_mark(void **state)
{
    (void)state;
    struct v2v_fusion *fusion = NULL;
    static float neighbour[SAMPLES];
    for (int64_t i = 0; i < SAMPLES; i++) {
        const int is_dead = i / PIXELS == DEAD;
        masked[i] = is_dead ? 0.0f : views[i];
        neighbour[i] =
            is_dead ? 0.0f : views[i] + 0.01f * (float)v2v_random_normal(5, 3, (uint64_t)i);
    }
    for (int is_left = 0; is_left < 2; is_left++) {
        assert_ok(v2v_fusion_create(&fusion, 1, VIEWS, SIDE, SIDE, is_left));
        memcpy(volume, masked, sizeof masked);
        v2v_fusion_begin(fusion, masked);
        v2v_fusion_add(fusion, masked, v2v_fusion_align(fusion, masked, neighbour));
        v2v_fusion_end(fusion, volume);
        assert_int_equal(v2v_blind_count(volume, SAMPLES), is_left ? PIXELS : 0);
        assert_true(v2v_fusion_averaging(fusion) != NULL);
        v2v_fusion_destroy(&fusion);
    }
}

int main(void)
{
#define TEST(test) cmocka_unit_test_setup_teardown(test, setup_scene, teardown)
    const struct CMUnitTest tests[] = {
        TEST(a_dead_view_is_as_none),
        TEST(a_dead_view_is_as_none_where_samples_have_weights),
        TEST(the_outside_of_an_aperture_costs_nothing),
        TEST(richardson_lucy_leaves_a_dead_view_out),
        TEST(averaged_frames_keep_the_mark),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
