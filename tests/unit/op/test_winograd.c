/* Winograd against the double-precision twin: every size of tail, upsampling, chunks. */
#include "op/conv_backend.h"
#include "support.h"
#include "twin_conv.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/op/activation.h"
#include "v2v3d/op/winograd.h"

#include <math.h>
#include <string.h>

/* Transforms grow a sum's moduli by at most 16 along each axis (48 at the worst output of a filter
 * of ones, against 3), and round about ten times on the way. */
#define GROWTH 256.0
#define EPSILON 0x1p-24

struct problem {
    int64_t in, out, height, width;
    int half;
    int64_t chunk_floats;
    int stride2;
    int keeps, sets;
};

/* Frames of less than a tile, of a tile and a bit, channels that fill no panel; the last ones in
 * several chunks. */
static const struct problem problems[] = {
    {1, 1, 1, 1, 0, 0, 0, 0, 0},
    {3, 5, 4, 4, 0, 0, 0, 0, 0},
    {8, 32, 5, 9, 0, 0, 0, 0, 0},
    {40, 39, 50, 70, 0, 0, 0, 0, 0},
    {129, 33, 12, 36, 0, 0, 0, 0, 0},
    {7, 16, 12, 20, 1, 0, 0, 0, 0},
    {16, 8, 2, 2, 1, 0, 0, 0, 0},
    {24, 40, 36, 28, 0, 1, 0, 0, 0},
    {9, 17, 40, 12, 1, 36 * 24 * 3 * 2, 0, 0, 0},
    {1, 3, 3, 131, 0, 0, 0, 0, 0},
    {130, 136, 17, 33, 0, 1, 0, 0, 0},
    {8, 32, 5, 9, 0, 0, 1, 0, 0},
    {24, 40, 36, 28, 0, 1, 1, 0, 0},
    {33, 16, 11, 22, 0, 0, 1, 0, 0},
};
enum { PROBLEMS = sizeof problems / sizeof *problems };

struct fixture {
    struct v2v_conv_spec spec; /* of the twin */
    struct v2v_workspace workspace;
    struct v2v_winograd *winograd;
    int64_t in_floats, small_floats, out_floats, weights;
    float *small, *in, *dout, *weight, *bias; /* in: small with every pixel repeated */
    float *out, *din, *dweight;
    double *value, *moduli;
};

static float *draw(int64_t count, uint64_t stream)
{
    float *x = v2v_mem_alloc("test", count, sizeof *x);
    assert_non_null(x);
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)(2.0 * v2v_random_uniform(17, stream, (uint64_t)i) - 1.0);
    }
    return x;
}

static void repeat_pixels(float *to, const float *from, const struct problem *p)
{
    int64_t rows = p->height >> p->half, columns = p->width >> p->half;
    for (int64_t i = 0; i < p->in * p->height * p->width; i++) {
        int64_t c = i / (p->height * p->width), y = i / p->width % p->height, x = i % p->width;
        to[i] = from[(c * rows + (y >> p->half)) * columns + (x >> p->half)];
    }
}

static struct v2v_plane *list_planes(const struct problem *p)
{
    int64_t rows = p->height >> p->half, columns = p->width >> p->half;
    struct v2v_plane *plane = v2v_mem_alloc("test", p->in, sizeof *plane);
    assert_non_null(plane);
    for (int64_t i = 0; i < p->in; i++) {
        plane[i] = (struct v2v_plane){i * rows * columns, 0, p->height, 0, p->width, i};
    }
    return plane;
}

static void fixture_init(struct fixture *f, const struct problem *p)
{
    *f = (struct fixture){.spec = {.batch = 1,
                                   .in = p->in,
                                   .out = p->out,
                                   .height = p->height,
                                   .width = p->width,
                                   .kernel = 3,
                                   .stride = 1 + p->stride2,
                                   .slope = 1.0f,
                                   .training = 1}};
    f->in_floats = p->in * p->height * p->width;
    f->small_floats = p->in * (p->height >> p->half) * (p->width >> p->half);
    f->out_floats = p->out * conv_out_height(&f->spec) * conv_out_width(&f->spec);
    f->weights = p->out * p->in * 9;
    int64_t most = f->in_floats > f->out_floats ? f->in_floats : f->out_floats;
    most = most > f->weights ? most : f->weights;
    f->small = draw(f->small_floats, 1);
    f->in = draw(f->in_floats, 2);
    f->dout = draw(f->out_floats, 3);
    f->weight = draw(f->weights, 4);
    f->bias = draw(p->out, 5);
    f->out = draw(f->out_floats, 6);
    f->din = draw(f->small_floats, 7);
    f->dweight = draw(f->weights, 8);
    assert_ok(V2V_ALLOC(f->value, "test", most));
    assert_ok(V2V_ALLOC(f->moduli, "test", most));
    repeat_pixels(f->in, f->small, p);
    struct v2v_plane *plane = list_planes(p);
    struct v2v_winograd_spec spec = {.in = p->in,
                                     .out = p->out,
                                     .height = p->height,
                                     .width = p->width,
                                     .plane = plane,
                                     .pitch = p->width >> p->half,
                                     .half = p->half,
                                     .stride2 = p->stride2,
                                     .slope = 1.0f,
                                     .training = 1,
                                     .chunk_floats = p->chunk_floats,
                                     .sets = p->sets,
                                     .keeps = p->keeps,
                                     .workspace = &f->workspace};
    assert_ok(v2v_winograd_create(&f->winograd, &spec));
    v2v_winograd_set_weights(f->winograd, f->weight, f->bias);
    v2v_mem_free(plane);
}

static void fixture_free(struct fixture *f)
{
    void *memory[] = {f->small, f->in,  f->dout,    f->weight, f->bias,
                      f->out,   f->din, f->dweight, f->value,  f->moduli};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
    v2v_winograd_destroy(&f->winograd);
    v2v_workspace_fini(&f->workspace);
}

static void fixture_fini(struct fixture *f)
{
    fixture_free(f);
    assert_int_equal(v2v_mem_held(), 0);
}

static void backward(struct v2v_winograd *winograd, float *din, float *dweight, const float *in,
                     const float *dout)
{
    struct v2v_gradients to = {.din = din, .dweight = dweight};
    v2v_winograd_backward(winograd, &to, in, dout);
}

/* `terms` products a sum. */
static void assert_close(const struct fixture *f, const float *x, int64_t count, int64_t terms)
{
    for (int64_t i = 0; i < count; i++) {
        double bound = GROWTH * EPSILON * (double)(terms + 10) * f->moduli[i];
        assert_true(fabs((double)x[i] - f->value[i]) <= bound);
    }
}

static void forward_equals_the_twin(void **state)
{
    (void)state;
    for (int j = 0; j < PROBLEMS; j++) {
        struct fixture f;
        fixture_init(&f, &problems[j]);
        twin_conv_forward((struct twin){f.value, f.moduli}, &f.spec, f.in, f.weight, f.bias);
        v2v_winograd_forward(f.winograd, f.out, f.small);
        assert_close(&f, f.out, f.out_floats, f.spec.in);
        fixture_fini(&f);
    }
}

static void gradient_of_the_data_is_added_and_equals_the_twin(void **state)
{
    (void)state;
    for (int j = 0; j < PROBLEMS; j++) {
        const struct problem *p = &problems[j];
        struct fixture f;
        fixture_init(&f, p);
        twin_conv_backward_data((struct twin){f.value, f.moduli}, &f.spec, f.dout, f.weight);
        /* the adjoint of repeating pixels sums them; what was there stays */
        int64_t rows = p->height >> p->half, columns = p->width >> p->half;
        for (int64_t i = 0; i < f.in_floats && p->half; i++) {
            int64_t c = i / (p->height * p->width), y = i / p->width % p->height, x = i % p->width;
            int64_t to = (c * rows + y / 2) * columns + x / 2;
            double value = f.value[i], moduli = f.moduli[i];
            f.value[to] = y % 2 + x % 2 == 0 ? value : f.value[to] + value;
            f.moduli[to] = y % 2 + x % 2 == 0 ? moduli : f.moduli[to] + moduli;
        }
        for (int64_t i = 0; i < f.small_floats; i++) {
            f.value[i] += (double)f.din[i];
            f.moduli[i] += fabs((double)f.din[i]);
        }
        backward(f.winograd, f.din, NULL, NULL, f.dout);
        assert_close(&f, f.din, f.small_floats, f.spec.out);
        fixture_fini(&f);
    }
}

/* Whatever lay there, in one chunk or in many: the bits of adding to zeros. */
static void gradient_of_the_data_is_set(void **state)
{
    (void)state;
    for (int i = 0; i < PROBLEMS; i++) {
        struct fixture f, setting;
        struct problem with = problems[i];
        with.sets = 1;
        fixture_init(&f, &problems[i]);
        fixture_init(&setting, &with);
        memset(f.din, 0, (size_t)f.small_floats * sizeof *f.din);
        backward(f.winograd, f.din, NULL, NULL, f.dout);
        backward(setting.winograd, setting.din, NULL, NULL, setting.dout);
        assert_memory_equal(f.din, setting.din, (size_t)f.small_floats * sizeof *f.din);
        fixture_free(&f);
        fixture_fini(&setting);
    }
}

/* Rows of tiles overlap, and behind repeated pixels up to four of their lines meet in one: they are
 * added in the same order in an image and in a slab of it, whose chunks are others. */
static void gradient_of_the_data_has_the_same_bits_whatever_the_chunks(void **state)
{
    (void)state;
    const struct problem whole = {
        .in = 5, .out = 9, .height = 48, .width = 64, .half = 1, .sets = 1};
    struct problem rows = whole;
    struct fixture f, one_by_one;
    rows.chunk_floats = 1;
    fixture_init(&f, &whole);
    fixture_init(&one_by_one, &rows);
    backward(f.winograd, f.din, NULL, NULL, f.dout);
    backward(one_by_one.winograd, one_by_one.din, NULL, NULL, one_by_one.dout);
    assert_memory_equal(f.din, one_by_one.din, (size_t)f.small_floats * sizeof *f.din);
    fixture_free(&one_by_one);
    fixture_fini(&f);
}

static void gradient_of_the_weights_is_added_and_equals_the_twin(void **state)
{
    (void)state;
    for (int j = 0; j < PROBLEMS; j++) {
        struct fixture f;
        fixture_init(&f, &problems[j]);
        twin_conv_backward_weights((struct twin){f.value, f.moduli}, &f.spec, f.in, f.dout);
        for (int64_t i = 0; i < f.weights; i++) {
            f.value[i] += (double)f.dweight[i];
            /* every tile sees all of its values, though a tap near the border has fewer pixels */
            f.moduli[i] += fabs((double)f.dweight[i]) + (double)(f.spec.height * f.spec.width);
        }
        backward(f.winograd, NULL, f.dweight, f.small, f.dout);
        assert_close(&f, f.dweight, f.weights, f.spec.height * f.spec.width / 16);
        fixture_fini(&f);
    }
}

static void both_gradients_at_once_are_those_one_by_one(void **state)
{
    (void)state;
    for (int j = 0; j < PROBLEMS; j++) {
        struct fixture f;
        fixture_init(&f, &problems[j]);
        float *din = draw(f.small_floats, 7), *dweight = draw(f.weights, 8);
        backward(f.winograd, f.din, f.dweight, f.small, f.dout);
        backward(f.winograd, din, NULL, NULL, f.dout);
        backward(f.winograd, NULL, dweight, f.small, f.dout);
        assert_memory_equal(f.din, din, (size_t)f.small_floats * sizeof *din);
        assert_memory_equal(f.dweight, dweight, (size_t)f.weights * sizeof *dweight);
        v2v_mem_free(din);
        v2v_mem_free(dweight);
        fixture_fini(&f);
    }
}

/* In one chunk or in many: the bits of doing it afterwards. */
static void an_activation_before_the_input_is_taken_back(void **state)
{
    (void)state;
    for (int j = 0; j < PROBLEMS; j++) {
        struct fixture f;
        struct problem p = problems[j];
        p.sets = 1;
        fixture_init(&f, &p);
        float *din = draw(f.small_floats, 7);
        struct v2v_gradients to = {.din = f.din, .in_slope = 0.25f};
        v2v_winograd_backward(f.winograd, &to, f.small, f.dout);
        backward(f.winograd, din, NULL, NULL, f.dout);
        v2v_leaky_backward(din, din, f.small, f.small_floats, 0.25f);
        assert_memory_equal(f.din, din, (size_t)f.small_floats * sizeof *din);
        v2v_mem_free(din);
        fixture_fini(&f);
    }
}

/* Behind the forward pass of the same input, once; else everything is transformed again. */
static void kept_inputs_have_the_bits_of_transforming_again(void **state)
{
    (void)state;
    for (int i = 0; i < PROBLEMS; i++) {
        struct fixture f, keeping;
        struct problem with = problems[i];
        with.keeps = 1;
        fixture_init(&f, &problems[i]);
        fixture_init(&keeping, &with);
        v2v_winograd_forward(f.winograd, f.out, f.small);
        v2v_winograd_forward(keeping.winograd, keeping.out, keeping.small);
        assert_memory_equal(f.out, keeping.out, (size_t)f.out_floats * sizeof *f.out);
        for (int pass = 0; pass < 2; pass++) {
            const float *in = pass == 0 ? NULL : keeping.small; /* kept: not read */
            backward(f.winograd, f.din, f.dweight, f.small, f.dout);
            backward(keeping.winograd, keeping.din, keeping.dweight, in, keeping.dout);
            assert_memory_equal(f.din, keeping.din, (size_t)f.small_floats * sizeof *f.din);
            assert_memory_equal(f.dweight, keeping.dweight, (size_t)f.weights * sizeof *f.dweight);
        }
        fixture_free(&f);
        fixture_fini(&keeping);
    }
}

static void relative_error_stays_small_with_many_channels(void **state)
{
    (void)state;
    static const struct problem deep = {1024, 16, 16, 16, 0, 0, 0, 0, 0};
    struct fixture f;
    fixture_init(&f, &deep);
    double error = 0.0, size = 0.0;
    twin_conv_forward((struct twin){f.value, f.moduli}, &f.spec, f.in, f.weight, f.bias);
    v2v_winograd_forward(f.winograd, f.out, f.small);
    for (int64_t i = 0; i < f.out_floats; i++) {
        double d = (double)f.out[i] - f.value[i];
        error += d * d;
        size += f.value[i] * f.value[i];
    }
    print_message("1024 channels: relative L2 error %.1e\n", sqrt(error / size));
    /* random round-off of the transforms, about ten roundings that grow fourfold along each axis */
    assert_true(sqrt(error / size) <= 16.0 * sqrt(10.0) * EPSILON * 2.0);
    fixture_fini(&f);
}

/* Planes that overlap, as shifted views do: pixels outside the bounds are zero. */
static void shifted_planes_of_one_owner_read_and_add_up(void **state)
{
    (void)state;
    enum { SIDE = 9, SHIFTS = 3, OUT = 2 };
    static const int64_t shift[SHIFTS] = {-2, 0, 3};
    float *image = draw(SIDE * SIDE, 1), *weight = draw(OUT * SHIFTS * 9, 2), *bias = draw(OUT, 3);
    float *out = draw(OUT * SIDE * SIDE, 4), *dout = draw(OUT * SIDE * SIDE, 5);
    float *dimage = NULL;
    struct v2v_workspace workspace = {0};
    struct v2v_winograd *winograd = NULL;
    struct v2v_plane plane[SHIFTS];
    for (int i = 0; i < SHIFTS; i++) {
        plane[i] = (struct v2v_plane){shift[i], 0, SIDE, -shift[i], SIDE - shift[i], 0};
    }
    struct v2v_winograd_spec spec = {.in = SHIFTS,
                                     .out = OUT,
                                     .height = SIDE,
                                     .width = SIDE,
                                     .plane = plane,
                                     .pitch = SIDE,
                                     .slope = 1.0f,
                                     .training = 1,
                                     .workspace = &workspace};
    assert_ok(V2V_ALLOC(dimage, "test", SIDE * SIDE));
    memset(bias, 0, OUT * sizeof *bias);
    assert_ok(v2v_winograd_create(&winograd, &spec));
    v2v_winograd_set_weights(winograd, weight, bias);
    v2v_winograd_forward(winograd, out, image);
    double whole = 0.0, image_side = 0.0, sum = 0.0;
    for (int i = 0; i < SHIFTS; i++) {
        for (int k = 0; k < 9; k++) {
            int64_t y = 4 + k / 3 - 1, x = 1 + k % 3 - 1 + shift[i];
            sum += x >= 0 && x < SIDE ? (double)weight[i * 9 + k] * image[y * SIDE + x] : 0.0;
        }
    }
    assert_true(fabs(sum - out[4 * SIDE + 1]) <= GROWTH * EPSILON * 27.0);
    backward(winograd, dimage, NULL, NULL, dout);
    for (int i = 0; i < OUT * SIDE * SIDE; i++) {
        whole += (double)out[i] * dout[i];
    }
    for (int i = 0; i < SIDE * SIDE; i++) {
        image_side += (double)image[i] * dimage[i];
    }
    assert_true(fabs(whole - image_side) <= GROWTH * EPSILON * OUT * SIDE * SIDE * 27.0);
    float *memory[] = {image, weight, bias, out, dout, dimage};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
    v2v_winograd_destroy(&winograd);
    v2v_workspace_fini(&workspace);
}

/* Some runs of tiles, in an image whose memory begins at the second row of tiles. */
static void check_parts(int64_t chunk_floats)
{
    enum { SIDE = 46, IN = 5, OUT = 9, ROW = 4 * SIDE, RUNS = 6 };
    const struct problem problem = {
        .in = IN, .out = OUT, .height = SIDE, .width = SIDE, .chunk_floats = chunk_floats};
    static const struct v2v_tile_run runs[RUNS] = {{1, 0, 3},  {1, 5, 7},  {2, 11, 1},
                                                   {5, 0, 12}, {7, 1, 10}, {11, 0, 12}};
    uint8_t mask[12][12] = {{0}};
    struct fixture f;
    fixture_init(&f, &problem);
    struct v2v_winograd_part part = {.run = runs, .runs = RUNS, .first_row = 1};
    float *some = draw(f.out_floats, 11), *before = draw(f.out_floats, 11);
    v2v_winograd_forward(f.winograd, f.out, f.small);
    v2v_winograd_forward_part(f.winograd, some, f.small, &part);
    for (int i = 0; i < RUNS; i++) {
        memset(&mask[runs[i].row][runs[i].first], 1, (size_t)runs[i].count);
    }
    for (int64_t i = 0; i < f.out_floats - ROW; i++) {
        int64_t y = i / SIDE % SIDE, x = i % SIDE;
        if (y < SIDE - 4) { /* the last rows of a channel's memory begin the next one's image */
            int listed = mask[y / 4 + 1][x / 4];
            assert_true(some[i] == (listed ? f.out[i + ROW] : before[i]));
        }
    }
    v2v_mem_free(some);
    v2v_mem_free(before);
    fixture_fini(&f);
}

/* At once, and 32 tiles at a time: then one run is cut. */
static void parts_have_the_bits_of_the_whole_and_leave_the_rest_alone(void **state)
{
    (void)state;
    check_parts(0);
    check_parts(1);
}

/* ---- lists of tiles ---- */

enum {
    LIST_ROWS = 5,
    LIST_COLUMNS = 79,
    LIST_HEIGHT = 4 * LIST_ROWS,
    LIST_WIDTH = 4 * LIST_COLUMNS
};
enum { LIST_IN = 5, LIST_OUT = 9, LIST_PIXELS = LIST_HEIGHT * LIST_WIDTH };

/* Runs that begin or end with the frame, that touch others by an edge, a corner or not at all, and
 * one that is longer than what goes through the transforms together. */
static const struct v2v_tile_run listed[] = {{0, 0, 3},  {0, 5, 70}, {1, 0, 1},  {1, 40, 6},
                                             {2, 66, 1}, {2, 70, 9}, {3, 8, 50}, {4, 62, 1}};
enum { LISTED = sizeof listed / sizeof *listed };

static void list_tiles(struct v2v_tiles *tiles)
{
    uint8_t mask[LIST_ROWS * LIST_COLUMNS] = {0};
    for (int r = 0; r < LISTED; r++) {
        memset(mask + listed[r].row * LIST_COLUMNS + listed[r].first, 1, (size_t)listed[r].count);
    }
    assert_ok(v2v_tiles_init(tiles, LIST_HEIGHT, LIST_WIDTH));
    v2v_tiles_set(tiles, mask);
}

/* Pixel i of an image as it lies among the listed tiles; -1: it does not. */
static int64_t place_in_list(const struct v2v_tiles *tiles, int64_t i)
{
    int64_t y = i / LIST_WIDTH, x = i % LIST_WIDTH;
    int64_t number = tiles->number[y / 4 * LIST_COLUMNS + x / 4];
    return number < 0 ? -1 : number * 16 + y % 4 * 4 + x % 4;
}

/* The pixels about one run become what the list says that it sees. */
static void surround(float *image, const float *from, const struct v2v_tiles *tiles,
                     const struct v2v_tile_run *run)
{
    int64_t y0 = run->row * 4, x0 = run->first * 4, y1 = y0 + 3, x1 = x0 + run->count * 4 - 1;
    for (int64_t y = y0 - 1; y <= y1 + 1; y++) {
        for (int64_t x = x0 - 1; x <= x1 + 1; x++) {
            int64_t i = y * LIST_WIDTH + x;
            if (y < 0 || y >= LIST_HEIGHT || x < 0 || x >= LIST_WIDTH ||
                place_in_list(tiles, i) >= 0) {
                continue;
            }
            int64_t nearest = v2v_within(y, y0, y1) * LIST_WIDTH + v2v_within(x, x0, x1);
            for (int64_t c = 0; c < LIST_IN; c++) {
                image[c * LIST_PIXELS + i] = from[c * LIST_PIXELS + nearest];
            }
        }
    }
}

/* Every run by itself in an image, against the list of all. */
static void check_list(int64_t chunk_floats)
{
    const struct problem problem = {.in = LIST_IN,
                                    .out = LIST_OUT,
                                    .height = LIST_HEIGHT,
                                    .width = LIST_WIDTH,
                                    .chunk_floats = chunk_floats};
    struct fixture f;
    struct v2v_tiles tiles;
    fixture_init(&f, &problem);
    list_tiles(&tiles);
    float *in = draw(f.in_floats, 11), *out = draw(f.out_floats, 12), *image = draw(f.in_floats, 1);
    for (int64_t i = 0; i < f.in_floats; i++) {
        int64_t place = place_in_list(&tiles, i % LIST_PIXELS);
        if (place >= 0) {
            in[i / LIST_PIXELS * LIST_PIXELS + place] = f.small[i];
        }
    }
    struct v2v_winograd_part part = {
        .run = listed, .runs = LISTED, .in_list = &tiles, .out_list = &tiles};
    v2v_winograd_forward_part(f.winograd, out, in, &part);
    for (int r = 0; r < LISTED; r++) {
        memcpy(image, f.small, (size_t)f.small_floats * sizeof *image);
        surround(image, f.small, &tiles, &listed[r]);
        part = (struct v2v_winograd_part){.run = &listed[r], .runs = 1};
        v2v_winograd_forward_part(f.winograd, f.out, image, &part);
        for (int64_t i = 0; i < listed[r].count * 16 * LIST_OUT; i++) {
            int64_t y = listed[r].row * 4 + i % 4, channel = i / 16 / listed[r].count;
            int64_t x = listed[r].first * 4 + i / 4 % (listed[r].count * 4);
            int64_t place = place_in_list(&tiles, y * LIST_WIDTH + x);
            assert_true(out[channel * LIST_PIXELS + place] ==
                        f.out[(channel * LIST_HEIGHT + y) * LIST_WIDTH + x]);
        }
    }
    v2v_tiles_fini(&tiles);
    v2v_mem_free(image);
    v2v_mem_free(in);
    v2v_mem_free(out);
    fixture_fini(&f);
}

/* At once, and 96 tiles at a time: then one run is cut. */
static void listed_tiles_have_the_bits_of_images_whose_edges_go_on(void **state)
{
    (void)state;
    check_list(0);
    check_list(1);
}

/* Whole rows behind a part of one: they share batches with it, or do not, but never its lines. */
static void whole_rows_behind_a_part_have_the_bits_of_the_whole(void **state)
{
    (void)state;
    static const struct v2v_tile_run runs[] = {{0, 3, 10}, {1, 0, 40}, {2, 0, 40}, {3, 0, 40}};
    static const struct v2v_tile_run wide[] = {{0, 0, 10}, {1, 0, 54}, {2, 0, 54}};
    static const struct {
        const struct v2v_tile_run *run;
        int64_t runs, width;
    } cases[] = {{runs, 4, 160}, {wide, 3, 216}};
    for (int i = 0; i < 2; i++) {
        struct problem problem = {.in = 3, .out = 4, .height = 16, .width = cases[i].width};
        struct fixture f;
        fixture_init(&f, &problem);
        struct v2v_winograd_part part = {.run = cases[i].run, .runs = cases[i].runs};
        float *some = draw(f.out_floats, 11);
        v2v_winograd_forward(f.winograd, f.out, f.small);
        v2v_winograd_forward_part(f.winograd, some, f.small, &part);
        for (int64_t j = 0; j < f.out_floats; j++) {
            int64_t row = j / problem.width % 16 / 4, column = j % problem.width / 4;
            for (int64_t r = 0; r < part.runs; r++) {
                const struct v2v_tile_run *run = &part.run[r];
                if (run->row == row && column >= run->first && column < run->first + run->count) {
                    assert_true(some[j] == f.out[j]);
                }
            }
        }
        v2v_mem_free(some);
        fixture_fini(&f);
    }
}

static void stride_two_takes_every_second_row_and_column(void **state)
{
    (void)state;
    enum { SIDE = 22, HALF = SIDE / 2, IN = 3, OUT = 5 };
    static float image[IN * SIDE * SIDE], weight[OUT * IN * 9], bias[OUT];
    static float whole[OUT * SIDE * SIDE], halved[OUT * HALF * HALF];
    struct v2v_workspace workspace = {0};
    struct v2v_plane plane[IN];
    float *drawn = draw(IN * SIDE * SIDE, 1), *taps = draw(OUT * IN * 9, 2);
    memcpy(image, drawn, sizeof image);
    memcpy(weight, taps, sizeof weight);
    for (int64_t c = 0; c < IN; c++) {
        plane[c] = (struct v2v_plane){c * SIDE * SIDE, 0, SIDE, 0, SIDE, c};
    }
    for (int stride2 = 0; stride2 < 2; stride2++) {
        struct v2v_winograd *winograd = NULL;
        struct v2v_winograd_spec spec = {.in = IN,
                                         .out = OUT,
                                         .height = SIDE,
                                         .width = SIDE,
                                         .plane = plane,
                                         .pitch = SIDE,
                                         .stride2 = stride2,
                                         .slope = 0.01f,
                                         .workspace = &workspace};
        assert_ok(v2v_winograd_create(&winograd, &spec));
        v2v_winograd_set_weights(winograd, weight, bias);
        v2v_winograd_forward(winograd, stride2 ? halved : whole, image);
        v2v_winograd_destroy(&winograd);
    }
    for (int i = 0; i < OUT * HALF * HALF; i++) {
        int c = i / (HALF * HALF), y = i / HALF % HALF, x = i % HALF;
        assert_true(halved[i] == whole[(c * SIDE + 2 * y) * SIDE + 2 * x]);
    }
    v2v_mem_free(drawn);
    v2v_mem_free(taps);
    v2v_workspace_fini(&workspace);
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(forward_equals_the_twin),
        cmocka_unit_test(gradient_of_the_data_is_added_and_equals_the_twin),
        cmocka_unit_test(gradient_of_the_data_is_set),
        cmocka_unit_test(gradient_of_the_data_has_the_same_bits_whatever_the_chunks),
        cmocka_unit_test(gradient_of_the_weights_is_added_and_equals_the_twin),
        cmocka_unit_test(both_gradients_at_once_are_those_one_by_one),
        cmocka_unit_test(an_activation_before_the_input_is_taken_back),
        cmocka_unit_test(kept_inputs_have_the_bits_of_transforming_again),
        cmocka_unit_test(relative_error_stays_small_with_many_channels),
        cmocka_unit_test(parts_have_the_bits_of_the_whole_and_leave_the_rest_alone),
        cmocka_unit_test(listed_tiles_have_the_bits_of_images_whose_edges_go_on),
        cmocka_unit_test(whole_rows_behind_a_part_have_the_bits_of_the_whole),
        cmocka_unit_test(stride_two_takes_every_second_row_and_column),
        cmocka_unit_test(shifted_planes_of_one_owner_read_and_add_up),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
