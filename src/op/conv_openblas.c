#include "op/conv_backend.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/op/activation.h"
#include "v2v3d/op/gemm.h"
#include <string.h>

/** Bytes of the unfolded strip of rows: bounded whatever the frame. */
static const int64_t STRIP_BYTES = 16 << 20;

/** Unfolded input: unfolded[(i,k,l),(y,x)] = in[i, y*stride+k-pad, x*stride+l-pad]; a convolution
 *  is then one matrix product. */
struct state {
    struct v2v_conv_spec spec;
    int64_t rows; /**< output rows of a strip */
    float *unfolded;
    const float *weight, *bias; /**< borrowed */
};

static enum v2v_status create(void **opaque, const struct v2v_conv_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct state *state = NULL;
    V2V_TRY(V2V_ALLOC(state, "conv", 1));
    state->spec = *spec;
    int64_t row = spec->in * spec->kernel * spec->kernel * conv_out_width(spec);
    int64_t most = STRIP_BYTES / (row * (int64_t)sizeof(float));
    most = most < 1 ? 1 : most;
    state->rows = most < conv_out_height(spec) ? most : conv_out_height(spec);
    V2V_TRY(V2V_ALLOC(state->unfolded, "conv.strips", v2v_mem_product(row, state->rows, 1)));
    *opaque = state;
    state = NULL;
done:
    v2v_mem_free(state);
    return rc;
}

static void destroy(void *opaque)
{
    struct state *state = opaque;
    if (state != NULL) {
        v2v_mem_free(state->unfolded);
        v2v_mem_free(state);
    }
}

static void set_weights(void *opaque, const float *weight, const float *bias)
{
    struct state *state = opaque;
    state->weight = weight;
    state->bias = bias;
}

/** One tap of an image row against a row of the unfolded strip: unfolded x, [begin,end) of it lies
 *  inside the image, at image column x * stride + shift. */
struct tap {
    int64_t channel, row, shift, begin, end;
};

static struct tap tap_of(const struct v2v_conv_spec *spec, int64_t index, int64_t y)
{
    int64_t k = spec->kernel, pad = (k - 1) / 2, s = spec->stride;
    int64_t l = index % k, shift = l - pad;
    struct tap tap = {.channel = index / (k * k),
                      .row = y * s + index / k % k - pad,
                      .shift = shift,
                      .begin = shift < 0 ? (-shift + s - 1) / s : 0,
                      .end = (spec->width - 1 - shift) / s + 1};
    int64_t columns = conv_out_width(spec);
    tap.end = tap.end < columns ? tap.end : columns;
    if (tap.row < 0 || tap.row >= spec->height) {
        tap.begin = tap.end = 0;
    }
    return tap;
}

static void unfold(const struct state *state, const float *image, int64_t first, int64_t rows)
{
    const struct v2v_conv_spec *spec = &state->spec;
    int64_t columns = conv_out_width(spec), s = spec->stride;
    int64_t taps = spec->in * spec->kernel * spec->kernel;
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t index = 0; index < taps; index++) {
        for (int64_t y = 0; y < rows; y++) {
            struct tap tap = tap_of(spec, index, first + y);
            float *to = state->unfolded + (index * rows + y) * columns;
            memset(to, 0, (size_t)columns * sizeof *to);
            const float *from = image + tap.channel * spec->height * spec->width;
            for (int64_t x = tap.begin; x < tap.end; x++) {
                to[x] = from[tap.row * spec->width + x * s + tap.shift];
            }
        }
    }
}

/** The adjoint of unfold; a thread owns whole channels: a fixed order of sums. */
static void fold(const struct state *state, float *image, int64_t first, int64_t rows)
{
    const struct v2v_conv_spec *spec = &state->spec;
    int64_t columns = conv_out_width(spec), s = spec->stride;
    int64_t taps = (int64_t)spec->kernel * spec->kernel;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < spec->in; i++) {
        for (int64_t index = i * taps; index < (i + 1) * taps; index++) {
            for (int64_t y = 0; y < rows; y++) {
                struct tap tap = tap_of(spec, index, first + y);
                const float *from = state->unfolded + (index * rows + y) * columns;
                float *to = image + i * spec->height * spec->width;
                for (int64_t x = tap.begin; x < tap.end; x++) {
                    to[tap.row * spec->width + x * s + tap.shift] += from[x];
                }
            }
        }
    }
}

/** Where a strip lies and how large its matrix product is. */
struct strip {
    int64_t first, rows; /**< output rows */
    int64_t taps;        /**< rows of the unfolded matrix */
    int64_t pixels;      /**< its columns */
    int64_t plane;       /**< pixels of a whole output channel */
    int64_t in_image, out_image;
};

static struct strip strip_at(const struct state *state, int64_t first)
{
    const struct v2v_conv_spec *spec = &state->spec;
    int64_t left = conv_out_height(spec) - first;
    int64_t plane = conv_out_height(spec) * conv_out_width(spec);
    struct strip strip = {.first = first,
                          .rows = left < state->rows ? left : state->rows,
                          .taps = spec->in * spec->kernel * spec->kernel,
                          .plane = plane,
                          .in_image = spec->in * spec->height * spec->width,
                          .out_image = spec->out * plane};
    strip.pixels = strip.rows * conv_out_width(spec);
    return strip;
}

static void finish(const struct state *state, float *out, struct strip strip)
{
#pragma omp parallel for schedule(static)
    for (int64_t o = 0; o < state->spec.out; o++) {
        float *row = out + o * strip.plane;
        float bias = state->bias[o];
        for (int64_t x = 0; x < strip.pixels; x++) {
            row[x] += bias;
        }
        if (state->spec.slope != 1.0f) {
            v2v_leaky_forward(row, row, strip.pixels, state->spec.slope);
        }
    }
}

static void forward(void *opaque, float *out, const float *in)
{
    const struct state *state = opaque;
    int64_t height = conv_out_height(&state->spec), width = conv_out_width(&state->spec);
    for (int64_t n = 0; n < state->spec.batch; n++) {
        for (int64_t y = 0; y < height; y += state->rows) {
            struct strip strip = strip_at(state, y);
            float *to = out + n * strip.out_image + y * width;
            unfold(state, in + n * strip.in_image, y, strip.rows);
            v2v_gemm(V2V_BACKEND_OPENBLAS, 0, 0, state->spec.out, strip.pixels, strip.taps, 1.0f,
                     state->weight, strip.taps, state->unfolded, strip.pixels, 0.0f, to,
                     strip.plane);
            finish(state, to, strip);
        }
    }
}

static void backward_data(void *opaque, float *din, const float *dout)
{
    const struct state *state = opaque;
    int64_t height = conv_out_height(&state->spec), width = conv_out_width(&state->spec);
    for (int64_t n = 0; n < state->spec.batch; n++) {
        int64_t image = state->spec.in * state->spec.height * state->spec.width;
        memset(din + n * image, 0, (size_t)image * sizeof *din);
        for (int64_t y = 0; y < height; y += state->rows) {
            struct strip strip = strip_at(state, y);
            v2v_gemm(V2V_BACKEND_OPENBLAS, 1, 0, strip.taps, strip.pixels, state->spec.out, 1.0f,
                     state->weight, strip.taps, dout + n * strip.out_image + y * width, strip.plane,
                     0.0f, state->unfolded, strip.pixels);
            fold(state, din + n * image, y, strip.rows);
        }
    }
}

static void backward_weights(void *opaque, float *dweight, const float *in, const float *dout)
{
    const struct state *state = opaque;
    int64_t height = conv_out_height(&state->spec), width = conv_out_width(&state->spec);
    for (int64_t n = 0; n < state->spec.batch; n++) {
        for (int64_t y = 0; y < height; y += state->rows) {
            struct strip strip = strip_at(state, y);
            unfold(state, in + n * strip.in_image, y, strip.rows);
            v2v_gemm(V2V_BACKEND_OPENBLAS, 0, 1, state->spec.out, strip.taps, strip.pixels, 1.0f,
                     dout + n * strip.out_image + y * width, strip.plane, state->unfolded,
                     strip.pixels, 1.0f, dweight, strip.taps);
        }
    }
}

const struct v2v_conv_backend v2v_conv_openblas = {.name = "OpenBLAS",
                                                   .create = create,
                                                   .destroy = destroy,
                                                   .set_weights = set_weights,
                                                   .forward = forward,
                                                   .backward_data = backward_data,
                                                   .backward_weights = backward_weights};
