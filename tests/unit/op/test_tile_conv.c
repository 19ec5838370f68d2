/* Convolutions of listed tiles in bf16, against direct sums. Numbers are multiples of 1/128 up to
 * 1, which bf16 holds, their products of 2^-14, whose sums float32 holds up to 2^10: results are
 * exact. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/op/blocked.h"
#include "v2v3d/op/gemm.h"
#include "v2v3d/op/tile_conv.h"

#include <math.h>
#include <string.h>

/* More than two blocks of 32 channels; more than two groups of 32 tiles, an odd number, be they all
 * or listed ones. */
enum { IN = 70, OUT = 40, TILE = V2V_TILE, ROWS = 15, COLUMNS = 9, TAPS = 9 };
enum { HEIGHT = ROWS * TILE, WIDTH = COLUMNS * TILE, PIXELS = HEIGHT * WIDTH };

static const char *const picture[ROWS] = {
    "##..#...#", "..#.##...", "#...##..#", "...#.....", "##.######",
    ".........", "####.####", "#########", "#.#.#.#.#", ".##.##.##",
    "####.####", ".........", "##.######", "#..#..#..", "#..#.....",
};

static struct v2v_workspace workspace;
static float in[IN * PIXELS], weight[OUT * IN * TAPS], bias[OUT];
static float out[OUT * PIXELS], again[OUT * PIXELS];

static void fill(float *x, int64_t count, uint64_t stream, int exact)
{
    for (int64_t i = 0; i < count; i++) {
        const double value = 2.0 * v2v_random_uniform(29, stream, (uint64_t)i) - 1.0;
        x[i] = (float)(exact ? round(value * 128.0) / 128.0 : value);
    }
}

static void draw(int exact)
{
    fill(in, IN * PIXELS, 1, exact);
    fill(weight, OUT * IN * TAPS, 2, exact);
    fill(bias, OUT, 3, exact);
    memset(out, 0, sizeof out);
}

static int drop_workspace(void **state)
{
    (void)state;
    v2v_workspace_fini(&workspace);
    return v2v_mem_held() != 0;
}

static void skip_without_bf16(void)
{
    if (!v2v_tile_conv_usable()) {
        print_message(
            "this processor has no instructions for bf16, or DNNL_MAX_CPU_ISA hides them\n");
        skip();
    }
}

static void list_all(struct v2v_tiles *tiles)
{
    assert_ok(v2v_tiles_init(tiles, HEIGHT, WIDTH));
}

static void list_picture(struct v2v_tiles *tiles)
{
    uint8_t mask[ROWS * COLUMNS];
    list_all(tiles);
    for (int64_t i = 0; i < ROWS * COLUMNS; i++) {
        mask[i] = picture[i / COLUMNS][i % COLUMNS] == '#';
    }
    v2v_tiles_set(tiles, mask);
}

static void run(const struct v2v_tile_conv_spec *spec, float *to, const float *from,
                const struct v2v_winograd_part *part)
{
    struct v2v_tile_conv *conv = NULL;
    assert_ok(v2v_tile_conv_create(&conv, spec));
    v2v_tile_conv_set_weights(conv, weight, bias);
    v2v_tile_conv_forward(conv, to, from, part);
    v2v_tile_conv_destroy(&conv);
}

/* ---- plain images ---- */

static double pixel(int64_t c, int64_t y, int64_t x, int half)
{
    const int inside = y >= 0 && y < HEIGHT && x >= 0 && x < WIDTH;
    return inside
               ? (double)in[c * (PIXELS >> 2 * half) + (y >> half) * (WIDTH >> half) + (x >> half)]
               : 0.0;
}

static double expected(int64_t o, int64_t y, int64_t x, int half)
{
    double sum = (double)bias[o];
    for (int64_t i = 0; i < IN * TAPS; i++) {
        const int64_t c = i / TAPS, tap = i % TAPS;
        sum += (double)weight[o * IN * TAPS + i] * pixel(c, y + tap / 3 - 1, x + tap % 3 - 1, half);
    }
    return sum > 0.0 ? sum : 0.25 * sum;
}

static void check_plain(int half, int stride2)
{
    struct v2v_plane plane[IN];
    struct v2v_tiles all;
    const int64_t width = WIDTH >> stride2, pixels = PIXELS >> 2 * stride2;
    for (int64_t c = 0; c < IN; c++) {
        plane[c] = (struct v2v_plane){
            .offset = c * (PIXELS >> 2 * half), .y1 = HEIGHT, .x1 = WIDTH, .owner = c};
    }
    const struct v2v_tile_conv_spec spec = {.in = IN,
                                            .out = OUT,
                                            .height = HEIGHT,
                                            .width = WIDTH,
                                            .plane = plane,
                                            .pitch = WIDTH >> half,
                                            .half = half,
                                            .stride2 = stride2,
                                            .slope = 0.25f,
                                            .workspace = &workspace};
    draw(1);
    list_all(&all);
    run(&spec, out, in, &(struct v2v_winograd_part){.run = all.run, .runs = all.first[ROWS]});
    for (int64_t i = 0; i < OUT * pixels; i++) {
        const int64_t y = i % pixels / width, x = i % width;
        assert_true((double)out[i] == expected(i / pixels, y << stride2, x << stride2, half));
    }
    v2v_tiles_fini(&all);
}

static void plain_images_are_direct_sums(void **state)
{
    (void)state;
    skip_without_bf16();
    check_plain(0, 0);
    check_plain(1, 0);
    check_plain(0, 1);
}

/* ---- listed tiles ---- */

/* Tiles of the list side by side, in float32 [channel][tile][16] and blocked. */
static void put_listed(float *plain, float *blocked, const struct v2v_tiles *list)
{
    const int64_t pixels = list->count * TILE * TILE;
    const struct v2v_blocked image = {
        .data = blocked, .channels = IN, .height = 1, .width = pixels};
    for (int64_t i = 0; i < IN * PIXELS; i++) {
        const int64_t y = i % PIXELS / WIDTH, x = i % WIDTH;
        const int64_t number = list->number[y / TILE * COLUMNS + x / TILE];
        if (number >= 0) {
            plain[i / PIXELS * pixels + (number * TILE + y % TILE) * TILE + x % TILE] = in[i];
        }
    }
    for (int64_t block = 0; block < v2v_blocked_count(IN); block++) {
        const float *row[V2V_BLOCKED_CHANNELS] = {NULL};
        for (int64_t c = 0; c < V2V_BLOCKED_CHANNELS && block * V2V_BLOCKED_CHANNELS + c < IN;
             c++) {
            row[c] = plain + (block * V2V_BLOCKED_CHANNELS + c) * pixels;
        }
        v2v_blocked_set(&image, block, 0, 0, row, pixels);
    }
}

/* Tile `t` of a run from lines as Winograd's operators see them. */
static double listed_sum(const struct v2v_tiles *list, const float *plain,
                         const struct v2v_tile_run *tile, int64_t o, int64_t y, int64_t x)
{
    double sum = (double)bias[o];
    for (int64_t c = 0; c < IN; c++) {
        for (int64_t k = 0; k < 3; k++) {
            float line[TILE + 2];
            v2v_tiles_line(line, list, plain + c * list->count * TILE * TILE, tile, y + k);
            for (int64_t l = 0; l < 3; l++) {
                sum += (double)weight[(o * IN + c) * TAPS + 3 * k + l] * (double)line[x + l];
            }
        }
    }
    return sum > 0.0 ? sum : 0.25 * sum;
}

static struct v2v_tile_conv_spec listed_spec(int64_t pixels)
{
    return (struct v2v_tile_conv_spec){.in = IN,
                                       .out = OUT,
                                       .height = HEIGHT,
                                       .width = WIDTH,
                                       .in_pixels = pixels,
                                       .slope = 0.25f,
                                       .workspace = &workspace};
}

static float plain[IN * PIXELS], blocked[96 * PIXELS];

static void listed_tiles_see_what_is_nearest(void **state)
{
    (void)state;
    skip_without_bf16();
    struct v2v_tiles list;
    draw(1);
    list_picture(&list);
    put_listed(plain, blocked, &list);
    const struct v2v_tile_conv_spec spec = listed_spec(list.count * TILE * TILE);
    run(&spec, out, blocked,
        &(struct v2v_winograd_part){.run = list.run, .runs = list.first[ROWS], .in_list = &list});
    for (int64_t i = 0; i < PIXELS; i++) {
        const int64_t y = i / WIDTH, x = i % WIDTH, o = i % OUT;
        const struct v2v_tile_run tile = {.row = y / TILE, .first = x / TILE, .count = 1};
        const int is_listed = list.number[tile.row * COLUMNS + tile.first] >= 0;
        const double value =
            is_listed ? listed_sum(&list, plain, &tile, o, y % TILE, x % TILE) : 0.0;
        assert_true((double)out[o * PIXELS + i] == value);
    }
    v2v_tiles_fini(&list);
}

/* Some rows of tiles, more than a group, read from memory that begins with a later row and written
 * to such, are those of all: to the bits, of numbers with all bits of float32, with any number of
 * threads. */
static void a_part_has_the_bits_of_the_whole(void **state)
{
    (void)state;
    enum { BEGIN = 1, FIRST = 2, LAST = 13, NUMBERS = TILE * TILE * V2V_BLOCKED_CHANNELS / 2 };
    skip_without_bf16();
    struct v2v_tiles list;
    draw(0);
    list_picture(&list);
    put_listed(plain, blocked, &list);
    const int64_t tiles = list.count, blocks = v2v_blocked_count(OUT);
    struct v2v_tile_conv_spec spec = listed_spec(tiles * TILE * TILE);
    spec.out_pixels = spec.in_pixels;
    struct v2v_winograd_part part = {
        .run = list.run, .runs = list.first[ROWS], .in_list = &list, .out_list = &list};
    run(&spec, out, blocked, &part);
    part.run = list.run + list.first[FIRST];
    part.runs = list.first[LAST] - list.first[FIRST];
    part.first_row = FIRST;
    part.shift = -list.before[BEGIN] * TILE * TILE;
    for (int threads = 1; threads <= 3; threads++) {
        v2v_op_set_threads(threads);
        memset(again, 0, sizeof again);
        run(&spec, again, blocked + list.before[BEGIN] * NUMBERS, &part);
        for (int64_t b = 0; b < blocks; b++) {
            assert_memory_equal(
                again + b * tiles * NUMBERS, out + (b * tiles + list.before[FIRST]) * NUMBERS,
                (size_t)((list.before[LAST] - list.before[FIRST]) * NUMBERS) * sizeof *out);
        }
    }
    v2v_op_set_threads(1);
    v2v_tiles_fini(&list);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(plain_images_are_direct_sums),
        cmocka_unit_test(listed_tiles_see_what_is_nearest),
        cmocka_unit_test(a_part_has_the_bits_of_the_whole),
    };
    return cmocka_run_group_tests(tests, NULL, drop_workspace);
}
