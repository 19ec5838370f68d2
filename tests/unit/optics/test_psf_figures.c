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

/* Two slices of 16 x 20 pixels and a point each; what lies under all pixels of one, or but for a
 * border pixel. */
static void a_constant_background_is_told_from_light(void **state)
{
    (void)state;
    enum { SIDE_Y = 16, SIDE_X = 20, SLICE = SIDE_Y * SIDE_X };
    static const struct {
        float under, border_pixel;
        double part;
    } cases[] = {{0.0f, 0.0f, 0.0},
                 {0.125f, 0.125f, 40.0 / 120.0}, /* of 320 pixels, 40, beside two points of 40 */
                 {0.125f, 0.0f, 0.0},
                 {0.01f, 0.01f, 0.0}}; /* 3.2 of 83.2: less than a twentieth */
    float data[2 * SLICE];
    struct v2v_psf_file psf = {1, 2, SIDE_Y, SIDE_X, 0, 0, data};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        for (int k = 0; k < 2 * SLICE; k++) {
            data[k] = k < SLICE ? cases[i].under : 0.0f;
        }
        data[5 * SIDE_X] = cases[i].border_pixel;
        data[3 * SIDE_X + 4] += 40.0f;
        data[SLICE + 3 * SIDE_X + 4] = 40.0f;
        assert_true(fabs(v2v_psf_pedestal(&psf) - cases[i].part) < 1e-6);
    }
    data[3 * SIDE_X + 4] = 0.01f; /* all its light is background, of a window that is too small */
    psf.height = 15;
    assert_true(v2v_psf_pedestal(&psf) == 0.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(figures_of_two_points_are_those_by_hand),
        cmocka_unit_test(a_dark_slice_has_no_centroid),
        cmocka_unit_test(correlation_is_free_of_scale_and_of_dark_sets_0),
        cmocka_unit_test(a_constant_background_is_told_from_light),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
