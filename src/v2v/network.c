#include "v2v3d/v2v/network.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/par/bucket_sum.h"
#include "v2v3d/v2v/model.h"
#include "v2v3d/v2v/schema.h"

#include <string.h>

enum { BRANCHES = 2 };

/* Measured on four noisy recordings (13 views, noise 0.2 of their peak): PSNR of thin and thick
 * structures falls by 0.01 dB at most. */
#define SKIP_AUTO 0.055

static const char *const keys[] = {"model.width",       "model.features",   "model.volume_scale",
                                   "model.homogeneous", "model.view_split", "model.view_seed",
                                   "model.align",       "model.merge",      NULL};

static struct v2v_model_spec spec_of(const struct v2v_network_spec *spec)
{
    return (struct v2v_model_spec){.views = spec->views,
                                   .slices = spec->slices,
                                   .width = spec->config->model.width,
                                   .features = spec->config->model.features,
                                   .branches = spec->outputs,
                                   .backend = spec->config->model.backend,
                                   .winograd = spec->config->model.winograd,
                                   .precision = spec->precision,
                                   .every_slice = !spec->config->model.merge,
                                   .volume_scale = spec->config->model.volume_scale,
                                   .split = spec->config->model.view_split,
                                   .split_seed = spec->config->model.view_seed,
                                   .unaligned = !spec->config->model.align,
                                   .skip = spec->skip,
                                   .slabs = spec->slabs,
                                   .shard = spec->shard};
}

/* Parameters from the first field that begins with `prefix` to `end`, and where that begins. */
static struct v2v_group group_of(const struct v2v_fields *fields, const char *prefix, int64_t *end,
                                 unsigned levels)
{
    int64_t first = *end, past = *end;
    for (int64_t i = fields->count - 1; i >= 0; i--) {
        if (strncmp(fields->item[i].name, prefix, strlen(prefix)) == 0) {
            first = fields->item[i].offset;
        }
    }
    *end = first;
    return (struct v2v_group){
        .name = prefix, .first = first, .count = past - first, .levels = levels};
}

/* The encoder's gradients are summed over slabs by backward itself. */
static enum v2v_status declare(struct v2v_schema *schema, const struct v2v_network_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_model_spec model = spec_of(spec);
    const unsigned samples = 1u << V2V_GRID_LEVEL_DATA, branches = 1u << V2V_GRID_LEVEL_BRANCH;
    const unsigned slabs = 1u << V2V_GRID_LEVEL_SHARD;
    V2V_TRY(v2v_model_schema(&schema->fields, &model));
    const struct v2v_fields *fields = &schema->fields;
    int64_t end = fields->total;
    schema->group[1] = group_of(fields, "unet2", &end, slabs | samples);
    schema->group[0] = group_of(fields, "unet1", &end, slabs | samples);
    schema->group[2] = group_of(fields, "feat_extract", &end, branches | samples);
    schema->groups = 3;
done:
    return rc;
}

/* The first convolutions take slices of all features of the views of a half. */
static void sizes_of(struct v2v_network_sizes *sizes, const struct v2v_arrays *arrays)
{
    static const char *const inputs[BRANCHES] = {"unet1.init_conv.0.weight",
                                                 "unet2.init_conv.0.weight"};
    const int64_t features = v2v_arrays_extent(arrays, "feat_extract.lastconv.2.weight", 0);
    const int64_t width = v2v_arrays_extent(arrays, "unet1.conv_final.4.weight", 1);
    const int64_t slices = v2v_arrays_extent(arrays, "unet1.conv_final.4.weight", 0);
    *sizes = (struct v2v_network_sizes){
        .setting = {{"model.width", width}, {"model.features", features}}, .slices = slices};
    /* Extents are below the file's size, and their product is checked. */
    const int64_t of_a_view = v2v_mem_product(features, slices, 1);
    for (int b = 0; b < BRANCHES && of_a_view > 0; b++) {
        sizes->views += v2v_arrays_extent(arrays, inputs[b], 1) / of_a_view;
    }
}

static enum v2v_status create(struct v2v_network *network, const struct v2v_network_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_shifts shifts = {0};
    struct v2v_model *model = NULL;
    const struct v2v_model_spec own = spec_of(spec);
    V2V_TRY(v2v_shifts_from_psf(&shifts, spec->psf));
    V2V_TRY(v2v_model_create(&model, &own, &shifts));
    network->self = model;
    network->weights = v2v_model_weights(model);
    for (int b = 0; b < BRANCHES; b++) {
        struct v2v_output *output = &network->output[b];
        V2V_TRY(V2V_ALLOC(output->held_out, "network.views", spec->views));
        output->count = v2v_branch_views(output->held_out, &own, 1 - b);
    }
done:
    v2v_shifts_fini(&shifts);
    return rc;
}

static void destroy(struct v2v_network *network)
{
    struct v2v_model *model = network->self;
    v2v_model_destroy(&model);
    network->self = NULL;
}

static void describe_work(struct v2v_grid_work *work, const struct v2v_network_spec *spec,
                          int64_t height, int64_t width)
{
    const struct v2v_model_spec model = spec_of(spec);
    v2v_model_describe_work(work, &model, height, width);
}

static void leave_room(struct v2v_network *network, int64_t floats, int64_t floats_a_row)
{
    v2v_model_leave_room(network->self, floats, floats_a_row);
}

static enum v2v_status plan(struct v2v_network *network, const struct v2v_network_plan *plan)
{
    enum v2v_status rc = v2v_model_plan(network->self, plan->height, plan->width, plan->training);
    network->gradients = v2v_model_gradients(network->self);
    return rc;
}

static struct v2v_part rows_of(const struct v2v_network *network, int rank)
{
    return v2v_model_rows_of(network->self, rank);
}

static void weights_changed(struct v2v_network *network)
{
    v2v_model_weights_changed(network->self);
}

static void forward(struct v2v_network *network, float *const *volume, const float *views)
{
    v2v_model_forward(network->self, volume[0], volume[1], views);
}

static double computed_part(const struct v2v_network *network)
{
    return v2v_model_computed_part(network->self);
}

static void watch(struct v2v_network *network,
                  void (*ready)(void *context, int64_t first, int64_t count), void *context)
{
    v2v_model_watch_gradients(network->self, ready, context);
}

static void backward(struct v2v_network *network, const float *const *dvolume)
{
    v2v_model_backward(network->self, dvolume[0], dvolume[1]);
}

const struct v2v_network_ops v2v_network_v2v = {
    .name = "v2v",
    .keys = keys,
    .outputs = BRANCHES,
    .skip_auto = SKIP_AUTO,
    .crop = 128,
    .traits = V2V_TRAIT_SKIPS | V2V_TRAIT_BF16 | V2V_TRAIT_SLABS,
    .declare = declare,
    .sizes_of = sizes_of,
    .create = create,
    .destroy = destroy,
    .describe_work = describe_work,
    .leave_room = leave_room,
    .plan = plan,
    .rows_of = rows_of,
    .weights_changed = weights_changed,
    .forward = forward,
    .computed_part = computed_part,
    .watch = watch,
    .backward = backward,
};
