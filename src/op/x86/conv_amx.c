/* Convolutions in bf16 by the tile unit. A strip of rows is one thread's: its pixels are packed
 * with their channels side by side, so that a run of 16 pixels, at any tap, is a tile in one piece
 * of memory; then every 32 pixels are multiplied with every 32 outputs. As many channels at a time
 * as keep the values of 32 pixels in the first-level cache and the weights of some outputs in the
 * second-level one. The sum of an output has the same order whatever the strips and threads. */
#include "op/conv_backend.h"
#include "op/isa.h"
#include "op/x86/amx.h"
#include "op/x86/amx_gradient.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include <omp.h>
#include <string.h>

/** Blocks of channels at a time; blocks of outputs and pairs of pixel runs whose sums are kept. */
enum { MOST_BLOCKS = 8, OUTPUTS = 4, PAIRS = 32 };

/** Numbers of a packed strip, and its rows where few channels would let it have more. */
static const int64_t STRIP_NUMBERS = 2 << 20;
static const int64_t MOST_ROWS = 32;

/** A convolution: the layer's own, or its data gradient. */
struct pass {
    int64_t in, out;
    int64_t height, width; /**< of the output */
    int64_t from_height, from_width;
    int64_t step; /**< what is read has zeros between its pixels: every step-th row and column */
    int64_t stride;
    int kernel;
    float slope;
    int in_form, out_form; /**< enum v2v_form */
    int64_t rows;          /**< of a strip at the output */
    int64_t packed, pitch; /**< rows of a packed strip, and pixels of such a row */
    int64_t blocks, chunk; /**< of channels; of them at a time */
    struct amx_walk walk;
    bf16 *weights; /**< [block of outputs][block of channels], as packed */
    const float *bias;
};

struct state {
    struct v2v_conv_spec spec;
    struct pass forward, data;
    struct amx_gradient *gradient;
    struct v2v_workspace own, *workspace;
    int threads;
    int64_t packed_floats; /**< of a thread's strip; its sums come behind */
    int64_t thread_floats;
};

/** Where the zeros begin behind the pixels of a packed row. */
static int64_t behind_pixels(const struct pass *pass)
{
    return (pass->kernel - 1) / 2 + (pass->from_width - 1) * pass->step + 1;
}

/** Rows of a strip: pairs of them, every thread has strips, and all as many as they can. */
static int64_t choose_rows(const struct pass *pass, int threads)
{
    int64_t row = pass->blocks * AMX_BLOCK * pass->pitch;
    int64_t most = STRIP_NUMBERS / row - (pass->kernel - 1);
    most = v2v_within(most / pass->stride, 2, MOST_ROWS);
    int64_t strips = v2v_parts(v2v_parts(pass->height, most), threads) * threads;
    return 2 * v2v_parts(v2v_parts(pass->height, strips), 2);
}

static enum v2v_status plan(struct pass *pass, int threads)
{
    int64_t runs = v2v_parts(pass->width, AMX_SIDE);
    int64_t read = (runs * AMX_SIDE - 1) * pass->stride + pass->kernel;
    int64_t filled = behind_pixels(pass);
    pass->pitch = read > filled ? read : filled;
    pass->blocks = v2v_parts(pass->in, AMX_BLOCK);
    pass->chunk = v2v_parts(pass->blocks, v2v_parts(pass->blocks, MOST_BLOCKS));
    pass->rows = choose_rows(pass, threads);
    pass->packed = (pass->rows - 1) * pass->stride + pass->kernel;
    pass->walk = (struct amx_walk){.pixel = pass->stride * AMX_DEPTH,
                                   .block = pass->packed * pass->pitch * AMX_DEPTH,
                                   .taps = pass->kernel * pass->kernel};
    for (int t = 0; t < pass->walk.taps; t++) {
        int y = t / pass->kernel, x = t % pass->kernel;
        pass->walk.tap[t] = (y * pass->pitch + x) * AMX_DEPTH;
    }
    return V2V_ALLOC(pass->weights, "conv.weights",
                     v2v_mem_product(v2v_parts(pass->out, AMX_BLOCK) * pass->blocks,
                                     pass->walk.taps, 2 * (int64_t)AMX_TILE));
}

static int64_t packed_floats(const struct pass *pass)
{
    return v2v_parts(pass->blocks * pass->walk.block, 2);
}

static void destroy(void *opaque)
{
    struct state *state = opaque;
    if (state == NULL) {
        return;
    }
    amx_gradient_destroy(state->gradient);
    v2v_mem_free(state->forward.weights);
    v2v_mem_free(state->data.weights);
    v2v_workspace_fini(&state->own);
    v2v_mem_free(state);
}

static enum v2v_status plan_training(struct state *state)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_conv_spec *spec = &state->spec;
    state->data = (struct pass){.in = spec->out,
                                .out = spec->in,
                                .height = spec->height,
                                .width = spec->width,
                                .from_height = conv_out_height(spec),
                                .from_width = conv_out_width(spec),
                                .step = spec->stride,
                                .stride = 1,
                                .kernel = spec->kernel,
                                .slope = 1.0f};
    V2V_TRY(plan(&state->data, state->threads));
    V2V_TRY(amx_gradient_create(&state->gradient, spec));
done:
    return rc;
}

static enum v2v_status create(void **opaque, const struct v2v_conv_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct state *state = NULL;
    if (!v2v_amx_usable()) {
        return V2V_FAIL(V2V_E_INTERNAL, "convolution: this processor has no tiles for bf16");
    }
    int takes_forms = spec->batch == 1 && !spec->training;
    V2V_ASSERT(takes_forms || (spec->in_form | spec->out_form) == V2V_FORM_PLAIN);
    V2V_TRY(V2V_ALLOC(state, "conv", 1));
    state->spec = *spec;
    state->threads = omp_get_max_threads();
    state->workspace = spec->method.workspace != NULL ? spec->method.workspace : &state->own;
    state->forward = (struct pass){.in = spec->in,
                                   .out = spec->out,
                                   .height = conv_out_height(spec),
                                   .width = conv_out_width(spec),
                                   .from_height = spec->height,
                                   .from_width = spec->width,
                                   .step = 1,
                                   .stride = spec->stride,
                                   .kernel = spec->kernel,
                                   .slope = spec->slope,
                                   .in_form = spec->in_form,
                                   .out_form = spec->out_form};
    V2V_TRY(plan(&state->forward, state->threads));
    state->packed_floats = packed_floats(&state->forward);
    if (spec->training) {
        V2V_TRY(plan_training(state));
        int64_t floats = packed_floats(&state->data);
        state->packed_floats = floats > state->packed_floats ? floats : state->packed_floats;
    }
    state->packed_floats = v2v_parts(state->packed_floats, AMX_SIDE) * AMX_SIDE;
    state->thread_floats = state->packed_floats + (int64_t)PAIRS * OUTPUTS * AMX_SUMS;
    int64_t floats = state->threads * state->thread_floats;
    int64_t gradient = spec->training ? amx_gradient_floats(state->gradient) : 0;
    V2V_TRY(v2v_workspace_reserve(state->workspace, floats > gradient ? floats : gradient));
    *opaque = state;
    state = NULL;
done:
    destroy(state);
    return rc;
}

static void pack_weights(struct pass *pass, const struct amx_weights *from)
{
    int64_t outputs = v2v_parts(pass->out, AMX_BLOCK);
    int64_t numbers = pass->walk.taps * 2 * (int64_t)AMX_TILE;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < outputs * pass->blocks; i++) {
        int64_t o = i / pass->blocks * AMX_BLOCK, c = i % pass->blocks * AMX_BLOCK;
        struct amx_weights part = *from;
        part.base += o * from->out + c * from->in;
        v2v_amx_pack_weights(pass->weights + i * numbers, &part, pass->out - o, pass->in - c);
    }
}

static void set_weights(void *opaque, const float *weight, const float *bias)
{
    struct state *state = opaque;
    int taps = state->forward.walk.taps;
    int64_t output = state->spec.in * taps;
    state->forward.bias = bias;
    pack_weights(&state->forward,
                 &(struct amx_weights){.base = weight, .out = output, .in = taps, .taps = taps});
    if (state->spec.training) {
        pack_weights(&state->data,
                     &(struct amx_weights){
                         .base = weight, .out = taps, .in = output, .taps = taps, .reversed = 1});
    }
}

/* ---- a strip ---- */

/** Row y of a block of channels, which the image has. */
static void pack_pixels(const struct pass *pass, bf16 *to, const float *in, int64_t block,
                        int64_t y)
{
    int64_t width = pass->from_width, plane = pass->from_height * width;
    if (pass->in_form == V2V_FORM_BLOCKED) {
        const bf16 *from = (const bf16 *)in + (block * plane + y * width) * AMX_DEPTH;
        memcpy(to, from, (size_t)(width * AMX_DEPTH) * sizeof *to);
        return;
    }
    const float *row[AMX_DEPTH] = {NULL};
    for (int64_t i = 0; i < v2v_smaller(pass->in - block * AMX_DEPTH, AMX_DEPTH); i++) {
        row[i] = in + (block * AMX_DEPTH + i) * plane + y * width;
    }
    v2v_amx_pack_pixels(to, row, width, pass->step);
}

static void clear(bf16 *to, int64_t pixels)
{
    memset(to, 0, (size_t)(pixels * AMX_DEPTH) * sizeof *to);
}

/** A row of a strip with the zeros about it. */
static void pack_row(const struct pass *pass, bf16 *to, const float *in, int64_t block, int64_t y)
{
    int64_t before = (pass->kernel - 1) / 2;
    int64_t behind = behind_pixels(pass);
    if (y < 0 || y % pass->step != 0 || y / pass->step >= pass->from_height) {
        clear(to, pass->pitch);
        return;
    }
    if (pass->step > 1) {
        clear(to, pass->pitch);
    } else {
        clear(to, before);
        clear(to + behind * AMX_DEPTH, pass->pitch - behind);
    }
    pack_pixels(pass, to + before * AMX_DEPTH, in, block, y / pass->step);
}

static void pack_strip(const struct pass *pass, bf16 *packed, const float *in, int64_t y0)
{
    int64_t first = y0 * pass->stride - (pass->kernel - 1) / 2;
    for (int64_t b = 0; b < pass->blocks; b++) {
        for (int64_t r = 0; r < pass->packed; r++) {
            pack_row(pass, packed + b * pass->walk.block + r * pass->pitch * AMX_DEPTH, in, b,
                     first + r);
        }
    }
}

/** Two runs of 16 pixels, one above the other, and 32 outputs. */
struct place {
    int64_t y, x, output; /**< y in the strip */
    int64_t rows;         /**< 1: the run below is not there */
};

static struct place place_of(const struct pass *pass, int64_t pair, int64_t rows)
{
    int64_t runs = v2v_parts(pass->width, AMX_SIDE);
    struct place place = {.y = pair / runs * 2, .x = pair % runs * AMX_SIDE};
    place.rows = v2v_smaller(rows - place.y, 2);
    return place;
}

static void multiply(const struct pass *pass, float *sums, const bf16 *packed,
                     const struct place *place, int64_t block)
{
    int64_t row = pass->stride * pass->pitch * AMX_DEPTH;
    const bf16 *first =
        packed + block * pass->walk.block + place->y * row + place->x * pass->walk.pixel;
    const bf16 *values[] = {first, place->rows > 1 ? first + row : first};
    int64_t numbers = pass->walk.taps * 2 * (int64_t)AMX_TILE;
    const bf16 *weights =
        pass->weights + (place->output / AMX_BLOCK * pass->blocks + block) * numbers;
    v2v_amx_multiply(sums, values, weights, &pass->walk,
                     v2v_smaller(pass->chunk, pass->blocks - block), block == 0);
}

static void unpack(const struct pass *pass, float *out, const float *sums,
                   const struct place *place, int64_t y0)
{
    int64_t plane = pass->height * pass->width;
    struct amx_result result = {.bias = pass->bias != NULL ? pass->bias + place->output : NULL,
                                .slope = pass->slope,
                                .pixels = pass->width - place->x,
                                .outputs = pass->out - place->output};
    for (int64_t i = 0; i < place->rows; i++) {
        int64_t pixel = (y0 + place->y + i) * pass->width + place->x;
        const float *from = sums + 2 * i * AMX_SIDE * AMX_SIDE;
        if (pass->out_form == V2V_FORM_BLOCKED) {
            int64_t block = place->output / AMX_DEPTH;
            v2v_amx_unpack_blocked((bf16 *)out + (block * plane + pixel) * AMX_DEPTH, from,
                                   &result);
        } else {
            v2v_amx_unpack(out + place->output * plane + pixel, plane, from, &result);
        }
    }
}

/** So many pairs of runs and so many outputs, through all channels. */
struct group {
    int64_t first, end;   /**< pairs */
    int64_t output, stop; /**< outputs */
};

static void run_group(const struct pass *pass, float *out, const bf16 *packed, float *sums,
                      const struct group *group, int64_t y0)
{
    int64_t rows = v2v_smaller(pass->rows, pass->height - y0);
    for (int64_t block = 0; block < pass->blocks; block += pass->chunk) {
        int is_last = block + pass->chunk >= pass->blocks;
        float *at = sums;
        for (int64_t pair = group->first; pair < group->end; pair++) {
            struct place place = place_of(pass, pair, rows);
            for (place.output = group->output; place.output < group->stop;
                 place.output += AMX_BLOCK) {
                multiply(pass, at, packed, &place, block);
                if (is_last) {
                    unpack(pass, out, at, &place, y0);
                }
                at += AMX_SUMS;
            }
        }
    }
}

static void run_strip(const struct pass *pass, float *out, const bf16 *packed, float *sums,
                      int64_t y0)
{
    int64_t rows = v2v_smaller(pass->rows, pass->height - y0);
    int64_t pairs = v2v_parts(rows, 2) * v2v_parts(pass->width, AMX_SIDE);
    for (int64_t o = 0; o < pass->out; o += (int64_t)OUTPUTS * AMX_BLOCK) {
        for (int64_t pair = 0; pair < pairs; pair += PAIRS) {
            struct group group = {.first = pair,
                                  .end = v2v_smaller(pair + PAIRS, pairs),
                                  .output = o,
                                  .stop = v2v_smaller(o + OUTPUTS * AMX_BLOCK, pass->out)};
            run_group(pass, out, packed, sums, &group, y0);
        }
    }
}

static void run(const struct state *state, const struct pass *pass, float *out, const float *in)
{
    int64_t strips = v2v_parts(pass->height, pass->rows);
    int64_t in_image = pass->in * pass->from_height * pass->from_width;
    int64_t out_image = pass->out * pass->height * pass->width;
#pragma omp parallel num_threads(state->threads)
    {
        float *mine = state->workspace->data + omp_get_thread_num() * state->thread_floats;
        bf16 *packed = (bf16 *)mine;
        v2v_amx_begin();
#pragma omp for schedule(static)
        for (int64_t i = 0; i < state->spec.batch * strips; i++) {
            int64_t n = i / strips, y0 = i % strips * pass->rows;
            pack_strip(pass, packed, in + n * in_image, y0);
            run_strip(pass, out + n * out_image, packed, mine + state->packed_floats, y0);
        }
        v2v_amx_end();
    }
}

static void forward(void *opaque, float *out, const float *in)
{
    const struct state *state = opaque;
    run(state, &state->forward, out, in);
}

static void backward_data(void *opaque, float *din, const float *dout)
{
    const struct state *state = opaque;
    run(state, &state->data, din, dout);
}

static void backward_weights(void *opaque, float *dweight, const float *in, const float *dout)
{
    const struct state *state = opaque;
    amx_gradient_add(state->gradient, state->workspace->data, dweight, in, dout);
}

const struct v2v_conv_backend v2v_conv_amx = {.name = "AMX bf16",
                                              .create = create,
                                              .destroy = destroy,
                                              .set_weights = set_weights,
                                              .forward = forward,
                                              .backward_data = backward_data,
                                              .backward_weights = backward_weights};
