/* Samples of a network that is taught by lessons: crops of them, mirrored and transposed, in the
 * order of their steps. */
#include "small_run.h"

#include "method/lessons.h"
#include "train/sampler.h"
#include "v2v3d/base/log.h"

#include <string.h>

enum { IMAGES = 16, PIXELS = SIDE * SIDE, BATCH = 2, SYMMETRIES = 8, STEPS_OF_LESSON = 250 };

static const struct v2v_sample_sides sides = {.unit = 2, .crop = SIDE};
static float lesson[2 * BATCH][IMAGES * PIXELS], sample[IMAGES * PIXELS];

static void setup(struct scene *scene)
{
    v2v_log_configure(V2V_LOG_WARNING, 0);
    scene_init(scene, test_folder(NULL), BATCH, NULL);
    assert_int_equal(v2v_lessons_images(SLICES), IMAGES);
    scene->config.train.crop = SIDE;
    scene->config.train.halo = 0;
    scene->config.train.steps = 2 * STEPS_OF_LESSON;
    scene->config.input.gain = (struct v2v_number){.mode = V2V_NUMBER_NONE};
    scene_record(scene, "recording.h5", scene_wave);
}

/* The lessons that this configuration has, each made from the frame that its number draws. */
static void make_lessons(struct scene *scene)
{
    struct v2v_lessons *lessons = NULL;
    const struct v2v_scaling scaling = {.gain = 1.0};
    assert_ok(v2v_lessons_create(&lessons, &scene->config, &scene->psf));
    for (int i = 0; i < 2 * BATCH; i++) {
        const uint64_t stream = v2v_random_fnv1a64("lessons") + (uint64_t)i;
        const int64_t t = v2v_random_below((uint64_t)scene->config.train.seed, stream, 0, FRAMES);
        assert_ok(v2v_lessons_make(lessons, lesson[i], scene->recording, &scaling, t, i));
    }
    v2v_lessons_destroy(&lessons);
}

static int is_turned(const float *a, const float *b, int symmetry)
{
    for (int i = 0; i < IMAGES * PIXELS; i++) {
        const int y = i / SIDE % SIDE, x = i % SIDE;
        const int fy = symmetry & 1 ? SIDE - 1 - y : y, fx = symmetry & 2 ? SIDE - 1 - x : x;
        const int from = symmetry & 4 ? fx * SIDE + fy : fy * SIDE + fx;
        if (a[i] != b[i / PIXELS * PIXELS + from]) {
            return 0;
        }
    }
    return 1;
}

/* Which lesson the sample is, and how turned; -1: none. */
static int find(int *symmetry)
{
    for (int i = 0; i < 2 * BATCH; i++) {
        for (*symmetry = 0; *symmetry < SYMMETRIES; ++*symmetry) {
            if (is_turned(sample, lesson[i], *symmetry)) {
                return i;
            }
        }
    }
    return -1;
}

static struct v2v_sampler *create(struct scene *scene)
{
    char run[PATH];
    struct v2v_sampler *sampler = NULL;
    struct v2v_train_job job = scene_job(scene, run, "run");
    assert_ok(v2v_sampler_create(&sampler, &job, sides, &v2v_examples_lessons, NULL));
    assert_int_equal(v2v_sampler_images(sampler), IMAGES);
    return sampler;
}

static void samples_are_lessons_turned_about(void **state)
{
    (void)state;
    struct scene scene;
    unsigned turns = 0;
    int drawn[2 * BATCH] = {0};
    setup(&scene);
    make_lessons(&scene);
    struct v2v_sampler *sampler = create(&scene);
    for (int64_t step = 0; step < 2 * STEPS_OF_LESSON; step += 10) {
        int symmetry = 0;
        const int index = (int)(step / 10 % BATCH);
        assert_ok(v2v_sampler_draw(sampler, sample, step, index));
        const int found = find(&symmetry);
        assert_true(found >= 0 && found % BATCH == index);
        assert_true(step >= STEPS_OF_LESSON || found < BATCH);
        turns |= 1u << symmetry;
        drawn[found]++;
    }
    assert_int_equal(turns, (1u << SYMMETRIES) - 1);
    for (int i = 0; i < 2 * BATCH; i++) {
        assert_true(drawn[i] > 0);
    }
    v2v_sampler_destroy(&sampler);
    scene_fini(&scene);
}

/* Sides that differ: mirrored, but no rows in the place of columns. */
static void samples_of_small_frames_are_parts_of_their_lessons(void **state)
{
    (void)state;
    enum { HEIGHT = 33, WIDTH = 50, ROWS = 32, STEPS = 40 };
    struct scene scene;
    unsigned turns = 0;
    setup(&scene);
    scene.config.train.crop = V2V_WHOLE_AUTO;
    scene.height = HEIGHT;
    scene.width = WIDTH;
    scene_record(&scene, "small.h5", scene_wave);
    make_lessons(&scene);
    struct v2v_sampler *sampler = create(&scene);
    assert_int_equal(v2v_sampler_height(sampler), ROWS);
    assert_int_equal(v2v_sampler_width(sampler), WIDTH);
    for (int64_t step = 0; step < STEPS; step++) {
        assert_ok(v2v_sampler_draw(sampler, sample, step, 0));
        int found = -1;
        for (int turn = 0; turn < 8 && found < 0; turn++) { /* by the first row and both flips */
            int same = 1;
            for (int i = 0; i < IMAGES * ROWS * WIDTH && same; i++) {
                const int y = i / WIDTH % ROWS, x = i % WIDTH, image = i / WIDTH / ROWS;
                const int fy = (turn & 4) / 4 + (turn & 1 ? ROWS - 1 - y : y);
                const int fx = turn & 2 ? WIDTH - 1 - x : x;
                same = sample[i] == lesson[0][(image * HEIGHT + fy) * WIDTH + fx];
            }
            found = same ? turn : -1;
        }
        assert_true(found >= 0);
        turns |= 1u << found;
    }
    assert_int_equal(turns, 0xff);
    v2v_sampler_destroy(&sampler);
    scene_fini(&scene);
}

static void without_flips_they_are_the_lessons_themselves(void **state)
{
    (void)state;
    struct scene scene;
    setup(&scene);
    scene.config.train.flips = 0;
    make_lessons(&scene);
    struct v2v_sampler *sampler = create(&scene);
    for (int index = 0; index < BATCH; index++) {
        assert_ok(v2v_sampler_draw(sampler, sample, 3, index));
        assert_memory_equal(sample, lesson[index], sizeof sample);
    }
    v2v_sampler_destroy(&sampler);
    scene_fini(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(samples_are_lessons_turned_about),
        cmocka_unit_test(samples_of_small_frames_are_parts_of_their_lessons),
        cmocka_unit_test(without_flips_they_are_the_lessons_themselves),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
