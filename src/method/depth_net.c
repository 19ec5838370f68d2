#include "method/depth_net.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/clones.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/method/examples.h"
#include "v2v3d/nn/layer.h"
#include "v2v3d/op/activation.h"
#include "v2v3d/par/bucket_sum.h"
#include "v2v3d/par/comm.h"

#include <string.h>

/* Layers and wires: a U-Net (Ronneberger et al., MICCAI 2015) of two levels over the plane, slices
 * as a batch. A layer convolves its input and keeps what is above 0; wires bring what layers put
 * out to the inputs of others, at once pooled (mean of 2 x 2) or repeated 2 x 2 where the sizes
 * differ. In every BLOCK channels of an input, the first `mix` are those of the slice below, the
 * next `mix` those of the slice above (temporal shift modules are built so: Lin, Gan and Han, ICCV
 * 2019); the outermost slices are their own neighbours. */
enum { LAYERS = 6, WIRES = 6, BLOCK = 16, INPUTS = 11, MOST_CHANNELS = 48 };

struct sizes {
    int64_t in, out;
    int half; /* bool: of the lower level, with half the rows and columns */
    const char *name;
};

static const struct sizes sizes[LAYERS] = {{INPUTS, 16, 0, "c1.weight"}, {16, 16, 0, "c2.weight"},
                                           {16, 32, 1, "c3.weight"},     {32, 32, 1, "c4.weight"},
                                           {48, 16, 0, "c5.weight"},     {16, 1, 0, "c6.weight"}};

struct wire {
    int from, to;  /* layers */
    int64_t first; /* channel of the input */
    int64_t mix;
};

static const struct wire wires[WIRES] = {{0, 1, 0, 4}, {1, 2, 0, 4},  {2, 3, 0, 4},
                                         {1, 4, 0, 2}, {3, 4, 16, 2}, {4, 5, 0, 0}};

/* Slices that the first layer sees of each feature, to either side. */
static const int64_t reach[V2V_FEATURES] = {2, 1, 1};

static const float no_bias[MOST_CHANNELS];
static const char *const keys[] = {
    "deconv.lambda",    "deconv.depth",      "deconv.curvature", "deconv.sparsity",
    "deconv.tolerance", "deconv.iterations", "recon.neighbours", NULL};
static const char *const before[] = {"deconv.curvature=0", "deconv.sparsity=0", NULL};

struct layer {
    int64_t weight; /* place in the table of fields */
    struct v2v_conv *conv;
    float *in, *out; /* [z,channels,y,x]; the last layer has no `out` */
    float *din;      /* in training, but of the first layer */
    int64_t height, width;
};

struct depth_net {
    struct layer layer[LAYERS];
    struct v2v_parameters parameters;
    struct v2v_conv_method method;
    struct v2v_workspace workspace;
    int64_t slices;
    float *dout; /* of the layer at hand, in training */
};

static enum v2v_status declare(struct v2v_schema *schema, const struct v2v_network_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    (void)spec;
    for (int i = 0; i < LAYERS; i++) {
        const int64_t shape[4] = {sizes[i].out, sizes[i].in, 3, 3};
        int64_t at = 0;
        V2V_TRY(v2v_fields_add(&schema->fields, &at, sizes[i].name, 4, shape));
        schema->fields.item[at].starts_small = i == LAYERS - 1;
    }
    schema->group[0] = (struct v2v_group){.name = "the convolutions",
                                          .count = schema->fields.total,
                                          .levels = 1u << V2V_GRID_LEVEL_DATA};
    schema->groups = 1;
done:
    return rc;
}

static enum v2v_status create(struct v2v_network *network, const struct v2v_network_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct depth_net *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "depth_net", 1));
    network->self = self;
    network->inputs = V2V_FEATURES * spec->slices;
    self->slices = spec->slices;
    self->method = (struct v2v_conv_method){.backend = spec->config->model.backend,
                                            .winograd = spec->config->model.winograd,
                                            .precision = V2V_PRECISION_F32,
                                            .workspace = &self->workspace};
    for (int i = 0; i < LAYERS; i++) {
        self->layer[i].weight =
            v2v_fields_find(&network->schema.fields, sizes[i].name) - network->schema.fields.item;
    }
    V2V_TRY(V2V_ALLOC(network->weights, "network.weights", network->schema.fields.total));
    self->parameters =
        (struct v2v_parameters){.fields = &network->schema.fields, .weights = network->weights};
done:
    return rc;
}

static void free_plan(struct depth_net *self)
{
    for (int i = 0; i < LAYERS; i++) {
        struct layer *layer = &self->layer[i];
        v2v_conv_destroy(&layer->conv);
        v2v_mem_free(layer->in);
        v2v_mem_free(layer->out);
        v2v_mem_free(layer->din);
        layer->in = layer->out = layer->din = NULL;
    }
    v2v_mem_free(self->dout);
    self->dout = NULL;
    v2v_workspace_fini(&self->workspace);
}

static void destroy(struct v2v_network *network)
{
    struct depth_net *self = network->self;
    if (self != NULL) {
        free_plan(self);
        v2v_mem_free(network->weights);
        v2v_mem_free(network->gradients);
        v2v_mem_free(self);
    }
}

/* Features, what enters and leaves the layers, and the volume. */
static void describe_work(struct v2v_grid_work *work, const struct v2v_network_spec *spec,
                          int64_t height, int64_t width)
{
    int64_t quarters = 4 * (V2V_FEATURES + 2); /* of a float for every voxel */
    for (int i = 0; i < LAYERS; i++) {
        quarters += (sizes[i].in + sizes[i].out) * (sizes[i].half ? 1 : 4);
    }
    const int64_t voxels = v2v_mem_product(spec->slices, height, width);
    *work = (struct v2v_grid_work){
        .height = height,
        .unit = 2,
        .most_shards = 1,
        .most_branches = 1,
        .bytes = v2v_mem_bytes(v2v_mem_product((quarters + 3) / 4, voxels, 1), 0)};
}

static void set_weights(struct layer *layer, const struct v2v_parameters *parameters)
{
    v2v_conv_set_weights(layer->conv,
                         v2v_parameter(parameters->fields, parameters->weights, layer->weight),
                         no_bias);
}

static enum v2v_status plan_layer(struct depth_net *self, int i,
                                  const struct v2v_network_plan *plan)
{
    enum v2v_status rc = V2V_OK;
    struct layer *layer = &self->layer[i];
    const int is_last = i == LAYERS - 1;
    layer->height = plan->height >> sizes[i].half;
    layer->width = plan->width >> sizes[i].half;
    const int64_t pixels = v2v_mem_product(self->slices, layer->height, layer->width);
    const struct v2v_conv_spec spec = {.batch = self->slices,
                                       .in = sizes[i].in,
                                       .out = sizes[i].out,
                                       .height = layer->height,
                                       .width = layer->width,
                                       .kernel = 3,
                                       .stride = 1,
                                       .slope = is_last ? 1.0f : 0.0f,
                                       .training = plan->training,
                                       .method = self->method};
    V2V_TRY(v2v_conv_create(&layer->conv, &spec));
    V2V_TRY(V2V_ALLOC(layer->in, "depth_net.images", v2v_mem_product(sizes[i].in, pixels, 1)));
    if (!is_last) {
        V2V_TRY(
            V2V_ALLOC(layer->out, "depth_net.images", v2v_mem_product(sizes[i].out, pixels, 1)));
    }
    if (plan->training && i > 0) {
        V2V_TRY(
            V2V_ALLOC(layer->din, "depth_net.gradients", v2v_mem_product(sizes[i].in, pixels, 1)));
    }
    set_weights(layer, &self->parameters);
done:
    return rc;
}

static enum v2v_status plan(struct v2v_network *network, const struct v2v_network_plan *plan)
{
    enum v2v_status rc = V2V_OK;
    struct depth_net *self = network->self;
    V2V_ASSERT(plan->height % 2 == 0 && plan->width % 2 == 0);
    free_plan(self);
    for (int i = 0; i < LAYERS; i++) {
        V2V_TRY(plan_layer(self, i, plan));
    }
    if (plan->training) { /* 16 channels above are more than 32 below */
        const int64_t floats = v2v_mem_product(BLOCK * self->slices, plan->height, plan->width);
        V2V_TRY(V2V_ALLOC(self->dout, "depth_net.gradients", floats));
    }
    if (plan->training && network->gradients == NULL) {
        V2V_TRY(V2V_ALLOC(network->gradients, "network.gradients", network->schema.fields.total));
    }
    self->parameters.gradients = network->gradients;
done:
    return rc;
}

static struct v2v_part rows_of(const struct v2v_network *network, int rank)
{
    const struct depth_net *self = network->self;
    (void)rank;
    return (struct v2v_part){0, self->layer[0].height};
}

static void weights_changed(struct v2v_network *network)
{
    struct depth_net *self = network->self;
    for (int i = 0; i < LAYERS; i++) {
        set_weights(&self->layer[i], &self->parameters);
    }
}

static int64_t neighbour(const struct depth_net *self, int64_t z, int64_t distance)
{
    return v2v_within(z + distance, 0, self->slices - 1);
}

/* What the first layer sees: neighbouring slices of the features. */
static void gather_features(const struct depth_net *self, const float *features)
{
    const struct layer *layer = &self->layer[0];
    const int64_t pixels = layer->height * layer->width;
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < self->slices; z++) {
        float *to = layer->in + z * INPUTS * pixels;
        for (int f = 0; f < V2V_FEATURES; f++) {
            for (int64_t d = -reach[f]; d <= reach[f]; d++, to += pixels) {
                memcpy(to, features + (f * self->slices + neighbour(self, z, d)) * pixels,
                       (size_t)pixels * sizeof *to);
            }
        }
    }
}

/* The slice from which slice z takes channel c of a wire. */
static int64_t source_of(const struct depth_net *self, const struct wire *wire, int64_t z,
                         int64_t c)
{
    const int64_t lane = c % BLOCK;
    const int64_t distance = lane < wire->mix ? -1 : lane < 2 * wire->mix ? 1 : 0;
    return neighbour(self, z, distance);
}

V2V_SIMD_CLONES
static void pool_plane(float *to, const float *from, int64_t height, int64_t width)
{
    for (int64_t y = 0; y < height; y++) {
        const float *top = from + 4 * y * width, *bottom = top + 2 * width;
        for (int64_t x = 0; x < width; x++) {
            const float sum = top[2 * x] + top[2 * x + 1] + (bottom[2 * x] + bottom[2 * x + 1]);
            to[y * width + x] = 0.25f * sum;
        }
    }
}

V2V_SIMD_CLONES
static void repeat_plane(float *to, const float *from, int64_t height, int64_t width)
{
    for (int64_t y = 0; y < height; y++) {
        float *row = to + 4 * y * width;
        for (int64_t x = 0; x < width; x++) {
            row[2 * x] = row[2 * x + 1] = from[y * width + x];
        }
        memcpy(row + 2 * width, row, (size_t)(2 * width) * sizeof *row);
    }
}

V2V_SIMD_CLONES
static void add_plane(float *to, const float *from, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        to[i] += from[i];
    }
}

/* The adjoint of pool_plane, added; sizes of the smaller plane. */
V2V_SIMD_CLONES
static void add_unpooled(float *to, const float *from, int64_t height, int64_t width)
{
    for (int64_t y = 0; y < 2 * height; y++) {
        float *row = to + 2 * y * width;
        const float *small = from + y / 2 * width;
        for (int64_t x = 0; x < width; x++) {
            row[2 * x] += 0.25f * small[x];
            row[2 * x + 1] += 0.25f * small[x];
        }
    }
}

/* The adjoint of repeat_plane, added; sizes of the smaller plane. */
V2V_SIMD_CLONES
static void add_unrepeated(float *to, const float *from, int64_t height, int64_t width)
{
    for (int64_t y = 0; y < height; y++) {
        const float *top = from + 4 * y * width, *bottom = top + 2 * width;
        for (int64_t x = 0; x < width; x++) {
            to[y * width + x] += top[2 * x] + top[2 * x + 1] + (bottom[2 * x] + bottom[2 * x + 1]);
        }
    }
}

static void bring(const struct depth_net *self, const struct wire *wire)
{
    const struct layer *from = &self->layer[wire->from], *to = &self->layer[wire->to];
    const int64_t pixels_from = from->height * from->width, pixels_to = to->height * to->width;
    const int64_t channels = sizes[wire->from].out, inputs = sizes[wire->to].in;
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t z = 0; z < self->slices; z++) {
        for (int64_t c = 0; c < channels; c++) {
            const int64_t source = source_of(self, wire, z, c);
            const float *out = from->out + (source * channels + c) * pixels_from;
            float *in = to->in + (z * inputs + wire->first + c) * pixels_to;
            if (to->height < from->height) {
                pool_plane(in, out, to->height, to->width);
            } else if (to->height > from->height) {
                repeat_plane(in, out, from->height, from->width);
            } else {
                memcpy(in, out, (size_t)pixels_to * sizeof *in);
            }
        }
    }
}

/* To the gradient of channel c of slice z that a layer put out, from a place that it went to. */
static void add_gradient(float *dout, const struct depth_net *self, const struct wire *wire,
                         int64_t z, int64_t c)
{
    const struct layer *from = &self->layer[wire->from], *to = &self->layer[wire->to];
    const int64_t pixels = to->height * to->width;
    const float *din = to->din + (z * sizes[wire->to].in + wire->first + c) * pixels;
    if (to->height < from->height) {
        add_unpooled(dout, din, to->height, to->width);
    } else if (to->height > from->height) {
        add_unrepeated(dout, din, from->height, from->width);
    } else {
        add_plane(dout, din, pixels);
    }
}

/* The gradient of what layer `from` convolved, from all places that it went to. */
static void collect(const struct depth_net *self, int from)
{
    const struct layer *layer = &self->layer[from];
    const int64_t channels = sizes[from].out, pixels = layer->height * layer->width;
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t z = 0; z < self->slices; z++) {
        for (int64_t c = 0; c < channels; c++) {
            float *dout = self->dout + (z * channels + c) * pixels;
            memset(dout, 0, (size_t)pixels * sizeof *dout);
            for (int w = 0; w < WIRES; w++) {
                for (int64_t t = z - 1; t <= z + 1; t++) {
                    if (wires[w].from == from && t >= 0 && t < self->slices &&
                        source_of(self, &wires[w], t, c) == z) {
                        add_gradient(dout, self, &wires[w], t, c);
                    }
                }
            }
            v2v_leaky_backward(dout, dout, layer->out + (z * channels + c) * pixels, pixels, 0.0f);
        }
    }
}

static void forward(struct v2v_network *network, float *const *volume, const float *features)
{
    struct depth_net *self = network->self;
    const int64_t pixels = self->layer[0].height * self->layer[0].width;
    gather_features(self, features);
    for (int i = 0; i < LAYERS; i++) {
        for (int w = 0; w < WIRES; w++) {
            if (wires[w].to == i) {
                bring(self, &wires[w]);
            }
        }
        float *out = i < LAYERS - 1 ? self->layer[i].out : volume[0];
        v2v_conv_forward(self->layer[i].conv, out, self->layer[i].in);
    }
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < self->slices; z++) {
        add_plane(volume[0] + z * pixels, features + z * pixels, pixels);
    }
}

static void watch(struct v2v_network *network,
                  void (*ready)(void *context, int64_t first, int64_t count), void *context)
{
    struct depth_net *self = network->self;
    self->parameters.ready = ready;
    self->parameters.context = context;
}

static void backward(struct v2v_network *network, const float *const *dvolume)
{
    struct depth_net *self = network->self;
    const struct v2v_parameters *parameters = &self->parameters;
    for (int i = LAYERS - 1; i >= 0; i--) {
        struct layer *layer = &self->layer[i];
        const struct v2v_gradients to = {
            .din = layer->din,
            .dweight = v2v_parameter(parameters->fields, parameters->gradients, layer->weight),
            .sets = 1};
        if (i < LAYERS - 1) {
            collect(self, i);
        }
        v2v_conv_backward(layer->conv, &to, layer->in, i < LAYERS - 1 ? self->dout : dvolume[0]);
        v2v_parameters_ready(parameters, layer->weight, layer->weight);
    }
}

const struct v2v_network_ops v2v_network_depth_net = {
    .name = "unrolled",
    .keys = keys,
    .before = before,
    .split = "none",
    .outputs = 1,
    .crop = 64,
    .examples = &v2v_examples_lessons,
    .traits = V2V_TRAIT_CORRECTS | V2V_TRAIT_ANY,
    .describe_work = describe_work,
    .rows_of = rows_of,
    .declare = declare,
    .create = create,
    .plan = plan,
    .destroy = destroy,
    .watch = watch,
    .weights_changed = weights_changed,
    .forward = forward,
    .backward = backward,
};
