/* Tiles of an axis: every place is kept once, and none near a tile's end but at the axis' own. */
#include "recon/tiling.h"
#include "support.h"

static void check(int64_t length, int64_t size, int64_t margin)
{
    const struct v2v_tiling tiling = v2v_tiling_of(length, size, margin);
    int64_t end = 0;
    for (int64_t i = 0; i < tiling.count; i++) {
        const int64_t start = v2v_tiling_start(&tiling, i);
        const struct v2v_part kept = v2v_tiling_kept(&tiling, i);
        assert_int_equal(kept.first, end);
        assert_true(kept.count > 0);
        end = kept.first + kept.count;
        assert_true(start >= 0 && (start + size <= length || tiling.count == 1));
        assert_true(kept.first >= start + (i > 0 ? margin : 0));
        assert_true(end <= start + size - (i < tiling.count - 1 ? margin : 0));
    }
    assert_int_equal(end, length);
    /* no tile more than needed: with one less, what each can keep would not do */
    const int64_t inner = size - 2 * margin, less = tiling.count - 1;
    assert_true(less == 0 || less * inner + 2 * margin < length);
}

static void every_place_is_kept_once_away_from_the_tiles_ends(void **state)
{
    (void)state;
    for (int64_t length = 1; length < 90; length++) {
        for (int64_t size = 1; size < 24; size++) {
            for (int64_t margin = 0; 2 * margin < size; margin++) {
                check(length, size, margin);
            }
        }
    }
}

static void one_tile_that_is_enough_has_no_margin(void **state)
{
    (void)state;
    for (int64_t length = 1; length < 24; length++) {
        for (int64_t margin = 0; margin < 30; margin++) {
            const struct v2v_tiling tiling = v2v_tiling_of(length, 24, margin);
            assert_int_equal(tiling.count, 1);
            assert_int_equal(v2v_tiling_kept(&tiling, 0).count, length);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_place_is_kept_once_away_from_the_tiles_ends),
        cmocka_unit_test(one_tile_that_is_enough_has_no_margin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
