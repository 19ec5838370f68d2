/* Our own convolution for few channels and stride 1: strips of rows over all images are the units
 * of work, one thread each; see direct_kernel.h. */
#include "op/conv_backend.h"
#include "op/direct_kernel.h"
#include "op/isa.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/clones.h"
#include "v2v3d/base/memory.h"
#include <omp.h>
#include <string.h>

/** A strip for the convolution stays in a core's second-level cache .. */
static const int64_t STRIP_FLOATS = 65536;
/** .. and 4 channels' rows of dout with one of the input, 5 * 4 KB, in the first-level one. */
static const int64_t CORRELATE_PIXELS = 1024;
/** Enough for the balance between cores; more rows would only cost cache. */
static const int64_t MOST_ROWS = 16;
/** Zeros behind a row: for the taps right of the last vector. */
static const int64_t TAIL = 16;

/** Partial sums of the gradient of the weights: as many for any number of threads, so that the bits
 *  do not depend on it. */
enum { PARTS = 8 };

/** A convolution of stride 1: the layer's own, or its data gradient. */
struct plan {
    int64_t in, out;
    int64_t rows;   /**< of a strip */
    int by_tiles;   /**< bool: in bf16, by v2v_direct_tiles */
    float *weights; /**< [out/4][in][k][k][4], or as v2v_direct_tiles packs them */
    float *bias;    /**< filled up to a multiple of 4 */
    float slope;
};

struct state {
    struct v2v_conv_spec spec;
    const struct direct_kernel *kernel;
    struct plan forward, data;
    int threads;
    int64_t pitch;
    int64_t gradient_rows;
    int64_t strip_floats, dout_floats; /**< of one thread */
    int64_t sum_floats;                /**< of one part */
    float *strips, *douts;             /**< [thread][..] */
    float *sums;                       /**< [part][..] */
};

static int64_t fill_up(int64_t channels)
{
    return (channels + DIRECT_CHANNELS - 1) / DIRECT_CHANNELS * DIRECT_CHANNELS;
}

static const struct direct_kernel *choose_kernel(void)
{
    static const struct direct_kernel *const sets[] = V2V_KERNEL_SETS(v2v_direct);
    return sets[v2v_kernel_set()];
}

static enum v2v_status make_plan(struct plan *plan, const struct state *state, int64_t in,
                                 int64_t out, float slope)
{
    enum v2v_status rc = V2V_OK;
    int64_t taps = (int64_t)state->spec.kernel * state->spec.kernel;
    int64_t halo = state->spec.kernel - 1;
    int64_t most = v2v_within(STRIP_FLOATS / (in * state->pitch) - halo, 1, MOST_ROWS);
    plan->in = in;
    plan->out = out;
    plan->slope = slope;
    plan->rows = most < state->spec.height ? most : state->spec.height;
    V2V_TRY(V2V_ALLOC(plan->weights, "conv.weights",
                      plan->by_tiles ? v2v_direct_tiles.floats(in) : fill_up(out) * in * taps));
    V2V_TRY(V2V_ALLOC(plan->bias, "conv.weights", fill_up(out)));
done:
    return rc;
}

static void destroy(void *opaque)
{
    struct state *state = opaque;
    if (state == NULL) {
        return;
    }
    float *owned[] = {
        state->forward.weights, state->forward.bias, state->data.weights, state->data.bias,
        state->strips,          state->douts,        state->sums};
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++) {
        v2v_mem_free(owned[i]);
    }
    v2v_mem_free(state);
}

static enum v2v_status create(void **opaque, const struct v2v_conv_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct state *state = NULL;
    V2V_ASSERT(spec->stride == 1);
    V2V_TRY(V2V_ALLOC(state, "conv", 1));
    state->spec = *spec;
    state->kernel = choose_kernel();
    state->threads = omp_get_max_threads();
    state->pitch = (spec->width + TAIL - 1) / TAIL * TAIL + TAIL;
    int64_t halo = spec->kernel - 1;
    state->forward.by_tiles = spec->method.precision != V2V_PRECISION_F32 && v2v_amx_usable() &&
                              v2v_direct_tiles.takes(spec->in, spec->out, spec->kernel);
    V2V_TRY(make_plan(&state->forward, state, spec->in, spec->out, spec->slope));
    int64_t rows = spec->in * (state->forward.rows + halo);
    if (spec->training) {
        V2V_TRY(make_plan(&state->data, state, spec->out, spec->in, 1.0f));
        int64_t data_rows = spec->out * (state->data.rows + halo);
        state->gradient_rows = v2v_within(CORRELATE_PIXELS / spec->width, 1, spec->height);
        int64_t gradient_rows = spec->in * (state->gradient_rows + halo);
        rows = rows > data_rows ? rows : data_rows;
        rows = rows > gradient_rows ? rows : gradient_rows;
        state->dout_floats = fill_up(spec->out) * state->gradient_rows * state->pitch;
        state->sum_floats =
            fill_up(spec->out) * spec->in * spec->kernel * spec->kernel * state->kernel->lanes;
        V2V_TRY(V2V_ALLOC(state->douts, "conv.strips", state->threads * state->dout_floats));
        V2V_TRY(V2V_ALLOC(state->sums, "conv.strips", PARTS * state->sum_floats));
    }
    state->strip_floats = rows * state->pitch;
    V2V_TRY(V2V_ALLOC(state->strips, "conv.strips", state->threads * state->strip_floats));
    *opaque = state;
    state = NULL;
done:
    destroy(state);
    return rc;
}

/** weight [out,in,k,k] or, transposed and rotated by 180 degrees, of the data gradient. */
static void pack(struct plan *plan, const struct v2v_conv_spec *spec, const float *weight, int turn)
{
    int64_t taps = (int64_t)spec->kernel * spec->kernel;
    for (int64_t o = 0; o < plan->out; o++) {
        for (int64_t i = 0; i < plan->in; i++) {
            for (int64_t t = 0; t < taps; t++) {
                int64_t from = turn ? (i * plan->out + o) * taps + taps - 1 - t
                                    : (o * plan->in + i) * taps + t;
                int64_t block = o / DIRECT_CHANNELS * plan->in + i;
                plan->weights[(block * taps + t) * DIRECT_CHANNELS + o % DIRECT_CHANNELS] =
                    weight[from];
            }
        }
    }
}

static void set_weights(void *opaque, const float *weight, const float *bias)
{
    struct state *state = opaque;
    struct plan *forward = &state->forward;
    if (forward->by_tiles) {
        v2v_direct_tiles.pack(forward->weights, weight, forward->in, forward->out);
    } else {
        pack(forward, &state->spec, weight, 0);
    }
    memcpy(forward->bias, bias, (size_t)forward->out * sizeof *bias);
    if (state->spec.training) {
        pack(&state->data, &state->spec, weight, 1);
    }
}

static void run_kernel(const struct state *state, const struct plan *plan,
                       const struct direct_target *target, const struct direct_strip *strip)
{
    if (plan->by_tiles) {
        v2v_direct_tiles.convolve(target, strip, plan->weights, plan->bias, plan->slope);
    } else {
        state->kernel->convolve(target, strip, plan->weights, plan->bias, state->spec.kernel,
                                plan->slope);
    }
}

/** Copy image rows [first, first + rows) of all channels behind `pad` columns each; rows outside
 * the image are zero. The columns before and behind the image are zero since creation: every use of
 *  one buffer has the same pitch and pad. Channels from `channels` to a multiple of 4 hold
 * anything: their sums are not read. */
static void load(const struct state *state, float *strip, const float *image, int64_t channels,
                 int64_t first, int64_t rows, int64_t pad)
{
    int64_t width = state->spec.width, height = state->spec.height;
    for (int64_t c = 0; c < channels; c++) {
        for (int64_t y = first; y < first + rows; y++, strip += state->pitch) {
            if (y >= 0 && y < height) {
                memcpy(strip + pad, image + (c * height + y) * width,
                       (size_t)width * sizeof *strip);
            } else {
                memset(strip + pad, 0, (size_t)width * sizeof *strip);
            }
        }
    }
}

static void convolve(const struct state *state, const struct plan *plan, float *out,
                     const float *in)
{
    int64_t height = state->spec.height, plane = height * state->spec.width;
    int64_t pad = (state->spec.kernel - 1) / 2;
    int64_t strips = (height + plan->rows - 1) / plan->rows;
#pragma omp parallel for schedule(static) num_threads(state->threads)
    for (int64_t unit = 0; unit < state->spec.batch * strips; unit++) {
        int64_t n = unit / strips, first = unit % strips * plan->rows;
        int64_t rows = height - first < plan->rows ? height - first : plan->rows;
        float *copy = state->strips + omp_get_thread_num() * state->strip_floats;
        load(state, copy, in + n * plan->in * plane, plan->in, first - pad, rows + 2 * pad, pad);
        struct direct_strip strip = {copy, plan->in, rows + 2 * pad, state->pitch, 0};
        struct direct_target target = {.data = out + n * plan->out * plane,
                                       .channels = plan->out,
                                       .plane = plane,
                                       .rows = rows,
                                       .width = state->spec.width,
                                       .pitch = state->spec.width,
                                       .held = height,
                                       .first = first};
        run_kernel(state, plan, &target, &strip);
    }
}

static void forward(void *opaque, float *out, const float *in)
{
    struct state *state = opaque;
    convolve(state, &state->forward, out, in);
}

/** The kernel reads and writes the lines where they lie. */
static void forward_lines(const void *opaque, const struct v2v_lines *out,
                          const struct v2v_lines *in, int64_t first, int64_t rows)
{
    const struct state *state = opaque;
    const struct plan *plan = &state->forward;
    int64_t pad = (state->spec.kernel - 1) / 2;
    struct direct_strip strip = {.data = in->data - pad,
                                 .channels = plan->in,
                                 .rows = in->held,
                                 .pitch = in->pitch,
                                 .first = v2v_lines_place(in, first - pad)};
    struct direct_target target = {.data = out->data,
                                   .channels = plan->out,
                                   .plane = v2v_lines_stride(out),
                                   .rows = rows,
                                   .width = out->width,
                                   .pitch = out->pitch,
                                   .held = out->held,
                                   .first = v2v_lines_place(out, first)};
    V2V_ASSERT(in->channels == plan->in && out->channels == plan->out && in->width == out->width);
    run_kernel(state, plan, &target, &strip);
}

static void backward_data(void *opaque, float *din, const float *dout)
{
    struct state *state = opaque;
    convolve(state, &state->data, din, dout);
}

V2V_SIMD_CLONES
static double lane_sum(const float *sums, int64_t lanes)
{
    double sum = 0.0;
#pragma omp simd reduction(+ : sum)
    for (int64_t i = 0; i < lanes; i++) {
        sum += (double)sums[i];
    }
    return sum;
}

/** Lanes and parts are added up in a fixed order. */
static void add_sums(const struct state *state, float *dweight)
{
    int64_t in = state->spec.in, k = state->spec.kernel, lanes = state->kernel->lanes;
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t o = 0; o < state->spec.out; o++) {
        for (int64_t i = 0; i < in; i++) {
            for (int64_t tap = 0; tap < k * k; tap++) {
                int64_t block = (o / DIRECT_CHANNELS * in + i) * k + tap / k;
                int64_t place = (block * DIRECT_CHANNELS + o % DIRECT_CHANNELS) * k + tap % k;
                double sum = 0.0;
                for (int part = 0; part < PARTS; part++) {
                    sum += lane_sum(state->sums + part * state->sum_floats + place * lanes, lanes);
                }
                dweight[(o * in + i) * k * k + tap] += (float)sum;
            }
        }
    }
}

/** Add what one strip of one image contributes. */
static void correlate_unit(const struct state *state, float *sums, const float *in,
                           const float *dout, int64_t first)
{
    const struct v2v_conv_spec *spec = &state->spec;
    int64_t pad = (spec->kernel - 1) / 2, left = spec->height - first;
    int64_t rows = left < state->gradient_rows ? left : state->gradient_rows;
    float *strip = state->strips + omp_get_thread_num() * state->strip_floats;
    float *right = state->douts + omp_get_thread_num() * state->dout_floats;
    load(state, strip, in, spec->in, first - pad, rows + 2 * pad, pad);
    load(state, right, dout, spec->out, first, rows, 0);
    state->kernel->correlate(
        sums, &(struct direct_strip){strip, spec->in, rows + 2 * pad, state->pitch, 0},
        &(struct direct_strip){right, spec->out, rows, state->pitch, 0}, spec->width, spec->kernel);
}

static void backward_weights(void *opaque, float *dweight, const float *in, const float *dout)
{
    struct state *state = opaque;
    const struct v2v_conv_spec *spec = &state->spec;
    int64_t plane = spec->height * spec->width;
    int64_t strips = (spec->height + state->gradient_rows - 1) / state->gradient_rows;
    int64_t units = spec->batch * strips;
#pragma omp parallel for schedule(static) num_threads(state->threads)
    for (int64_t part = 0; part < PARTS; part++) {
        float *sums = state->sums + part * state->sum_floats;
        memset(sums, 0, (size_t)state->sum_floats * sizeof *sums);
        for (int64_t unit = units * part / PARTS; unit < units * (part + 1) / PARTS; unit++) {
            int64_t n = unit / strips, first = unit % strips * state->gradient_rows;
            correlate_unit(state, sums, in + n * spec->in * plane, dout + n * spec->out * plane,
                           first);
        }
    }
    add_sums(state, dweight);
}

const struct v2v_conv_backend v2v_conv_direct = {.name = "direct",
                                                 .create = create,
                                                 .destroy = destroy,
                                                 .set_weights = set_weights,
                                                 .forward = forward,
                                                 .backward_data = backward_data,
                                                 .backward_weights = backward_weights,
                                                 .forward_lines = forward_lines};
