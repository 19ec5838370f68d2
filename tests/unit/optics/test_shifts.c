#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/shifts.h"
#include <math.h>
#include <string.h>

static void make_psf(struct v2v_psf_file *psf, int64_t views, int64_t slices, int64_t height,
                     int64_t width)
{
    *psf =
        (struct v2v_psf_file){.views = views, .slices = slices, .height = height, .width = width};
    assert_ok(V2V_ALLOC(psf->data, "test", views * slices * height * width));
}

static float *pixel(const struct v2v_psf_file *psf, int64_t v, int64_t z, int64_t y, int64_t x)
{
    return &psf->data[((v * psf->slices + z) * psf->height + y) * psf->width + x];
}

static void shift_of_a_point_is_its_distance_from_the_centre(void **state)
{
    struct v2v_psf_file psf;
    struct v2v_shifts shifts;
    (void)state;
    make_psf(&psf, 2, 2, 9, 11); /* centre 4, 5 */
    *pixel(&psf, 0, 0, 4, 5) = 1;
    *pixel(&psf, 0, 1, 1, 5) = 2;
    *pixel(&psf, 1, 0, 8, 10) = 0.5f;
    *pixel(&psf, 1, 1, 4, 0) = 1e-20f;
    assert_ok(v2v_shifts_from_psf(&shifts, &psf));
    const int32_t dy[] = {0, -3, 4, 0}, dx[] = {0, 0, 5, -5};
    assert_memory_equal(shifts.dy, dy, sizeof dy);
    assert_memory_equal(shifts.dx, dx, sizeof dx);
    assert_int_equal(v2v_shifts_reach(&shifts), 5);
    v2v_shifts_fini(&shifts);
    v2v_mem_free(psf.data);
}

static void shift_of_an_even_side_counts_from_the_flipped_centre(void **state)
{
    struct v2v_psf_file psf;
    struct v2v_shifts shifts;
    (void)state;
    make_psf(&psf, 1, 1, 8, 6); /* centres 3 and 2 flip to 4 and 3 */
    *pixel(&psf, 0, 0, 4, 2) = 1;
    assert_ok(v2v_shifts_from_psf(&shifts, &psf));
    assert_int_equal(shifts.dy[0], 0);
    assert_int_equal(shifts.dx[0], -1);
    v2v_shifts_fini(&shifts);
    v2v_mem_free(psf.data);
}

/* So do those beside it by no more than float32 samples may be rounded; not by 0.1 of a pixel. */
static void centroids_half_way_round_to_the_even_flipped_pixel(void **state)
{
    struct v2v_psf_file psf;
    struct v2v_shifts shifts;
    (void)state;
    make_psf(&psf, 1, 6, 9, 9);                              /* centre 4 */
    *pixel(&psf, 0, 0, 4, 4) = *pixel(&psf, 0, 0, 5, 4) = 1; /* flipped 3.5: 4 */
    *pixel(&psf, 0, 1, 5, 4) = *pixel(&psf, 0, 1, 6, 4) = 1; /* flipped 2.5: 2 */
    *pixel(&psf, 0, 2, 4, 4) = *pixel(&psf, 0, 3, 5, 4) = 1;
    *pixel(&psf, 0, 2, 5, 4) = *pixel(&psf, 0, 3, 4, 4) = 1 - 4e-6f; /* flipped 3.5 +- 1e-6: 4 */
    *pixel(&psf, 0, 4, 5, 4) = *pixel(&psf, 0, 5, 6, 4) = 0.6f;
    *pixel(&psf, 0, 4, 6, 4) = *pixel(&psf, 0, 5, 5, 4) = 0.4f; /* flipped 2.6: 3; 2.4: 2 */
    assert_ok(v2v_shifts_from_psf(&shifts, &psf));
    const int32_t dy[] = {0, 2, 0, 0, 1, 2};
    assert_memory_equal(shifts.dy, dy, sizeof dy);
    v2v_shifts_fini(&shifts);
    v2v_mem_free(psf.data);
}

static void slice_without_energy_has_shift_zero(void **state)
{
    struct v2v_psf_file psf;
    struct v2v_shifts shifts;
    (void)state;
    make_psf(&psf, 1, 2, 5, 5);
    *pixel(&psf, 0, 1, 0, 0) = 1;
    assert_ok(v2v_shifts_from_psf(&shifts, &psf));
    assert_int_equal(shifts.dy[0], 0);
    assert_int_equal(shifts.dx[0], 0);
    assert_int_equal(shifts.dy[1], -2);
    v2v_shifts_fini(&shifts);
    v2v_mem_free(psf.data);
}

static void shifts_short_of_memory_hold_nothing(void **state)
{
    struct v2v_psf_file psf;
    struct v2v_shifts shifts;
    (void)state;
    make_psf(&psf, 4, 4, 3, 3);
    const size_t held = v2v_mem_held();
    v2v_mem_set_limit(held + 100); /* room for dy (64 bytes), not for dx */
    assert_int_equal(v2v_shifts_from_psf(&shifts, &psf), V2V_E_MEMORY);
    v2v_mem_set_limit(0);
    assert_int_equal(v2v_mem_held(), held);
    assert_null(shifts.dy);
    v2v_mem_free(psf.data);
}

/* Views 0 and 1 mirror each other in y, view 2 is symmetric in y; none is in x. Sides 7 x 6, so x
 * has a pixel without partner, left empty. */
static void make_mirrored(struct v2v_psf_file *psf)
{
    make_psf(psf, 3, 2, 7, 6);
    for (int64_t z = 0; z < 2; z++) {
        for (int64_t y = 0; y < 7; y++) {
            for (int64_t x = 0; x < 5; x++) {
                const uint64_t i = (uint64_t)((z * 7 + y) * 5 + x);
                const float value = (float)v2v_random_uniform(11, 0, i);
                *pixel(psf, 0, z, y, x) = value;
                *pixel(psf, 1, z, 6 - y, x) = value;
                *pixel(psf, 2, z, y, x) += 0.5f * value;
                *pixel(psf, 2, z, 6 - y, x) += 0.5f * value;
            }
        }
    }
}

static void flip_that_maps_the_set_onto_itself_names_the_partners(void **state)
{
    static const int32_t expected[] = {1, 0, 2};
    struct v2v_psf_file psf;
    int32_t partner[3] = {-1, -1, -1};
    (void)state;
    make_mirrored(&psf);
    assert_int_equal(v2v_shifts_flip_partner(partner, &psf, 0, 1e-6), 1);
    assert_memory_equal(partner, expected, sizeof expected);
    assert_int_equal(v2v_shifts_flip_partner(partner, &psf, 1, 1e-6), 0);
    v2v_mem_free(psf.data);
}

static void flip_compares_a_pixel_without_partner_with_zero(void **state)
{
    struct v2v_psf_file psf;
    int32_t partner[1] = {-1};
    (void)state;
    make_psf(&psf, 1, 1, 6, 6);
    *pixel(&psf, 0, 0, 2, 3) = *pixel(&psf, 0, 0, 2, 4) = 10;
    assert_int_equal(v2v_shifts_flip_partner(partner, &psf, 1, 0), 1);
    assert_int_equal(partner[0], 0);
    /* Centroid 70/21, twice that rounds to 7: pixel 0 becomes 7, outside. 1/sqrt(201) = 0.0705. */
    *pixel(&psf, 0, 0, 2, 0) = 1;
    assert_int_equal(v2v_shifts_flip_partner(partner, &psf, 1, 0.070), 0);
    assert_int_equal(v2v_shifts_flip_partner(partner, &psf, 1, 0.071), 1);
    v2v_mem_free(psf.data);
}

/* Two mirrored views that lie off the centre pixel by the same distance; then one of them alone. */
static void flip_of_a_set_displaced_as_a_whole_is_physical(void **state)
{
    static const int32_t expected[] = {1, 0};
    struct v2v_psf_file psf;
    int32_t partner[2] = {-1, -1};
    (void)state;
    make_psf(&psf, 2, 1, 8, 8); /* centre 3; the set's 4 */
    *pixel(&psf, 0, 0, 1, 3) = *pixel(&psf, 1, 0, 7, 3) = 1;
    assert_int_equal(v2v_shifts_flip_partner(partner, &psf, 0, 0), 1);
    assert_memory_equal(partner, expected, sizeof expected);
    *pixel(&psf, 0, 0, 1, 3) = 0;
    *pixel(&psf, 0, 0, 2, 4) = 1;
    assert_int_equal(v2v_shifts_flip_partner(partner, &psf, 0, 0.5), 0);
    v2v_mem_free(psf.data);
}

static void flip_that_sends_two_views_to_one_is_not_physical(void **state)
{
    struct v2v_psf_file psf;
    int32_t partner[3] = {-1, -1, -1};
    (void)state;
    make_psf(&psf, 3, 1, 5, 5);
    *pixel(&psf, 0, 0, 1, 2) = *pixel(&psf, 1, 0, 1, 2) = 1;
    *pixel(&psf, 2, 0, 3, 2) = 2; /* views 0 and 1 are 0.5 from it, it is 1 from them */
    assert_int_equal(v2v_shifts_flip_partner(partner, &psf, 0, 1.1), 0);
    v2v_mem_free(psf.data);
}

static void equal_views_each_have_their_own_partner(void **state)
{
    struct v2v_psf_file psf;
    int32_t partner[2] = {-1, -1};
    (void)state;
    make_psf(&psf, 2, 1, 5, 5);
    *pixel(&psf, 0, 0, 2, 2) = *pixel(&psf, 1, 0, 2, 2) = 1;
    assert_int_equal(v2v_shifts_flip_partner(partner, &psf, 0, 0.1), 1);
    assert_int_not_equal(partner[0], partner[1]);
    v2v_mem_free(psf.data);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shift_of_a_point_is_its_distance_from_the_centre),
        cmocka_unit_test(shift_of_an_even_side_counts_from_the_flipped_centre),
        cmocka_unit_test(centroids_half_way_round_to_the_even_flipped_pixel),
        cmocka_unit_test(slice_without_energy_has_shift_zero),
        cmocka_unit_test(shifts_short_of_memory_hold_nothing),
        cmocka_unit_test(flip_that_maps_the_set_onto_itself_names_the_partners),
        cmocka_unit_test(flip_compares_a_pixel_without_partner_with_zero),
        cmocka_unit_test(flip_of_a_set_displaced_as_a_whole_is_physical),
        cmocka_unit_test(flip_that_sends_two_views_to_one_is_not_physical),
        cmocka_unit_test(equal_views_each_have_their_own_partner),
    };
    return cmocka_run_group_tests_name("optics.shifts", tests, NULL, NULL);
}
