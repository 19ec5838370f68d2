#include "cli/evaluation.h"

#include "cli/levels.h"
#include "cli/projection.h"
#include "cli/provenance.h"
#include "cli/steps.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/conf/kept_views.h"
#include "v2v3d/eval/as_recorded.h"
#include "v2v3d/eval/quality.h"
#include "v2v3d/method/estimator.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/saturation.h"
#include "v2v3d/tensor/statistics.h"
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

/* Pixels between a view and its prediction that are worth a warning: views in register were up to
 * 0.51 off where their volume is uncertain in depth (tests/bench/views.md). */
static const double out_of_register = 0.7;

/* Light of a volume over that of its views, or the other way round, that is. */
static const double out_of_flux = V2V_MATCH_MUCH_LIGHT;

/* What goes with one evaluation. */
struct work {
    struct v2v_evaluation *evaluation;
    const struct v2v_evaluation_job *job;
    const struct v2v_session *session;
    struct v2v_psf_file psf;
    struct v2v_recording *recording;
    struct v2v_scaling scaling;
    struct v2v_projection projection;
    float *views, *scratch;    /* [v,y,x] */
    struct v2v_match *of_view; /* [v]: over all frames .. */
    struct v2v_match *here;    /* [v]: .. and of the one at hand */
    int64_t *known;            /* [figure,v]: frames, of the figures that are no held-out views' */
    int64_t height, width, saturated;
    double off_light;               /* times that light is most out of proportion; 0: nowhere */
    int64_t off_frame;              /* where that is, of frames that show something */
    double deficit;                 /* what views lie below zero by where they are dark */
    struct v2v_level_range trained; /* with weights: levels of the training, and what those of .. */
    struct v2v_scaling trained_by;  /* .. the recording are taken by */
    int is_homogeneous;
    char levels[V2V_LEVELS_TEXT]; /* what is to be said of them, or "" */
};

static enum v2v_status check_shapes(const struct work *work, const struct v2v_volume_info *info)
{
    const struct v2v_recording_info *shown = v2v_recording_info(work->recording);
    if (info->slices == work->psf.slices && info->height == shown->height &&
        info->width == shown->width && info->frames == shown->frames) {
        return V2V_OK;
    }
    return V2V_FAIL(V2V_E_INPUT,
                    "%s: %" PRId64 " frames, %" PRId64 " slices of %" PRId64 " x %" PRId64
                    " do not go with %s and its PSFs: %" PRId64 " frames, %" PRId64
                    " slices of %" PRId64 " x %" PRId64,
                    work->job->volume, info->frames, info->slices, info->height, info->width,
                    work->job->input, shown->frames, work->psf.slices, shown->height, shown->width);
}

static enum v2v_status take_memory(struct work *work)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_evaluation *evaluation = work->evaluation;
    const int64_t pixels = work->height * work->width;
    for (int f = V2V_FIGURE_RESIDUAL; f <= V2V_FIGURE_FLUX; f++) {
        V2V_TRY(V2V_ALLOC(evaluation->value[f], "evaluate.figures", evaluation->frames));
    }
    for (int f = 0; f < V2V_VIEW_FIGURE_COUNT; f++) {
        V2V_TRY(V2V_ALLOC(evaluation->of_view[f], "evaluate.figures", work->psf.views));
    }
    V2V_TRY(V2V_ALLOC(work->known, "evaluate.figures", V2V_VIEW_HELDOUT * work->psf.views));
    V2V_TRY(V2V_ALLOC(evaluation->disagreement_slices, "evaluate.figures", work->psf.slices));
    V2V_TRY(V2V_ALLOC(work->of_view, "evaluate.figures", work->psf.views));
    V2V_TRY(V2V_ALLOC(work->here, "evaluate.figures", work->psf.views));
    V2V_TRY(V2V_ALLOC(work->views, "evaluate.views", v2v_mem_product(work->psf.views, pixels, 1)));
    V2V_TRY(
        V2V_ALLOC(work->scratch, "evaluate.views", v2v_mem_product(work->psf.views, pixels, 1)));
done:
    return rc;
}

/* To the mean over the frames in which it is known; NaN as long as there is none. */
static void add_known(struct work *work, int figure, int64_t v, double value)
{
    double *mean = &work->evaluation->of_view[figure][v];
    int64_t *known = &work->known[figure * work->psf.views + v];
    if (!isnan(value)) {
        ++*known;
        *mean = *known == 1 ? value : *mean + (value - *mean) / (double)*known;
    } else if (*known == 0) {
        *mean = NAN;
    }
}

/* Local: how the projections of frame t meet its views. */
static void match(struct work *work, int64_t t)
{
    struct v2v_evaluation *evaluation = work->evaluation;
    const struct v2v_match all =
        v2v_match_views(work->here, work->scratch, work->views, work->projection.views,
                        work->psf.views, work->height, work->width);
    const double scale = v2v_match_scale(&all);
    for (int64_t v = 0; v < work->psf.views; v++) {
        const struct v2v_match *one = &work->here[v];
        v2v_match_add(&work->of_view[v], one);
        add_known(work, V2V_VIEW_RESIDUAL, v, v2v_match_residual(one, scale));
        add_known(work, V2V_VIEW_RESIDUAL_SIGMAS, v, v2v_match_sigmas(one, scale));
        add_known(work, V2V_VIEW_FLUX, v, v2v_match_flux(one));
    }
    evaluation->value[V2V_FIGURE_RESIDUAL][t] = v2v_match_residual(&all, scale);
    evaluation->value[V2V_FIGURE_FLUX][t] = v2v_match_flux(&all);
}

/* Local: is the light of frame t that which is most out of proportion so far? The sum of noise
 * alone is no measure. */
static void judge_flux(struct work *work, int64_t t)
{
    const double flux = work->evaluation->value[V2V_FIGURE_FLUX][t];
    const double off = flux <= 0.0 ? INFINITY : flux < 1.0 ? 1.0 / flux : flux; /* NaN stays */
    if (off > fmax(work->off_light, out_of_flux) &&
        (!v2v_structure_can_be_seen(work->height, work->width) ||
         v2v_structure_is_seen(work->views, work->psf.views, work->height, work->width))) {
        work->off_light = off;
        work->off_frame = t;
    }
}

/* The views again from the volume, compared with those of the recording less its offset.
 * Collective. */
static enum v2v_status project(struct work *work, struct v2v_volume *volume)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_projection *p = &work->projection;
    int64_t saturated = 0;
    V2V_TRY(v2v_projection_init(p, work->session, &work->psf, work->height, work->width));
    for (int64_t t = 0; t < work->evaluation->frames; t++) {
        v2v_watchdog_beat("evaluate: a frame's residual");
        rc = v2v_volume_read(volume, p->slices, t, p->mine.first, p->mine.count);
        if (rc == V2V_OK) {
            rc = v2v_as_recorded_read(work->views, &saturated, NULL, work->recording,
                                      &work->scaling, t);
        }
        V2V_TRY(v2v_par_agree(work->session->world, rc));
        work->saturated += saturated;
        const struct v2v_dark dark = v2v_dark_of_images(work->scratch, work->views, work->psf.views,
                                                        work->height, work->width);
        work->deficit = fmax(work->deficit, dark.below);
        V2V_TRY(v2v_projection_forward(p));
        v2v_as_recorded_predict(p->views, work->scratch, work->recording, 0, work->psf.views);
        v2v_saturated_cap(p->views, work->views, work->psf.views, work->height * work->width);
        match(work, t);
        judge_flux(work, t);
    }
done:
    v2v_projection_fini(p);
    return rc;
}

/* The file of uncertainties. Collective. */
static enum v2v_status open_output(struct work *work, struct v2v_volume_writer **writer)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_evaluation_job *job = work->job;
    struct v2v_provenance provenance = {0};
    const struct v2v_volume_info info =
        v2v_step_volume_of(work->session, v2v_recording_info(work->recording), &work->psf);
    V2V_TRY(
        v2v_provenance_init(&provenance, work->session, &work->psf, job->weights, &work->scaling));
    V2V_TRY(v2v_provenance_origin(&provenance, work->session, job->input,
                                  v2v_recording_info(work->recording)->before));
    V2V_TRY(v2v_volume_create(writer, job->uncertainty, &info,
                              1u << V2V_VOLUME_MEAN | 1u << V2V_VOLUME_UNCERTAINTY, provenance.item,
                              provenance.count, work->session->world));
done:
    v2v_provenance_fini(&provenance);
    return rc;
}

/* Means over the frames of which views were left out. */
static void summarize(struct work *work)
{
    struct v2v_evaluation *evaluation = work->evaluation;
    const struct v2v_consistency *found = &evaluation->consistency;
    const int64_t frames = found->frames, views = work->psf.views, slices = work->psf.slices;
    const struct v2v_volume_info info =
        v2v_step_volume_of(work->session, v2v_recording_info(work->recording), &work->psf);
    evaluation->heldout = v2v_mean_of_known(found->heldout, frames, 1);
    evaluation->heldout_sigmas = v2v_mean_of_known(found->heldout_sigmas, frames, 1);
    evaluation->disagreement = v2v_mean_of_known(found->disagreement, frames, 1);
    evaluation->resolution = v2v_mean_of_known(found->resolution, frames, 1);
    evaluation->resolution_um =
        info.pixel_size_um > 0.0 ? evaluation->resolution * info.pixel_size_um : NAN;
    for (int64_t v = 0; v < views; v++) {
        const struct {
            int figure;
            const double *of;
        } means[] = {{V2V_VIEW_HELDOUT, found->heldout_views + v},
                     {V2V_VIEW_HELDOUT_SIGMAS, found->heldout_views_sigmas + v}};
        for (size_t i = 0; i < sizeof means / sizeof *means; i++) {
            evaluation->of_view[means[i].figure][v] = v2v_mean_of_known(means[i].of, frames, views);
        }
        evaluation->of_view[V2V_VIEW_SHIFT_Y][v] =
            v2v_mean_of_known(found->shift + 2 * v, frames, 2 * views);
        evaluation->of_view[V2V_VIEW_SHIFT_X][v] =
            v2v_mean_of_known(found->shift + 2 * v + 1, frames, 2 * views);
    }
    for (int64_t z = 0; z < slices; z++) {
        evaluation->disagreement_slices[z] =
            v2v_mean_of_known(found->disagreement_slices + z, frames, slices);
    }
}

/* Views left out. Collective. */
static enum v2v_status leave_out(struct work *work)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_session *session = work->session;
    struct v2v_volume_writer *writer = NULL;
    struct v2v_consistency_job job = {.config = &session->config,
                                      .psf = &work->psf,
                                      .recording = work->recording,
                                      .scaling = &work->scaling,
                                      .weights = work->job->weights,
                                      .frames = work->job->heldout_frames};
    if (work->job->uncertainty != NULL) {
        V2V_TRY(open_output(work, &writer));
        job.writer = writer;
    }
    V2V_TRY(v2v_consistency_of(&work->evaluation->consistency, &job, session->world));
    summarize(work);
    if (writer != NULL) {
        V2V_TRY(v2v_volume_finish(&writer));
    }
done:
    v2v_volume_abandon(&writer);
    return rc;
}

/* All ranks know it; one says it. Local. */
static void warn(struct work *work, const char *text)
{
    struct v2v_evaluation *evaluation = work->evaluation;
    const size_t used = strlen(evaluation->warnings);
    if (v2v_step_on_root(work->session) && !work->session->common->quiet) {
        v2v_log(V2V_LOG_WARNING, "%s", text);
    }
    snprintf(evaluation->warnings + used, sizeof evaluation->warnings - used, "%s%s",
             used > 0 ? "; " : "", text);
}

/* What is trained at another brightness, too few iterations, noise that is left, a wrong offset. */
static void warn_of_flux(struct work *work)
{
    char text[128];
    if (work->off_light > 0.0) {
        snprintf(text, sizeof text,
                 "the volume has %.3g times the light of its views in frame %" PRId64,
                 work->evaluation->value[V2V_FIGURE_FLUX][work->off_frame], work->off_frame);
        warn(work, text);
    }
}

static void judge_light(struct work *work)
{
    double times = 0.0;
    const int64_t odd = v2v_match_odd_view(&times, work->of_view, work->psf.views);
    char text[128];
    if (odd >= 0) {
        snprintf(text, sizeof text,
                 "view %" PRId64 " is %.2f times as bright as the volume has it, beside the others",
                 v2v_kept_views_number(work->evaluation->without_views, odd), times);
        warn(work, text);
    }
}

/* The levels that the network was trained at. Collective. */
static enum v2v_status read_levels(struct work *work)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_session *session = work->session;
    struct v2v_weights_info info;
    const struct v2v_network_ops *network = NULL;
    rc = v2v_weights_file_info(&info, work->job->weights);
    if (rc == V2V_OK) {
        rc = v2v_network_of_weights(&network, &info, work->job->weights);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    work->trained = info.levels;
    work->trained_by = work->scaling; /* of homogeneous networks: a gain changes nothing */
    work->is_homogeneous =
        !v2v_estimator_of_network(network)->has_gain || session->config.model.homogeneous;
    if (!work->is_homogeneous) {
        V2V_TRY(v2v_scaling_decide(&work->trained_by, work->recording, &session->config.input,
                                   session->world));
    }
done:
    return rc;
}

/* Does the volume's file name another recording than the one at hand, or other PSFs? Collective. */
static enum v2v_status compare_origins(struct work *work)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_origin *of_volume = &work->evaluation->origin;
    struct v2v_origin here;
    char psf[V2V_ORIGIN_TEXT];
    snprintf(psf, sizeof psf, "%08" PRIx32, v2v_psf_file_sum(&work->psf));
    if (of_volume->psf[0] != '\0' && strcmp(psf, of_volume->psf) != 0) {
        warn(work, "the volume was made by other PSFs, or by these calibrated or normalised "
                   "otherwise, as its file says");
    }
    if (of_volume->recording[0] == '\0') {
        return V2V_OK;
    }
    V2V_TRY(v2v_origin_of(&here, work->job->input, 0, work->session));
    if (strcmp(here.recording, of_volume->recording) != 0) {
        warn(work, "the volume was made of another recording, as its file says");
    }
done:
    return rc;
}

/* What is decided by the whole recording, as it is where the volume is made, the offset as the
 * volume states it; then only the frames that the volume shows are left. Collective. */
static enum v2v_status settle(struct work *work, const struct v2v_volume_info *info)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_origin *origin = &work->evaluation->origin;
    const int64_t first = origin->first_frame;
    const int is_auto = work->session->config.input.offset.mode == V2V_NUMBER_AUTO;
    V2V_TRY(v2v_step_offset(work->session, &work->scaling, work->recording));
    if (is_auto && origin->recording[0] != '\0' && isfinite(origin->offset)) {
        work->scaling.pedestal = origin->offset == 0.0 ? work->scaling.pedestal : 0.0;
        work->scaling.offset = origin->offset;
        work->scaling.is_guessed = 0;
    }
    if (work->job->weights != NULL) {
        V2V_TRY(read_levels(work));
    }
    if (first >= 0 && first + info->frames <= v2v_recording_info(work->recording)->frames) {
        V2V_TRY(v2v_recording_cut(work->recording, first, info->frames));
    }
done:
    return rc;
}

/* Views without light lie nowhere. */
static int shows_nothing(const struct v2v_structure *structure)
{
    return structure->squares > 0.0 && !isfinite(v2v_structure_missed(structure));
}

/* What is wrong with the volume and with the recording, as far as they tell. */
static void find_faults(struct work *work)
{
    const struct v2v_evaluation *evaluation = work->evaluation;
    char text[128];
    warn_of_flux(work);
    judge_light(work);
    if (work->saturated > 0) {
        snprintf(text, sizeof text, "%" PRId64 " pixels of the views are saturated",
                 work->saturated);
        warn(work, text);
    }
    if (work->scaling.pedestal > 0.0) {
        snprintf(text, sizeof text,
                 "the views are hardly anywhere darker than %.4g: the camera's zero (--offset)?",
                 work->scaling.pedestal);
        warn(work, text);
    }
    if (work->scaling.is_guessed) {
        snprintf(text, sizeof text,
                 "%g is subtracted, the zero of signed counts, which most are above (--offset)",
                 work->scaling.offset);
        warn(work, text);
    }
    if (work->deficit > 0.0) {
        snprintf(text, sizeof text,
                 "where they are dark the views are %.4g below the offset %.4g: is it too high?",
                 work->deficit, work->scaling.offset);
        warn(work, text);
    }
    if (work->levels[0] != '\0') {
        warn(work, work->levels);
    }
    /* one other view tells too little of where a view should be */
    const int64_t views = evaluation->consistency.views > 2 ? evaluation->consistency.views : 0;
    for (int64_t v = 0; v < views; v++) {
        const double y = evaluation->of_view[V2V_VIEW_SHIFT_Y][v];
        const double x = evaluation->of_view[V2V_VIEW_SHIFT_X][v];
        if (sqrt(y * y + x * x) > out_of_register && !shows_nothing(&work->of_view[v].structure)) {
            snprintf(text, sizeof text,
                     "view %" PRId64 " is out of register: %+.1f, %+.1f pixels in y, x",
                     v2v_kept_views_number(evaluation->without_views, v), y, x);
            warn(work, text);
        }
    }
}

enum v2v_status v2v_evaluation_of_views(struct v2v_evaluation *evaluation,
                                        const struct v2v_evaluation_job *job,
                                        struct v2v_volume *volume,
                                        const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct work work = {.evaluation = evaluation, .job = job, .session = session};
    const struct v2v_volume_info *info = v2v_volume_info(volume);
    V2V_TRY(v2v_step_psf(session, &work.psf, job->psf));
    if (job->uncertainty != NULL && work.psf.views < 2) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: one view alone: there is no other to leave out, and no "
                         "uncertainty to write",
                         job->psf));
    }
    V2V_TRY(v2v_step_recording(session, &work.recording, job->input, &work.psf));
    V2V_TRY(settle(&work, info));
    V2V_TRY(check_shapes(&work, info));
    work.height = info->height;
    work.width = info->width;
    evaluation->views = work.psf.views;
    evaluation->without_views = session->config.input.without_views;
    evaluation->slices = work.psf.slices;
    V2V_TRY(v2v_par_agree(session->world, take_memory(&work)));
    V2V_TRY(compare_origins(&work));
    V2V_TRY(project(&work, volume));
    if (job->heldout_frames > 0) {
        V2V_TRY(leave_out(&work));
    }
    if (job->weights != NULL) {
        V2V_TRY(v2v_levels_compare(work.levels, &work.trained, work.is_homogeneous, work.recording,
                                   &work.trained_by, 0, session));
    }
    find_faults(&work);
done:
    v2v_mem_free(work.known);
    v2v_mem_free(work.scratch);
    v2v_mem_free(work.views);
    v2v_mem_free(work.of_view);
    v2v_mem_free(work.here);
    v2v_recording_close(&work.recording);
    v2v_psf_file_fini(&work.psf);
    return rc;
}
