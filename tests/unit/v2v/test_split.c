/* Which views the branches see, and whether their features are shifted. */
#include "small_model.h"

#include "v2v3d/v2v/schema.h"

#include <string.h>

enum { MOST_VIEWS = 14, SEEDS = 400 };

static void random_halves_share_out_the_views_evenly(void **state)
{
    (void)state;
    for (int64_t count = 2; count <= MOST_VIEWS; count++) {
        int often[MOST_VIEWS] = {0};
        for (int64_t seed = 0; seed < SEEDS; seed++) {
            int32_t first[MOST_VIEWS], second[MOST_VIEWS];
            int seen[MOST_VIEWS] = {0};
            const struct v2v_model_spec spec = {
                .views = count, .split = V2V_VIEWS_RANDOM, .split_seed = seed};
            const int64_t n = v2v_branch_views(first, &spec, 0);
            assert_int_equal(n, (count + 1) / 2);
            assert_int_equal(v2v_branch_views(second, &spec, 1), count - n);
            for (int64_t i = 0; i < n; i++) {
                seen[first[i]]++;
                often[first[i]]++;
                assert_true(i == 0 || first[i] > first[i - 1]);
            }
            for (int64_t i = 0; i < count - n; i++) {
                seen[second[i]]++;
            }
            for (int64_t v = 0; v < count; v++) {
                assert_int_equal(seen[v], 1);
            }
        }
        /* Five standard deviations of a binomial number: 5 sqrt(400 p (1 - p)) <= 50. */
        for (int64_t v = 0; v < count; v++) {
            const double expected = (double)(SEEDS * ((count + 1) / 2)) / (double)count;
            assert_true(often[v] > expected - 50 && often[v] < expected + 50);
        }
    }
}

static void both_branches_see_all_views_where_they_are_not_split(void **state)
{
    (void)state;
    const struct v2v_model_spec spec = {.views = VIEWS, .split = V2V_VIEWS_ALL};
    for (int b = 0; b < BRANCHES; b++) {
        int32_t list[VIEWS];
        assert_int_equal(v2v_branch_views(list, &spec, b), VIEWS);
        for (int v = 0; v < VIEWS; v++) {
            assert_int_equal(list[v], v);
        }
    }
}

static void run(float (*volume)[VOXELS], const struct v2v_model_spec *spec)
{
    struct v2v_model *model = create(spec);
    assert_ok(v2v_model_plan(model, SIDE, SIDE, 0));
    v2v_model_forward(model, volume[0], volume[1], views);
    v2v_model_destroy(&model);
}

/* Which branches change with a view, against which see it. */
static void a_branch_depends_on_its_views_alone(void **state)
{
    (void)state;
    static const int splits[] = {V2V_VIEWS_EVEN_ODD, V2V_VIEWS_RANDOM, V2V_VIEWS_ALL};
    static float before[BRANCHES][VOXELS], after[BRANCHES][VOXELS];
    for (size_t k = 0; k < sizeof splits / sizeof *splits; k++) {
        struct v2v_model_spec spec = small;
        spec.split = splits[k];
        spec.split_seed = 6;
        fill(views, VIEWS * PIXELS, 0);
        run(before, &spec);
        for (int v = 0; v < VIEWS; v++) {
            fill(views, VIEWS * PIXELS, 0);
            views[v * PIXELS + PIXELS / 2 + SIDE / 2] += 1.0f;
            run(after, &spec);
            for (int b = 0; b < BRANCHES; b++) {
                int32_t list[VIEWS];
                const int64_t count = v2v_branch_views(list, &spec, b);
                int sees = 0;
                for (int64_t i = 0; i < count; i++) {
                    sees |= list[i] == v;
                }
                assert_int_equal(memcmp(before[b], after[b], sizeof before[b]) != 0, sees);
            }
        }
    }
}

/* Without alignment the network is the one of PSFs without parallax. */
static void unaligned_features_are_those_of_no_shifts(void **state)
{
    (void)state;
    static float unaligned[BRANCHES][VOXELS], aligned[BRANCHES][VOXELS], still[BRANCHES][VOXELS];
    struct v2v_model_spec spec = small;
    struct v2v_model *model = NULL;
    struct v2v_shifts shifts = small_shifts(VIEWS, SLICES);
    fill(views, VIEWS * PIXELS, 0);
    run(aligned, &spec);
    memset(shifts.dy, 0, sizeof *shifts.dy * VIEWS * SLICES);
    memset(shifts.dx, 0, sizeof *shifts.dx * VIEWS * SLICES);
    assert_ok(v2v_model_create(&model, &spec, &shifts));
    assert_ok(
        v2v_rule_weights(v2v_model_fields(model), v2v_model_weights(model), V2V_RULE_HASH, 7));
    assert_ok(v2v_model_plan(model, SIDE, SIDE, 0));
    v2v_model_forward(model, still[0], still[1], views);
    v2v_model_destroy(&model);
    v2v_shifts_fini(&shifts);
    spec.unaligned = 1;
    run(unaligned, &spec);
    for (int b = 0; b < BRANCHES; b++) {
        assert_memory_equal(unaligned[b], still[b], sizeof still[b]);
        assert_memory_not_equal(unaligned[b], aligned[b], sizeof aligned[b]);
    }
}

/* Volumes, and gradients by them, of a network in training; free the gradients. */
static float *train(float (*volume)[VOXELS], const struct v2v_model_spec *spec,
                    const struct v2v_shifts *shifts, const float *images)
{
    static float dvolume[BRANCHES][VOXELS];
    struct v2v_model *model = NULL;
    float *gradients = NULL;
    assert_ok(v2v_model_create(&model, spec, shifts));
    assert_ok(
        v2v_rule_weights(v2v_model_fields(model), v2v_model_weights(model), V2V_RULE_HASH, 7));
    assert_ok(v2v_model_plan(model, SIDE, SIDE, 1));
    v2v_model_forward(model, volume[0], volume[1], images);
    for (int b = 0; b < BRANCHES; b++) {
        fill(dvolume[b], VOXELS, 5 + (uint64_t)b);
    }
    v2v_model_backward(model, dvolume[0], dvolume[1]);
    const int64_t count = v2v_model_fields(model)->total;
    assert_ok(V2V_ALLOC(gradients, "test", count));
    memcpy(gradients, v2v_model_gradients(model), (size_t)count * sizeof *gradients);
    v2v_model_destroy(&model);
    return gradients;
}

/* A network that sees all views twice is one of even and odd views that are alike. */
static void all_views_are_even_and_odd_ones_that_are_alike(void **state)
{
    (void)state;
    static float twice[2 * VIEWS * PIXELS], all[BRANCHES][VOXELS], halves[BRANCHES][VOXELS];
    struct v2v_model_spec spec = small;
    struct v2v_shifts one = small_shifts(VIEWS, SLICES), two = small_shifts(2 * VIEWS, SLICES);
    fill(views, VIEWS * PIXELS, 0);
    for (int64_t v = 0; v < 2 * VIEWS; v++) {
        memcpy(twice + v * PIXELS, views + v / 2 * PIXELS, PIXELS * sizeof *twice);
        for (int64_t z = 0; z < SLICES; z++) {
            two.dy[v * SLICES + z] = one.dy[v / 2 * SLICES + z];
            two.dx[v * SLICES + z] = one.dx[v / 2 * SLICES + z];
        }
    }
    spec.views = 2 * VIEWS;
    float *expected = train(halves, &spec, &two, twice);
    spec.views = VIEWS;
    spec.split = V2V_VIEWS_ALL;
    float *gradients = train(all, &spec, &one, views);
    struct v2v_fields fields = {0};
    assert_ok(v2v_model_schema(&fields, &spec));
    assert_memory_equal(all, halves, sizeof all);
    assert_memory_equal(gradients, expected, (size_t)fields.total * sizeof *gradients);
    v2v_fields_fini(&fields);
    v2v_mem_free(expected);
    v2v_mem_free(gradients);
    v2v_shifts_fini(&one);
    v2v_shifts_fini(&two);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_halves_share_out_the_views_evenly),
        cmocka_unit_test(both_branches_see_all_views_where_they_are_not_split),
        cmocka_unit_test(a_branch_depends_on_its_views_alone),
        cmocka_unit_test(all_views_are_even_and_odd_ones_that_are_alike),
        cmocka_unit_test(unaligned_features_are_those_of_no_shifts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
