/* Which tiles of images of half the sides a scene needs, against the definition and against a whole
 * convolution. */
#include "support.h"
#include "v2v/scene_half.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/op/conv.h"

#include <math.h>
#include <string.h>

/* Tiles of the frame; the square of background that lies at (ROW,COLUMN). */
enum { ROWS = 24, COLUMNS = 32, TILES = ROWS * COLUMNS, ROW = 8, COLUMN = 11, SQUARE = 8 };
enum { HALF_ROWS = ROWS / 2, HALF_COLUMNS = COLUMNS / 2, HALF_TILES = TILES / 4 };
enum { IN = 5, OUT = 6, WIDTH = COLUMNS * 2, PIXELS = ROWS * 2 * WIDTH };

struct frame {
    uint8_t computed[TILES], dark[TILES];
    struct v2v_tiles computed_list, dark_list;
    struct v2v_scene_half half;
};

static int is_in_square(int64_t i)
{
    int64_t y = i / COLUMNS - ROW, x = i % COLUMNS - COLUMN;
    return y >= 0 && y < SQUARE && x >= 0 && x < SQUARE;
}

/* A tenth of the tiles is lit, here and there. */
static void setup(struct frame *frame, uint64_t seed)
{
    *frame = (struct frame){0};
    for (int64_t i = 0; i < TILES; i++) {
        int lit = !is_in_square(i) && v2v_random_uniform(seed, 0, (uint64_t)i) < 0.1;
        frame->dark[i] = (uint8_t)!lit;
        frame->computed[i] = (uint8_t)(lit || is_in_square(i));
    }
    assert_ok(v2v_tiles_init(&frame->computed_list, ROWS * V2V_TILE, COLUMNS * V2V_TILE));
    assert_ok(v2v_tiles_init(&frame->dark_list, ROWS * V2V_TILE, COLUMNS * V2V_TILE));
    v2v_tiles_set(&frame->computed_list, frame->computed);
    v2v_tiles_set(&frame->dark_list, frame->dark);
    assert_ok(v2v_scene_half_init(&frame->half, &frame->computed_list));
    v2v_scene_half_set(&frame->half, &frame->computed_list, &frame->dark_list, ROW, COLUMN);
}

static void teardown(struct frame *frame)
{
    v2v_scene_half_fini(&frame->half);
    v2v_tiles_fini(&frame->computed_list);
    v2v_tiles_fini(&frame->dark_list);
    assert_int_equal(v2v_mem_held(), 0);
}

static void unlist(uint8_t *mask, const struct v2v_tiles *tiles)
{
    memset(mask, 0, HALF_TILES);
    for (int64_t r = 0; r < tiles->first[tiles->rows]; r++) {
        const struct v2v_tile_run *run = &tiles->run[r];
        memset(mask + run->row * HALF_COLUMNS + run->first, 1, (size_t)run->count);
    }
}

/* Is any pixel that a tile of half the sides is computed from, one beyond its sides, in a marked
 * tile of the frame, 2 x 2 such pixels? Or does one lie beyond the frame? */
static int sees(const uint8_t *mask, int64_t y, int64_t x)
{
    for (int64_t i = 0; i < 36; i++) {
        int64_t py = y * 4 - 1 + i / 6, px = x * 4 - 1 + i % 6;
        if (py < 0 || px < 0 || py >= ROWS * 2 || px >= WIDTH || mask[py / 2 * COLUMNS + px / 2]) {
            return 1;
        }
    }
    return 0;
}

/* Mark what a tile of the frame reads of an image of half the sides that is upsampled. */
static void mark_read(uint8_t *mask, int64_t y, int64_t x)
{
    for (int64_t i = 0; i < 36; i++) {
        int64_t py = (y * 4 - 1 + i / 6) >> 1, px = (x * 4 - 1 + i % 6) >> 1;
        if (py >= 0 && px >= 0 && py < ROWS * 2 && px < WIDTH) {
            mask[py / 4 * HALF_COLUMNS + px / 4] = 1;
        }
    }
}

static void lists_hold_what_sees_light_and_what_is_read(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= 5; seed++) {
        struct frame frame;
        uint8_t mixed[HALF_TILES], even[HALF_TILES], read[HALF_TILES];
        uint8_t wanted[HALF_TILES] = {0}, lit[TILES];
        setup(&frame, seed);
        unlist(mixed, &frame.half.mixed);
        unlist(even, &frame.half.even);
        unlist(read, &frame.half.read);
        for (int64_t i = 0; i < TILES; i++) {
            lit[i] = !frame.dark[i];
        }
        int64_t sample = frame.half.row * HALF_COLUMNS + frame.half.column;
        assert_false(sees(lit, frame.half.row, frame.half.column));
        for (int64_t i = 0; i < TILES; i++) {
            if (frame.computed[i]) {
                mark_read(wanted, i / COLUMNS, i % COLUMNS);
            }
        }
        for (int64_t i = 0; i < HALF_TILES; i++) {
            int is_mixed = sees(lit, i / HALF_COLUMNS, i % HALF_COLUMNS) || i == sample;
            assert_int_equal(mixed[i], is_mixed);
            assert_int_equal(even[i], !is_mixed);
            assert_int_equal(read[i], wanted[i]);
        }
        teardown(&frame);
    }
}

static float *draw(int64_t count, uint64_t stream)
{
    float *x = v2v_mem_alloc("test", count, sizeof *x);
    assert_non_null(x);
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)v2v_random_normal(3, stream, (uint64_t)i);
    }
    return x;
}

/* Images of half the sides, the same in all dark tiles. */
static float *draw_images(const struct frame *frame)
{
    float *in = draw(IN * PIXELS, 1);
    for (int64_t i = 0; i < IN * PIXELS; i++) {
        int64_t y = i % PIXELS / WIDTH, x = i % WIDTH;
        if (frame->dark[y / 2 * COLUMNS + x / 2]) {
            in[i] = 0.3f * (float)(i / PIXELS) - 0.5f;
        }
    }
    return in;
}

/* 45 products a sum; by Winograd the round-off of as many terms grows by less than 100
 * (the transforms' constants), of values of about 1. */
static void one_tile_of_background_stands_for_all(void **state)
{
    (void)state;
    const double bound = 100.0 * sqrt(9.0 * IN) * 6e-8 * 4.0;
    struct v2v_workspace workspace = {0};
    struct v2v_conv_spec spec = {.batch = 1,
                                 .in = 32,
                                 .out = 32,
                                 .height = ROWS * 2,
                                 .width = WIDTH,
                                 .kernel = 3,
                                 .stride = 1,
                                 .slope = 1.0f,
                                 .method = {.winograd = 1, .workspace = &workspace}};
    struct v2v_conv *conv = NULL;
    struct frame frame;
    setup(&frame, 1);
    float *in = draw(spec.in * PIXELS, 1), *few = draw_images(&frame);
    float *weight = draw(spec.in * spec.out * 9, 2), *bias = draw(spec.out, 3);
    float *whole = draw(spec.out * PIXELS, 4), *part = draw(spec.out * PIXELS, 5);
    memset(in, 0, (size_t)(spec.in * PIXELS) * sizeof *in); /* so many channels that tiles pay */
    memcpy(in, few, IN * PIXELS * sizeof *in);
    assert_ok(v2v_conv_create(&conv, &spec));
    v2v_conv_set_weights(conv, weight, bias);
    v2v_conv_forward(conv, whole, in);
    v2v_conv_forward_tiles(conv, part, in, &frame.half.mixed);
    v2v_scene_half_level(&frame.half, part, spec.out);
    for (int64_t i = 0; i < spec.out * PIXELS; i++) {
        assert_true(fabs((double)part[i] - (double)whole[i]) <= bound);
    }
    float *owned[] = {in, few, weight, bias, whole, part};
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++) {
        v2v_mem_free(owned[i]);
    }
    v2v_conv_destroy(&conv);
    v2v_workspace_fini(&workspace);
    teardown(&frame);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lists_hold_what_sees_light_and_what_is_read),
        cmocka_unit_test(one_tile_of_background_stands_for_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
