/* Where a camera ends, told from counts of light and from flat images. */
#include "support.h"

#include "v2v3d/base/random.h"
#include "v2v3d/tensor/saturation.h"

#include <math.h>

enum { SAMPLES = 3 * 64 * 64 };

static void views_cut_off_are_saturated(void **state)
{
    (void)state;
    static float views[SAMPLES];
    int64_t above = 0;
    for (int i = 0; i < SAMPLES; i++) { /* counts of light: few at the end */
        views[i] = (float)v2v_random_poisson(9, 0, (uint64_t)i, 40.0);
        above += views[i] >= 50.0f;
    }
    assert_true(v2v_saturated_pixels(views, SAMPLES) == 0);
    assert_true(isinf(v2v_saturated_value(views, SAMPLES)));
    for (int i = 0; i < SAMPLES; i++) {
        views[i] = fminf(views[i], 50.0f);
    }
    assert_true(above >= 10);
    assert_true(v2v_saturated_pixels(views, SAMPLES) == above);
    assert_true(v2v_saturated_value(views, SAMPLES) == 50.0f);
    for (int i = 0; i < SAMPLES; i++) {
        views[i] = 3.0f;
    }
    assert_true(v2v_saturated_pixels(views, SAMPLES) == 0); /* flat */
}

/* A level of coarse counts that more than half of an image has, and one beside blind samples. */
static void levels_of_counts_are_no_end(void **state)
{
    (void)state;
    static float views[SAMPLES];
    for (int i = 0; i < SAMPLES; i++) {
        views[i] = i % 10 < 7 ? 100.0f : i % 10 < 9 ? 99.0f : 98.0f;
    }
    assert_true(v2v_saturated_pixels(views, SAMPLES) == 0);
    for (int i = 0; i < SAMPLES; i++) {
        views[i] = i % 10 < 4 ? 100.0f : V2V_BLIND;
    }
    assert_true(v2v_saturated_pixels(views, SAMPLES) == 0);
}

/* Two views that end at different values, and a third that doesn't: each by its own. */
static void every_view_has_its_own_end(void **state)
{
    (void)state;
    enum { VIEWS = 3, PIXELS = SAMPLES / VIEWS };
    static const float end[VIEWS] = {0.5f, 0.7f, 2.0f};
    static float views[SAMPLES], seen[SAMPLES];
    int64_t cut_off[VIEWS] = {0};
    for (int i = 0; i < SAMPLES; i++) {
        const float light = (float)v2v_random_uniform(9, 1, (uint64_t)i);
        const float most = end[i / PIXELS];
        views[i] = fminf(0.1f + 0.5f * light, most);
        cut_off[i / PIXELS] += views[i] == most;
        seen[i] = 0.65f;
    }
    for (int v = 0; v < VIEWS; v++) {
        const float highest = v2v_saturated_value(views + v * PIXELS, PIXELS);
        assert_true(v == 0 ? highest == end[0] : isinf(highest));
    }
    views[PIXELS] = 0.65f; /* above the cap: a single one */
    v2v_saturated_cap(seen, views, VIEWS, PIXELS);
    for (int i = 0; i < SAMPLES; i++) {
        assert_true(seen[i] == (views[i] == end[0] && i < PIXELS ? end[0] : 0.65f));
    }
    assert_true(v2v_rest_of(0.3f, 0.2f, 0.3f) == 0.3f - 0.2f);
    assert_true(v2v_rest_of(0.3f, 0.4f, 0.3f) == 0.0f);
    assert_true(v2v_rest_of(0.2f, 0.4f, 0.3f) == 0.2f - 0.4f);
    assert_true(v2v_rest_of(V2V_BLIND, 0.4f, INFINITY) == 0.0f);
    assert_int_equal(v2v_saturated_leave(views, VIEWS, PIXELS), cut_off[0]);
    for (int i = 0; i < SAMPLES; i++) {
        assert_true((views[i] == V2V_BLIND) == (i < PIXELS && seen[i] == end[0]));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(views_cut_off_are_saturated),
        cmocka_unit_test(levels_of_counts_are_no_end),
        cmocka_unit_test(every_view_has_its_own_end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
