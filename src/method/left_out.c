#include "v2v3d/method/left_out.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/projector.h"

#include <string.h>

/* So few hardly do without one, and not without two. */
enum { FEW_VIEWS = 6 };

int64_t v2v_left_out_folds(int64_t views)
{
    return views > FEW_VIEWS ? v2v_parts(views, 2) : views;
}

struct v2v_left_out_views v2v_left_out_fold(int64_t views, int64_t fold)
{
    return (struct v2v_left_out_views){fold, v2v_left_out_folds(views), views};
}

static int is_left_out(const struct v2v_left_out_views *without, int64_t view)
{
    return view < without->end && view % without->every == without->first;
}

/* The views of `list` out of data [views,size], one after the other. */
static void gather(float *to, const float *data, const int32_t *list, int64_t count, int64_t size)
{
    for (int64_t i = 0; i < count; i++) {
        memcpy(to + i * size, data + list[i] * size, (size_t)size * sizeof *to);
    }
}

/** Local: a set of the PSFs of some views. */
static enum v2v_status choose_psf(struct v2v_psf_file *chosen, const struct v2v_psf_file *psf,
                                  const int32_t *list, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    const int64_t kernels = v2v_mem_product(psf->slices, psf->height, psf->width);
    *chosen = *psf;
    chosen->views = count;
    chosen->data = NULL;
    V2V_TRY(V2V_ALLOC(chosen->data, "left_out.psf", v2v_mem_product(count, kernels, 1)));
    gather(chosen->data, psf->data, list, count, kernels);
done:
    return rc;
}

/** Local. */
static enum v2v_status take_memory(struct v2v_left_out *self, const struct v2v_problem *problem,
                                   const struct v2v_left_out_views *without)
{
    enum v2v_status rc = V2V_OK;
    int64_t left_out = 0;
    V2V_TRY(V2V_ALLOC(self->view, "left_out.views", self->views));
    for (int32_t v = 0; v < self->views; v++) {
        if (!is_left_out(without, v)) {
            self->view[self->used++] = v;
        }
    }
    for (int32_t v = 0; v < self->views; v++) {
        if (is_left_out(without, v)) {
            self->view[self->used + left_out++] = v;
        }
    }
    V2V_ASSERT(self->used > 0);
    V2V_TRY(V2V_ALLOC(self->recorded, "left_out.views",
                      v2v_mem_product(self->used, self->height, self->width)));
    if (problem->config->recon.neighbours > 0) {
        V2V_TRY(V2V_ALLOC(self->frames, "left_out.views",
                          v2v_mem_product(self->used, self->height, self->width)));
    }
    V2V_TRY(choose_psf(&self->psf, problem->psf, self->view, self->used));
done:
    return rc;
}

/** Collective(shard). */
static enum v2v_status plan_prediction(struct v2v_left_out *self, const struct v2v_psf_file *psf,
                                       const struct v2v_comm *shard)
{
    enum v2v_status rc = V2V_OK;
    const int64_t first = self->used < self->views ? self->used : 0;
    const int64_t count = self->views - first;
    struct v2v_psf_file predicted = {0};
    self->predicted = count;
    V2V_TRY(v2v_par_agree(shard, choose_psf(&predicted, psf, self->view + first, count)));
    V2V_TRY(v2v_projector_create(&self->projector, &predicted, self->height, self->width,
                                 V2V_SPLIT_SLABS, shard));
    const struct v2v_projector_share share = v2v_projector_share(self->projector);
    rc = V2V_ALLOC(self->volume, "left_out.volume",
                   v2v_mem_product(share.slices.count, share.rows.count, self->width));
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(self->rows, "left_out.views",
                       v2v_mem_product(count, share.view_rows.count, self->width));
    }
    V2V_TRY(v2v_par_agree(shard, rc));
done:
    v2v_psf_file_fini(&predicted);
    return rc;
}

enum v2v_status v2v_left_out_create(struct v2v_left_out **left_out,
                                    const struct v2v_estimator_ops *ops,
                                    const struct v2v_problem *problem,
                                    struct v2v_left_out_views without, int predicts,
                                    const struct v2v_comm *shard)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_left_out *self = NULL;
    struct v2v_problem own = *problem;
    rc = V2V_ALLOC(self, "left_out", 1);
    if (rc == V2V_OK) {
        *self = (struct v2v_left_out){
            .views = problem->psf->views, .height = problem->height, .width = problem->width};
        rc = take_memory(self, problem, &without);
    }
    V2V_TRY(v2v_par_agree(shard, rc));
    own.psf = &self->psf;
    V2V_TRY(v2v_estimator_create(&self->estimator, ops, &own, shard));
    V2V_ASSERT(self->estimator->height == self->height && self->estimator->width == self->width);
    if (predicts) {
        V2V_TRY(plan_prediction(self, problem->psf, shard));
    }
done:
    if (rc != V2V_OK) {
        v2v_left_out_destroy(&self);
    }
    *left_out = self;
    return rc;
}

enum v2v_status v2v_left_out_choose(struct v2v_left_out **left_out,
                                    const struct v2v_estimator_ops *ops,
                                    const struct v2v_problem *problem, int64_t choice,
                                    const struct v2v_comm *shard)
{
    const int64_t views = problem->psf->views, count = views > FEW_VIEWS ? V2V_LEFT_OUT_MOST : 1;
    const int64_t every = views / count; /* not below the number of choices */
    const struct v2v_left_out_views without = {every - 1 - choice, every, every * count};
    V2V_ASSERT(choice >= 0 && choice < every);
    return v2v_left_out_create(left_out, ops, problem, without, 1, shard);
}

void v2v_left_out_destroy(struct v2v_left_out **left_out)
{
    struct v2v_left_out *self = *left_out;
    *left_out = NULL;
    if (self != NULL) {
        v2v_projector_destroy(&self->projector);
        v2v_estimator_destroy(&self->estimator);
        v2v_psf_file_fini(&self->psf);
        v2v_mem_free(self->rows);
        v2v_mem_free(self->volume);
        v2v_mem_free(self->frames);
        v2v_mem_free(self->recorded);
        v2v_mem_free(self->view);
        v2v_mem_free(self);
    }
}

enum v2v_status v2v_left_out_run(struct v2v_left_out *self, float *slices, const float *views,
                                 const struct v2v_averaging *averaging)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_estimator *estimator = self->estimator;
    struct v2v_averaging used;
    gather(self->recorded, views, self->view, self->used, self->height * self->width);
    if (averaging != NULL) {
        V2V_ASSERT(self->frames != NULL);
        gather(self->frames, averaging->frames, self->view, self->used, self->height * self->width);
        used = *averaging;
        used.frames = self->frames;
        estimator->averaging = &used;
    }
    rc = estimator->ops->run(estimator, &slices, self->recorded, NULL);
    estimator->averaging = NULL;
    return rc;
}

void v2v_left_out_predict(struct v2v_left_out *self, float *predicted, const float *slices)
{
    const int64_t count = self->predicted;
    V2V_ASSERT(self->projector != NULL);
    v2v_projector_from_slices(self->projector, self->volume, slices);
    v2v_projector_forward(self->projector, self->rows, self->volume, NULL, count, 1.0f);
    v2v_projector_gather_views(self->projector, predicted, self->rows, count);
}
