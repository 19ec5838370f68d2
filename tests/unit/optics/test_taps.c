/* Merged alignment taps (REFERENCE.md 8). */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/optics/taps.h"

#include <stdio.h>
#include <string.h>

enum { VIEWS = 5, SLICES = 7, LISTED = 3 };

static const int32_t listed[LISTED] = {0, 2, 4};

static void fill(struct v2v_shifts *shifts, int32_t *dy, int32_t *dx)
{
    *shifts = (struct v2v_shifts){.views = VIEWS, .slices = SLICES, .dy = dy, .dx = dx};
    for (int i = 0; i < VIEWS * SLICES; i++) {
        dy[i] = (int32_t)v2v_random_below(3, 0, (uint64_t)i, 5) - 2;
        dx[i] = (int32_t)v2v_random_below(3, 1, (uint64_t)i, 9) - 4;
    }
}

static void check_place(const struct v2v_taps *taps, const struct v2v_shifts *shifts, int i, int z,
                        int k, int l, unsigned rows)
{
    int32_t t = taps->of[((i * SLICES + z) * 3 + k) * 3 + l];
    if (!(rows >> k & 1)) {
        assert_int_equal(t, -1);
        return;
    }
    assert_in_range(t, 0, taps->count - 1);
    int at = listed[i] * SLICES + z;
    assert_int_equal(taps->tap[t].view, i);
    assert_int_equal(taps->tap[t].y, k - 1 + shifts->dy[at]);
    assert_int_equal(taps->tap[t].x, l - 1 + shifts->dx[at]);
}

static void every_kernel_position_has_its_tap(void **state)
{
    (void)state;
    static const unsigned rows[] = {V2V_TAPS_ALL, V2V_TAPS_NOT_FIRST, V2V_TAPS_NOT_LAST};
    int32_t dy[VIEWS * SLICES], dx[VIEWS * SLICES];
    struct v2v_shifts shifts;
    fill(&shifts, dy, dx);
    for (int r = 0; r < 3; r++) {
        struct v2v_taps taps;
        assert_ok(v2v_taps_create(&taps, &shifts, listed, LISTED, rows[r], V2V_TAPS_ALL, 1));
        for (int place = 0; place < LISTED * SLICES * 9; place++) {
            check_place(&taps, &shifts, place / 9 / SLICES, place / 9 % SLICES, place / 3 % 3,
                        place % 3, rows[r]);
        }
        v2v_taps_fini(&taps);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void taps_are_distinct_and_sorted(void **state)
{
    (void)state;
    int32_t dy[VIEWS * SLICES], dx[VIEWS * SLICES];
    struct v2v_shifts shifts;
    struct v2v_taps taps;
    fill(&shifts, dy, dx);
    assert_ok(v2v_taps_create(&taps, &shifts, listed, LISTED, V2V_TAPS_ALL, V2V_TAPS_ALL, 1));
    for (int64_t t = 1; t < taps.count; t++) {
        const struct v2v_tap *a = &taps.tap[t - 1], *b = &taps.tap[t];
        assert_true(a->view < b->view || (a->view == b->view && a->y < b->y) ||
                    (a->view == b->view && a->y == b->y && a->x < b->x));
    }
    v2v_taps_fini(&taps);
}

static void the_2psam_set_has_423_and_486_taps(void **state)
{
    (void)state;
    static const int64_t golden[] = {423, 486};
    struct v2v_psf_file psf;
    struct v2v_shifts shifts;
    char folder[512];
    const char *found = test_shared("psf/2psam/psf_1.tif");
    if (found == NULL) {
        skip();
    }
    snprintf(folder, sizeof folder, "%.*s", (int)(strrchr(found, '/') - found), found);
    assert_ok(v2v_psf_read(&psf, folder, "", V2V_NORMALIZE_NONE, NULL));
    assert_ok(v2v_shifts_from_psf(&shifts, &psf));
    for (int b = 0; b < 2; b++) {
        struct v2v_taps taps;
        int32_t views[13];
        int64_t count = 0;
        for (int32_t v = b; v < 13; v += 2) {
            views[count++] = v;
        }
        assert_ok(v2v_taps_create(&taps, &shifts, views, count, V2V_TAPS_ALL, V2V_TAPS_ALL, 1));
        assert_int_equal(taps.count, golden[b]);
        v2v_taps_fini(&taps);
    }
    v2v_shifts_fini(&shifts);
    v2v_psf_file_fini(&psf);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kernel_position_has_its_tap),
        cmocka_unit_test(taps_are_distinct_and_sorted),
        cmocka_unit_test(the_2psam_set_has_423_and_486_taps),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
