/* Samples are where the random numbers say, whoever draws them, in whatever order. */
#include "small_run.h"

#include "train/sampler.h"
#include "v2v3d/base/log.h"

#include <string.h>

enum { CROP = 32, PIXELS = CROP * CROP, CODE = 32768, BATCH = 3 };
enum {
    DRAW_FRAME,
    DRAW_Y,
    DRAW_X,
    DRAW_FLIP_Y,
    DRAW_FLIP_X
}; /* streams' counters, as saved runs
      rely on them */

static const struct v2v_sample_sides sides = {.unit = 32, .crop = 64};

/* Frame and place of a sample, exact in float32. */
static float code(int t, int64_t i)
{
    return (float)(t * CODE + i);
}

/* Tilted to both sides along y (views 1 and 2) and along x (3 and 4): each axis' flip exchanges its
 * pair. */
static void make_symmetric(struct v2v_psf_file *psf)
{
    static const int tilt_y[VIEWS] = {0, 1, -1, 0, 0}, tilt_x[VIEWS] = {0, 0, 0, 1, -1};
    memset(psf->data, 0, VIEWS * SLICES * KERNEL * KERNEL * sizeof *psf->data);
    for (int v = 0; v < VIEWS; v++) {
        for (int z = 0; z < SLICES; z++) {
            int y = KERNEL / 2 + tilt_y[v] * (z - 1), x = KERNEL / 2 + tilt_x[v] * (z - 1);
            psf->data[((v * SLICES + z) * KERNEL + y) * KERNEL + x] = 1.0f;
        }
    }
}

static const int32_t partner[2][VIEWS] = {{0, 2, 1, 3, 4}, {0, 1, 2, 4, 3}};

static void setup(struct scene *scene)
{
    v2v_log_configure(V2V_LOG_WARNING, 0);
    scene_init(scene, test_folder(NULL), BATCH, NULL);
    scene->config.input.offset = (struct v2v_number){V2V_NUMBER_NONE, 0.0};
    scene->config.input.gain = (struct v2v_number){V2V_NUMBER_GIVEN, 1.0};
}

static struct v2v_sampler *create(struct scene *scene)
{
    char run[PATH];
    struct v2v_sampler *sampler = NULL;
    struct v2v_train_job job = scene_job(scene, run, "run");
    assert_ok(v2v_sampler_create(&sampler, &job, sides, NULL, NULL));
    return sampler;
}

static int64_t draw(const struct scene *scene, int64_t stream, int what, int64_t below)
{
    uint64_t seed = (uint64_t)scene->config.train.seed;
    return v2v_random_below(seed, (uint64_t)stream, (uint64_t)what, below);
}

/* What sample `index` of step `step` must be; the number of flips in it. */
static int check_sample(const struct scene *scene, const float *views, int64_t step, int64_t index,
                        int symmetric)
{
    int64_t stream = step * BATCH + index;
    int64_t t = draw(scene, stream, DRAW_FRAME, FRAMES);
    int64_t y0 = draw(scene, stream, DRAW_Y, SIDE - CROP + 1);
    int64_t x0 = draw(scene, stream, DRAW_X, SIDE - CROP + 1);
    int flip_y = symmetric && draw(scene, stream, DRAW_FLIP_Y, 2) == 1;
    int flip_x = symmetric && draw(scene, stream, DRAW_FLIP_X, 2) == 1;
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        int64_t v = i / PIXELS, y = i / CROP % CROP, x = i % CROP;
        v = flip_y ? partner[0][v] : v;
        v = flip_x ? partner[1][v] : v;
        y = y0 + (flip_y ? CROP - 1 - y : y);
        x = x0 + (flip_x ? CROP - 1 - x : x);
        assert_true(views[i] == code((int)t, (v * SIDE + y) * SIDE + x));
    }
    return flip_y + flip_x;
}

static void check_samples(int symmetric)
{
    static float views[VIEWS * PIXELS];
    struct scene scene;
    int flips = 0;
    setup(&scene);
    if (symmetric) {
        make_symmetric(&scene.psf);
    }
    scene_record(&scene, "recording.h5", code);
    struct v2v_sampler *sampler = create(&scene);
    assert_int_equal(v2v_sampler_height(sampler), CROP);
    assert_int_equal(v2v_sampler_width(sampler), CROP);
    for (int64_t step = 0; step < 10; step++) {
        for (int64_t index = 0; index < BATCH; index++) {
            assert_ok(v2v_sampler_draw(sampler, views, step, index));
            flips += check_sample(&scene, views, step, index, symmetric);
        }
    }
    assert_true(symmetric ? flips > 0 : flips == 0);
    v2v_sampler_destroy(&sampler);
    scene_fini(&scene);
}

static void crops_lie_where_the_random_numbers_say(void **state)
{
    (void)state;
    check_samples(0);
}

static void flips_exchange_the_views_with_their_partners(void **state)
{
    (void)state;
    check_samples(1);
}

/* The brightest of a hundred positions is the brightest of all but a hundredth: codes grow with y,
 * then x, so that the crop lies in the lowest rows. */
static void of_several_candidates_the_brightest_becomes_the_crop(void **state)
{
    (void)state;
    static float views[VIEWS * PIXELS];
    struct scene scene;
    setup(&scene);
    scene.config.train.candidates = 100;
    scene_record(&scene, "recording.h5", code);
    struct v2v_sampler *sampler = create(&scene);
    for (int64_t step = 0; step < 10; step++) {
        int64_t lowest = 0, stream = step * BATCH;
        for (int64_t i = 0; i < 100; i++) {
            /* five counters a candidate, as saved runs rely on */
            int64_t y = draw(&scene, stream, (int)(5 * i + DRAW_Y), SIDE - CROP + 1);
            lowest = y > lowest ? y : lowest;
        }
        assert_ok(v2v_sampler_draw(sampler, views, step, 0));
        assert_int_equal((int64_t)views[0] % CODE / SIDE, lowest);
    }
    v2v_sampler_destroy(&sampler);
    scene_fini(&scene);
}

static void unwanted_flips_are_not_drawn(void **state)
{
    (void)state;
    static float views[VIEWS * PIXELS];
    struct scene scene;
    setup(&scene);
    make_symmetric(&scene.psf);
    scene.config.train.flips = 0;
    scene_record(&scene, "recording.h5", code);
    struct v2v_sampler *sampler = create(&scene);
    for (int64_t step = 0; step < 5; step++) {
        assert_ok(v2v_sampler_draw(sampler, views, step, 0));
        assert_int_equal(check_sample(&scene, views, step, 0, 0), 0);
    }
    v2v_sampler_destroy(&sampler);
    scene_fini(&scene);
}

static void samples_do_not_depend_on_the_order_of_drawing(void **state)
{
    (void)state;
    enum { STEPS = 4 };
    static float forth[STEPS][VIEWS * PIXELS], back[VIEWS * PIXELS];
    struct scene scene;
    setup(&scene);
    make_symmetric(&scene.psf);
    scene_record(&scene, "recording.h5", code);
    struct v2v_sampler *one = create(&scene), *other = create(&scene);
    for (int step = 0; step < STEPS; step++) {
        assert_ok(v2v_sampler_draw(one, forth[step], step, 1));
    }
    for (int step = STEPS - 1; step >= 0; step--) {
        assert_ok(v2v_sampler_draw(other, back, step, 1));
        assert_memory_equal(back, forth[step], sizeof back);
    }
    assert_memory_not_equal(forth[0], forth[1], sizeof back);
    v2v_sampler_destroy(&one);
    v2v_sampler_destroy(&other);
    scene_fini(&scene);
}

static int64_t mirrored(int64_t i, int64_t n)
{
    return i < n ? i : 2 * (n - 1) - i;
}

static void whole_frames_are_reflected_to_multiples_of_32(void **state)
{
    (void)state;
    enum { HEIGHT = 40, WIDTH = 33, PADDED = 64 };
    static float views[VIEWS * PADDED * PADDED];
    struct scene scene;
    setup(&scene);
    make_symmetric(&scene.psf);
    scene.config.train.crop = 0;
    scene.height = HEIGHT;
    scene.width = WIDTH;
    scene_record(&scene, "recording.h5", code);
    struct v2v_sampler *sampler = create(&scene);
    struct v2v_window window = v2v_sampler_window(sampler);
    const struct v2v_window expected = {0, HEIGHT, 0, WIDTH};
    assert_memory_equal(&window, &expected, sizeof window);
    assert_int_equal(v2v_sampler_height(sampler), PADDED);
    assert_int_equal(v2v_sampler_width(sampler), PADDED);
    for (int64_t step = 0; step < 5; step++) {
        assert_ok(v2v_sampler_draw(sampler, views, step, 0));
        int t = (int)draw(&scene, step * BATCH, DRAW_FRAME, FRAMES);
        for (int64_t i = 0; i < VIEWS * PADDED * PADDED; i++) {
            int64_t y = mirrored(i / PADDED % PADDED, HEIGHT), x = mirrored(i % PADDED, WIDTH);
            assert_true(views[i] == code(t, (i / PADDED / PADDED * HEIGHT + y) * WIDTH + x));
        }
    }
    v2v_sampler_destroy(&sampler);
    scene_fini(&scene);
}

static void the_window_leaves_the_halo_out(void **state)
{
    (void)state;
    struct scene scene;
    setup(&scene);
    scene_record(&scene, "recording.h5", code);
    struct v2v_sampler *sampler = create(&scene);
    struct v2v_window window = v2v_sampler_window(sampler);
    const struct v2v_window expected = {4, CROP - 4, 4, CROP - 4};
    assert_memory_equal(&window, &expected, sizeof window);
    v2v_sampler_destroy(&sampler);
    scene_fini(&scene);
}

/* Frames, what a network asks, and what its samples are then. */
struct open_size {
    int64_t frame[2]; /* y, x */
    struct v2v_sample_sides sides;
    int64_t halo;
    int64_t sample[2];
    struct v2v_window window;
};

/* A side has the network's size, or the multiples of the unit that the frame has; where nothing of
 * such a crop counts, it is the frame, padded. */
static void a_crop_that_is_left_open_is_as_large_as_the_frame_allows(void **state)
{
    (void)state;
    static const struct open_size sizes[] = {
        {{64, 64}, {2, 64}, 0, {64, 64}, {0, 64, 0, 64}},
        {{65, 70}, {2, 64}, 0, {64, 64}, {0, 64, 0, 64}},
        {{40, 60}, {2, 64}, 0, {40, 60}, {0, 40, 0, 60}},
        {{33, 90}, {2, 64}, 0, {32, 64}, {0, 32, 0, 64}},
        {{63, 63}, {2, 64}, 0, {62, 62}, {0, 62, 0, 62}},
        {{100, 90}, {32, 128}, 16, {96, 64}, {16, 80, 16, 48}},
        {{40, 60}, {32, 128}, 16, {64, 64}, {0, 40, 0, 60}}, /* 32 are halo */
        {{20, 40}, {32, 128}, 0, {32, 64}, {0, 20, 0, 40}},
        {{1, 40}, {2, 64}, 0, {2, 40}, {0, 1, 0, 40}},
    };
    struct scene scene;
    setup(&scene);
    scene.config.train.crop = V2V_WHOLE_AUTO;
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        const struct open_size *size = &sizes[i];
        char run[PATH];
        struct v2v_sampler *sampler = NULL;
        float *views = NULL;
        scene.config.train.halo = size->halo;
        scene.height = size->frame[0];
        scene.width = size->frame[1];
        scene_record(&scene, "recording.h5", scene_wave);
        struct v2v_train_job job = scene_job(&scene, run, "run");
        assert_ok(v2v_sampler_create(&sampler, &job, size->sides, NULL, NULL));
        const struct v2v_window window = v2v_sampler_window(sampler);
        assert_int_equal(v2v_sampler_height(sampler), size->sample[0]);
        assert_int_equal(v2v_sampler_width(sampler), size->sample[1]);
        assert_memory_equal(&window, &size->window, sizeof window);
        assert_ok(V2V_ALLOC(views, "test", VIEWS * size->sample[0] * size->sample[1]));
        assert_ok(v2v_sampler_draw(sampler, views, 0, 0));
        v2v_mem_free(views);
        v2v_sampler_destroy(&sampler);
    }
    scene_fini(&scene);
}

/* The same bits as of a crop that was asked for. */
static void a_crop_that_is_left_open_is_the_same_where_it_fits(void **state)
{
    (void)state;
    static float asked[VIEWS * PIXELS], left_open[VIEWS * PIXELS];
    struct scene scene;
    char run[PATH];
    struct v2v_sampler *sampler[2] = {NULL};
    setup(&scene);
    scene_record(&scene, "recording.h5", code);
    for (int i = 0; i < 2; i++) {
        struct v2v_train_job job = scene_job(&scene, run, "run");
        scene.config.train.crop = i == 0 ? CROP : V2V_WHOLE_AUTO;
        assert_ok(
            v2v_sampler_create(&sampler[i], &job, (struct v2v_sample_sides){2, CROP}, NULL, NULL));
    }
    for (int64_t step = 0; step < 5; step++) {
        assert_ok(v2v_sampler_draw(sampler[0], asked, step, 0));
        assert_ok(v2v_sampler_draw(sampler[1], left_open, step, 0));
        assert_memory_equal(asked, left_open, sizeof asked);
    }
    v2v_sampler_destroy(&sampler[0]);
    v2v_sampler_destroy(&sampler[1]);
    scene_fini(&scene);
}

static void a_halo_that_leaves_nothing_is_refused(void **state)
{
    (void)state;
    struct scene scene;
    char run[PATH];
    struct v2v_sampler *sampler = NULL;
    setup(&scene);
    scene.config.train.crop = V2V_WHOLE_AUTO;
    scene.config.train.halo = 32;
    scene_record(&scene, "recording.h5", code);
    struct v2v_train_job job = scene_job(&scene, run, "run");
    assert_int_equal(v2v_sampler_create(&sampler, &job, sides, NULL, NULL), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "train.halo: 32 leaves nothing of"));
    scene_fini(&scene);
}

static void check_refused(struct scene *scene, const char *word)
{
    char run[PATH];
    struct v2v_sampler *sampler = NULL;
    struct v2v_train_job job = scene_job(scene, run, "run");
    assert_int_equal(v2v_sampler_create(&sampler, &job, sides, NULL, NULL), V2V_E_INPUT);
    assert_null(sampler);
    assert_non_null(strstr(v2v_status_message(), word));
}

static void recordings_that_do_not_fit_are_refused(void **state)
{
    (void)state;
    struct scene scene;
    setup(&scene);
    scene.height = CROP - 1;
    scene_record(&scene, "low.h5", code);
    check_refused(&scene, "train.crop");
    scene.height = CROP;
    scene.width = CROP - 1;
    scene_record(&scene, "narrow.h5", code);
    check_refused(&scene, "train.crop");
    scene.width = CROP;
    scene_record(&scene, "good.h5", code);
    scene.psf.views = VIEWS - 1;
    check_refused(&scene, "views");
    scene.psf.views = VIEWS;
    scene_fini(&scene);
}

static void both_recordings_are_drawn_from(void **state)
{
    (void)state;
    static float views[VIEWS * PIXELS];
    struct scene scene;
    char run[PATH];
    setup(&scene);
    scene_record(&scene, "one.h5", code);
    struct v2v_recording *one = scene.recording;
    struct v2v_sampler *sampler = NULL;
    scene.recording = NULL;
    scene.height = scene.width = CROP; /* the crop is the frame */
    scene_record(&scene, "two.h5", code);
    struct v2v_recording *const both[] = {one, scene.recording};
    struct v2v_train_job job = scene_job(&scene, run, "run");
    job.recordings = both;
    job.recording_count = 2;
    assert_ok(v2v_sampler_create(&sampler, &job, sides, NULL, NULL));
    int from_two = 0;
    for (int64_t step = 0; step < 20; step++) {
        int64_t frame = draw(&scene, step * BATCH, DRAW_FRAME, 2 * FRAMES);
        assert_ok(v2v_sampler_draw(sampler, views, step, 0));
        if (frame >= FRAMES) {
            from_two++;
            assert_true(views[VIEWS * PIXELS - 1] == code((int)frame - FRAMES, VIEWS * PIXELS - 1));
        }
    }
    assert_in_range(from_two, 1, 19);
    v2v_sampler_destroy(&sampler);
    v2v_recording_close(&one);
    scene_fini(&scene);
}

static float brighter_by_frame(int t, int64_t i)
{
    return (float)(1 << t) * (float)(1 + i % 7);
}

/* Powers of two: the same bits. */
static void frames_of_a_homogeneous_network_have_one_level(void **state)
{
    (void)state;
    static float first[VIEWS * PIXELS], views[VIEWS * PIXELS];
    struct scene scene;
    setup(&scene);
    scene.config.model.homogeneous = 1;
    scene.height = scene.width = CROP; /* the crop is the frame */
    scene_record(&scene, "recording.h5", brighter_by_frame);
    struct v2v_sampler *sampler = create(&scene);
    int64_t frames = 0;
    assert_ok(v2v_sampler_draw(sampler, first, 0, 0));
    for (int64_t step = 0; step < 20; step++) {
        frames |= 1 << draw(&scene, step * BATCH, DRAW_FRAME, FRAMES);
        assert_ok(v2v_sampler_draw(sampler, views, step, 0));
        assert_memory_equal(first, views, sizeof views);
    }
    assert_true(frames > 2); /* more than one */
    v2v_sampler_destroy(&sampler);
    scene_fini(&scene);
}

/* The example of train.h. */
static enum v2v_status header_example(struct v2v_train_report *report, struct scene *scene,
                                      const char *folder, struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_train_job job = {.config = &scene->config,
                                .psf = &scene->psf,
                                .recordings = &scene->recording,
                                .recording_count = 1,
                                .folder = folder};
    V2V_TRY(v2v_train_run(&job, report, comm));
done:
    return rc;
}

static void header_example_trains(void **state)
{
    (void)state;
    struct scene scene;
    struct v2v_train_report report;
    setup(&scene);
    scene_record(&scene, "recording.h5", scene_wave);
    scene.config.train.steps = 2;
    assert_ok(header_example(&report, &scene, scene.folder, NULL));
    assert_int_equal(report.steps, 2);
    assert_true(isfinite(report.last_total) && report.last_total > 0.0);
    scene_fini(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(crops_lie_where_the_random_numbers_say),
        cmocka_unit_test(flips_exchange_the_views_with_their_partners),
        cmocka_unit_test(of_several_candidates_the_brightest_becomes_the_crop),
        cmocka_unit_test(unwanted_flips_are_not_drawn),
        cmocka_unit_test(samples_do_not_depend_on_the_order_of_drawing),
        cmocka_unit_test(whole_frames_are_reflected_to_multiples_of_32),
        cmocka_unit_test(the_window_leaves_the_halo_out),
        cmocka_unit_test(a_crop_that_is_left_open_is_as_large_as_the_frame_allows),
        cmocka_unit_test(a_crop_that_is_left_open_is_the_same_where_it_fits),
        cmocka_unit_test(a_halo_that_leaves_nothing_is_refused),
        cmocka_unit_test(recordings_that_do_not_fit_are_refused),
        cmocka_unit_test(both_recordings_are_drawn_from),
        cmocka_unit_test(frames_of_a_homogeneous_network_have_one_level),
        cmocka_unit_test(header_example_trains),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
