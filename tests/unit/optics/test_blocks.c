/* Blocks read exactly what shifts and kernel positions read, each pixel once. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/blocks.h"
#include "v2v3d/optics/taps.h"

enum { VIEWS = 4, LISTED = 3, SLICES = 11, REACH = 5, PLACES = LISTED * SLICES * 9 };

static const int32_t listed[LISTED] = {0, 2, 3};

static void random_shifts(struct v2v_shifts *shifts, int32_t *dy, int32_t *dx)
{
    for (int i = 0; i < VIEWS * SLICES; i++) {
        dy[i] = (int32_t)v2v_random_below(3, 0, (uint64_t)i, 2 * REACH + 1) - REACH;
        dx[i] = (int32_t)v2v_random_below(3, 1, (uint64_t)i, 2 * REACH + 1) - REACH;
    }
    *shifts = (struct v2v_shifts){VIEWS, SLICES, dy, dx};
}

static void check_places(const struct v2v_blocks *blocks, const struct v2v_shifts *shifts)
{
    for (int place = 0; place < PLACES; place++) {
        int i = place / (SLICES * 9), z = place / 9 % SLICES, k = place % 9;
        int at = listed[i] * SLICES + z;
        const struct v2v_block *block = &blocks->block[blocks->of[place] / 9];
        int inner = blocks->of[place] % 9;
        assert_int_equal(block->view, i);
        assert_int_equal(block->y + inner / 3, shifts->dy[at] + k / 3);
        assert_int_equal(block->x + inner % 3, shifts->dx[at] + k % 3);
    }
    for (int i = 0; i < LISTED; i++) {
        for (int64_t b = blocks->first[i]; b < blocks->first[i + 1]; b++) {
            assert_int_equal(blocks->block[b].view, i);
        }
    }
    assert_int_equal(blocks->first[LISTED], blocks->count);
}

static void merged_blocks_take_every_tap_once(void **state)
{
    (void)state;
    int32_t dy[VIEWS * SLICES], dx[VIEWS * SLICES];
    struct v2v_shifts shifts;
    struct v2v_taps taps;
    struct v2v_blocks blocks;
    uint8_t used[PLACES * 9] = {0}; /* a block for every tap at worst */
    int64_t distinct = 0;
    random_shifts(&shifts, dy, dx);
    assert_ok(v2v_taps_create(&taps, &shifts, listed, LISTED, V2V_TAPS_ALL, V2V_TAPS_ALL, 1));
    assert_ok(v2v_blocks_create(&blocks, &shifts, listed, LISTED, 1));
    check_places(&blocks, &shifts);
    for (int place = 0; place < PLACES; place++) {
        distinct += !used[blocks.of[place]];
        used[blocks.of[place]] = 1;
    }
    assert_int_equal(distinct, taps.count);
    print_message("%d blocks for %d shifts\n", (int)blocks.count, LISTED * SLICES);
    v2v_blocks_fini(&blocks);
    v2v_taps_fini(&taps);
    assert_int_equal(v2v_mem_held(), 0);
}

static void blocks_of_every_slice_are_the_shifts(void **state)
{
    (void)state;
    int32_t dy[VIEWS * SLICES], dx[VIEWS * SLICES];
    struct v2v_shifts shifts;
    struct v2v_blocks blocks;
    random_shifts(&shifts, dy, dx);
    assert_ok(v2v_blocks_create(&blocks, &shifts, listed, LISTED, 0));
    check_places(&blocks, &shifts);
    assert_int_equal(blocks.count, LISTED * SLICES);
    v2v_blocks_fini(&blocks);
}

/* Shifts along a row: the taps are 3 rows of length SLICES + 2. */
static void a_straight_line_of_shifts_takes_a_third_of_the_blocks(void **state)
{
    (void)state;
    enum { LONG = 31 };
    int32_t dy[LONG] = {0}, dx[LONG];
    struct v2v_shifts shifts = {1, LONG, dy, dx};
    struct v2v_blocks blocks;
    for (int z = 0; z < LONG; z++) {
        dx[z] = z - LONG / 2;
    }
    assert_ok(v2v_blocks_create(&blocks, &shifts, listed, 1, 1));
    assert_int_equal(blocks.count, (LONG + 2) / 3);
    v2v_blocks_fini(&blocks);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(merged_blocks_take_every_tap_once),
        cmocka_unit_test(blocks_of_every_slice_are_the_shifts),
        cmocka_unit_test(a_straight_line_of_shifts_takes_a_third_of_the_blocks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
