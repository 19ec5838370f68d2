/* Lists of tiles, and lines of images that hold listed tiles alone. */
#include "support.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/op/tiles.h"

#include <string.h>

enum { TILE = V2V_TILE, ROWS = 5, COLUMNS = 9, WIDTH = COLUMNS * TILE, HEIGHT = ROWS * TILE };

static const char *const picture[ROWS] = {
    "##..#...#", /* at either edge */
    "..#.##...", /* touched by a corner, by an edge */
    "#...##..#", "...#.....", "##.######",
};

static void list(struct v2v_tiles *tiles)
{
    uint8_t mask[ROWS * COLUMNS];
    for (int64_t i = 0; i < ROWS * COLUMNS; i++) {
        mask[i] = picture[i / COLUMNS][i % COLUMNS] == '#';
    }
    assert_ok(v2v_tiles_init(tiles, HEIGHT, WIDTH));
    v2v_tiles_set(tiles, mask);
}

static void every_listed_tile_has_its_number(void **state)
{
    (void)state;
    struct v2v_tiles tiles;
    int64_t count = 0;
    list(&tiles);
    for (int64_t row = 0; row < ROWS; row++) {
        assert_int_equal(tiles.before[row], count);
        for (int64_t x = 0; x < COLUMNS; x++) {
            int is_listed = picture[row][x] == '#';
            assert_int_equal(tiles.number[row * COLUMNS + x], is_listed ? count : -1);
            count += is_listed;
        }
    }
    assert_int_equal(tiles.before[ROWS], count);
    assert_int_equal(tiles.count, count);
    v2v_tiles_fini(&tiles);
    assert_int_equal(v2v_mem_held(), 0);
}

static int is_listed(int64_t y, int64_t x)
{
    return picture[y / TILE][x / TILE] == '#';
}

/* Every pixel of the frame has a value of its own, 0 is none of them. */
static float value(int64_t y, int64_t x)
{
    return (float)(1 + y * WIDTH + x);
}

/* Pixel (y,x) as the tiles of `run` see it: of their row of tiles as far as it is listed. */
static float seen(const struct v2v_tile_run *run, int64_t y, int64_t x)
{
    int64_t first = run->first, last = run->first + run->count - 1, top = run->row * TILE;
    if (y < 0 || y >= HEIGHT || x < 0 || x >= WIDTH) {
        return 0.0f;
    }
    if (is_listed(y, x)) {
        return value(y, x);
    }
    while (first > 0 && picture[run->row][first - 1] == '#') {
        first--;
    }
    while (last < COLUMNS - 1 && picture[run->row][last + 1] == '#') {
        last++;
    }
    return value(v2v_within(y, top, top + TILE - 1),
                 v2v_within(x, first * TILE, last * TILE + TILE - 1));
}

/* Runs and every part of them. */
static void lines_go_on_where_no_tile_is(void **state)
{
    (void)state;
    static float channel[HEIGHT * WIDTH];
    struct v2v_tiles tiles;
    int64_t checked = 0;
    list(&tiles);
    for (int64_t i = 0; i < HEIGHT * WIDTH; i++) {
        int64_t y = i / WIDTH, x = i % WIDTH;
        int64_t number = tiles.number[y / TILE * COLUMNS + x / TILE];
        if (number >= 0) {
            channel[(number * TILE + y % TILE) * TILE + x % TILE] = value(y, x);
        }
    }
    for (int64_t i = 0; i < ROWS * COLUMNS * COLUMNS; i++) {
        struct v2v_tile_run run = {
            .row = i / COLUMNS / COLUMNS, .first = i / COLUMNS % COLUMNS, .count = i % COLUMNS + 1};
        if (run.first + run.count > COLUMNS ||
            memchr(picture[run.row] + run.first, '.', (size_t)run.count) != NULL) {
            continue;
        }
        for (int64_t k = 0; k < TILE + 2; k++) {
            float line[WIDTH + 2];
            v2v_tiles_line(line, &tiles, channel, &run, k);
            for (int64_t x = 0; x < run.count * TILE + 2; x++) {
                assert_true(line[x] ==
                            seen(&run, run.row * TILE + k - 1, run.first * TILE + x - 1));
            }
            checked++;
        }
    }
    assert_true(checked > 30 * (TILE + 2));
    v2v_tiles_fini(&tiles);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_listed_tile_has_its_number),
        cmocka_unit_test(lines_go_on_where_no_tile_is),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
