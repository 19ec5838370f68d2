#include "method/unet_network.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/par/bucket_sum.h"

struct unet_network {
    struct v2v_plain_unet *unet;
    struct v2v_parameters parameters;
    struct v2v_conv_method method;
    struct v2v_workspace workspace;
    int64_t depth, height;
};

enum v2v_status v2v_unet_network_declare(struct v2v_schema *schema,
                                         const struct v2v_plain_unet_spec *unet, const char *prefix)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_plain_unet_declare(&schema->fields, unet, prefix));
    schema->group[0] = (struct v2v_group){
        .name = "the U-Net", .count = schema->fields.total, .levels = 1u << V2V_GRID_LEVEL_DATA};
    schema->groups = 1;
done:
    return rc;
}

enum v2v_status v2v_unet_network_create(struct v2v_network *network,
                                        const struct v2v_network_spec *spec,
                                        const struct v2v_plain_unet_spec *unet, int64_t depth)
{
    enum v2v_status rc = V2V_OK;
    struct unet_network *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "unet_network", 1));
    network->self = self;
    network->inputs = depth * unet->in;
    network->slices = depth * unet->out;
    self->depth = depth;
    self->method = (struct v2v_conv_method){.backend = spec->config->model.backend,
                                            .winograd = spec->config->model.winograd,
                                            .precision = V2V_PRECISION_F32,
                                            .workspace = &self->workspace};
    V2V_TRY(v2v_plain_unet_create(&self->unet, unet, 0));
    V2V_TRY(V2V_ALLOC(network->weights, "network.weights", network->schema.fields.total));
    self->parameters =
        (struct v2v_parameters){.fields = &network->schema.fields, .weights = network->weights};
done:
    return rc;
}

void v2v_unet_network_destroy(struct v2v_network *network)
{
    struct unet_network *self = network->self;
    if (self != NULL) {
        v2v_plain_unet_destroy(&self->unet);
        v2v_workspace_fini(&self->workspace);
        v2v_mem_free(network->weights);
        v2v_mem_free(network->gradients);
        v2v_mem_free(self);
    }
}

/* What goes in and comes out beside the U-Net's own. */
void v2v_unet_network_describe_work(struct v2v_grid_work *work,
                                    const struct v2v_plain_unet_spec *unet, int64_t depth,
                                    int64_t height, int64_t width)
{
    const int64_t images = v2v_mem_product(depth, unet->in + unet->out, 1);
    *work = (struct v2v_grid_work){
        .height = height,
        .unit = v2v_plain_unet_unit(unet),
        .most_shards = 1,
        .most_branches = 1,
        .bytes = v2v_mem_bytes(v2v_mem_product(images, height, width),
                               v2v_plain_unet_bytes(unet, depth, height, width, 0))};
}

int64_t v2v_unet_network_width(const struct v2v_arrays *arrays, const char *prefix)
{
    char name[V2V_FIELDS_NAME_BYTES];
    return v2v_text_format(name, sizeof name, "%s.down0.0.weight", prefix) == V2V_OK
               ? v2v_arrays_extent(arrays, name, 0)
               : 0;
}

int64_t v2v_unet_network_levels(const struct v2v_arrays *arrays, const char *prefix)
{
    char name[V2V_FIELDS_NAME_BYTES];
    int64_t levels = 0;
    while (v2v_text_format(name, sizeof name, "%s.down%d.0.weight", prefix, (int)levels) ==
               V2V_OK &&
           levels < V2V_PLAIN_UNET_MOST_LEVELS && v2v_arrays_find(arrays, name) != NULL) {
        levels++;
    }
    return levels;
}

enum v2v_status v2v_unet_network_plan(struct v2v_network *network,
                                      const struct v2v_network_plan *plan)
{
    enum v2v_status rc = V2V_OK;
    struct unet_network *self = network->self;
    self->height = plan->height;
    v2v_workspace_fini(&self->workspace);
    V2V_TRY(v2v_plain_unet_plan(self->unet, self->depth, plan->height, plan->width, &self->method,
                                plan->training ? V2V_TRAINING_LEAN : V2V_TRAINING_OFF));
    if (plan->training && network->gradients == NULL) {
        V2V_TRY(V2V_ALLOC(network->gradients, "network.gradients", network->schema.fields.total));
    }
    self->parameters.gradients = network->gradients;
    v2v_plain_unet_weights_changed(self->unet, &self->parameters);
done:
    return rc;
}

struct v2v_part v2v_unet_network_rows_of(const struct v2v_network *network, int rank)
{
    const struct unet_network *self = network->self;
    (void)rank;
    return (struct v2v_part){0, self->height};
}

void v2v_unet_network_weights_changed(struct v2v_network *network)
{
    struct unet_network *self = network->self;
    v2v_plain_unet_weights_changed(self->unet, &self->parameters);
}

void v2v_unet_network_forward(struct v2v_network *network, float *const *volume, const float *views)
{
    struct unet_network *self = network->self;
    v2v_plain_unet_forward(self->unet, volume[0], views);
}

void v2v_unet_network_watch(struct v2v_network *network,
                            void (*ready)(void *context, int64_t first, int64_t count),
                            void *context)
{
    struct unet_network *self = network->self;
    self->parameters.ready = ready;
    self->parameters.context = context;
}

void v2v_unet_network_backward(struct v2v_network *network, const float *const *dvolume)
{
    struct unet_network *self = network->self;
    v2v_plain_unet_backward(self->unet, &self->parameters, dvolume[0]);
}
