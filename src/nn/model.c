#include "v2v3d/nn/model.h"

#include "nn/align_conv.h"
#include "nn/encoder.h"
#include "nn/strips.h"
#include "nn/unet.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/nn/schema.h"

#include <string.h>

enum { BRANCHES = 2 };

struct v2v_model {
    struct v2v_model_spec spec;
    struct v2v_fields fields;
    struct v2v_parameters parameters;
    int64_t ring; /* of zeros about the feature planes: the farthest tap */
    int64_t height, width;
    int training;
    /* One set of weights, a workspace for each branch's views: their gradients are summed branch by
     * branch whether one rank holds both branches or two hold one each, to the same bits. NULL for
     * a branch not held. */
    struct v2v_encoder *encoder[BRANCHES];
    struct v2v_unet *unet[BRANCHES];
    int32_t *views[BRANCHES]; /* network order */
    int64_t view_count[BRANCHES];
    int32_t *held; /* views of all branches held, in batch order */
    int64_t held_count;
    struct v2v_shifts shifts; /* a copy */
    struct v2v_scene scene;   /* where tiles may be skipped */
    double computed_part;
    struct v2v_padded features, dfeatures;
    float *batch;   /* [held,y,x]: the encoder's input */
    float *dbatch;  /* [held,feature,y,x] training */
    float *dvolume; /* [z,y,x] scaled gradient, training */
    float *workspace[BRANCHES];
    struct v2v_workspace shared; /* of all convolutions, one after the other */
};

static const char *const prefix[BRANCHES] = {"unet1", "unet2"};

int64_t v2v_branch_views(int32_t *list, int64_t views, int branch)
{
    int64_t count = 0;
    for (int64_t v = branch; v < views; v += BRANCHES) {
        list[count++] = (int32_t)v;
    }
    return count;
}

static int holds(const struct v2v_model *model, int branch)
{
    return (model->spec.branches >> branch & 1) != 0;
}

/* Without training its encoder takes all views, one after the other. */
static int first_branch(const struct v2v_model *model)
{
    return holds(model, 0) ? 0 : 1;
}

static enum v2v_status list_views(struct v2v_model *model)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(V2V_ALLOC(model->held, "model.views", model->spec.views));
    for (int b = 0; b < BRANCHES; b++) {
        V2V_TRY(V2V_ALLOC(model->views[b], "model.views", model->spec.views));
        model->view_count[b] = v2v_branch_views(model->views[b], model->spec.views, b);
        for (int64_t i = 0; i < model->view_count[b] && holds(model, b); i++) {
            model->held[model->held_count++] = model->views[b][i];
        }
    }
done:
    return rc;
}

static struct v2v_conv_method method_of(struct v2v_model *model)
{
    /* the transforms of minimal filtering would grow bf16's rounding */
    int is_f32 = model->spec.precision == V2V_PRECISION_F32;
    return (struct v2v_conv_method){.backend = model->spec.backend,
                                    .winograd = model->spec.winograd && is_f32,
                                    .workspace = &model->shared,
                                    .precision = model->spec.precision};
}

/* Declare the parameters of everything held; `shifts` NULL: the table of fields only. */
static enum v2v_status declare(struct v2v_model *model, const struct v2v_shifts *shifts)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_model_spec *spec = &model->spec;
    int first = first_branch(model);
    V2V_TRY(v2v_encoder_create(&model->encoder[first], &model->fields, spec->features));
    if (first == 0 && holds(model, 1)) {
        V2V_TRY(v2v_encoder_twin(&model->encoder[1], model->encoder[0]));
    }
    for (int b = 0; b < BRANCHES; b++) {
        struct v2v_unet_spec unet = {.prefix = prefix[b],
                                     .views = model->views[b],
                                     .view_count = model->view_count[b],
                                     .features = spec->features,
                                     .slices = spec->slices,
                                     .width = spec->width,
                                     .every_slice = spec->every_slice,
                                     .method = method_of(model)};
        if (holds(model, b)) {
            V2V_TRY(v2v_unet_create(&model->unet[b], &model->fields, &unet, shifts));
        }
    }
done:
    return rc;
}

static enum v2v_status create(struct v2v_model **model, const struct v2v_model_spec *spec,
                              const struct v2v_shifts *shifts)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_model *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "model", 1));
    self->spec = *spec;
    V2V_TRY(list_views(self));
    V2V_TRY(declare(self, shifts));
done:
    if (rc != V2V_OK) {
        v2v_model_destroy(&self);
    }
    *model = self;
    return rc;
}

enum v2v_status v2v_model_schema(struct v2v_fields *fields, const struct v2v_model_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_model *model = NULL;
    V2V_TRY(create(&model, spec, NULL));
    *fields = model->fields;
    model->fields = (struct v2v_fields){0};
done:
    v2v_model_destroy(&model);
    return rc;
}

enum v2v_status v2v_model_create(struct v2v_model **model, const struct v2v_model_spec *spec,
                                 const struct v2v_shifts *shifts)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_model *self = NULL;
    if (shifts->views != spec->views || shifts->slices != spec->slices) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "the network takes %lld views and %lld slices, the PSF set has %lld and "
                         "%lld",
                         (long long)spec->views, (long long)spec->slices, (long long)shifts->views,
                         (long long)shifts->slices));
    }
    if (spec->views < 2) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "training view to view takes two views or more, not %lld",
                         (long long)spec->views));
    }
    V2V_TRY(create(&self, spec, shifts));
    self->ring = v2v_shifts_reach(shifts) + 1;
    V2V_TRY(v2v_shifts_copy(&self->shifts, shifts));
    self->parameters.fields = &self->fields;
    V2V_TRY(V2V_ALLOC(self->parameters.weights, "model.weights", self->fields.total));
done:
    if (rc != V2V_OK) {
        v2v_model_destroy(&self);
    }
    *model = self;
    return rc;
}

static void free_workspace(struct v2v_model *model)
{
    float **memory[] = {&model->batch, &model->dbatch, &model->dvolume, &model->workspace[0],
                        &model->workspace[1]};
    v2v_padded_fini(&model->features);
    v2v_padded_fini(&model->dfeatures);
    v2v_workspace_fini(&model->shared);
    v2v_scene_fini(&model->scene);
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(*memory[i]);
        *memory[i] = NULL;
    }
}

void v2v_model_destroy(struct v2v_model **model)
{
    struct v2v_model *self = *model;
    if (self == NULL) {
        return;
    }
    free_workspace(self);
    for (int b = 0; b < BRANCHES; b++) {
        v2v_encoder_destroy(&self->encoder[b]);
        v2v_unet_destroy(&self->unet[b]);
        v2v_mem_free(self->views[b]);
    }
    v2v_shifts_fini(&self->shifts);
    v2v_mem_free(self->held);
    v2v_mem_free(self->parameters.weights);
    v2v_mem_free(self->parameters.gradients);
    v2v_fields_fini(&self->fields);
    v2v_mem_free(self);
    *model = NULL;
}

const struct v2v_model_spec *v2v_model_spec(const struct v2v_model *model)
{
    return &model->spec;
}

const struct v2v_fields *v2v_model_fields(const struct v2v_model *model)
{
    return &model->fields;
}

float *v2v_model_weights(struct v2v_model *model)
{
    return model->parameters.weights;
}

float *v2v_model_gradients(struct v2v_model *model)
{
    return model->parameters.gradients;
}

/* Without training one view after the other goes through the encoder, and the U-Nets share one
 * workspace: a large frame then needs the memory of one view and one branch. */
static enum v2v_status plan_workspace(struct v2v_model *model, int64_t strip_floats)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_model_spec *spec = &model->spec;
    int64_t height = model->height, width = model->width, pixels = height * width;
    int64_t need[BRANCHES] = {0};
    for (int b = 0; b < BRANCHES; b++) {
        if (model->unet[b] != NULL) {
            need[b] =
                v2v_unet_workspace(model->unet[b], height, width, strip_floats, model->training);
        }
    }
    if (!model->training) {
        need[0] = need[0] > need[1] ? need[0] : need[1];
        need[1] = 0;
    }
    V2V_TRY(
        v2v_padded_init(&model->features, spec->views, spec->features, height, width, model->ring));
    for (int b = 0; b < BRANCHES; b++) {
        V2V_TRY(V2V_ALLOC(model->workspace[b], "unet.workspace", need[b]));
    }
    if (model->training) {
        V2V_TRY(v2v_padded_init(&model->dfeatures, spec->views, spec->features, height, width,
                                model->ring));
        V2V_TRY(V2V_ALLOC(model->batch, "model.batch", model->held_count * pixels));
        V2V_TRY(
            V2V_ALLOC(model->dbatch, "model.batch", model->held_count * spec->features * pixels));
        V2V_TRY(V2V_ALLOC(model->dvolume, "model.batch", spec->slices * pixels));
    }
done:
    return rc;
}

static int skips(const struct v2v_model *model)
{
    return model->spec.skip > 0.0 && v2v_unet_knows_scenes(model->unet[first_branch(model)]);
}

static enum v2v_status plan(struct v2v_model *model, int64_t strip_floats)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_conv_method method = method_of(model);
    int64_t height = model->height, width = model->width;
    int training = model->training;
    free_workspace(model);
    V2V_TRY(plan_workspace(model, strip_floats));
    if (training && model->parameters.gradients == NULL) {
        V2V_TRY(V2V_ALLOC(model->parameters.gradients, "model.gradients", model->fields.total));
    }
    for (int b = 0; b < BRANCHES; b++) {
        if (model->encoder[b] != NULL && (training || b == first_branch(model))) {
            V2V_TRY(v2v_encoder_plan(model->encoder[b], training ? model->view_count[b] : 1, height,
                                     width, &method, training));
        }
        if (model->unet[b] != NULL) {
            V2V_TRY(v2v_unet_plan(model->unet[b], model->workspace[training ? b : 0],
                                  &model->features, training));
        }
    }
    if (skips(model)) {
        V2V_TRY(v2v_scene_init(&model->scene, &model->shifts, height, width));
    }
done:
    return rc;
}

/* When memory is short, smaller strips may fit: they cost rows that are computed twice. */
enum v2v_status v2v_model_plan(struct v2v_model *model, int64_t height, int64_t width, int training)
{
    int64_t strip_floats = V2V_STRIPS_FLOATS;
    V2V_ASSERT(height % V2V_MODEL_GRID == 0 && width % V2V_MODEL_GRID == 0);
    model->height = height;
    model->width = width;
    model->training = training;
    enum v2v_status rc = plan(model, strip_floats);
    while (rc == V2V_E_MEMORY && strip_floats > V2V_STRIPS_LEAST_FLOATS &&
           v2v_unet_knows_scenes(model->unet[first_branch(model)])) {
        strip_floats /= 2;
        rc = plan(model, strip_floats);
    }
    if (rc == V2V_OK) {
        v2v_model_weights_changed(model);
    }
    return rc;
}

void v2v_model_weights_changed(struct v2v_model *model)
{
    for (int b = 0; b < BRANCHES; b++) {
        if (model->encoder[b] != NULL) {
            v2v_encoder_weights_changed(model->encoder[b], &model->parameters);
        }
        if (model->unet[b] != NULL) {
            v2v_unet_weights_changed(model->unet[b], &model->parameters);
        }
    }
}

static void encode_one_by_one(struct v2v_model *model, const float *views)
{
    struct v2v_encoder *encoder = model->encoder[first_branch(model)];
    for (int64_t i = 0; i < model->held_count; i++) {
        const float *view = views + model->held[i] * model->height * model->width;
        v2v_padded_put(&model->features, model->held[i], v2v_encoder_forward(encoder, view));
    }
}

/* First image of branch b among those of all branches held, of `size` floats each. */
static int64_t batch_start(const struct v2v_model *model, int b, int64_t size)
{
    return b == first_branch(model) ? 0 : model->view_count[0] * size;
}

static void encode_branch(struct v2v_model *model, int b, const float *views)
{
    int64_t pixels = model->height * model->width, features = model->spec.features;
    float *batch = model->batch + batch_start(model, b, pixels);
    for (int64_t i = 0; i < model->view_count[b]; i++) {
        memcpy(batch + i * pixels, views + model->views[b][i] * pixels,
               (size_t)pixels * sizeof *views);
    }
    const float *f = v2v_encoder_forward(model->encoder[b], batch);
    for (int64_t i = 0; i < model->view_count[b]; i++) {
        v2v_padded_put(&model->features, model->views[b][i], f + i * features * pixels);
    }
}

static void scale(float *out, const float *in, int64_t count, float factor)
{
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < count; i++) {
        out[i] = in[i] * factor;
    }
}

void v2v_model_forward(struct v2v_model *model, float *volume1, float *volume2, const float *views)
{
    float *volume[BRANCHES] = {volume1, volume2};
    int64_t voxels = model->spec.slices * model->height * model->width;
    const struct v2v_scene *scene = NULL;
    model->computed_part = 1.0;
    if (skips(model) && v2v_scene_look(&model->scene, views, model->spec.skip)) {
        scene = &model->scene;
        model->computed_part = (double)scene->computed.count /
                               (double)(scene->computed.rows * scene->computed.columns);
    }
    if (!model->training) {
        encode_one_by_one(model, views);
    }
    for (int b = 0; b < BRANCHES; b++) {
        if (model->unet[b] != NULL) {
            if (model->training) {
                encode_branch(model, b, views);
            }
            const float *output = v2v_unet_forward(model->unet[b], &model->features, scene);
            scale(volume[b], output, voxels, (float)model->spec.volume_scale);
        }
    }
}

double v2v_model_computed_part(const struct v2v_model *model)
{
    return model->computed_part;
}

static void encode_back(struct v2v_model *model, int b)
{
    int64_t pixels = model->height * model->width, features = model->spec.features;
    float *dbatch = model->dbatch + batch_start(model, b, features * pixels);
    for (int64_t i = 0; i < model->view_count[b]; i++) {
        v2v_padded_get(&model->dfeatures, model->views[b][i], dbatch + i * features * pixels);
    }
    v2v_encoder_backward(model->encoder[b], &model->parameters, dbatch,
                         model->batch + batch_start(model, b, pixels));
}

void v2v_model_backward(struct v2v_model *model, const float *dvolume1, const float *dvolume2)
{
    const float *dvolume[BRANCHES] = {dvolume1, dvolume2};
    int64_t pixels = model->height * model->width, features = model->spec.features;
    struct v2v_padded *dfeatures = &model->dfeatures;
    V2V_ASSERT(model->training);
    int64_t padded = dfeatures->views * features * (dfeatures->height + 2 * dfeatures->ring) *
                     (dfeatures->width + 2 * dfeatures->ring);
    memset(dfeatures->data, 0, (size_t)padded * sizeof *dfeatures->data);
    for (int b = 0; b < BRANCHES; b++) {
        if (model->unet[b] != NULL) {
            scale(model->dvolume, dvolume[b], model->spec.slices * pixels,
                  (float)model->spec.volume_scale);
            v2v_unet_backward(model->unet[b], &model->parameters, dfeatures, &model->features,
                              model->dvolume);
            encode_back(model, b);
        }
    }
}
