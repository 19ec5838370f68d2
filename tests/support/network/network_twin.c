#include "network/network_twin.h"

#include "network/network_table.h"
#include "network/twin_image.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/v2v/schema.h"
#include <cblas.h>
#include <string.h>

enum { BRANCHES = 2, LEVELS = 4, PYRAMID = 3, DEEP = 16, LEVEL_FEATURES = 4 };

/* Patches of one matrix product: 128 channels x 9 x 2048 doubles = 19 MB. */
enum { CHUNK_CHANNELS = 128, STRIP_PIXELS = 2048 };

struct twin {
    const struct v2v_model_spec *spec;
    const struct v2v_shifts *shifts;
    const struct v2v_fields *fields;
    const float *weights;
    const struct v2v_net_layer *table; /* of the part at hand */
    const char *prefix;
    int64_t branch_views;
    double *patch;
    int64_t patch_count;
};

/* A layer whose input channels come bit by bit. */
struct pass {
    const struct v2v_net_layer *layer;
    int64_t in, out;
    double *weight; /* [out,in,k,k] */
};

static enum v2v_status parameter(const float **values, const struct twin *twin, const char *layer,
                                 const char *kind, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    char name[V2V_FIELDS_NAME_BYTES];
    V2V_TRY(v2v_text_format(name, sizeof name, "%s.%s.%s", twin->prefix, layer, kind));
    const struct v2v_fields_item *field = v2v_fields_find(twin->fields, name);
    if (field == NULL || field->count != count) {
        V2V_TRY(V2V_FAIL(V2V_E_INTERNAL, "%s: %s", name,
                         field == NULL ? "no such parameter" : "another shape than the twin's"));
    }
    *values = twin->weights + field->offset;
done:
    return rc;
}

/* `out` is made, for an input of [height,width], and holds the bias. */
static enum v2v_status pass_begin(struct pass *pass, struct v2v_image *out, const struct twin *twin,
                                  const char *name, int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    const float *weight = NULL, *bias = NULL;
    int in_unet = twin->table == v2v_net_unet;
    const struct v2v_net_layer *layer = v2v_net_find(twin->table, name);
    *pass =
        (struct pass){.layer = layer,
                      .in = v2v_net_channels(layer->in, in_unet, twin->spec, twin->branch_views),
                      .out = v2v_net_channels(layer->out, in_unet, twin->spec, twin->branch_views)};
    int64_t count = pass->out * pass->in * layer->kernel * layer->kernel;
    V2V_TRY(parameter(&weight, twin, name, "weight", count));
    V2V_TRY(parameter(&bias, twin, name, "bias", pass->out));
    V2V_TRY(V2V_ALLOC(pass->weight, "twin.weight", count));
    for (int64_t i = 0; i < count; i++) {
        pass->weight[i] = weight[i];
    }
    V2V_TRY(v2v_image_init(out, pass->out, height / layer->stride, width / layer->stride));
    int64_t pixels = out->height * out->width;
    for (int64_t i = 0; i < pass->out * pixels; i++) {
        out->data[i] = bias[i / pixels];
    }
done:
    return rc;
}

/* patch[c,k,l,y,x] = in[c, y*stride+k-pad, x*stride+l-pad], zero outside, for output rows
 * y0 .. y0+rows-1. */
static void fill_patch(double *patch, const struct v2v_image *in, int64_t c0, int64_t channels,
                       const struct v2v_net_layer *layer, int64_t y0, int64_t rows, int64_t columns)
{
    int kernel = layer->kernel, pad = (kernel - 1) / 2;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < channels * kernel * kernel; i++) {
        const double *plane = in->data + (c0 + i / (kernel * kernel)) * in->height * in->width;
        int64_t k = i / kernel % kernel - pad, l = i % kernel - pad;
        double *to = patch + i * rows * columns;
        for (int64_t y = 0; y < rows; y++) {
            int64_t sy = (y0 + y) * layer->stride + k;
            for (int64_t x = 0; x < columns; x++) {
                int64_t sx = x * layer->stride + l;
                int inside = sy >= 0 && sy < in->height && sx >= 0 && sx < in->width;
                to[y * columns + x] = inside ? plane[sy * in->width + sx] : 0.0;
            }
        }
    }
}

static enum v2v_status reserve_patch(struct twin *twin, int64_t count)
{
    if (count <= twin->patch_count) {
        return V2V_OK;
    }
    v2v_mem_free(twin->patch);
    twin->patch_count = count;
    return V2V_ALLOC(twin->patch, "twin.patch", count);
}

/* Add what `in` contributes, whose channels are the layer's from `first` on. */
static enum v2v_status pass_add(const struct pass *pass, struct v2v_image *out, struct twin *twin,
                                const struct v2v_image *in, int64_t first)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_net_layer *layer = pass->layer;
    int64_t taps = (int64_t)layer->kernel * layer->kernel, pixels = out->height * out->width;
    int64_t strip = STRIP_PIXELS / out->width > 1 ? STRIP_PIXELS / out->width : 1;
    V2V_TRY(reserve_patch(twin, v2v_mem_product(CHUNK_CHANNELS * taps, strip, out->width)));
    for (int64_t y = 0; y < out->height; y += strip) {
        int64_t rows = out->height - y < strip ? out->height - y : strip;
        for (int64_t c = 0; c < in->channels; c += CHUNK_CHANNELS) {
            int64_t left = in->channels - c;
            int64_t channels = left < CHUNK_CHANNELS ? left : CHUNK_CHANNELS;
            fill_patch(twin->patch, in, c, channels, layer, y, rows, out->width);
            const int taken = (int)(channels * taps), made = (int)(rows * out->width);
            cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, pass->out, made, taken, 1.0,
                        pass->weight + (first + c) * taps, (int)(pass->in * taps), twin->patch,
                        made, 1.0, out->data + y * out->width, (int)pixels);
        }
    }
done:
    return rc;
}

static void pass_end(struct pass *pass, struct v2v_image *out)
{
    if (out->data != NULL) {
        v2v_image_leaky(out, pass->layer->slope);
    }
    v2v_mem_free(pass->weight);
}

static enum v2v_status convolve(struct v2v_image *out, struct twin *twin,
                                const struct v2v_image *in, const char *name)
{
    enum v2v_status rc = V2V_OK;
    struct pass pass = {0};
    V2V_TRY(pass_begin(&pass, out, twin, name, in->height, in->width));
    V2V_ASSERT(in->channels == pass.in);
    V2V_TRY(pass_add(&pass, out, twin, in, 0));
done:
    pass_end(&pass, out);
    return rc;
}

/* x <- layer(x) */
static enum v2v_status advance(struct v2v_image *x, struct twin *twin, const char *name)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_image out = {0};
    rc = convolve(&out, twin, x, name);
    v2v_image_replace(x, &out);
    return rc;
}

/* ---- encoder ---- */

static enum v2v_status residual_block(struct v2v_image *x, struct twin *twin, const char *block,
                                      int is_wider)
{
    enum v2v_status rc = V2V_OK;
    char name[V2V_FIELDS_NAME_BYTES];
    struct v2v_image y = {0};
    V2V_TRY(v2v_text_format(name, sizeof name, "%s.conv.0", block));
    V2V_TRY(convolve(&y, twin, x, name));
    V2V_TRY(v2v_text_format(name, sizeof name, "%s.conv.2", block));
    V2V_TRY(advance(&y, twin, name));
    if (is_wider) {
        V2V_TRY(v2v_text_format(name, sizeof name, "%s.downsample.conv", block));
        V2V_TRY(advance(x, twin, name));
    }
    for (int64_t i = 0; i < v2v_image_count(&y); i++) {
        x->data[i] += y.data[i];
    }
done:
    v2v_image_fini(&y);
    return rc;
}

/* joined <- [x, branch1, branch2, branch3] */
static enum v2v_status pyramid(struct v2v_image *joined, struct twin *twin,
                               const struct v2v_image *x)
{
    static const char *const names[PYRAMID] = {"branch1.1.conv", "branch2.1.conv",
                                               "branch3.1.conv"};
    enum v2v_status rc = V2V_OK;
    struct v2v_image small = {0};
    int64_t pixels = x->height * x->width;
    V2V_TRY(v2v_image_init(joined, DEEP + PYRAMID * LEVEL_FEATURES, x->height, x->width));
    memcpy(joined->data, x->data, (size_t)(DEEP * pixels) * sizeof *x->data);
    for (int k = 0; k < PYRAMID; k++) {
        V2V_TRY(v2v_image_average_pool(&small, x, 2 << k));
        V2V_TRY(advance(&small, twin, names[k]));
        v2v_image_bilinear(joined->data + (DEEP + k * LEVEL_FEATURES) * pixels, &small, x->height,
                           x->width);
        v2v_image_fini(&small);
    }
done:
    v2v_image_fini(&small);
    return rc;
}

/* @param features [features,y,x] of one view */
static enum v2v_status encode(double *features, struct twin *twin, const float *view,
                              int64_t height, int64_t width)
{
    static const struct {
        const char *name;
        int is_wider;
    } blocks[] = {{"layer1.0", 0}, {"layer1.1", 0}, {"layer2.0", 1},
                  {"layer2.1", 0}, {"layer3.0", 1}, {"layer3.1", 0}};
    enum v2v_status rc = V2V_OK;
    struct v2v_image x = {0}, joined = {0};
    V2V_TRY(v2v_image_init(&x, 1, height, width));
    for (int64_t i = 0; i < height * width; i++) {
        x.data[i] = view[i];
    }
    V2V_TRY(advance(&x, twin, "conv1.0"));
    for (size_t b = 0; b < sizeof blocks / sizeof blocks[0]; b++) {
        V2V_TRY(residual_block(&x, twin, blocks[b].name, blocks[b].is_wider));
    }
    V2V_TRY(pyramid(&joined, twin, &x));
    V2V_TRY(advance(&joined, twin, "lastconv.0.conv"));
    V2V_TRY(advance(&joined, twin, "lastconv.2"));
    memcpy(features, joined.data, (size_t)v2v_image_count(&joined) * sizeof *features);
done:
    v2v_image_fini(&joined);
    v2v_image_fini(&x);
    return rc;
}

/* ---- U-Net ---- */

/* aligned[f*Z+z, y, x] = feat[f, y+dy[v,z], x+dx[v,z]], zero outside, of view v. */
static void align_view(struct v2v_image *aligned, const struct twin *twin,
                       const struct v2v_image *features, int64_t v)
{
    int64_t slices = twin->spec->slices, height = features->height, width = features->width;
#pragma omp parallel for schedule(static)
    for (int64_t c = 0; c < aligned->channels; c++) {
        int64_t z = c % slices;
        int64_t dy = twin->shifts->dy[v * slices + z], dx = twin->shifts->dx[v * slices + z];
        const double *from =
            features->data + (v * twin->spec->features + c / slices) * height * width;
        double *to = aligned->data + c * height * width;
        for (int64_t y = 0; y < height; y++) {
            for (int64_t x = 0; x < width; x++) {
                int64_t sy = y + dy, sx = x + dx;
                int inside = sy >= 0 && sy < height && sx >= 0 && sx < width;
                to[y * width + x] = inside ? from[sy * width + sx] : 0.0;
            }
        }
    }
}

/* The first layer, view by view: the aligned features of all views never exist together. */
static enum v2v_status enter(struct v2v_image *out, struct twin *twin,
                             const struct v2v_image *features, const int32_t *list)
{
    enum v2v_status rc = V2V_OK;
    struct pass pass = {0};
    struct v2v_image aligned = {0};
    int64_t channels = twin->spec->features * twin->spec->slices;
    V2V_TRY(v2v_image_init(&aligned, channels, features->height, features->width));
    V2V_TRY(pass_begin(&pass, out, twin, "init_conv.0", features->height, features->width));
    for (int64_t i = 0; i < twin->branch_views; i++) {
        align_view(&aligned, twin, features, list[i]);
        V2V_TRY(pass_add(&pass, out, twin, &aligned, i * channels));
    }
done:
    pass_end(&pass, out);
    v2v_image_fini(&aligned);
    return rc;
}

/* skip[0..4] = E0..E4 */
static enum v2v_status go_down(struct v2v_image *skip, struct twin *twin)
{
    enum v2v_status rc = V2V_OK;
    char name[V2V_FIELDS_NAME_BYTES];
    struct v2v_image x = {0};
    for (int k = 0; k < LEVELS; k++) {
        V2V_TRY(v2v_image_join(&x, &skip[k], NULL));
        v2v_image_leaky(&x, 0.01);
        V2V_TRY(v2v_text_format(name, sizeof name, "encoder_%d.conv.1", k + 1));
        V2V_TRY(advance(&x, twin, name));
        V2V_TRY(v2v_image_max_pool2(&skip[k + 1], &x));
        v2v_image_fini(&x);
    }
done:
    v2v_image_fini(&x);
    return rc;
}

/* f <- decoder_4(.. decoder_1([E3, upscale_2(E4)])) */
static enum v2v_status go_up(struct v2v_image *f, struct twin *twin, const struct v2v_image *skip)
{
    enum v2v_status rc = V2V_OK;
    char name[V2V_FIELDS_NAME_BYTES];
    struct v2v_image joined = {0};
    V2V_TRY(v2v_image_join(f, &skip[LEVELS], NULL));
    v2v_image_leaky(f, 0.05);
    V2V_TRY(v2v_image_nearest2(f));
    V2V_TRY(advance(f, twin, "upscale_2.upscale.1"));
    for (int k = 1; k <= LEVELS; k++) {
        V2V_TRY(v2v_image_join(&joined, &skip[LEVELS - k], f));
        v2v_image_replace(f, &joined);
        v2v_image_leaky(f, 0.01);
        V2V_TRY(v2v_image_nearest2(f));
        V2V_TRY(v2v_text_format(name, sizeof name, "decoder_%d.decoder.1.upscale.1", k));
        V2V_TRY(advance(f, twin, name));
    }
done:
    v2v_image_fini(&joined);
    return rc;
}

static enum v2v_status run_unet(double *volume, struct twin *twin, const struct v2v_image *features,
                                const int32_t *list)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_image x = {0}, skip[LEVELS + 1] = {{0}};
    V2V_TRY(enter(&x, twin, features, list));
    V2V_TRY(advance(&x, twin, "init_conv.2"));
    V2V_TRY(advance(&x, twin, "init_conv.4"));
    V2V_TRY(convolve(&skip[0], twin, &x, "init_conv.6"));
    v2v_image_fini(&x);
    V2V_TRY(go_down(skip, twin));
    V2V_TRY(go_up(&x, twin, skip));
    V2V_TRY(advance(&x, twin, "conv_final.0"));
    V2V_TRY(advance(&x, twin, "conv_final.2"));
    V2V_TRY(advance(&x, twin, "conv_final.4"));
    for (int64_t i = 0; i < v2v_image_count(&x); i++) {
        volume[i] = twin->spec->volume_scale * x.data[i];
    }
done:
    for (int k = 0; k <= LEVELS; k++) {
        v2v_image_fini(&skip[k]);
    }
    v2v_image_fini(&x);
    return rc;
}

enum v2v_status v2v_network_twin(double *const *volume, const struct v2v_model_spec *spec,
                                 const struct v2v_shifts *shifts, const struct v2v_fields *fields,
                                 const float *weights, const float *views, int64_t height,
                                 int64_t width)
{
    static const char *const prefix[BRANCHES] = {"unet1", "unet2"};
    enum v2v_status rc = V2V_OK;
    struct twin twin = {.spec = spec,
                        .shifts = shifts,
                        .fields = fields,
                        .weights = weights,
                        .table = v2v_net_encoder,
                        .prefix = "feat_extract"};
    struct v2v_image features = {0};
    int32_t *list = NULL;
    int64_t pixels = height * width;
    V2V_TRY(V2V_ALLOC(list, "twin.views", spec->views));
    V2V_TRY(v2v_image_init(&features, spec->views * spec->features, height, width));
    for (int64_t v = 0; v < spec->views; v++) {
        V2V_TRY(encode(features.data + v * spec->features * pixels, &twin, views + v * pixels,
                       height, width));
    }
    twin.table = v2v_net_unet;
    for (int b = 0; b < BRANCHES; b++) {
        twin.prefix = prefix[b];
        twin.branch_views = v2v_branch_views(list, spec, b);
        V2V_TRY(run_unet(volume[b], &twin, &features, list));
    }
done:
    v2v_mem_free(twin.patch);
    v2v_image_fini(&features);
    v2v_mem_free(list);
    return rc;
}
