#include "optics/zernike.h"
#include "support.h"
#include <math.h>
#include <string.h>

static double mode(int j, double y, double x)
{
    struct v2v_zernike zernike = {.last = j};
    zernike.waves[j] = 1;
    return v2v_zernike_at(&zernike, y, x);
}

/* R. J. Noll, J. Opt. Soc. Am. 66, 207 (1976), table I. */
static void modes_are_those_of_nolls_table(void **state)
{
    const double y = 0.3, x = 0.4, r = 0.5, t = atan2(y, x);
    const double expected[12] = {0,
                                 1,
                                 2 * r * cos(t),
                                 2 * r * sin(t),
                                 sqrt(3) * (2 * r * r - 1),
                                 sqrt(6) * r * r * sin(2 * t),
                                 sqrt(6) * r * r * cos(2 * t),
                                 sqrt(8) * (3 * pow(r, 3) - 2 * r) * sin(t),
                                 sqrt(8) * (3 * pow(r, 3) - 2 * r) * cos(t),
                                 sqrt(8) * pow(r, 3) * sin(3 * t),
                                 sqrt(8) * pow(r, 3) * cos(3 * t),
                                 sqrt(5) * (6 * pow(r, 4) - 6 * r * r + 1)};
    (void)state;
    for (int j = 1; j <= 11; j++) {
        assert_true(fabs(mode(j, y, x) - expected[j]) < 1e-12);
    }
}

/* Midpoints of 400 x 400 squares: the disk's edge is a staircase of relative area 1e-3. */
static void modes_are_orthonormal_over_the_disk(void **state)
{
    enum { SIDE = 400, MODES = 22 };
    static double product[MODES + 1][MODES + 1];
    double area = 0;
    (void)state;
    for (int i = 0; i < SIDE * SIDE; i++) {
        const double y = (i / SIDE + 0.5) * 2 / SIDE - 1, x = (i % SIDE + 0.5) * 2 / SIDE - 1;
        double value[MODES + 1];
        if (hypot(y, x) > 1) {
            continue;
        }
        area++;
        for (int j = 1; j <= MODES; j++) {
            value[j] = mode(j, y, x);
        }
        for (int j = 1; j <= MODES; j++) {
            for (int k = 1; k <= j; k++) {
                product[j][k] += value[j] * value[k];
            }
        }
    }
    for (int j = 1; j <= MODES; j++) {
        for (int k = 1; k <= j; k++) {
            assert_true(fabs(product[j][k] / area - (j == k)) < 0.01);
        }
    }
}

static void text_comes_back(void **state)
{
    struct v2v_zernike zernike;
    char text[64];
    (void)state;
    assert_ok(v2v_zernike_parse(&zernike, "4:0.125, 11:-0.5"));
    assert_int_equal(zernike.last, 11);
    assert_true(zernike.waves[4] == 0.125 && zernike.waves[11] == -0.5);
    assert_ok(v2v_zernike_print(text, sizeof text, &zernike));
    assert_string_equal(text, "4:0.125, 11:-0.5");
    assert_int_equal(v2v_zernike_print(text, 8, &zernike), V2V_E_CONFIG);
    assert_ok(v2v_zernike_parse(&zernike, ""));
    assert_int_equal(zernike.last, 0);
}

static void bad_text_is_refused(void **state)
{
    static const char *const bad[] = {"4", "4:", "x:1", "0:1", "37:1", "4:1e9", "4:nan", "4 0.1"};
    struct v2v_zernike zernike;
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(v2v_zernike_parse(&zernike, bad[i]), V2V_E_CONFIG);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(modes_are_those_of_nolls_table),
        cmocka_unit_test(modes_are_orthonormal_over_the_disk),
        cmocka_unit_test(text_comes_back),
        cmocka_unit_test(bad_text_is_refused),
    };
    return cmocka_run_group_tests_name("optics.zernike", tests, NULL, NULL);
}
