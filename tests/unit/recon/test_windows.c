/* Windows of a frame hold all the tiles that changed, and no more pixels than it pays to cut. */
#include "recon/windows.h"
#include "support.h"

#include <string.h>

enum { HEIGHT = 250, WIDTH = 400, TILE = 4, ROWS = 63, COLUMNS = 100, HALO = 4, MARGIN = 16 };

static const struct v2v_windows_plan plan = {.height = HEIGHT,
                                             .width = WIDTH,
                                             .tile = TILE,
                                             .halo = HALO,
                                             .margin = MARGIN,
                                             .border = 40,
                                             .least = 128};

static uint8_t changed[ROWS * COLUMNS];
static struct v2v_window windows[V2V_WINDOWS_MOST];

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

/* Along one axis: in the frame, of an allowed length, the core inside and its margin, too, unless
 * the frame ends. */
static void assert_axis(const struct v2v_part *part, const struct v2v_part *core, int64_t whole)
{
    const int64_t end = core->first + core->count;
    assert_true(part->first >= 0 && part->first + part->count <= whole);
    assert_int_equal(part->first % 2, 0);
    assert_true(part->count % V2V_WINDOWS_STEP == 0 || part->first + part->count == whole);
    assert_true(holds(part, core->first > MARGIN ? core->first - MARGIN : 0,
                      end + MARGIN < whole ? end + MARGIN : whole));
}

/* Every changed pixel and those HALO around it, of the frame, are in some core. */
static void assert_covered(int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        assert_axis(&windows[i].rows, &windows[i].core_rows, HEIGHT);
        assert_axis(&windows[i].columns, &windows[i].core_columns, WIDTH);
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
        /* 12 + 2 * (4 + 16) pixels, rounded up, and the border: below the least */
        assert_true(v2v_windows_part(windows, 1, &plan) == 128.0 * 128 / (290.0 * 440));
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
    assert_true(v2v_windows_part(windows, 1, &plan) == 1.0);
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
        cmocka_unit_test(places_far_apart_take_a_window_each),
        cmocka_unit_test(a_frame_that_changed_everywhere_is_not_cut),
        cmocka_unit_test(windows_are_few_however_many_places_changed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
