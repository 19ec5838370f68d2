#include "cli/heldout.h"

#include "cli/projection.h"
#include "cli/steps.h"
#include "cli/volumes.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/eval/as_recorded.h"
#include "v2v3d/eval/quality.h"
#include "v2v3d/method/fusion.h"
#include "v2v3d/method/left_out.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/nn/precision.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/pad.h"
#include "v2v3d/tensor/saturation.h"
#include <math.h>
#include <string.h>

enum { MOST = V2V_ESTIMATOR_MOST_OUTPUTS };

struct trial {
    const struct v2v_session *session;
    const struct v2v_estimator_ops *ops;
    struct v2v_psf_file psf;
    struct v2v_problem problem;
    struct v2v_match match; /* of the views so far */
    struct v2v_recording *recording;
    float *recorded, *seen;    /* [v,y,x] frame 0; averaged with its neighbours' */
    struct v2v_fusion *fusion; /* of the latter */
    float *scratch;            /* [y,x] */
};

/* Folds that are judged: few, as each of them takes a volume. */
static int is_judged(int64_t fold, int64_t folds)
{
    return fold == 0 || fold == folds / 2;
}

static void judge(struct trial *trial, int64_t view, float *predicted)
{
    const int64_t height = trial->problem.height, width = trial->problem.width;
    const float *recorded = trial->recorded + view * height * width;
    v2v_as_recorded_predict(predicted, trial->scratch, trial->recording, view, 1);
    v2v_saturated_cap(predicted, recorded, 1, height * width);
    const struct v2v_match match = v2v_match_of(trial->scratch, recorded, predicted, height, width);
    v2v_match_add(&trial->match, &match);
}

/* Frame 0 in the units that the method takes. */
static enum v2v_status read(struct trial *trial, const char *input)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_session *session = trial->session;
    struct v2v_problem *problem = &trial->problem;
    const struct v2v_input_settings settings = v2v_estimator_input(trial->ops, &session->config);
    struct v2v_scaling scaling;
    V2V_TRY(v2v_step_recording(session, &trial->recording, input, &trial->psf));
    struct v2v_recording *const recording = trial->recording;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    const int64_t views = info->views, pixels = v2v_mem_product(info->height, info->width, 1);
    problem->height = info->height;
    problem->width = info->width;
    V2V_TRY(v2v_scaling_decide(&scaling, recording, &settings, session->world));
    V2V_TRY(V2V_ALLOC(trial->recorded, "heldout.views", v2v_mem_product(views, pixels, 1)));
    V2V_TRY(V2V_ALLOC(trial->seen, "heldout.views", v2v_mem_product(views, pixels, 1)));
    V2V_TRY(V2V_ALLOC(trial->scratch, "heldout.views", pixels));
    V2V_TRY(v2v_as_recorded_read(trial->recorded, NULL, NULL, recording, &scaling, 0));
    V2V_TRY(v2v_fusion_create(&trial->fusion, session->config.recon.neighbours, views, info->height,
                              info->width, trial->ops->leaves_blind));
    V2V_TRY(v2v_fusion_read(trial->fusion, trial->seen, recording, &scaling, 0));
    if (trial->ops->has_gain && session->config.model.homogeneous) {
        const float level =
            (float)v2v_scaling_level(trial->seen, trial->scratch, views, info->height, info->width);
        for (int64_t i = 0; i < views * pixels; i++) {
            const float recorded = trial->recorded[i];
            trial->recorded[i] = recorded != V2V_BLIND ? recorded * level : recorded;
        }
    }
done:
    return rc;
}

/* A volume of the views of all folds but one, and that one predicted. */
static enum v2v_status leave_out(struct trial *trial, int64_t fold)
{
    enum v2v_status rc = V2V_OK;
    const int64_t views = trial->psf.views, pixels = trial->problem.height * trial->problem.width;
    struct v2v_left_out *part = NULL;
    float *volume = NULL, *predicted = NULL;
    rc = V2V_ALLOC(volume, "heldout.volume", v2v_mem_product(trial->psf.slices, pixels, 1));
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(predicted, "heldout.views", v2v_mem_product(views, pixels, 1));
    }
    V2V_TRY(v2v_par_agree(trial->session->world, rc));
    v2v_watchdog_beat("a volume of some views");
    V2V_TRY(v2v_left_out_create(&part, trial->ops, &trial->problem, v2v_left_out_fold(views, fold),
                                1, trial->session->world));
    V2V_TRY(v2v_left_out_run(part, volume, trial->seen, v2v_fusion_averaging(trial->fusion)));
    v2v_left_out_predict(part, predicted, volume);
    for (int64_t k = part->used; k < views; k++) {
        judge(trial, part->view[k], predicted + (k - part->used) * pixels);
    }
done:
    v2v_left_out_destroy(&part);
    v2v_mem_free(predicted);
    v2v_mem_free(volume);
    return rc;
}

/* Views that output `o` did not see, as its volume [z,padded y,padded x] shows them. */
static enum v2v_status judge_output(struct trial *trial, const struct v2v_estimator *estimator,
                                    int o, const float *volume, struct v2v_projection *projection)
{
    enum v2v_status rc = V2V_OK;
    const int64_t height = trial->problem.height, width = trial->problem.width;
    const struct v2v_output *output = &estimator->output[o];
    const int64_t folds = v2v_left_out_folds(trial->psf.views);
    for (int64_t row = 0; row < trial->psf.slices * height; row++) {
        const int64_t z = row / height, y = row % height;
        memcpy(projection->slices + row * width,
               volume + (z * estimator->height + y) * estimator->width,
               (size_t)width * sizeof *volume);
    }
    V2V_TRY(v2v_projection_forward(projection));
    for (int64_t i = 0; i < output->count; i++) {
        const int64_t v = output->held_out[i];
        if (is_judged(v % folds, folds)) {
            judge(trial, v, projection->views + v * height * width);
        }
    }
done:
    return rc;
}

/* All outputs of a network. */
static enum v2v_status judge_outputs(struct trial *trial)
{
    enum v2v_status rc = V2V_OK;
    const int64_t height = trial->problem.height, width = trial->problem.width;
    const int64_t views = trial->psf.views, slices = trial->psf.slices;
    struct v2v_estimator *estimator = NULL;
    struct v2v_projection projection = {0};
    float *volume[MOST] = {NULL}, *padded = NULL;
    v2v_watchdog_beat("the volumes of halves");
    V2V_TRY(v2v_estimator_create(&estimator, trial->ops, &trial->problem, trial->session->world));
    const int64_t rows = estimator->height, columns = estimator->width;
    rc = V2V_ALLOC(padded, "heldout.views", v2v_mem_product(views, rows, columns));
    for (int o = 0; o < MOST && rc == V2V_OK && v2v_estimator_holds(estimator, o); o++) {
        rc = V2V_ALLOC(volume[o], "heldout.volume", v2v_mem_product(slices, rows, columns));
    }
    V2V_TRY(v2v_par_agree(trial->session->world, rc));
    v2v_pad_reflect(padded, trial->seen, views, height, width, rows, columns);
    V2V_TRY(trial->ops->run(estimator, volume, padded, NULL));
    V2V_TRY(v2v_projection_init(&projection, trial->session, &trial->psf, height, width));
    for (int o = 0; o < MOST && volume[o] != NULL; o++) {
        V2V_TRY(judge_output(trial, estimator, o, volume[o], &projection));
    }
done:
    for (int o = 0; o < MOST; o++) {
        v2v_mem_free(volume[o]);
    }
    v2v_mem_free(padded);
    v2v_projection_fini(&projection);
    v2v_estimator_destroy(&estimator);
    return rc;
}

/* What volumes_make settles of a network whose outputs see halves. */
static enum v2v_status settle_network(struct trial *trial, int *saw_all)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_config *config = &trial->session->config;
    const struct v2v_network_ops *network = NULL;
    V2V_TRY(v2v_network_find(&network, config->model.method));
    *saw_all = network->split == NULL && config->model.view_split == V2V_VIEWS_ALL;
    V2V_TRY(v2v_precision_agree(&trial->problem.precision, config->recon.precision,
                                trial->session->world));
    trial->problem.skip = v2v_volumes_skip(&config->recon.skip, trial->ops, network);
done:
    return rc;
}

enum v2v_status v2v_heldout_of(struct v2v_heldout *heldout, const char *psf, const char *input,
                               const char *weights, const struct v2v_estimator_ops *ops,
                               const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct trial trial = {.session = session, .ops = ops};
    *heldout = (struct v2v_heldout){NAN, NAN};
    V2V_TRY(v2v_step_psf(session, &trial.psf, psf));
    if (trial.psf.views < 2) {
        goto done;
    }
    trial.problem = (struct v2v_problem){.config = &session->config,
                                         .psf = &trial.psf,
                                         .weights = weights,
                                         .precision = V2V_PRECISION_F32};
    V2V_TRY(v2v_par_agree(session->world, read(&trial, input)));
    if (ops->has_gain) {
        int saw_all = 0;
        V2V_TRY(settle_network(&trial, &saw_all));
        if (saw_all) {
            goto done;
        }
        V2V_TRY(judge_outputs(&trial));
    } else {
        const int64_t folds = v2v_left_out_folds(trial.psf.views);
        for (int64_t fold = 0; fold < folds; fold++) {
            if (is_judged(fold, folds)) {
                V2V_TRY(leave_out(&trial, fold));
            }
        }
    }
    heldout->residual = v2v_match_residual(&trial.match, 1.0);
    heldout->sigmas = v2v_match_sigmas(&trial.match, 1.0);
done:
    v2v_fusion_destroy(&trial.fusion);
    v2v_mem_free(trial.scratch);
    v2v_mem_free(trial.seen);
    v2v_mem_free(trial.recorded);
    v2v_recording_close(&trial.recording);
    v2v_psf_file_fini(&trial.psf);
    return rc;
}
