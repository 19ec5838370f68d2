#include "cli/evaluation.h"

#include "cli/steps.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/eval/metrics.h"
#include "v2v3d/eval/quality.h"
#include "v2v3d/par/watchdog.h"
#include <inttypes.h>
#include <math.h>

const char *const v2v_figure_names[V2V_FIGURE_COUNT] = {
    "psnr", "ssim", "background_truth", "background_volume", "scale", "residual", "flux"};

static enum v2v_status allocate(struct v2v_evaluation *evaluation, int first, int last)
{
    enum v2v_status rc = V2V_OK;
    for (int f = first; f <= last; f++) {
        V2V_TRY(V2V_ALLOC(evaluation->value[f], "evaluate.figures", evaluation->frames));
    }
done:
    return rc;
}

static enum v2v_status check_shapes(const struct v2v_evaluation_job *job,
                                    const struct v2v_volume_info *truth,
                                    const struct v2v_volume_info *volume)
{
    if (truth->slices == volume->slices && truth->height == volume->height &&
        truth->width == volume->width) {
        return V2V_OK;
    }
    return V2V_FAIL(V2V_E_INPUT,
                    "%s is %" PRId64 " x %" PRId64 " x %" PRId64 " voxels, but %s is %" PRId64
                    " x %" PRId64 " x %" PRId64,
                    job->truth, truth->slices, truth->height, truth->width, job->volume,
                    volume->slices, volume->height, volume->width);
}

/* The frame of the truth that the volume's first one shows. As `simulate` has it, frame t of a
 * recording shows frame t mod T of the truth; volumes of one recording show it side by side.
 * @param is_root of the ranks: it says what others keep to themselves */
static enum v2v_status align(int64_t *first, const struct v2v_evaluation *evaluation,
                             const struct v2v_evaluation_job *job, const struct v2v_origin *truth,
                             int64_t of_truth, int is_root)
{
    const struct v2v_origin *volume = &evaluation->origin;
    *first = v2v_larger(volume->first_frame, 0);
    if (v2v_origin_is_same(volume, truth)) {
        *first -= truth->first_frame;
        if (*first < 0 || *first + evaluation->frames > of_truth) {
            return V2V_FAIL(V2V_E_INPUT,
                            "%s shows frames %" PRId64 " to %" PRId64
                            " of its recording, %s %" PRId64 " to %" PRId64,
                            job->volume, volume->first_frame,
                            volume->first_frame + evaluation->frames - 1, job->truth,
                            truth->first_frame, truth->first_frame + of_truth - 1);
        }
    }
    const int is_over = of_truth > 1 && *first + evaluation->frames > of_truth;
    *first %= of_truth;
    if (*first > 0) {
        v2v_log(V2V_LOG_INFO, "the volume's first frame shows frame %" PRId64 " of %s", *first,
                job->truth);
    }
    if (is_over && is_root) {
        v2v_log(V2V_LOG_WARNING,
                "%s has %" PRId64 " frames, fewer than the volume shows: they are taken over and "
                "over, as simulate --frames does",
                job->truth, of_truth);
    }
    return V2V_OK;
}

/* Local: scores of frame t, which shows frame `shown` of what was simulated. */
static enum v2v_status score_frame(struct v2v_evaluation *evaluation, struct v2v_volume *truth,
                                   struct v2v_volume *volume, float *a, float *b, int64_t t,
                                   int64_t shown, int fit_scale)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_scores scores;
    const struct v2v_volume_info *info = v2v_volume_info(volume);
    V2V_TRY(v2v_volume_read(truth, a, shown, 0, info->slices));
    V2V_TRY(v2v_volume_read(volume, b, t, 0, info->slices));
    V2V_TRY(v2v_scores_of(&scores, a, b, info->slices, info->height, info->width, fit_scale));
    evaluation->value[V2V_FIGURE_PSNR][t] = scores.psnr;
    evaluation->value[V2V_FIGURE_SSIM][t] = scores.ssim;
    evaluation->value[V2V_FIGURE_BACKGROUND_TRUTH][t] = scores.background_truth;
    evaluation->value[V2V_FIGURE_BACKGROUND_VOLUME][t] = scores.background_volume;
    evaluation->value[V2V_FIGURE_SCALE][t] = scores.scale;
done:
    return rc;
}

/* A volume's settings are the recording's but for what is in the file. */
static enum v2v_status settings_of(struct v2v_input_settings *settings,
                                   const struct v2v_session *session, const char *dataset)
{
    *settings = session->config.input;
    return v2v_text_format(settings->dataset, sizeof settings->dataset, "%s",
                           dataset != NULL ? dataset : "");
}

static enum v2v_status score(struct v2v_evaluation *evaluation,
                             const struct v2v_evaluation_job *job, struct v2v_volume *volume,
                             const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume *truth = NULL;
    struct v2v_input_settings settings;
    float *a = NULL, *b = NULL;
    const struct v2v_volume_info *info = v2v_volume_info(volume);
    int64_t voxels = info->slices * info->height * info->width;
    struct v2v_origin origin;
    int64_t first = 0;
    V2V_TRY(settings_of(&settings, session, job->truth_dataset));
    if (settings.slices == 0) {
        settings.slices = info->slices; /* of a TIFF that doesn't say */
    }
    V2V_TRY(v2v_volume_open(&truth, job->truth, &settings, session->world));
    V2V_TRY(check_shapes(job, v2v_volume_info(truth), info));
    const int64_t of_truth = v2v_volume_info(truth)->frames;
    V2V_TRY(v2v_origin_read(&origin, job->truth, session));
    V2V_TRY(align(&first, evaluation, job, &origin, of_truth, v2v_step_on_root(session)));
    rc = allocate(evaluation, V2V_FIGURE_PSNR, V2V_FIGURE_SCALE);
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(a, "evaluate.truth", voxels);
    }
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(b, "evaluate.volume", voxels);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    int64_t ranks = v2v_comm_size(session->world);
    for (int64_t t = v2v_comm_rank(session->world); t < info->frames && rc == V2V_OK; t += ranks) {
        v2v_watchdog_beat("evaluate: a frame");
        rc =
            score_frame(evaluation, truth, volume, a, b, t, (first + t) % of_truth, job->fit_scale);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    for (int f = V2V_FIGURE_PSNR; f <= V2V_FIGURE_SCALE; f++) {
        v2v_par_sum_f64(session->world, evaluation->value[f], info->frames);
    }
done:
    v2v_mem_free(b);
    v2v_mem_free(a);
    v2v_volume_close(&truth);
    return rc;
}

enum v2v_status v2v_evaluation_run(struct v2v_evaluation *evaluation,
                                   const struct v2v_evaluation_job *job,
                                   const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume *volume = NULL;
    struct v2v_input_settings settings;
    *evaluation = (struct v2v_evaluation){.is_corrected = job->weights != NULL,
                                          .heldout = NAN,
                                          .heldout_sigmas = NAN,
                                          .disagreement = NAN,
                                          .resolution = NAN,
                                          .resolution_um = NAN};
    V2V_TRY(settings_of(&settings, session, job->volume_dataset));
    settings.channel = 0; /* which is the truth's and the recording's */
    V2V_TRY(v2v_volume_open(&volume, job->volume, &settings, session->world));
    evaluation->frames = v2v_volume_info(volume)->frames;
    V2V_TRY(v2v_origin_read(&evaluation->origin, job->volume, session));
    if (job->truth != NULL) {
        V2V_TRY(score(evaluation, job, volume, session));
    }
    if (job->psf != NULL) {
        V2V_TRY(v2v_evaluation_of_views(evaluation, job, volume, session));
    }
    for (int f = 0; f < V2V_FIGURE_COUNT; f++) {
        if (evaluation->value[f] != NULL) {
            evaluation->mean[f] = v2v_mean_of_known(evaluation->value[f], evaluation->frames, 1);
        }
    }
done:
    v2v_volume_close(&volume);
    return rc;
}

void v2v_evaluation_fini(struct v2v_evaluation *evaluation)
{
    for (int f = 0; f < V2V_FIGURE_COUNT; f++) {
        v2v_mem_free(evaluation->value[f]);
    }
    for (int f = 0; f < V2V_VIEW_FIGURE_COUNT; f++) {
        v2v_mem_free(evaluation->of_view[f]);
    }
    v2v_mem_free(evaluation->disagreement_slices);
    v2v_consistency_fini(&evaluation->consistency);
    *evaluation = (struct v2v_evaluation){0};
}
