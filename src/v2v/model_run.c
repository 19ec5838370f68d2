/* Forward and backward of the model, over its slabs and those of the other ranks of the shard. */
#include "v2v/model_state.h"

#include "v2v3d/tensor/bulk.h"

#include <string.h>

enum { BRANCHES = V2V_BRANCHES };

static int64_t held_rows(const struct v2v_model *model)
{
    return v2v_model_rows(model).count;
}

/* Rows of the held volumes that come before those of a slab. */
static int64_t rows_before(const struct v2v_model *model, int64_t local)
{
    return v2v_slabs_at(model->slabs, local)->first - v2v_model_rows(model).first;
}

/* The first used slab's U-Net computes what lies below E1; NULL: this rank has none. */
static struct v2v_unet *middle_of(const struct v2v_model *model, int b)
{
    return v2v_model_is_used(model, 0) ? model->slab[0].unet[b] : NULL;
}

/* ---- encoder ---- */

/* View number i of those that a rank encodes without training; -1: it has fewer. */
static int32_t view_of_rank(const struct v2v_model *model, int rank, int64_t i)
{
    int is_alone = v2v_comm_size(model->spec.shard) == 1;
    for (int b = 0; b < BRANCHES; b++) {
        struct v2v_part part = is_alone ? (struct v2v_part){0, model->view_count[b]}
                                        : v2v_model_view_part(model, b, rank);
        if (!v2v_model_holds(model, b)) {
            continue;
        }
        if (i < part.count) {
            return model->views[b][part.first + i];
        }
        i -= part.count;
    }
    return -1;
}

/* Which views all ranks have in round i; 0: none has any. */
static int list_round(const struct v2v_model *model, int32_t *view, int64_t i)
{
    int any = 0;
    for (int r = 0; r < v2v_comm_size(model->spec.shard); r++) {
        view[r] = view_of_rank(model, r, i);
        any |= view[r] >= 0;
    }
    return any;
}

/* The features of one view travel while the next one is encoded. */
static void encode_one_by_one(struct v2v_model *model, const float *views)
{
    struct v2v_encoder *encoder = model->slab[0].encoder[v2v_model_first_branch(model)];
    int rank = v2v_comm_rank(model->spec.shard), pending = 0;
    for (int64_t i = 0;; i++) {
        int32_t *now = model->round[i % 2], *before = model->round[1 - i % 2];
        int any = list_round(model, now, i);
        const float *features = NULL;
        if (now[rank] >= 0) {
            features =
                v2v_encoder_forward(encoder, views + now[rank] * model->height * model->width);
        }
        if (pending) {
            v2v_slabs_end_features(model->slabs, model->features, before);
        }
        if (!any) {
            return;
        }
        v2v_slabs_begin_features(model->slabs, model->features, now, features);
        pending = 1;
    }
}

/* View number i of branch b that slab `index` encodes in training, as the ranks see it. */
static void list_training_round(const struct v2v_model *model, int32_t *view, int b, int64_t index,
                                int64_t i)
{
    int ranks = v2v_comm_size(model->spec.shard);
    for (int r = 0; r < ranks; r++) {
        struct v2v_part part = v2v_model_view_part(model, b, ranks > 1 ? r : index);
        view[r] = i < part.count ? model->views[b][part.first + i] : -1;
    }
}

/* No slab encodes more views of a branch than the first. */
static int64_t most_views(const struct v2v_model *model, int b)
{
    return v2v_model_view_part(model, b, 0).count;
}

static void encode_branch(struct v2v_model *model, int64_t local, int b, const float *views)
{
    struct v2v_model_slab *slab = &model->slab[local];
    int64_t pixels = model->height * model->width, index = v2v_slabs_index(model->slabs, local);
    struct v2v_part part = v2v_model_view_part(model, b, index);
    for (int64_t i = 0; i < part.count; i++) {
        memcpy(slab->batch[b] + i * pixels, views + model->views[b][part.first + i] * pixels,
               (size_t)pixels * sizeof *views);
    }
    const float *features =
        part.count > 0 ? v2v_encoder_forward(slab->encoder[b], slab->batch[b]) : NULL;
    for (int64_t i = 0; i < most_views(model, b); i++) {
        const float *own = i < part.count ? features + i * model->spec.features * pixels : NULL;
        list_training_round(model, model->round[0], b, index, i);
        v2v_slabs_begin_features(model->slabs, model->features, model->round[0], own);
        v2v_slabs_end_features(model->slabs, model->features, model->round[0]);
    }
}

static void encode_back(struct v2v_model *model, int64_t local, int b)
{
    struct v2v_model_slab *slab = &model->slab[local];
    int64_t image = model->spec.features * model->height * model->width;
    int64_t index = v2v_slabs_index(model->slabs, local);
    int64_t count = v2v_model_view_part(model, b, index).count;
    for (int64_t i = 0; i < most_views(model, b); i++) {
        list_training_round(model, model->round[0], b, index, i);
        v2v_slabs_return_features(model->slabs, i < count ? slab->dbatch[b] + i * image : NULL,
                                  model->dfeatures, model->round[0]);
    }
    if (count > 0) {
        v2v_encoder_backward(slab->encoder[b], &slab->parameters, slab->dbatch[b], slab->batch[b]);
    }
}

/* ---- forward ---- */

/* What the scene leaves of a slab; NULL: all of it. */
static const struct v2v_scene *look(struct v2v_model *model, int64_t local, const float *views)
{
    struct v2v_scene *scene = &model->slab[local].scene;
    const struct v2v_tiles *tiles = &scene->computed;
    if (!v2v_model_skips(model) || !v2v_scene_look(scene, views, model->spec.skip)) {
        return NULL;
    }
    double part = (double)tiles->count / (double)(tiles->rows * tiles->columns);
    model->computed_part -= (1.0 - part) / (double)model->held;
    return scene;
}

/* Where a slab's own rows of slice z begin: in what it computes [z,rows computed,x], and in the
 * volumes of this rank [z,rows held,x]. */
struct place {
    int64_t computed, held;
};

static struct place place_of(const struct v2v_model *model, int64_t local, int64_t z)
{
    const struct v2v_slab *slab = v2v_slabs_at(model->slabs, local);
    return (struct place){.computed = (z * v2v_slab_computed(slab) + slab->above) * model->width,
                          .held =
                              (z * held_rows(model) + rows_before(model, local)) * model->width};
}

/* A volume's rows from those that the network computed. */
static void take_output(const struct v2v_model *model, float *volume, const float *output,
                        int64_t local)
{
    int64_t count = v2v_slabs_at(model->slabs, local)->rows * model->width;
    float factor = (float)model->spec.volume_scale;
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < model->spec.slices; z++) {
        struct place place = place_of(model, local, z);
        for (int64_t i = 0; i < count; i++) {
            volume[place.held + i] = output[place.computed + i] * factor;
        }
    }
}

/* The adjoint; the margins get nothing. */
static void take_gradient(const struct v2v_model *model, float *doutput, const float *dvolume,
                          int64_t local)
{
    const struct v2v_slab *slab = v2v_slabs_at(model->slabs, local);
    int64_t above = slab->above * model->width, below = slab->below * model->width;
    int64_t count = slab->rows * model->width;
    float factor = (float)model->spec.volume_scale;
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < model->spec.slices; z++) {
        struct place place = place_of(model, local, z);
        float *to = doutput + place.computed;
        memset(to - above, 0, (size_t)above * sizeof *to);
        memset(to + count, 0, (size_t)below * sizeof *to);
        for (int64_t i = 0; i < count; i++) {
            to[i] = dvolume[place.held + i] * factor;
        }
    }
}

enum { MOST_SLABS = V2V_MODEL_MOST_SLABS };

static void run_branch(struct v2v_model *model, int b, float *volume,
                       const struct v2v_scene *const *scene)
{
    struct v2v_unet *middle = middle_of(model, b);
    const float *e1[MOST_SLABS] = {NULL};
    if (model->packed.shares && middle != NULL) {
        v2v_unet_weights_changed(middle, &model->slab[0].parameters);
    }
    for (int64_t local = 0; local < model->held; local++) {
        if (v2v_model_is_used(model, local)) {
            e1[local] =
                v2v_unet_enter(model->slab[local].unet[b], &model->features[local], scene[local]);
        }
    }
    if (v2v_model_slabs(model) > 1) {
        struct v2v_slabs_images images = v2v_unet_e1_images(model->slab[0].unet[b]);
        v2v_slabs_gather(model->slabs, middle != NULL ? v2v_unet_e1(middle) : NULL, e1, &images);
    }
    if (middle != NULL) {
        v2v_unet_middle(middle);
    }
    /* the first one's memory holds the middle's results */
    for (int64_t local = model->held - 1; local >= 0; local--) {
        if (v2v_model_is_used(model, local)) {
            take_output(model, volume,
                        v2v_unet_leave(model->slab[local].unet[b], middle, model->slabs, local,
                                       scene[local]),
                        local);
        }
    }
}

void v2v_model_forward(struct v2v_model *model, float *volume1, float *volume2, const float *views)
{
    float *volume[BRANCHES] = {volume1, volume2};
    const struct v2v_scene *scene[MOST_SLABS] = {NULL};
    model->computed_part = 1.0;
    for (int64_t local = 0; local < model->held; local++) {
        if (v2v_model_is_used(model, local)) {
            scene[local] = look(model, local, views);
        }
    }
    if (!model->training) {
        encode_one_by_one(model, views);
    }
    for (int b = 0; b < BRANCHES; b++) {
        if (v2v_model_holds(model, b)) {
            for (int64_t local = 0; model->training && local < model->held; local++) {
                encode_branch(model, local, b, views);
            }
            run_branch(model, b, volume[b], scene);
        }
    }
}

double v2v_model_computed_part(const struct v2v_model *model)
{
    return model->computed_part;
}

/* ---- backward ---- */

void v2v_model_watch_gradients(struct v2v_model *model,
                               void (*ready)(void *context, int64_t first, int64_t count),
                               void *context)
{
    model->ready = ready;
    model->ready_context = context;
    model->slab[0].parameters.ready = model->held > 1 ? NULL : ready;
    model->slab[0].parameters.context = context;
}

static void tell(const struct v2v_model *model, int64_t first, int64_t count)
{
    if (model->ready != NULL) {
        model->ready(model->ready_context, first, count);
    }
}

static void run_branch_back(struct v2v_model *model, int b, const float *dvolume)
{
    struct v2v_unet *middle = middle_of(model, b);
    const float *djoined[MOST_SLABS] = {NULL}, *de1 = NULL;
    int is_cut = v2v_model_slabs(model) > 1;
    for (int64_t local = 0; local < model->held; local++) {
        struct v2v_model_slab *slab = &model->slab[local];
        if (v2v_model_is_used(model, local)) {
            take_gradient(model, slab->dvolume, dvolume, local);
            djoined[local] =
                v2v_unet_leave_backward(slab->unet[b], &slab->parameters, slab->dvolume);
        }
    }
    if (is_cut) {
        struct v2v_slabs_images images = v2v_unet_joined_images(model->slab[0].unet[b]);
        v2v_slabs_sum(model->slabs, middle != NULL ? v2v_unet_gradient(middle) : NULL, djoined,
                      &images);
    }
    if (middle != NULL) {
        de1 = v2v_unet_middle_backward(middle, &model->slab[0].parameters);
    }
    for (int64_t local = 0; is_cut && local < model->held; local++) {
        if (v2v_model_is_used(model, local)) {
            v2v_unet_cut_gradient(model->slab[local].unet[b], de1, model->slabs, local);
        }
    }
    for (int64_t local = 0; local < model->held; local++) {
        struct v2v_model_slab *slab = &model->slab[local];
        if (v2v_model_is_used(model, local)) {
            v2v_unet_enter_backward(slab->unet[b], &slab->parameters, &model->dfeatures[local],
                                    &model->features[local]);
        }
    }
}

/* Gradients [first, first + count) of this rank's slabs, added up in their order, into the model's.
 */
static void sum_held(struct v2v_model *model, int64_t first, int64_t count)
{
    float *sum = model->gradients + first;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < count; i++) {
        float total = 0.0f; /* as sums over ranks begin */
        for (int64_t local = 0; local < model->held; local++) {
            total += model->slab[local].parameters.gradients[first + i];
        }
        sum[i] = total;
    }
}

static void clear_slabs(struct v2v_model *model, int64_t first, int64_t count)
{
    for (int64_t local = 0; local < model->held; local++) {
        v2v_bulk_clear(model->slab[local].parameters.gradients + first, count);
    }
}

/* The encoder's gradient: that of a branch is summed over all slabs, then over the branches, as
 * ranks that hold one branch each do. */
static void add_encoder_gradient(struct v2v_model *model)
{
    if (model->held > 1) {
        sum_held(model, 0, model->encoder_floats);
    }
    v2v_par_sum_ordered_f32(model->spec.shard, model->gradients, model->encoder_floats,
                            model->scratch);
    for (int64_t i = 0; i < model->encoder_floats; i++) {
        model->encoder_sum[i] += model->gradients[i];
    }
    clear_slabs(model, 0, model->encoder_floats);
}

static void clear_feature_gradients(struct v2v_model *model)
{
    for (int64_t local = 0; local < model->held; local++) {
        v2v_padded_clear(&model->dfeatures[local]);
    }
}

void v2v_model_backward(struct v2v_model *model, const float *dvolume1, const float *dvolume2)
{
    const float *dvolume[BRANCHES] = {dvolume1, dvolume2};
    int is_cut = v2v_model_slabs(model) > 1;
    V2V_ASSERT(model->training);
    /* the encoder's are added to; of several slabs, some compute less than all */
    clear_slabs(model, 0, is_cut ? model->fields.total : model->encoder_floats);
    if (is_cut) {
        memset(model->encoder_sum, 0, (size_t)model->encoder_floats * sizeof(float));
    }
    clear_feature_gradients(model);
    for (int b = 0; b < BRANCHES; b++) {
        if (!v2v_model_holds(model, b)) {
            continue;
        }
        if (b > 0 && model->spec.split == V2V_VIEWS_ALL) { /* else they are of other views */
            clear_feature_gradients(model);
        }
        run_branch_back(model, b, dvolume[b]);
        for (int64_t local = 0; local < model->held; local++) {
            encode_back(model, local, b);
        }
        if (is_cut) {
            add_encoder_gradient(model);
        }
    }
    if (is_cut) {
        memcpy(model->gradients, model->encoder_sum, (size_t)model->encoder_floats * sizeof(float));
    }
    if (model->held > 1) {
        sum_held(model, model->encoder_floats, model->fields.total - model->encoder_floats);
        tell(model, model->encoder_floats, model->fields.total - model->encoder_floats);
    }
    if (model->held == 1 && !v2v_model_is_used(model, 0)) { /* zeros, which no layer announced */
        tell(model, model->encoder_floats, model->fields.total - model->encoder_floats);
    }
    tell(model, 0, model->encoder_floats);
}
