#include "op/conv_backend.h"
#include "op/isa.h"
#include "op/pixels.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/op/activation.h"
#include "v2v3d/op/resample.h"
#include "v2v3d/op/tiles.h"
#include "v2v3d/tensor/bulk.h"

/** Our own kernel is taken up to this many channel pairs, in * out. Measured with bench_conv on one
 *  Cascade Lake core (AVX-512) of a busy machine, means of 2 to 4 runs that spread by a quarter,
 *  GFLOP/s of processor time, forward / data / weights, 3x3 on 128 x 128 pixels:
 *            4->4      8->8      16->16    28->16    16->32    64->64
 *  direct    47/44/28  57/59/36  61/59/39  61/58/45  67/56/43  81/86/50
 *  oneDNN    11/12/ 8  29/29/19  53/47/46  50/50/43  55/54/52  76/88/75 */
enum { DIRECT_LIMIT = 28 * 16 };

struct v2v_conv {
    struct v2v_conv_spec spec;
    float *repeated; /**< input in full size, where the backend has no upsampling of its own */
    const struct v2v_conv_backend *backend;
    void *state;
};

/** With fewer tiles than a panel holds, reading the transformed weights would take longer than
 *  multiplying. */
enum { WINOGRAD_TILES = 32 };

static int winograd_pays(const struct v2v_conv_spec *spec)
{
    int64_t rows = (spec->height + V2V_TILE - 1) / V2V_TILE;
    int64_t columns = (spec->width + V2V_TILE - 1) / V2V_TILE;
    return spec->method.winograd && spec->kernel == 3 && rows * columns >= WINOGRAD_TILES;
}

/** Layers of few channels stay with our own kernel: packing or reordering them would take longer
 *  than their multiplications. */
static int bf16_pays(const struct v2v_conv_spec *spec)
{
    return spec->method.precision != V2V_PRECISION_F32 && spec->kernel == 3 &&
           spec->in * spec->out > DIRECT_LIMIT;
}

const struct v2v_conv_backend *v2v_conv_choose(const struct v2v_conv_spec *spec)
{
    if (bf16_pays(spec)) {
        return v2v_amx_usable() ? &v2v_conv_amx : &v2v_conv_bf16;
    }
    if (spec->stride == 1 && spec->in * spec->out <= DIRECT_LIMIT) {
        return &v2v_conv_direct;
    }
    if (winograd_pays(spec)) {
        return &v2v_conv_winograd;
    }
    return spec->method.backend == V2V_BACKEND_OPENBLAS ? &v2v_conv_openblas : &v2v_conv_onednn;
}

int v2v_conv_takes_blocked(const struct v2v_conv_spec *spec)
{
    return v2v_conv_choose(spec) == &v2v_conv_amx && spec->batch == 1 && !spec->training;
}

static enum v2v_status check_spec(const struct v2v_conv_spec *spec)
{
    V2V_ASSERT(spec->kernel == 1 || spec->kernel == 3);
    V2V_ASSERT(spec->stride == 1 || spec->stride == 2);
    V2V_ASSERT((spec->in_form | spec->out_form) == V2V_FORM_PLAIN || v2v_conv_takes_blocked(spec));
    int64_t channels = spec->in > spec->out ? spec->in : spec->out;
    int64_t weights = v2v_mem_product(spec->in, spec->out, (int64_t)spec->kernel * spec->kernel);
    int64_t pixels = v2v_mem_product(spec->height, spec->width, 1);
    int64_t elements = pixels < 0 ? -1 : v2v_mem_product(spec->batch, channels, pixels);
    if (weights < 1 || elements < 1 || spec->in < 1 || spec->out < 1) {
        return V2V_FAIL(V2V_E_INTERNAL,
                        "convolution of %lld images, %lld to %lld channels, %lld x %lld pixels: "
                        "not countable",
                        (long long)spec->batch, (long long)spec->in, (long long)spec->out,
                        (long long)spec->height, (long long)spec->width);
    }
    return V2V_OK;
}

static enum v2v_status make_room(struct v2v_conv *conv)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_conv_spec *spec = &conv->spec;
    if (spec->upsample && conv->backend != &v2v_conv_winograd) {
        V2V_ASSERT(spec->in_form == V2V_FORM_PLAIN);
        V2V_ASSERT(spec->stride == 1 && spec->height % 2 == 0 && spec->width % 2 == 0);
        V2V_TRY(V2V_ALLOC(conv->repeated, "conv.upsampled",
                          spec->batch * spec->in * spec->height * spec->width));
    }
done:
    return rc;
}

/** The input as the backend takes it. */
static const float *full_size(struct v2v_conv *conv, const float *in)
{
    if (conv->repeated == NULL) {
        return in;
    }
    v2v_nearest2_forward(conv->repeated, in, conv->spec.batch * conv->spec.in,
                         conv->spec.height / 2, conv->spec.width / 2);
    return conv->repeated;
}

enum v2v_status v2v_conv_create_with(struct v2v_conv **conv, const struct v2v_conv_spec *spec,
                                     const struct v2v_conv_backend *backend)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_conv *made = NULL;
    V2V_TRY(check_spec(spec));
    V2V_TRY(V2V_ALLOC(made, "conv", 1));
    made->spec = *spec;
    made->backend = backend;
    V2V_TRY(make_room(made));
    V2V_TRY(backend->create(&made->state, spec));
    *conv = made;
    made = NULL;
done:
    if (made != NULL) {
        v2v_mem_free(made->repeated);
    }
    v2v_mem_free(made);
    return rc;
}

enum v2v_status v2v_conv_create(struct v2v_conv **conv, const struct v2v_conv_spec *spec)
{
    return v2v_conv_create_with(conv, spec, v2v_conv_choose(spec));
}

void v2v_conv_destroy(struct v2v_conv **conv)
{
    if (*conv == NULL) {
        return;
    }
    (*conv)->backend->destroy((*conv)->state);
    v2v_mem_free((*conv)->repeated);
    v2v_mem_free(*conv);
    *conv = NULL;
}

void v2v_conv_set_weights(struct v2v_conv *conv, const float *weight, const float *bias)
{
    conv->backend->set_weights(conv->state, weight, bias);
}

void v2v_conv_forward(struct v2v_conv *conv, float *out, const float *in)
{
    conv->backend->forward(conv->state, out, full_size(conv, in));
}

void v2v_conv_forward_tiles(struct v2v_conv *conv, float *out, const float *in,
                            const struct v2v_tiles *tiles)
{
    V2V_ASSERT(conv->spec.batch == 1 && conv->spec.stride == 1);
    if (conv->backend->forward_tiles == NULL) {
        v2v_conv_forward(conv, out, in);
    } else {
        conv->backend->forward_tiles(conv->state, out, full_size(conv, in), tiles);
    }
}

int v2v_conv_takes_lines(const struct v2v_conv *conv)
{
    return conv->backend->forward_lines != NULL;
}

void v2v_conv_forward_lines(const struct v2v_conv *conv, const struct v2v_lines *out,
                            const struct v2v_lines *in, int64_t first, int64_t rows)
{
    V2V_ASSERT(v2v_conv_takes_lines(conv) && conv->repeated == NULL);
    conv->backend->forward_lines(conv->state, out, in, first, rows);
}

void v2v_conv_backward_data(struct v2v_conv *conv, float *din, const float *dout)
{
    V2V_ASSERT(conv->spec.training);
    if (conv->repeated == NULL) {
        conv->backend->backward_data(conv->state, din, dout);
        return;
    }
    conv->backend->backward_data(conv->state, conv->repeated, dout);
    v2v_nearest2_backward(din, conv->repeated, conv->spec.batch * conv->spec.in,
                          conv->spec.height / 2, conv->spec.width / 2);
}

/* Inputs whose taps of one output are read in one go. */
enum { FLIPPED = 16 };

void v2v_conv_flip_weights(float *flipped, const float *weight, const struct v2v_conv_spec *spec)
{
    int64_t taps = (int64_t)spec->kernel * spec->kernel;
#pragma omp parallel for schedule(static)
    for (int64_t first = 0; first < spec->in; first += FLIPPED) {
        int64_t end = v2v_smaller(first + FLIPPED, spec->in);
        for (int64_t o = 0; o < spec->out; o++) {
            for (int64_t i = first; i < end; i++) {
                for (int64_t t = 0; t < taps; t++) {
                    flipped[(i * spec->out + o) * taps + t] =
                        weight[(o * spec->in + i) * taps + taps - 1 - t];
                }
            }
        }
    }
}

void v2v_bias_gradient(float *dbias, const float *dout, int64_t batch, int64_t channels,
                       int64_t rows, int64_t columns)
{
#pragma omp parallel for schedule(static)
    for (int64_t c = 0; c < channels; c++) {
        double sum = 0.0;
        for (int64_t n = 0; n < batch; n++) {
            sum += v2v_pixels_sum(dout + (n * channels + c) * rows * columns, rows, columns);
        }
        dbias[c] += (float)sum;
    }
}

static void add_bias_gradient(const struct v2v_conv *conv, float *dbias, const float *dout)
{
    if (dbias != NULL) {
        v2v_bias_gradient(dbias, dout, conv->spec.batch, conv->spec.out,
                          conv_out_height(&conv->spec), conv_out_width(&conv->spec));
    }
}

/* Of all images, before they are upsampled. */
static int64_t in_floats(const struct v2v_conv_spec *spec)
{
    int half = spec->upsample;
    return spec->batch * spec->in * (spec->height >> half) * (spec->width >> half);
}

void v2v_conv_backward_weights(struct v2v_conv *conv, float *dweight, float *dbias, const float *in,
                               const float *dout)
{
    V2V_ASSERT(conv->spec.training);
    conv->backend->backward_weights(conv->state, dweight, full_size(conv, in), dout);
    add_bias_gradient(conv, dbias, dout);
}

static void clear_weights_gradient(const struct v2v_conv_spec *spec, const struct v2v_gradients *to)
{
    if (to->dweight != NULL) {
        v2v_bulk_clear(to->dweight, spec->out * spec->in * spec->kernel * spec->kernel);
    }
    if (to->dbias != NULL) {
        v2v_bulk_clear(to->dbias, spec->out);
    }
}

void v2v_conv_backward(struct v2v_conv *conv, const struct v2v_gradients *to, const float *in,
                       const float *dout)
{
    V2V_ASSERT(conv->spec.training);
    if (conv->backend->backward != NULL) {
        conv->backend->backward(conv->state, to, in, dout);
        return;
    }
    if (to->sets) {
        clear_weights_gradient(&conv->spec, to);
    }
    if (to->dweight != NULL) {
        v2v_conv_backward_weights(conv, to->dweight, to->dbias, in, dout);
    }
    if (to->din != NULL) {
        v2v_conv_backward_data(conv, to->din, dout);
    }
    if (to->din != NULL && to->in_slope > 0.0f) {
        v2v_leaky_backward(to->din, to->din, in, in_floats(&conv->spec), to->in_slope);
    }
}
