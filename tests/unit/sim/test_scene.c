#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/sim/scene.h"

#include <string.h>

static float *scene(int64_t slices, int64_t height, int64_t width, uint64_t seed)
{
    float *volume = NULL;
    assert_ok(V2V_ALLOC(volume, "test", slices * height * width));
    assert_ok(v2v_scene_fill(volume, slices, height, width, seed));
    return volume;
}

static void scenes_are_sparse_bright_and_within_0_and_1(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= 20; seed++) {
        int64_t count = 20 * 96 * 80, dark = 0;
        float *volume = scene(20, 96, 80, seed), brightest = 0;
        for (int64_t i = 0; i < count; i++) {
            assert_true(volume[i] >= 0 && volume[i] <= 1);
            dark += volume[i] == 0;
            brightest = volume[i] > brightest ? volume[i] : brightest;
        }
        assert_true(brightest > 0.5f); /* the dimmest soma is 0.55, away from its rim */
        assert_true(dark * 10 > count * 8);
        v2v_mem_free(volume);
    }
}

static void a_seed_repeats_its_scene_and_another_gives_another(void **state)
{
    (void)state;
    size_t bytes = 8 * 64 * 64 * sizeof(float);
    float *a = scene(8, 64, 64, 1), *b = scene(8, 64, 64, 1), *c = scene(8, 64, 64, 2);
    assert_memory_equal(a, b, bytes);
    assert_memory_not_equal(a, c, bytes);
    v2v_mem_free(a);
    v2v_mem_free(b);
    v2v_mem_free(c);
}

static void any_size_is_filled_or_refused(void **state)
{
    (void)state;
    static const int64_t sizes[][3] = {{1, 1, 1}, {1, 40, 3}, {5, 2, 40}};
    for (int i = 0; i < 3; i++) {
        float *volume = scene(sizes[i][0], sizes[i][1], sizes[i][2], 7);
        v2v_mem_free(volume);
    }
    float voxel;
    assert_int_equal(v2v_scene_fill(&voxel, 0, 1, 1, 1), V2V_E_INPUT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(scenes_are_sparse_bright_and_within_0_and_1),
        cmocka_unit_test(a_seed_repeats_its_scene_and_another_gives_another),
        cmocka_unit_test(any_size_is_filled_or_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
