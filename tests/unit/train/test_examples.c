/* Samples of networks that are taught by examples of other kinds than lessons: what goes in and
 * what should come out are of the same place and frame, however they are mirrored. */
#include "small_run.h"

#include "train/sampler.h"
#include "v2v3d/base/log.h"

#include <math.h>
#include <string.h>

enum { CROP = 32, PIXELS = CROP * CROP, CODE = 32768, FIRST = 4, DRAWN = 60 };
enum { OF_FRAMES = 1, GAIN = 2 };

static const struct v2v_sample_sides sides = {.unit = 32, .crop = 64};
static float sample[(VIEWS + SLICES) * PIXELS];

/* Frame, image and place of a sample, exact in float32; frames are about alike bright. */
static float code(int t, int64_t i)
{
    return (float)((FIRST + t) * CODE + i);
}

struct place {
    int64_t t, image, y, x;
};

static struct place decode(float value)
{
    const int64_t all = (int64_t)value, i = all % CODE;
    return (struct place){all / CODE - FIRST, i / SIDE / SIDE, i / SIDE % SIDE, i % SIDE};
}

/* A tilt along y (views 1 and 2) and one along x (3 and 4): each axis' flip exchanges its pair.
 * @param off pixels that the whole set lies down and right of its centre */
static void make_symmetric(struct v2v_psf_file *psf, int off)
{
    static const int tilt_y[VIEWS] = {0, 1, -1, 0, 0}, tilt_x[VIEWS] = {0, 0, 0, 1, -1};
    memset(psf->data, 0, VIEWS * SLICES * KERNEL * KERNEL * sizeof *psf->data);
    for (int v = 0; v < VIEWS; v++) {
        for (int z = 0; z < SLICES; z++) {
            int y = KERNEL / 2 + off + tilt_y[v] * (z - 1);
            int x = KERNEL / 2 + off + tilt_x[v] * (z - 1);
            psf->data[((v * SLICES + z) * KERNEL + y) * KERNEL + x] = 1.0f / SLICES;
        }
    }
}

static const int64_t partner[2][VIEWS] = {{0, 2, 1, 3, 4}, {0, 1, 2, 4, 3}};

static void setup(struct scene *scene)
{
    v2v_log_configure(V2V_LOG_WARNING, 0);
    scene_init(scene, test_folder(NULL), 1, NULL);
    make_symmetric(&scene->psf, 0);
    scene->config.input.offset = (struct v2v_number){V2V_NUMBER_NONE, 0.0};
    scene->config.input.gain = (struct v2v_number){V2V_NUMBER_GIVEN, GAIN};
    scene_record(scene, "recording.h5", code);
}

/* Coded as the recording is, slices in the place of views; of any number of frames and slices.
 * @param unit what voxels are multiplied by */
static struct v2v_volume *write_truth(const struct scene *scene, int64_t frames, int64_t slices,
                                      float unit)
{
    static float volume[(SLICES + 1) * SIDE * SIDE];
    char path[PATH];
    struct v2v_volume_writer *writer = NULL;
    struct v2v_volume *truth = NULL;
    const struct v2v_volume_info info = {
        .frames = frames, .slices = slices, .height = SIDE, .width = SIDE};
    snprintf(path, sizeof path, "%s/truth.h5", scene->folder);
    assert_ok(v2v_volume_create(&writer, path, &info, 1u << V2V_VOLUME_MEAN, NULL, 0, scene->comm));
    for (int t = 0; t < frames; t++) {
        for (int64_t i = 0; i < slices * SIDE * SIDE; i++) {
            volume[i] = unit * code(t, i);
        }
        assert_ok(v2v_volume_write(writer, V2V_VOLUME_MEAN, volume, t, 0, slices));
    }
    assert_ok(v2v_volume_finish(&writer));
    assert_ok(v2v_volume_open(&truth, path, NULL, scene->comm));
    return truth;
}

/* The flips of a sample, as bits, told by its first view; then all pixels must agree with them.
 * @param still the truth has one frame, for all */
static int check_pair(int still)
{
    const struct place first = decode(sample[0] / GAIN), last = decode(sample[PIXELS - 1] / GAIN);
    const int flip[2] = {first.y > last.y, first.x > last.x};
    for (int64_t i = 0; i < (VIEWS + SLICES) * PIXELS; i++) {
        const struct place at = decode(sample[i] / GAIN);
        const int64_t y = i / CROP % CROP, x = i % CROP;
        int64_t image = i / PIXELS;
        assert_int_equal(at.y, flip[0] ? first.y - y : first.y + y);
        assert_int_equal(at.x, flip[1] ? first.x - x : first.x + x);
        if (image < VIEWS) {
            image = flip[0] ? partner[0][image] : image;
            image = flip[1] ? partner[1][image] : image;
            assert_int_equal(at.t, first.t);
        } else {
            image -= VIEWS;
            assert_int_equal(at.t, still ? 0 : first.t);
        }
        assert_int_equal(at.image, image);
    }
    return flip[0] | flip[1] << 1;
}

static void check_truths(int64_t frames)
{
    char run[PATH];
    struct scene scene;
    struct v2v_sampler *sampler = NULL;
    unsigned seen = 0;
    setup(&scene);
    struct v2v_volume *truth = write_truth(&scene, frames, SLICES, 1.0f);
    struct v2v_train_job job = scene_job(&scene, run, "run");
    job.truths = &truth;
    assert_ok(v2v_sampler_create(&sampler, &job, sides, &v2v_examples_truth, NULL));
    assert_int_equal(v2v_sampler_images(sampler), VIEWS + SLICES);
    for (int64_t step = 0; step < DRAWN; step++) {
        assert_ok(v2v_sampler_draw(sampler, sample, step, 0));
        seen |= 1u << check_pair(frames == OF_FRAMES);
    }
    assert_int_equal(seen, 15); /* all four ways to mirror */
    v2v_sampler_destroy(&sampler);
    v2v_volume_close(&truth);
    scene_fini(&scene);
}

static void views_and_their_volume_are_cut_and_mirrored_together(void **state)
{
    (void)state;
    check_truths(FRAMES);
}

static void a_volume_of_one_frame_is_that_of_all(void **state)
{
    (void)state;
    check_truths(OF_FRAMES);
}

/* Mean of the codes of so many images of frame t. */
static double mean_code(int64_t t, int64_t images)
{
    return (double)(FIRST + t) * CODE + ((double)(images * SIDE * SIDE) - 1.0) / 2.0;
}

/* Voxels of a thousandth of their views' light, as beside counts: they come in the views' units. */
static void a_volume_in_other_units_comes_in_those_of_its_views(void **state)
{
    (void)state;
    char run[PATH];
    struct scene scene;
    struct v2v_sampler *sampler = NULL;
    const float unit = 1e-3f;
    setup(&scene);
    scene.config.train.flips = 0;
    struct v2v_volume *truth = write_truth(&scene, FRAMES, SLICES, unit);
    struct v2v_train_job job = scene_job(&scene, run, "run");
    job.truths = &truth;
    assert_ok(v2v_sampler_create(&sampler, &job, sides, &v2v_examples_truth, NULL));
    for (int64_t step = 0; step < DRAWN; step++) {
        assert_ok(v2v_sampler_draw(sampler, sample, step, 0));
        const struct place first = decode(sample[0] / GAIN);
        /* PSFs sum to 1 a view; of all frames, whose means go in a straight line */
        const double ratio = (mean_code(0, VIEWS) + mean_code(FRAMES - 1, VIEWS)) /
                             (mean_code(0, SLICES) + mean_code(FRAMES - 1, SLICES));
        for (int64_t i = 0; i < SLICES * PIXELS; i++) {
            const int64_t y = first.y + i / CROP % CROP, x = first.x + i % CROP;
            const int64_t at = (i / PIXELS * SIDE + y) * SIDE + x;
            const double expected = GAIN * ratio * (double)code((int)first.t, at);
            /* the unit, the product with it and the scale round to 2^-24 each */
            assert_true(fabs((double)sample[VIEWS * PIXELS + i] - expected) <=
                        4.0 * 0x1p-24 * expected);
        }
    }
    v2v_sampler_destroy(&sampler);
    v2v_volume_close(&truth);
    scene_fini(&scene);
}

static void a_volume_of_other_slices_is_refused(void **state)
{
    (void)state;
    char run[PATH];
    struct scene scene;
    struct v2v_sampler *sampler = NULL;
    setup(&scene);
    struct v2v_volume *truth = write_truth(&scene, FRAMES, SLICES + 1, 1.0f);
    struct v2v_train_job job = scene_job(&scene, run, "run");
    job.truths = &truth;
    assert_int_equal(v2v_sampler_create(&sampler, &job, sides, &v2v_examples_truth, NULL),
                     V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "truth 1"));
    v2v_volume_close(&truth);
    scene_fini(&scene);
}

/* ---- flips that move the volume ---- */

static float volume_of(int t, int64_t i)
{
    return (float)v2v_random_uniform(11, (uint64_t)t, (uint64_t)i);
}

static float projections[FRAMES][VIEWS * SIDE * SIDE];

static float projection_of(int t, int64_t i)
{
    return projections[t][i];
}

static void project(float *views, const float *volume, const struct v2v_psf_file *psf, int64_t side)
{
    struct v2v_projector *projector = NULL;
    assert_ok(v2v_projector_create(&projector, psf, side, side, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, views, volume, NULL, VIEWS, 1.0f);
    v2v_projector_destroy(&projector);
}

/* Whatever is mirrored, the volume of a sample makes its views, but within a kernel's reach of the
 * crop's edges: in float32 to the rounding of transforms, far below the values' spread of 1. */
static void check_projections(int off)
{
    enum { RING = KERNEL };
    static float volume[SLICES * SIDE * SIDE], made[VIEWS * PIXELS];
    char run[PATH];
    struct scene scene;
    struct v2v_sampler *sampler = NULL;
    int64_t flipped = 0;
    v2v_log_configure(V2V_LOG_WARNING, 0);
    scene_init(&scene, test_folder(NULL), 1, NULL);
    make_symmetric(&scene.psf, off);
    scene.config.input.gain = (struct v2v_number){V2V_NUMBER_GIVEN, 1.0};
    scene.config.train.flip_tolerance = 1e-3;
    for (int t = 0; t < FRAMES; t++) {
        for (int64_t i = 0; i < SLICES * SIDE * SIDE; i++) {
            volume[i] = volume_of(t, i);
        }
        project(projections[t], volume, &scene.psf, SIDE);
    }
    scene_record(&scene, "recording.h5", projection_of);
    scene_truth(&scene, volume_of);
    struct v2v_train_job job = scene_job(&scene, run, "run");
    assert_ok(v2v_sampler_create(&sampler, &job, sides, &v2v_examples_truth, NULL));
    for (int64_t step = 0; step < DRAWN; step++) {
        assert_ok(v2v_sampler_draw(sampler, sample, step, 0));
        project(made, sample + VIEWS * PIXELS, &scene.psf, CROP);
        for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
            const int64_t y = i / CROP % CROP, x = i % CROP;
            if (y >= RING && y < CROP - RING && x >= RING && x < CROP - RING) {
                assert_true(fabsf(made[i] - sample[i]) < 1e-4f);
            }
        }
        scene.config.train.flips = 0; /* the same sample as it would be without */
        static float plain[(VIEWS + SLICES) * PIXELS];
        struct v2v_sampler *other = NULL;
        assert_ok(v2v_sampler_create(&other, &job, sides, &v2v_examples_truth, NULL));
        assert_ok(v2v_sampler_draw(other, plain, step, 0));
        flipped += memcmp(plain, sample, sizeof plain) != 0;
        v2v_sampler_destroy(&other);
        scene.config.train.flips = 1;
    }
    assert_in_range(flipped, DRAWN / 3, DRAWN); /* of three in four, those that stay in the frame */
    v2v_sampler_destroy(&sampler);
    scene_fini(&scene);
}

static void mirrored_volumes_make_the_mirrored_views(void **state)
{
    (void)state;
    check_projections(0);
    check_projections(1); /* a set off its centre: the volume moves */
    check_projections(-1);
}

/* One frame in, the next one out, of one view, wherever the first lies. */
static void odd_frames_go_in_and_even_ones_should_come_out(void **state)
{
    (void)state;
    char run[PATH];
    struct scene scene;
    struct v2v_sampler *sampler = NULL;
    unsigned views = 0;
    setup(&scene);
    scene.config.deepcad.frames = FRAMES / 2;
    struct v2v_train_job job = scene_job(&scene, run, "run");
    assert_ok(v2v_sampler_create(&sampler, &job, sides, &v2v_examples_odd_even, NULL));
    assert_int_equal(v2v_sampler_images(sampler), FRAMES);
    for (int64_t step = 0; step < DRAWN; step++) {
        assert_ok(v2v_sampler_draw(sampler, sample, step, 0));
        for (int64_t i = 0; i < PIXELS; i++) {
            const struct place in = decode(sample[i] / GAIN);
            const struct place out = decode(sample[PIXELS + i] / GAIN);
            assert_int_equal(in.t, 0);
            assert_int_equal(out.t, 1);
            assert_true(in.image == out.image && in.y == out.y && in.x == out.x);
            views |= 1u << in.image;
        }
    }
    assert_int_equal(views, (1u << VIEWS) - 1);
    v2v_sampler_destroy(&sampler);
    scene_fini(&scene);
}

/* Of six frames: two in, two out, from frame 0, 1 or 2 on, alternating. */
static void stacks_begin_at_every_frame_that_leaves_room(void **state)
{
    (void)state;
    enum { LONG = 6, STACK = 2 };
    char run[PATH], path[PATH];
    struct scene scene;
    struct v2v_sampler *sampler = NULL;
    struct v2v_recording *recording = NULL;
    struct v2v_recording_writer *writer = NULL;
    static float views[VIEWS * SIDE * SIDE];
    const struct v2v_recording_info info = {
        .frames = LONG, .views = VIEWS, .height = SIDE, .width = SIDE};
    const struct v2v_input_settings input = {.views = VIEWS};
    unsigned starts = 0;
    setup(&scene);
    snprintf(path, sizeof path, "%s/long.h5", scene.folder);
    assert_ok(v2v_recording_create(&writer, path, &info, NULL));
    for (int t = 0; t < LONG; t++) {
        for (int64_t i = 0; i < VIEWS * SIDE * SIDE; i++) {
            views[i] = code(t, i);
        }
        assert_ok(v2v_recording_write(writer, views, t, 0, VIEWS));
    }
    assert_ok(v2v_recording_finish(&writer));
    assert_ok(v2v_recording_open(&recording, path, &input, NULL));
    scene.config.deepcad.frames = STACK;
    struct v2v_train_job job = scene_job(&scene, run, "run");
    job.recordings = &recording;
    assert_ok(v2v_sampler_create(&sampler, &job, sides, &v2v_examples_odd_even, NULL));
    for (int64_t step = 0; step < DRAWN; step++) {
        assert_ok(v2v_sampler_draw(sampler, sample, step, 0));
        const int64_t first = decode(sample[0] / GAIN).t;
        assert_int_equal(decode(sample[PIXELS] / GAIN).t, first + 2);
        assert_int_equal(decode(sample[2 * PIXELS] / GAIN).t, first + 1);
        assert_int_equal(decode(sample[3 * PIXELS] / GAIN).t, first + 3);
        starts |= 1u << first;
    }
    assert_int_equal(starts, 7);
    v2v_sampler_destroy(&sampler);
    v2v_recording_close(&recording);
    scene_fini(&scene);
}

static void recordings_with_too_few_frames_are_refused(void **state)
{
    (void)state;
    char run[PATH];
    struct scene scene;
    struct v2v_sampler *sampler = NULL;
    setup(&scene);
    scene.config.deepcad.frames = FRAMES / 2 + 1;
    struct v2v_train_job job = scene_job(&scene, run, "run");
    assert_int_equal(v2v_sampler_create(&sampler, &job, sides, &v2v_examples_odd_even, NULL),
                     V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "takes 4 or more"));
    scene_fini(&scene);
}

/* The example of examples.h. */
static enum v2v_status header_example(float *first, const struct scene *scene,
                                      const struct v2v_network_ops *network, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_example_source source = {.recording = scene->recording,
                                              .scaling = {.gain = 1.0},
                                              .truth = scene->truth,
                                              .units = 1.0};
    struct v2v_examples *examples = NULL;
    float *images = NULL;
    int64_t count = 0;
    V2V_TRY(v2v_examples_create(&examples, network->examples, &scene->config, &scene->psf));
    count = (examples->inputs + examples->outputs) * scene->height * scene->width;
    V2V_TRY(V2V_ALLOC(images, "images", count));
    V2V_TRY(examples->ops->make(examples, images, &source, t, 0));
    *first = images[0];
done:
    v2v_mem_free(images);
    v2v_examples_destroy(&examples);
    return rc;
}

static void header_example_makes_an_example(void **state)
{
    (void)state;
    struct scene scene;
    const struct v2v_network_ops *network = NULL;
    float first = 0.0f;
    setup(&scene);
    scene_truth(&scene, code);
    assert_ok(v2v_network_find(&network, "vcdnet"));
    assert_ok(header_example(&first, &scene, network, 1));
    assert_true(first == code(1, 0));
    scene_fini(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(views_and_their_volume_are_cut_and_mirrored_together),
        cmocka_unit_test(a_volume_of_one_frame_is_that_of_all),
        cmocka_unit_test(a_volume_in_other_units_comes_in_those_of_its_views),
        cmocka_unit_test(a_volume_of_other_slices_is_refused),
        cmocka_unit_test(mirrored_volumes_make_the_mirrored_views),
        cmocka_unit_test(odd_frames_go_in_and_even_ones_should_come_out),
        cmocka_unit_test(stacks_begin_at_every_frame_that_leaves_room),
        cmocka_unit_test(recordings_with_too_few_frames_are_refused),
        cmocka_unit_test(header_example_makes_an_example),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
