#include "method/backconv.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/nn/layer.h"
#include "v2v3d/par/bucket_sum.h"
#include "v2v3d/par/comm.h"

#include <string.h>

/* volume_h = conv3(leaky(conv2(leaky(conv1(A_h^T y_h / n_h))))), h one half of the views, A_h their
 * projection, n_h what makes A_h^T y_h of constant views as bright as they are. Depth slices are
 * channels. */
enum { HALVES = 2, LAYERS = 3 };

static const float slope = 0.01f;
static const char *const keys[] = {"backconv.width", "model.homogeneous", NULL};

struct backconv {
    struct v2v_layer layer[LAYERS];
    struct v2v_parameters parameters;
    struct v2v_conv_method method;
    struct v2v_workspace workspace;
    struct v2v_projector *projector; /* borrowed */
    int64_t height, width;
    int32_t *seen[HALVES]; /* views of a half */
    int64_t seen_count[HALVES];
    float factor[HALVES];     /* 1 / n_h */
    float *views;             /* [views of a half,y,x] */
    float *image[LAYERS + 1]; /* [half held,channels,y,x]: what enters a layer, and the volumes */
    float *gradient[LAYERS + 1]; /* likewise, of the last ones, in training */
};

static enum v2v_status declare_layers(struct v2v_layer *layer, struct v2v_fields *fields,
                                      const struct v2v_network_spec *spec)
{
    static const char *const name[LAYERS] = {"0", "2", "4"};
    enum v2v_status rc = V2V_OK;
    const int64_t inner = spec->config->backconv.width;
    const int64_t channels[LAYERS + 1] = {spec->slices, inner, inner, spec->slices};
    for (int i = 0; i < LAYERS; i++) {
        int is_last = i == LAYERS - 1;
        layer[i] = (struct v2v_layer){.in = channels[i],
                                      .out = channels[i + 1],
                                      .kernel = 3,
                                      .stride = 1,
                                      .is_last = is_last,
                                      .in_slope = i > 0 ? slope : 0.0f,
                                      .slope = is_last ? 1.0f : slope};
        V2V_TRY(v2v_layer_declare(&layer[i], fields, "conv", name[i]));
    }
done:
    return rc;
}

static enum v2v_status declare(struct v2v_schema *schema, const struct v2v_network_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_layer layer[LAYERS];
    V2V_TRY(declare_layers(layer, &schema->fields, spec));
    schema->group[0] =
        (struct v2v_group){.name = "the convolutions",
                           .count = schema->fields.total,
                           .levels = 1u << V2V_GRID_LEVEL_BRANCH | 1u << V2V_GRID_LEVEL_DATA};
    schema->groups = 1;
done:
    return rc;
}

/* Light that a voxel gives to the views of a half, mean over the slices. */
static double light_of(const struct v2v_psf_file *psf, const int32_t *views, int64_t count)
{
    const int64_t floats = psf->slices * psf->height * psf->width;
    double sum = 0.0;
    for (int64_t i = 0; i < count; i++) {
        for (int64_t k = 0; k < floats; k++) {
            sum += psf->data[views[i] * floats + k];
        }
    }
    return sum / (double)psf->slices;
}

static enum v2v_status split_views(struct v2v_network *network, const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    struct backconv *self = network->self;
    for (int h = 0; h < HALVES; h++) {
        struct v2v_output *output = &network->output[h];
        V2V_TRY(V2V_ALLOC(self->seen[h], "backconv.views", network->views));
        V2V_TRY(V2V_ALLOC(output->held_out, "backconv.views", network->views));
        for (int64_t v = 0; v < network->views; v++) {
            if (v % HALVES == h) {
                self->seen[h][self->seen_count[h]++] = (int32_t)v;
            } else {
                output->held_out[output->count++] = (int32_t)v;
            }
        }
        double light = light_of(psf, self->seen[h], self->seen_count[h]);
        self->factor[h] = light > 0.0 ? (float)(1.0 / light) : 0.0f;
    }
done:
    return rc;
}

/* The same convolutions serve any number of views. */
static void sizes_of(struct v2v_network_sizes *sizes, const struct v2v_arrays *arrays)
{
    *sizes = (struct v2v_network_sizes){
        .setting = {{"backconv.width", v2v_arrays_extent(arrays, "conv.0.weight", 0)}},
        .slices = v2v_arrays_extent(arrays, "conv.0.weight", 1)};
}

static enum v2v_status create(struct v2v_network *network, const struct v2v_network_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct backconv *self = NULL;
    struct v2v_fields fields = {0};
    V2V_TRY(V2V_ALLOC(self, "backconv", 1));
    network->self = self;
    self->method = (struct v2v_conv_method){.backend = spec->config->model.backend,
                                            .winograd = spec->config->model.winograd,
                                            .precision = V2V_PRECISION_F32,
                                            .workspace = &self->workspace};
    V2V_TRY(declare_layers(self->layer, &fields, spec)); /* their places in network->schema */
    V2V_TRY(V2V_ALLOC(network->weights, "network.weights", network->schema.fields.total));
    self->parameters =
        (struct v2v_parameters){.fields = &network->schema.fields, .weights = network->weights};
    V2V_TRY(split_views(network, spec->psf));
done:
    v2v_fields_fini(&fields);
    return rc;
}

static void free_plan(struct backconv *self)
{
    for (int i = 0; i <= LAYERS; i++) {
        v2v_mem_free(self->image[i]);
        v2v_mem_free(self->gradient[i]);
        self->image[i] = self->gradient[i] = NULL;
    }
    v2v_mem_free(self->views);
    self->views = NULL;
    v2v_workspace_fini(&self->workspace);
}

static void destroy(struct v2v_network *network)
{
    struct backconv *self = network->self;
    if (self != NULL) {
        free_plan(self);
        for (int i = 0; i < LAYERS; i++) {
            v2v_layer_fini(&self->layer[i]);
        }
        v2v_mem_free(self->seen[0]);
        v2v_mem_free(self->seen[1]);
        v2v_mem_free(network->weights);
        v2v_mem_free(network->gradients);
        v2v_mem_free(self);
    }
}

/* Views, volumes and what lies between the layers of both halves; the spectra of the PSFs. */
static void describe_work(struct v2v_grid_work *work, const struct v2v_network_spec *spec,
                          int64_t height, int64_t width)
{
    int64_t inner = HALVES * 2 * spec->config->backconv.width;
    int64_t floats = 2 * spec->views + (2 * HALVES + 1) * spec->slices + inner;
    int64_t fixed =
        spec->psf == NULL ? 0 : v2v_projector_bytes(spec->psf, height, width, V2V_SPLIT_SLICES, 1);
    *work = (struct v2v_grid_work){
        .height = height,
        .unit = 1,
        .most_shards = 1,
        .most_branches = HALVES,
        .fixed_bytes = fixed,
        .bytes = v2v_mem_bytes(v2v_mem_product(floats, height, width), fixed)};
}

static int64_t held_count(const struct v2v_network *network)
{
    return v2v_network_holds(network, 0) + v2v_network_holds(network, 1);
}

static enum v2v_status plan(struct v2v_network *network, const struct v2v_network_plan *plan)
{
    enum v2v_status rc = V2V_OK;
    struct backconv *self = network->self;
    const int64_t pixels = v2v_mem_product(plan->height, plan->width, held_count(network));
    V2V_ASSERT(plan->projector != NULL);
    free_plan(self);
    self->projector = plan->projector;
    self->height = plan->height;
    self->width = plan->width;
    V2V_TRY(V2V_ALLOC(self->views, "backconv.views",
                      v2v_mem_product(self->seen_count[0], plan->height, plan->width)));
    for (int i = 0; i <= LAYERS; i++) {
        int64_t channels = i < LAYERS ? self->layer[i].in : self->layer[i - 1].out;
        V2V_TRY(V2V_ALLOC(self->image[i], "backconv.images", channels * pixels));
        if (plan->training && i > 0) {
            V2V_TRY(V2V_ALLOC(self->gradient[i], "backconv.gradients", channels * pixels));
        }
    }
    if (plan->training && network->gradients == NULL) {
        V2V_TRY(V2V_ALLOC(network->gradients, "network.gradients", network->schema.fields.total));
    }
    self->parameters.gradients = network->gradients;
    for (int i = 0; i < LAYERS; i++) {
        V2V_TRY(v2v_layer_plan(&self->layer[i], held_count(network), plan->height, plan->width,
                               &self->method,
                               plan->training ? V2V_TRAINING_LEAN : V2V_TRAINING_OFF));
        v2v_layer_weights_changed(&self->layer[i], &self->parameters);
    }
done:
    return rc;
}

static struct v2v_part rows_of(const struct v2v_network *network, int rank)
{
    const struct backconv *self = network->self;
    (void)rank;
    return (struct v2v_part){0, self->height};
}

static void weights_changed(struct v2v_network *network)
{
    struct backconv *self = network->self;
    for (int i = 0; i < LAYERS; i++) {
        v2v_layer_weights_changed(&self->layer[i], &self->parameters);
    }
}

/* x0 [z,y,x] from the views of half h. */
static void back_project(struct backconv *self, float *x0, const float *views, int h)
{
    const int64_t pixels = self->height * self->width;
    for (int64_t i = 0; i < self->seen_count[h]; i++) {
        memcpy(self->views + i * pixels, views + self->seen[h][i] * pixels,
               (size_t)pixels * sizeof *views);
    }
    v2v_projector_adjoint(self->projector, x0, self->views, self->seen[h], self->seen_count[h],
                          self->factor[h]);
}

static void forward(struct v2v_network *network, float *const *volume, const float *views)
{
    struct backconv *self = network->self;
    const int64_t voxels = network->slices * self->height * self->width;
    int64_t at = 0;
    for (int h = 0; h < HALVES; h++) {
        if (v2v_network_holds(network, h)) {
            back_project(self, self->image[0] + voxels * at++, views, h);
        }
    }
    for (int i = 0; i < LAYERS; i++) {
        v2v_conv_forward(self->layer[i].conv, self->image[i + 1], self->image[i]);
    }
    at = 0;
    for (int h = 0; h < HALVES; h++) {
        if (v2v_network_holds(network, h)) {
            memcpy(volume[h], self->image[LAYERS] + voxels * at++, (size_t)voxels * sizeof(float));
        }
    }
}

static void watch(struct v2v_network *network,
                  void (*ready)(void *context, int64_t first, int64_t count), void *context)
{
    struct backconv *self = network->self;
    self->parameters.ready = ready;
    self->parameters.context = context;
}

static void backward(struct v2v_network *network, const float *const *dvolume)
{
    struct backconv *self = network->self;
    const int64_t voxels = network->slices * self->height * self->width;
    int64_t at = 0;
    for (int h = 0; h < HALVES; h++) {
        if (v2v_network_holds(network, h)) {
            memcpy(self->gradient[LAYERS] + voxels * at++, dvolume[h],
                   (size_t)voxels * sizeof(float));
        }
    }
    for (int i = LAYERS - 1; i >= 0; i--) {
        v2v_layer_backward(&self->layer[i], &self->parameters, self->gradient[i], self->image[i],
                           self->gradient[i + 1]);
        v2v_parameters_ready(&self->parameters, self->layer[i].weight, self->layer[i].bias);
    }
}

const struct v2v_network_ops v2v_network_backconv = {
    .name = "backconv",
    .keys = keys,
    .split = "even-odd",
    .outputs = HALVES,
    .crop = 128,
    .traits = V2V_TRAIT_PROJECTS,
    .declare = declare,
    .sizes_of = sizes_of,
    .create = create,
    .destroy = destroy,
    .describe_work = describe_work,
    .plan = plan,
    .rows_of = rows_of,
    .weights_changed = weights_changed,
    .forward = forward,
    .watch = watch,
    .backward = backward,
};
