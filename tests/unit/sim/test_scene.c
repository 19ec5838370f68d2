#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/sim/noise.h"
#include "v2v3d/sim/scene.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Voxels that are no cubes: a slice is two pixels deep. */
static struct v2v_scene scene_of(const char *kind, int64_t slices, int64_t height, int64_t width,
                                 uint64_t seed)
{
    struct v2v_scene scene = {.slices = slices,
                              .height = height,
                              .width = width,
                              .slice_um = 1.4,
                              .pixel_um = 0.7,
                              .seed = seed};
    assert_ok(v2v_scene_find(&scene.kind, kind));
    return scene;
}

static float *drawn(const struct v2v_scene *scene, int64_t t, int64_t first, int64_t count)
{
    float *volume = NULL;
    assert_ok(V2V_ALLOC(volume, "test", count * scene->height * scene->width));
    v2v_scene_draw(volume, scene, t, first, count);
    return volume;
}

static void every_kind_has_light_within_0_and_1(void **state)
{
    (void)state;
    int kinds = 0;
    for (const char *name; (name = v2v_scene_name(kinds)) != NULL; kinds++) {
        const int is_dense = strcmp(name, "dense") == 0;
        for (uint64_t seed = 1; seed <= 5; seed++) {
            const struct v2v_scene scene = scene_of(name, 12, 96, 80, seed);
            const int64_t count = 12 * 96 * 80;
            int64_t dark = 0;
            float *volume = drawn(&scene, 0, 0, 12), brightest = 0;
            for (int64_t i = 0; i < count; i++) {
                assert_true(volume[i] >= 0 && volume[i] <= 1);
                dark += volume[i] == 0;
                brightest = fmaxf(brightest, volume[i]);
            }
            /* The dimmest structure of all has 0.25; dense scenes are never dark. */
            if (!(brightest > 0.2f) || (is_dense ? dark > 0 : dark * 3 < count)) {
                fail_msg("%s, seed %d: %g of the voxels dark, brightest %g", name, (int)seed,
                         (double)dark / (double)count, (double)brightest);
            }
            v2v_mem_free(volume);
        }
    }
    assert_int_equal(kinds, 8);
}

static void a_seed_repeats_its_scene_and_another_gives_another(void **state)
{
    (void)state;
    const size_t bytes = (size_t)8 * 64 * 64 * sizeof(float);
    for (int kind = 0; v2v_scene_name(kind) != NULL; kind++) {
        const struct v2v_scene one = scene_of(v2v_scene_name(kind), 8, 64, 64, 1);
        const struct v2v_scene two = scene_of(v2v_scene_name(kind), 8, 64, 64, 2);
        float *a = drawn(&one, 0, 0, 8), *b = drawn(&one, 7, 0, 8), *c = drawn(&two, 0, 0, 8);
        assert_memory_equal(a, b, bytes); /* a still scene: any frame */
        assert_memory_not_equal(a, c, bytes);
        v2v_mem_free(a);
        v2v_mem_free(b);
        v2v_mem_free(c);
    }
}

static void slices_drawn_alone_are_those_of_the_whole(void **state)
{
    (void)state;
    const int64_t pixels = 40 * 48;
    for (int kind = 0; v2v_scene_name(kind) != NULL; kind++) {
        struct v2v_scene scene = scene_of(v2v_scene_name(kind), 13, 40, 48, 4);
        scene.motion_um = 1;
        float *whole = drawn(&scene, 3, 0, 13), *part = drawn(&scene, 3, 4, 7);
        assert_memory_equal(whole + 4 * pixels, part, (size_t)(7 * pixels) * sizeof *part);
        v2v_mem_free(whole);
        v2v_mem_free(part);
    }
}

/* Where the light is, in micrometres. */
static void centroid(double at[3], const struct v2v_scene *scene, int64_t t)
{
    float *volume = drawn(scene, t, 0, scene->slices);
    double light = 0;
    int64_t i = 0;
    at[0] = at[1] = at[2] = 0;
    for (int64_t z = 0; z < scene->slices; z++) {
        for (int64_t y = 0; y < scene->height; y++) {
            for (int64_t x = 0; x < scene->width; x++, i++) {
                light += (double)volume[i];
                at[0] += (double)volume[i] * (double)z * scene->slice_um;
                at[1] += (double)volume[i] * (double)y * scene->pixel_um;
                at[2] += (double)volume[i] * (double)x * scene->pixel_um;
            }
        }
    }
    v2v_mem_free(volume);
    for (int axis = 0; axis < 3; axis++) {
        at[axis] /= light;
    }
}

/* In 2300 cubic micrometres there is one bead. */
static void structures_move_by_what_is_asked(void **state)
{
    (void)state;
    int inside = 0;
    for (uint64_t seed = 1; seed <= 150; seed++) {
        struct v2v_scene scene = scene_of("beads", 40, 46, 46, seed);
        double from[3], to[3], back[3], way = 0, return_way = 0;
        scene.slice_um = scene.pixel_um = 0.3;
        scene.motion_um = 0.5;
        centroid(from, &scene, 0);
        centroid(to, &scene, 1);
        centroid(back, &scene, 80); /* 40 um on: there and back */
        for (int axis = 0; axis < 3; axis++) {
            way += (to[axis] - from[axis]) * (to[axis] - from[axis]);
            return_way += (back[axis] - from[axis]) * (back[axis] - from[axis]);
        }
        assert_true(return_way < 1e-12);
        inside += fabs(sqrt(way) - 0.5) < 0.01;
    }
    /* Where a bead reaches over the border its light's centroid moves by less. */
    assert_true(inside > 75);
}

static void unknown_kinds_are_refused_with_the_known_ones(void **state)
{
    (void)state;
    int kind = 0;
    assert_int_equal(v2v_scene_find(&kind, "neuron"), V2V_E_USAGE);
    for (int i = 0; v2v_scene_name(i) != NULL; i++) {
        assert_non_null(strstr(v2v_status_message(), v2v_scene_name(i)));
    }
}

static void any_size_is_filled(void **state)
{
    (void)state;
    static const int64_t sizes[][3] = {{1, 1, 1}, {1, 40, 3}, {5, 2, 40}};
    for (int kind = 0; v2v_scene_name(kind) != NULL; kind++) {
        for (int i = 0; i < 3; i++) {
            const struct v2v_scene scene =
                scene_of(v2v_scene_name(kind), sizes[i][0], sizes[i][1], sizes[i][2], 7);
            v2v_mem_free(drawn(&scene, 0, 0, scene.slices));
        }
    }
}

/** The example of scene.h. */
static enum v2v_status example(float *volume, float *noisy, const float *views, int64_t count,
                               uint64_t seed)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_scene scene = {
        .slices = 8, .height = 64, .width = 64, .slice_um = 1, .pixel_um = 1, .seed = seed};
    struct v2v_noise noise;
    V2V_TRY(v2v_scene_find(&scene.kind, "neurons"));
    v2v_scene_draw(volume, &scene, 0, 0, scene.slices);
    V2V_TRY(v2v_noise_parse(&noise, "gaussian:0.2"));
    V2V_TRY(v2v_noise_level(&noise, views, count));
    v2v_noise_apply(noisy, views, count, &noise, seed, 0, 0);
done:
    return rc;
}

static void the_headers_example_runs(void **state)
{
    (void)state;
    static float volume[8 * 64 * 64], noisy[64];
    const float views[64] = {[0] = 1, [1] = 2};
    assert_ok(example(volume, noisy, views, 64, 1));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_has_light_within_0_and_1),
        cmocka_unit_test(a_seed_repeats_its_scene_and_another_gives_another),
        cmocka_unit_test(slices_drawn_alone_are_those_of_the_whole),
        cmocka_unit_test(structures_move_by_what_is_asked),
        cmocka_unit_test(unknown_kinds_are_refused_with_the_known_ones),
        cmocka_unit_test(any_size_is_filled),
        cmocka_unit_test(the_headers_example_runs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
