/* PSF slices in figures. */
#include "support.h"

#include "v2v3d/optics/psf_figures.h"

#include <math.h>

enum { HEIGHT = 6, WIDTH = 5, PIXELS = HEIGHT * WIDTH }; /* centre 2, 2 */

static void figures_of_two_points_are_those_by_hand(void **state)
{
    (void)state;
    float slice[PIXELS] = {0};
    slice[2 * WIDTH + 3] = 3.0f;
    slice[5 * WIDTH + 1] = 1.0f; /* in the outermost ring */
    slice[3 * WIDTH + 3] = 0x1p-20f;
    const struct v2v_slice_figures found = v2v_slice_figures_of(slice, HEIGHT, WIDTH);
    assert_true(found.energy == 4.0 + 0x1p-20 && found.border == 1.0);
    assert_true(fabs(found.y - 0.75) < 1e-6 && fabs(found.x - 0.5) < 1e-6); /* 2^-20 of a point */
    assert_int_equal(found.support, 2); /* the third point is below a thousandth */
}

static void a_dark_slice_has_no_centroid(void **state)
{
    (void)state;
    const float slice[PIXELS] = {0};
    const struct v2v_slice_figures found = v2v_slice_figures_of(slice, HEIGHT, WIDTH);
    assert_true(found.energy == 0.0 && found.y == 0.0 && found.x == 0.0 && found.border == 0.0);
    assert_int_equal(found.support, 0);
}

static void correlation_is_free_of_scale_and_of_dark_sets_0(void **state)
{
    (void)state;
    const float a[3] = {1.0f, 2.0f, 2.0f}, b[3] = {4.0f, 8.0f, 8.0f}, c[3] = {2.0f, -2.0f, 1.0f};
    const float dark[3] = {0};
    assert_true(v2v_psf_correlation(a, b, 3) == 1.0);
    assert_true(v2v_psf_correlation(a, c, 3) == 0.0);
    assert_true(v2v_psf_correlation(a, dark, 3) == 0.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(figures_of_two_points_are_those_by_hand),
        cmocka_unit_test(a_dark_slice_has_no_centroid),
        cmocka_unit_test(correlation_is_free_of_scale_and_of_dark_sets_0),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
