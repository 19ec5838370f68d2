#include "v2v/model_state.h"

#include "v2v/strips.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/op/tile_conv.h"
#include "v2v3d/v2v/schema.h"

#include <string.h>

enum { BRANCHES = V2V_BRANCHES };

/* Streams of this purpose. */
static const uint64_t split_stream = (uint64_t)'V' << 56;

static const char *const prefix[BRANCHES] = {"unet1", "unet2"};

/* Is view v of branch 0 by chance? As many are as of even ones: of those left, each as likely. */
static int64_t draw_half(int32_t *list, const struct v2v_model_spec *spec, int branch)
{
    int64_t count = 0, wanted = (spec->views + 1) / BRANCHES;
    for (int64_t v = 0; v < spec->views; v++) {
        const int64_t left = spec->views - v;
        const int is_first =
            v2v_random_below((uint64_t)spec->split_seed, split_stream, (uint64_t)v, left) < wanted;
        wanted -= is_first;
        if (is_first == (branch == 0)) {
            list[count++] = (int32_t)v;
        }
    }
    return count;
}

int64_t v2v_branch_views(int32_t *list, const struct v2v_model_spec *spec, int branch)
{
    int64_t count = 0;
    if (spec->split == V2V_VIEWS_RANDOM) {
        return draw_half(list, spec, branch);
    }
    const int is_all = spec->split == V2V_VIEWS_ALL;
    for (int64_t v = is_all ? 0 : branch; v < spec->views; v += is_all ? 1 : BRANCHES) {
        list[count++] = (int32_t)v;
    }
    return count;
}

static enum v2v_status list_views(struct v2v_model *model)
{
    enum v2v_status rc = V2V_OK;
    for (int b = 0; b < BRANCHES; b++) {
        V2V_TRY(V2V_ALLOC(model->views[b], "model.views", model->spec.views));
        model->view_count[b] = v2v_branch_views(model->views[b], &model->spec, b);
    }
done:
    return rc;
}

/* Its transforms would grow bf16's rounding. */
static int filters_minimally(const struct v2v_model *model)
{
    return model->spec.winograd && model->spec.precision == V2V_PRECISION_F32;
}

static struct v2v_conv_method method_of(struct v2v_model *model)
{
    return (struct v2v_conv_method){.backend = model->spec.backend,
                                    .winograd = filters_minimally(model),
                                    .workspace = &model->shared,
                                    .pool = &model->packed,
                                    .precision = model->spec.precision};
}

/* Its weights stay: both branches use them. */
static struct v2v_conv_method encoder_method(struct v2v_model *model)
{
    struct v2v_conv_method method = method_of(model);
    method.pool = NULL;
    return method;
}

/* Do full-size layers compute strips of rows, and tiles alone? */
static int streams(const struct v2v_model *model)
{
    return (filters_minimally(model) || model->is_listed) && !model->training;
}

/* Declare the parameters of everything held; `shifts` NULL: the table of fields only. */
static enum v2v_status declare(struct v2v_model *model, const struct v2v_shifts *shifts)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_model_spec *spec = &model->spec;
    struct v2v_model_slab *slab = &model->slab[0];
    int first = v2v_model_first_branch(model);
    V2V_TRY(v2v_encoder_create(&slab->encoder[first], &model->fields, spec->features));
    model->encoder_floats = model->fields.total;
    if (first == 0 && v2v_model_holds(model, 1)) {
        V2V_TRY(v2v_encoder_twin(&slab->encoder[1], slab->encoder[0]));
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
        if (v2v_model_holds(model, b)) {
            V2V_TRY(v2v_unet_create(&slab->unet[b], &model->fields, &unet, shifts));
        }
    }
done:
    return rc;
}

/* The same operators for one more slab. */
static enum v2v_status add_twins(struct v2v_model *model, int64_t local)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_model_slab *first = &model->slab[0];
    struct v2v_model_slab *slab = &model->slab[local];
    for (int b = 0; b < BRANCHES; b++) {
        if (v2v_model_holds(model, b)) {
            V2V_TRY(v2v_encoder_twin(&slab->encoder[b], first->encoder[b]));
            V2V_TRY(v2v_unet_twin(&slab->unet[b], first->unet[b], &model->alignment));
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
    self->held = v2v_comm_size(spec->shard) > 1 ? 1 : v2v_model_slabs(self);
    V2V_TRY(V2V_ALLOC(self->slab, "model", self->held));
    V2V_TRY(V2V_ALLOC(self->features, "model", self->held));
    V2V_TRY(V2V_ALLOC(self->dfeatures, "model", self->held));
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
    struct v2v_shifts alignment = {0};
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
    V2V_ASSERT(v2v_comm_size(spec->shard) == 1 || v2v_comm_size(spec->shard) == spec->slabs);
    V2V_TRY(v2v_shifts_copy(&alignment, shifts));
    for (int64_t i = 0; spec->unaligned && i < shifts->views * shifts->slices; i++) {
        alignment.dy[i] = alignment.dx[i] = 0;
    }
    V2V_TRY(create(&self, spec, &alignment));
    self->ring = v2v_shifts_reach(&alignment) + 1;
    self->alignment = alignment;
    alignment = (struct v2v_shifts){0};
    V2V_TRY(v2v_shifts_copy(&self->shifts, shifts));
    for (int64_t local = 1; local < self->held; local++) {
        V2V_TRY(add_twins(self, local));
    }
    for (int i = 0; i < 2; i++) {
        V2V_TRY(V2V_ALLOC(self->round[i], "model.views", v2v_comm_size(spec->shard)));
    }
    V2V_TRY(V2V_ALLOC(self->weights, "model.weights", self->fields.total));
    for (int64_t local = 0; local < self->held; local++) {
        self->slab[local].parameters =
            (struct v2v_parameters){.fields = &self->fields, .weights = self->weights};
    }
done:
    v2v_shifts_fini(&alignment);
    if (rc != V2V_OK) {
        v2v_model_destroy(&self);
    }
    *model = self;
    return rc;
}

static void free_slab(struct v2v_model_slab *slab)
{
    for (int b = 0; b < BRANCHES; b++) {
        float **memory[] = {&slab->workspace[b], &slab->encoding[b], &slab->batch[b],
                            &slab->dbatch[b]};
        for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
            v2v_mem_free(*memory[i]);
            *memory[i] = NULL;
        }
    }
    v2v_mem_free(slab->dvolume);
    slab->dvolume = NULL;
    v2v_scene_fini(&slab->scene);
}

static void free_workspace(struct v2v_model *model)
{
    for (int64_t local = 0; local < model->held; local++) {
        free_slab(&model->slab[local]);
        v2v_padded_fini(&model->features[local]);
        v2v_padded_fini(&model->dfeatures[local]);
    }
    v2v_slabs_destroy(&model->slabs);
    v2v_workspace_fini(&model->shared);
    v2v_pool_fini(&model->packed);
}

/* Slab 0 has the model's own gradients. */
static void destroy_slab(struct v2v_model *model, int64_t local)
{
    struct v2v_model_slab *slab = &model->slab[local];
    for (int b = 0; b < BRANCHES; b++) {
        v2v_encoder_destroy(&slab->encoder[b]);
        v2v_unet_destroy(&slab->unet[b]);
    }
    if (local > 0) {
        v2v_mem_free(slab->parameters.gradients);
    }
}

void v2v_model_destroy(struct v2v_model **model)
{
    struct v2v_model *self = *model;
    if (self == NULL) {
        return;
    }
    if (self->slab != NULL && self->features != NULL && self->dfeatures != NULL) {
        free_workspace(self);
        for (int64_t local = 0; local < self->held; local++) {
            destroy_slab(self, local);
        }
    }
    for (int b = 0; b < BRANCHES; b++) {
        v2v_mem_free(self->views[b]);
        v2v_mem_free(self->round[b]);
    }
    v2v_shifts_fini(&self->shifts);
    v2v_shifts_fini(&self->alignment);
    void *memory[] = {self->slab,      self->features,    self->dfeatures, self->weights,
                      self->gradients, self->encoder_sum, self->scratch};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
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
    return model->weights;
}

float *v2v_model_gradients(struct v2v_model *model)
{
    return model->gradients;
}

struct v2v_part v2v_model_rows_of(const struct v2v_model *model, int rank)
{
    int64_t ranks = v2v_comm_size(model->spec.shard);
    struct v2v_slab slab = v2v_slab_cut(model->height, V2V_MODEL_GRID, ranks, rank);
    return (struct v2v_part){slab.first, slab.rows};
}

struct v2v_part v2v_model_rows(const struct v2v_model *model)
{
    return v2v_model_rows_of(model, v2v_comm_rank(model->spec.shard));
}

/* Per pixel: features, views as recorded and padded, volumes (of both branches as computed and as
 * written, and their mean), one view in the encoder (64 channels), the half-size layers of one
 * branch (4n channels at a time). Whatever the rows: strips, and weights with their transforms (16
 * layers, 4 times the values; the first one's are merged). Of frames of 256 x 320 to 1024 x 1024 at
 * width 128 it is a tenth to a fifth less than `reconstruct` plans. */
void v2v_model_describe_work(struct v2v_grid_work *work, const struct v2v_model_spec *spec,
                             int64_t height, int64_t width)
{
    enum { VOLUMES = 5, ENCODER = 64, WEIGHTS_OF_N2 = 9 * 120, TRANSFORMED = 4 };
    int64_t n = spec->width, grid = V2V_MODEL_GRID;
    int64_t pixels = (height + grid - 1) / grid * grid * ((width + grid - 1) / grid * grid);
    int64_t floats = spec->views * (spec->features + 2) + VOLUMES * spec->slices + ENCODER + n;
    int64_t fixed = V2V_STRIPS_FLOATS + BRANCHES * TRANSFORMED * WEIGHTS_OF_N2 * n * n;
    *work = (struct v2v_grid_work){.height = height,
                                   .unit = grid,
                                   .margin = V2V_SLAB_MARGIN,
                                   .most_branches = BRANCHES,
                                   .fixed_bytes = fixed * (int64_t)sizeof(float),
                                   .bytes = (fixed + floats * pixels) * (int64_t)sizeof(float)};
}

/* ---- plan ---- */

/* One slab, or one a rank, or all on one rank; between them whole images are gathered: E1, what UP3
 * reads. */
static enum v2v_status plan_slabs(struct v2v_model *model)
{
    const struct v2v_unet *unet = model->slab[0].unet[v2v_model_first_branch(model)];
    struct v2v_slabs_spec spec = {.comm = model->spec.shard,
                                  .count = v2v_model_slabs(model),
                                  .unit = V2V_MODEL_GRID,
                                  .height = model->height,
                                  .width = model->width,
                                  .features = model->spec.features,
                                  .ring = model->ring};
    const struct v2v_slabs_images whole[] = {
        v2v_unet_e1_images(unet),
        v2v_unet_joined_images(unet),
        {.channels = model->spec.features}, /* one view's, of one slab with its ring */
    };
    int first = spec.count > 1 ? 0 : 2, kinds = model->training ? 3 : 1;
    for (int i = first; i < kinds; i++) {
        int64_t floats = v2v_slabs_gathered_floats(&spec, &whole[i]);
        spec.gathered_floats = floats > spec.gathered_floats ? floats : spec.gathered_floats;
    }
    return v2v_slabs_create(&model->slabs, &spec);
}

static enum v2v_status plan_training(struct v2v_model *model, int64_t local)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_model_slab *slab = &model->slab[local];
    int64_t pixels = model->height * model->width, features = model->spec.features;
    int64_t rows = v2v_slab_computed(v2v_slabs_at(model->slabs, local));
    struct v2v_conv_method method = encoder_method(model);
    V2V_TRY(v2v_padded_init(&model->dfeatures[local], model->spec.views, features, rows,
                            model->width, model->ring));
    for (int b = 0; b < BRANCHES; b++) {
        int64_t count = v2v_model_view_part(model, b, v2v_slabs_index(model->slabs, local)).count;
        if (v2v_model_holds(model, b) && count > 0) {
            V2V_TRY(V2V_ALLOC(slab->batch[b], "model.batch", count * pixels));
            V2V_TRY(V2V_ALLOC(slab->dbatch[b], "model.batch", count * features * pixels));
            V2V_TRY(V2V_ALLOC(
                slab->encoding[b], "encoder.workspace",
                v2v_encoder_workspace(slab->encoder[b], count, model->height, model->width, 1)));
            V2V_TRY(v2v_encoder_plan(slab->encoder[b], slab->encoding[b], &method));
        }
    }
    V2V_TRY(V2V_ALLOC(slab->dvolume, "model.batch", model->spec.slices * rows * model->width));
done:
    return rc;
}

/* Gradients: the model's are those of its first slab, until all slabs' are added to them. */
static enum v2v_status plan_gradients(struct v2v_model *model)
{
    enum v2v_status rc = V2V_OK;
    if (model->training && model->gradients == NULL) {
        V2V_TRY(V2V_ALLOC(model->gradients, "model.gradients", model->fields.total));
    }
    for (int64_t local = 0; local < model->held; local++) {
        struct v2v_parameters *parameters = &model->slab[local].parameters;
        if (local == 0) {
            parameters->gradients = model->gradients;
        } else if (model->training && parameters->gradients == NULL) {
            V2V_TRY(V2V_ALLOC(parameters->gradients, "model.gradients", model->fields.total));
        }
    }
    if (model->training && v2v_model_slabs(model) > 1 && model->encoder_sum == NULL) {
        V2V_TRY(V2V_ALLOC(model->encoder_sum, "model.gradients", model->encoder_floats));
        V2V_TRY(V2V_ALLOC(model->scratch, "model.gradients", V2V_PAR_SCRATCH));
    }
done:
    return rc;
}

/* Without training the U-Nets of a slab share one workspace, which the encoder has used before: a
 * large frame then needs the memory of one branch. A slab without rows encodes views all the same.
 */
static enum v2v_status plan_unets(struct v2v_model *model, int64_t local, int64_t strip_floats)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_model_slab *slab = &model->slab[local];
    struct v2v_unet_size size = {.height = model->height,
                                 .width = model->width,
                                 .slab = *v2v_slabs_at(model->slabs, local),
                                 .has_middle = local == 0,
                                 .counts_middle = v2v_slabs_index(model->slabs, local) == 0,
                                 .strip_floats = strip_floats,
                                 .is_listed = model->is_listed,
                                 .training = model->training};
    int64_t need[BRANCHES] = {0}, slab_rows = size.slab.rows;
    for (int b = 0; b < BRANCHES; b++) {
        if (slab->unet[b] != NULL && slab_rows > 0) {
            need[b] = v2v_unet_workspace(slab->unet[b], &size);
        }
    }
    if (!model->training) {
        int64_t more = need[0] > need[1] ? need[0] : need[1];
        need[0] = more > model->encoding_floats ? more : model->encoding_floats;
        need[1] = 0;
    }
    for (int b = 0; b < BRANCHES; b++) {
        V2V_TRY(V2V_ALLOC(slab->workspace[b], "unet.workspace", need[b]));
    }
    for (int b = 0; b < BRANCHES; b++) {
        if (slab->unet[b] != NULL && slab_rows > 0) {
            v2v_pool_restart(&model->packed);
            V2V_TRY(v2v_unet_plan(slab->unet[b], slab->workspace[model->training ? b : 0],
                                  &model->features[local]));
        }
    }
done:
    return rc;
}

int v2v_model_skips(const struct v2v_model *model)
{
    return model->spec.skip > 0.0 && streams(model);
}

static enum v2v_status plan_slab(struct v2v_model *model, int64_t local, int64_t strip_floats)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_slab *slab = v2v_slabs_at(model->slabs, local);
    if (model->training) {
        V2V_TRY(plan_training(model, local));
    }
    V2V_TRY(v2v_padded_init(&model->features[local], model->spec.views, model->spec.features,
                            v2v_slab_computed(slab), model->width, model->ring));
    V2V_TRY(plan_unets(model, local, strip_floats));
    if (slab->rows > 0 && v2v_model_skips(model)) {
        V2V_TRY(v2v_scene_init(&model->slab[local].scene, &model->shifts, model->height,
                               model->width, slab));
    }
done:
    return rc;
}

/* What a plan is made with. */
struct economy {
    int64_t strip_floats; /* of all slabs */
    int shares;           /* the U-Nets' packed weights share memory */
    int is_listed;        /* strips in bf16 */
};

/* Without training one view after the other goes through the encoder. */
static enum v2v_status plan(struct v2v_model *model, const struct economy *economy)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_conv_method method = encoder_method(model);
    float *room = NULL;
    free_workspace(model);
    model->packed.shares = economy->shares;
    model->is_listed = economy->is_listed;
    V2V_TRY(plan_slabs(model));
    int64_t rows = v2v_model_rows(model).count;
    V2V_TRY(V2V_ALLOC(room, "model.room", model->room + rows * model->room_a_row));
    V2V_TRY(plan_gradients(model));
    struct v2v_encoder *encoder = model->slab[0].encoder[v2v_model_first_branch(model)];
    model->encoding_floats =
        model->training ? 0 : v2v_encoder_workspace(encoder, 1, model->height, model->width, 0);
    for (int64_t local = 0; local < model->held; local++) {
        V2V_TRY(plan_slab(model, local, economy->strip_floats / v2v_model_slabs(model)));
    }
    if (!model->training) {
        V2V_TRY(v2v_encoder_plan(encoder, model->slab[0].workspace[0], &method));
    }
    V2V_TRY(v2v_pool_fill(&model->packed, "conv.weights"));
done:
    v2v_mem_free(room);
    return rc;
}

void v2v_model_leave_room(struct v2v_model *model, int64_t floats, int64_t floats_a_row)
{
    model->room = floats;
    model->room_a_row = floats_a_row;
}

/* At width 128 two branches' packed weights take as much memory as a frame of 880 x 880 pixels
 * takes beside them; packing them for every frame takes as long as computing 47 x 47 of its pixels.
 */
static const int64_t large_frame = 768 * 768;

/* Packed weights of one branch at a time, for every frame. */
static int can_share(const struct v2v_model *model)
{
    return streams(model) && model->held == 1 && model->spec.branches == V2V_BRANCH_BOTH;
}

/* Strips and tiles in bf16: other sums than whole images have, which are rounded otherwise. */
static int can_list(const struct v2v_model *model)
{
    return model->spec.precision != V2V_PRECISION_F32 && !model->training && v2v_tile_conv_usable();
}

/* One thing more to save memory by, at the price of time; 0: there is none. Smaller strips come
 * last: a scene's tiles in them read the weights more often. */
static int save_more(struct v2v_model *model, struct economy *economy)
{
    if (model->training == V2V_TRAINING_KEEPS) {
        model->training = V2V_TRAINING_LEAN;
    } else if (!economy->is_listed && can_list(model)) {
        economy->is_listed = 1;
    } else if (!economy->shares && can_share(model)) {
        economy->shares = 1;
    } else if (streams(model) && economy->strip_floats > V2V_STRIPS_LEAST_FLOATS) {
        economy->strip_floats /= 2;
    } else {
        return 0;
    }
    return 1;
}

/* A frame that is cut for its size's sake keeps one branch's weights at a time from the start. */
enum v2v_status v2v_model_plan(struct v2v_model *model, int64_t height, int64_t width, int training)
{
    V2V_ASSERT(height % V2V_MODEL_GRID == 0 && width % V2V_MODEL_GRID == 0);
    model->height = height;
    model->width = width;
    model->training = training ? V2V_TRAINING_KEEPS : V2V_TRAINING_OFF;
    int is_cut = v2v_model_slabs(model) > 1 && height * width >= large_frame;
    struct economy economy = {.strip_floats = V2V_STRIPS_FLOATS,
                              .is_listed = model->spec.skip > 0.0 && can_list(model)};
    model->is_listed = economy.is_listed;
    economy.shares = is_cut && can_share(model);
    enum v2v_status rc = plan(model, &economy);
    while (rc == V2V_E_MEMORY && save_more(model, &economy)) {
        rc = plan(model, &economy);
    }
    if (rc == V2V_OK) {
        v2v_model_weights_changed(model);
    }
    return rc;
}

void v2v_model_weights_changed(struct v2v_model *model)
{
    for (int64_t local = 0; local < model->held; local++) {
        struct v2v_model_slab *slab = &model->slab[local];
        for (int b = 0; b < BRANCHES; b++) {
            if (slab->encoder[b] != NULL) {
                v2v_encoder_weights_changed(slab->encoder[b], &slab->parameters);
            }
            if (slab->unet[b] != NULL && !model->packed.shares) {
                v2v_unet_weights_changed(slab->unet[b], &slab->parameters);
            }
        }
    }
}
