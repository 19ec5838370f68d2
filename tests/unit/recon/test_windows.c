/* Windows of a frame hold all the tiles that changed, and no more pixels than it pays to cut. */
#include "recon/windows.h"
#include "support.h"
#include "v2v3d/fft/fft2.h"

#include <string.h>

enum { HEIGHT = 250, WIDTH = 400, TILE = 4, ROWS = 63, COLUMNS = 100, HALO = 4, MARGIN = 8 };
enum { TORUS_HEIGHT = 288, TORUS_WIDTH = 440 };

static const struct v2v_windows_plan plan = {.height = HEIGHT,
                                             .width = WIDTH,
                                             .torus_height = TORUS_HEIGHT,
                                             .torus_width = TORUS_WIDTH,
                                             .tile = TILE,
                                             .halo = HALO,
                                             .margin = MARGIN,
                                             .least = 128};

static uint8_t changed[ROWS * COLUMNS];
static struct v2v_core_window windows[V2V_WINDOWS_MOST];

static void mark(int64_t top, int64_t bottom, int64_t left, int64_t right)
{
    for (int64_t y = top; y < bottom; y++) {
        memset(changed + y * COLUMNS + left, 1, (size_t)(right - left));
    }
}

static int64_t cover(void)
{
    return v2v_windows_cover(windows, changed, &plan);
}

static int holds(const struct v2v_part *outer, int64_t first, int64_t end)
{
    return outer->first <= first && outer->first + outer->count >= end;
}

/* Along one axis: of a good length, the core and its margin inside, no place of the torus twice. */
static void assert_axis(const struct v2v_part *part, const struct v2v_part *core, int64_t whole,
                        int64_t torus)
{
    const int64_t end = core->first + core->count;
    assert_true(core->first >= 0 && end <= whole);
    assert_int_equal(part->first % 2, 0);
    assert_int_equal(part->count, v2v_fft_good_size(part->count));
    assert_true(part->count <= torus && part->first + part->count <= torus);
    if (part->count == torus) {
        assert_int_equal(part->first, 0);
    } else {
        assert_true(part->first >= whole - torus);
        assert_true(holds(part, core->first - MARGIN, end + MARGIN));
    }
}

/* Every changed pixel and those HALO around it, of the frame, are in some core. */
static void assert_covered(int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        assert_axis(&windows[i].rows, &windows[i].core_rows, HEIGHT, TORUS_HEIGHT);
        assert_axis(&windows[i].columns, &windows[i].core_columns, WIDTH, TORUS_WIDTH);
    }
    for (int64_t tile = 0; tile < ROWS * COLUMNS; tile++) {
        const int64_t top = tile / COLUMNS * TILE - HALO, left = tile % COLUMNS * TILE - HALO;
        const int64_t bottom = top + TILE + 2 * HALO, right = left + TILE + 2 * HALO;
        int found = !changed[tile];
        for (int64_t i = 0; i < count && !found; i++) {
            found =
                holds(&windows[i].core_rows, top > 0 ? top : 0,
                      bottom < HEIGHT ? bottom : HEIGHT) &&
                holds(&windows[i].core_columns, left > 0 ? left : 0, right < WIDTH ? right : WIDTH);
        }
        assert_true(found);
    }
}

static void nothing_changed_takes_no_window(void **state)
{
    (void)state;
    memset(changed, 0, sizeof changed);
    assert_int_equal(cover(), 0);
    assert_true(v2v_windows_part(windows, 0, &plan) == 0.0);
}

static void one_place_takes_one_window_also_in_a_corner(void **state)
{
    (void)state;
    static const int64_t places[][2] = {{0, 0}, {30, 50}, {60, 97}};
    for (int i = 0; i < 3; i++) {
        memset(changed, 0, sizeof changed);
        mark(places[i][0], places[i][0] + 3, places[i][1], places[i][1] + 3);
        assert_int_equal(cover(), 1);
        assert_covered(1);
        /* 12 + 2 * (4 + 8) pixels: below the least */
        assert_true(v2v_windows_part(windows, 1, &plan) ==
                    128.0 * 128 / ((double)TORUS_HEIGHT * TORUS_WIDTH));
    }
}

/* Twice the margin is beside the core, however large it is. */
static void a_large_place_has_its_margins(void **state)
{
    (void)state;
    memset(changed, 0, sizeof changed);
    mark(10, 38, 20, 48); /* 112 pixels, 120 with the halo, 136 with margins: above the least */
    assert_int_equal(cover(), 1);
    assert_covered(1);
}

/* Of a frame with odd sides the border is odd. */
static void odd_sides_begin_at_even_places(void **state)
{
    (void)state;
    struct v2v_windows_plan odd = plan;
    odd.height = 251;
    odd.width = 399;
    for (int64_t at = 0; at < 60; at += 59) {
        memset(changed, 0, sizeof changed);
        mark(at, at + 2, at, at + 2);
        assert_int_equal(v2v_windows_cover(windows, changed, &odd), 1);
        assert_axis(&windows[0].rows, &windows[0].core_rows, 251, TORUS_HEIGHT);
        assert_axis(&windows[0].columns, &windows[0].core_columns, 399, TORUS_WIDTH);
    }
}

static void places_far_apart_take_a_window_each(void **state)
{
    (void)state;
    memset(changed, 0, sizeof changed);
    mark(5, 8, 5, 8);
    mark(50, 55, 90, 93);
    mark(8, 9, 7, 10); /* near the first */
    assert_int_equal(cover(), 2);
    assert_covered(2);
}

static void a_frame_that_changed_everywhere_is_not_cut(void **state)
{
    (void)state;
    mark(0, ROWS, 0, COLUMNS);
    assert_int_equal(cover(), 1);
    assert_covered(1);
    assert_true(v2v_windows_part(windows, 1, &plan) > 0.9);
}

static void assert_in_frame(int64_t first, int64_t count, int64_t in_frame, int64_t so_many)
{
    const struct v2v_part part = {first, count};
    const struct v2v_part known = v2v_windows_in_frame(&part, HEIGHT);
    assert_int_equal(known.first, in_frame);
    assert_int_equal(known.count, so_many);
}

static void what_of_a_window_is_in_the_frame_is_known(void **state)
{
    (void)state;
    assert_in_frame(20, 128, 0, 128);
    assert_in_frame(-10, 128, 10, 118);
    assert_in_frame(HEIGHT - 100, 128, 0, 100);
    assert_in_frame(-6, HEIGHT + 16, 6, HEIGHT);
    assert_in_frame(0, TORUS_HEIGHT, 0, HEIGHT);
}

/* Before its first row and column are the torus' last. */
static void a_window_is_cut_from_the_torus(void **state)
{
    (void)state;
    enum { COUNT = 2, ROWS_OF_IT = 12, COLUMNS_OF_IT = 10 };
    static float planes[COUNT * TORUS_HEIGHT * TORUS_WIDTH];
    static float out[COUNT * ROWS_OF_IT * COLUMNS_OF_IT];
    static const int64_t at[][2] = {{0, 0}, {-4, 3}, {7, -6}, {-12, -10}, {276, 430}};
    for (int64_t i = 0; i < COUNT * TORUS_HEIGHT * TORUS_WIDTH; i++) {
        planes[i] = (float)i;
    }
    for (int k = 0; k < 5; k++) {
        const struct v2v_core_window window = {
            {at[k][0], ROWS_OF_IT}, {at[k][1], COLUMNS_OF_IT}, {0}, {0}};
        v2v_windows_cut(out, planes, COUNT, &window, &plan);
        for (int64_t i = 0; i < COUNT * ROWS_OF_IT * COLUMNS_OF_IT; i++) {
            const int64_t row = at[k][0] + i / COLUMNS_OF_IT % ROWS_OF_IT + TORUS_HEIGHT;
            const int64_t column = at[k][1] + i % COLUMNS_OF_IT + TORUS_WIDTH;
            const int64_t plane = i / (ROWS_OF_IT * COLUMNS_OF_IT);
            const int64_t place = (plane * TORUS_HEIGHT + row % TORUS_HEIGHT) * TORUS_WIDTH;
            assert_true(out[i] == (float)(place + column % TORUS_WIDTH));
        }
    }
}

static void windows_are_few_however_many_places_changed(void **state)
{
    (void)state;
    memset(changed, 0, sizeof changed);
    for (int64_t i = 0; i < ROWS * COLUMNS; i += 37) {
        changed[i] = 1;
    }
    const int64_t count = cover();
    assert_true(count >= 1 && count <= V2V_WINDOWS_MOST);
    assert_covered(count);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_changed_takes_no_window),
        cmocka_unit_test(one_place_takes_one_window_also_in_a_corner),
        cmocka_unit_test(a_large_place_has_its_margins),
        cmocka_unit_test(odd_sides_begin_at_even_places),
        cmocka_unit_test(places_far_apart_take_a_window_each),
        cmocka_unit_test(a_frame_that_changed_everywhere_is_not_cut),
        cmocka_unit_test(what_of_a_window_is_in_the_frame_is_known),
        cmocka_unit_test(a_window_is_cut_from_the_torus),
        cmocka_unit_test(windows_are_few_however_many_places_changed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
