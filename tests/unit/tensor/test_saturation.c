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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(views_cut_off_are_saturated),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
