/* The reference's alignment shifts of the real 2pSAM PSFs (REFERENCE.md 3). */
#include "support.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/optics/shifts.h"

static void assert_equal_shifts(const int32_t *shifts, const char *dataset, int64_t expected)
{
    int64_t count = 0;
    double *golden = test_h5_read(test_shared("golden/alignment.h5"), dataset, &count);
    assert_int_equal(count, expected);
    for (int64_t i = 0; i < count; i++) {
        assert_int_equal(shifts[i], (int64_t)golden[i]);
    }
    test_release(golden);
}

static void shifts_of_the_real_set_match_the_reference(void **state)
{
    struct v2v_psf_file psf;
    struct v2v_shifts shifts;
    (void)state;
    if (test_shared("psf/2psam") == NULL || test_shared("golden/alignment.h5") == NULL) {
        skip();
    }
    assert_ok(v2v_psf_read(&psf, test_shared("psf/2psam"), "", V2V_NORMALIZE_NONE, NULL));
    assert_ok(v2v_shifts_from_psf(&shifts, &psf));
    assert_equal_shifts(shifts.dy, "dy", psf.views * psf.slices);
    assert_equal_shifts(shifts.dx, "dx", psf.views * psf.slices);
    assert_int_equal(v2v_shifts_reach(&shifts), 12);
    v2v_shifts_fini(&shifts);
    v2v_psf_file_fini(&psf);
}

static void normalising_views_leaves_the_shifts(void **state)
{
    struct v2v_psf_file psf;
    struct v2v_shifts shifts;
    (void)state;
    if (test_shared("psf/2psam") == NULL || test_shared("golden/alignment.h5") == NULL) {
        skip();
    }
    assert_ok(v2v_psf_read(&psf, test_shared("psf/2psam"), "", V2V_NORMALIZE_VIEW, NULL));
    assert_ok(v2v_shifts_from_psf(&shifts, &psf));
    assert_equal_shifts(shifts.dy, "dy", psf.views * psf.slices);
    assert_equal_shifts(shifts.dx, "dx", psf.views * psf.slices);
    v2v_shifts_fini(&shifts);
    v2v_psf_file_fini(&psf);
}

/* The set was computed symmetric about pixel 64: both flips map it onto itself, to the rounding of
 * its values in float and of the optics program that made it. */
static void both_flips_of_the_real_set_are_physical(void **state)
{
    static const int32_t expected[2][13] = {{0, 11, 6, 5, 4, 3, 2, 9, 8, 7, 10, 1, 12},
                                            {0, 1, 2, 9, 8, 7, 6, 5, 4, 3, 12, 11, 10}};
    struct v2v_psf_file psf;
    int32_t partner[13];
    (void)state;
    if (test_shared("psf/2psam") == NULL) {
        skip();
    }
    assert_ok(v2v_psf_read(&psf, test_shared("psf/2psam"), "", V2V_NORMALIZE_VIEW, NULL));
    assert_int_equal(psf.views, 13);
    for (int axis = 0; axis < 2; axis++) {
        assert_int_equal(v2v_shifts_flip_partner(partner, &psf, axis, 1e-4), 1);
        assert_memory_equal(partner, expected[axis], sizeof partner);
    }
    v2v_psf_file_fini(&psf);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shifts_of_the_real_set_match_the_reference),
        cmocka_unit_test(normalising_views_leaves_the_shifts),
        cmocka_unit_test(both_flips_of_the_real_set_are_physical),
    };
    return cmocka_run_group_tests_name("optics.alignment", tests, NULL, NULL);
}
