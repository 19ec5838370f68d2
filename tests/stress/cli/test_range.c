/* Recordings of any size of number, and of none: training and reconstruction stay finite. */
#include "small_run.h"

#include "v2v3d/recon/recon.h"
#include "v2v3d/tensor/statistics.h"

#include <string.h>

enum {
    STEPS = 3,
    PIXELS = SIDE * SIDE,
    VOXELS = SLICES * PIXELS,
    HOT = 2 * PIXELS + 17 * SIDE + 5
};

static double factor;

static float scaled(int t, int64_t i)
{
    return (float)(factor * scene_wave(t, i));
}

static float zero(int t, int64_t i)
{
    (void)t;
    (void)i;
    return 0.0f;
}

static float constant(int t, int64_t i)
{
    (void)t;
    (void)i;
    return 100.0f;
}

static float hot_pixel(int t, int64_t i)
{
    return t == 0 && i == HOT ? 1e6f : 100.0f;
}

static float not_a_number(int t, int64_t i)
{
    return t == 1 && i == HOT ? NAN : scene_wave(t, i);
}

static enum v2v_status reconstruct(struct scene *scene, const char *weights, const char *volume)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_scaling scaling;
    const struct v2v_estimator_ops *ops = NULL;
    struct v2v_recon *recon = NULL;
    struct v2v_volume_writer *writer = NULL;
    const struct v2v_problem problem = {.config = &scene->config,
                                        .psf = &scene->psf,
                                        .weights = weights,
                                        .height = SIDE,
                                        .width = SIDE};
    const struct v2v_volume_info info = {
        .frames = FRAMES, .slices = SLICES, .height = SIDE, .width = SIDE};
    V2V_TRY(v2v_estimator_find(&ops, "learned"));
    V2V_TRY(v2v_recon_create(&recon, ops, &problem, FRAMES, NULL));
    V2V_TRY(v2v_scaling_decide(&scaling, scene->recording, &scene->config.input, NULL));
    V2V_TRY(v2v_volume_create(&writer, volume, &info, 1u << V2V_VOLUME_MEAN, NULL, 0, NULL));
    V2V_TRY(v2v_recon_run(recon, scene->recording, &scaling, writer, 0, NULL));
    V2V_TRY(v2v_volume_finish(&writer));
done:
    v2v_volume_abandon(&writer);
    v2v_recon_destroy(&recon);
    return rc;
}

static enum v2v_status train(struct scene *scene, struct v2v_train_report *report)
{
    char run[PATH];
    struct v2v_train_job job = scene_job(scene, run, "run");
    job.force = 1;
    return v2v_train_run(&job, report, NULL);
}

/* Three steps on the scene's recording and a volume by what came out of them. */
static void check_finite(struct scene *scene)
{
    static float slices[VOXELS];
    char weights[PATH], path[PATH];
    struct v2v_train_report report;
    struct v2v_volume *volume = NULL;
    snprintf(weights, sizeof weights, "%s/run/weights.h5", scene->folder);
    snprintf(path, sizeof path, "%s/volume.h5", scene->folder);
    assert_ok(train(scene, &report));
    assert_int_equal(report.steps, STEPS);
    assert_true(isfinite(report.last_total));
    assert_int_equal(scene_step(scene, weights), STEPS);
    assert_ok(reconstruct(scene, weights, path));
    assert_ok(v2v_volume_open(&volume, path, NULL, NULL));
    for (int t = 0; t < FRAMES; t++) {
        assert_ok(v2v_volume_read(volume, slices, t, 0, SLICES));
        assert_int_equal(v2v_first_not_finite(slices, VOXELS), -1);
    }
    v2v_volume_close(&volume);
}

static void setup(struct scene *scene)
{
    scene_init(scene, test_folder(NULL), 1, NULL);
    scene->config.train.steps = STEPS;
}

static void set_gain(struct scene *scene)
{
    scene->config.input.offset = (struct v2v_number){V2V_NUMBER_NONE, 0.0};
    scene->config.input.gain = (struct v2v_number){V2V_NUMBER_GIVEN, 1.0};
}

static void check_scaled(int by_hand)
{
    struct scene scene;
    char name[32];
    setup(&scene);
    if (by_hand) {
        set_gain(&scene);
    }
    for (int power = -6; power <= 6; power += 3) {
        factor = pow(10.0, power);
        snprintf(name, sizeof name, "recording%d.h5", power);
        scene_record(&scene, name, scaled);
        check_finite(&scene);
    }
    scene_fini(&scene);
}

static void recordings_of_any_size_are_scaled_to_one(void **state)
{
    (void)state;
    check_scaled(0);
}

static void recordings_of_any_size_are_taken_as_they_are(void **state)
{
    (void)state;
    check_scaled(1);
}

static void flat_recordings_and_hot_pixels_are_no_trouble(void **state)
{
    (void)state;
    struct scene scene;
    setup(&scene);
    scene_record(&scene, "constant.h5", constant);
    check_finite(&scene);
    scene_record(&scene, "hot.h5", hot_pixel);
    scene.config.input.offset = (struct v2v_number){V2V_NUMBER_NONE, 0.0};
    check_finite(&scene);
    scene_record(&scene, "zero.h5", zero);
    set_gain(&scene);
    check_finite(&scene);
    scene_fini(&scene);
}

static void an_empty_recording_needs_a_gain(void **state)
{
    (void)state;
    struct scene scene;
    struct v2v_train_report report;
    setup(&scene);
    scene_record(&scene, "zero.h5", zero);
    assert_int_equal(train(&scene, &report), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "input.gain"));
    scene_fini(&scene);
}

/* Found when the gain is decided, or when the frame is drawn. */
static void a_nan_is_refused_with_its_place(void **state)
{
    (void)state;
    struct scene scene;
    struct v2v_train_report report;
    setup(&scene);
    scene.config.train.steps = 50; /* frame 1 is drawn among so many */
    scene_record(&scene, "nan.h5", not_a_number);
    for (int by_hand = 0; by_hand < 2; by_hand++) {
        assert_int_equal(train(&scene, &report), V2V_E_INPUT);
        const char *message = v2v_status_message();
        assert_non_null(strstr(message, "nan.h5"));
        assert_non_null(strstr(message, "frame 1, view 2, y 17, x 5"));
        set_gain(&scene);
    }
    scene_fini(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(recordings_of_any_size_are_scaled_to_one),
        cmocka_unit_test(recordings_of_any_size_are_taken_as_they_are),
        cmocka_unit_test(flat_recordings_and_hot_pixels_are_no_trouble),
        cmocka_unit_test(an_empty_recording_needs_a_gain),
        cmocka_unit_test(a_nan_is_refused_with_its_place),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
