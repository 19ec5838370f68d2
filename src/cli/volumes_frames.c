#include "cli/volumes_frames.h"

#include "cli/steps.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/eval/quality.h"
#include "v2v3d/optics/data_step.h"
#include "v2v3d/par/agreement.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/saturation.h"
#include "v2v3d/tensor/statistics.h"
#include <math.h>

/* Of a view's brightness in the reference: structure that moves, noise of the reference itself and
 * bleaching stay well within. */
static const double much_dimmer = 0.5;

/* A frame's views are explained worse than those of the frame that is explained best: more of their
 * brightness is left beyond noise, which of little noise is what iterations leave; more of their
 * noise too, which bleaching does not change; and more than is left of views in register
 * (tests/bench/views.md). */
static const double much_more = 1.7, least_left = 2e-3, more_of_noise = 1.1, more_than_noise = 1.05;

/* Standard deviations of what is left of two frames of nothing but noise. */
static const double certain = 8.0;

/* Of every frame; ranks fill in theirs, the rest is 0, and all know all of it then. */
struct judged {
    double *unseen;  /* 1: shows nothing */
    double *odd;     /* 1 + the view that is of another brightness; 0: none is .. */
    double *times;   /* .. times that of the reference */
    double *above;   /* its dark lies so much above the offset .. */
    double *below;   /* .. or below */
    double *clipped; /* part of its samples that is saturated, where that is much */
};

enum { OF_A_FRAME = 6 };

/* Frames whose volumes tell how well they explain their views. */
struct explained {
    int64_t known;        /* how many */
    int64_t best;         /* is explained best, or -1 */
    int64_t moved, first; /* how many are worse than that, and the first of them */
};

/* @param clipped out: part of its samples that is saturated; NULL: not asked for */
static enum v2v_status read_frame(float *views, double *clipped,
                                  const struct v2v_volumes_made *made, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(made->recording);
    const int64_t samples = info->views * info->height * info->width;
    struct v2v_scaling offset = *made->scaling; /* with the shading of a calibration */
    offset.gain = 1.0;
    V2V_TRY(v2v_recording_read_seen(made->recording, views, offset.offset, NULL, t));
    if (clipped != NULL) {
        *clipped = (double)v2v_saturated_pixels(views, samples) / (double)samples;
    }
    v2v_scaling_apply(&offset, views, samples);
done:
    return rc;
}

/* How far a frame's dark lies above zero, where nothing was said of the offset, or below; 0, 0: it
 * does not. */
static void judge_zero(double *above, double *below, const float *views, float *scratch,
                       const struct v2v_volumes_made *made, const struct v2v_session *session)
{
    const struct v2v_recording_info *info = v2v_recording_info(made->recording);
    const int is_told =
        session->config.input.offset.mode == V2V_NUMBER_NONE || made->scaling->pedestal > 0.0;
    *above = is_told
                 ? 0.0
                 : v2v_pedestal_of_images(scratch, views, info->views, info->height, info->width);
    *below = v2v_deficit_of_images(scratch, views, info->views, info->height, info->width);
}

/* Frame t, beside the reference. Local. */
static void judge(struct judged *judged, int64_t t, struct v2v_match *of_view, const float *views,
                  const float *reference, const struct v2v_recording_info *info)
{
    const int64_t height = info->height, width = info->width;
    double times = 1.0;
    if (!v2v_structure_is_seen(views, info->views, height, width)) {
        judged->unseen[t] = 1.0;
        return;
    }
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < info->views; v++) {
        const int64_t first = v * height * width;
        of_view[v].structure = v2v_structure_of(views + first, reference + first, height, width);
    }
    const int64_t odd = v2v_match_odd_view(&times, of_view, info->views);
    if (odd >= 0 && (times < much_dimmer || times > 1.0 / much_dimmer)) {
        judged->odd[t] = (double)(odd + 1);
        judged->times[t] = times;
    }
}

/* Of the views' brightness, without the noise. */
static double left_of(const struct v2v_misfit *misfit)
{
    return misfit->noise_of_coarse * sqrt(fmax(misfit->coarse * misfit->coarse - 1.0, 0.0));
}

/* The root mean square of n sums of noise scatters by 1 / sqrt(2 n) of itself, of two frames
 * together by 1 / sqrt(n). */
static int is_worse(const struct v2v_misfit *misfit, const struct v2v_misfit *best,
                    const struct v2v_recording_info *info)
{
    enum { SIDE = V2V_DATA_STEP_SQUARE };
    const int64_t sums = info->views * (info->height / SIDE) * (info->width / SIDE);
    const double more = fmax(more_of_noise, 1.0 + certain / sqrt((double)v2v_larger(sums, 1)));
    return misfit->coarse > fmax(more_than_noise, more * best->coarse) &&
           left_of(misfit) > fmax(least_left, much_more * left_of(best));
}

/* Frames of which something else was told count for nothing. */
static int is_known(const struct judged *judged, const struct v2v_misfit *misfit, int64_t t)
{
    return misfit[t].coarse > 0.0 && judged->unseen[t] == 0.0 && judged->odd[t] == 0.0 &&
           judged->above[t] + judged->below[t] + judged->clipped[t] == 0.0;
}

static struct explained judge_explained(const struct judged *judged,
                                        const struct v2v_misfit *misfit, int64_t frames,
                                        const struct v2v_recording_info *info)
{
    struct explained found = {.best = -1};
    for (int64_t t = 0; t < frames; t++) {
        if (is_known(judged, misfit, t)) {
            const int is_best =
                found.best < 0 || left_of(&misfit[t]) < left_of(&misfit[found.best]);
            found.best = is_best ? t : found.best;
            found.known++;
        }
    }
    for (int64_t t = frames - 1; t >= 0 && found.best >= 0; t--) {
        if (is_known(judged, misfit, t) && is_worse(&misfit[t], &misfit[found.best], info)) {
            found.moved++;
            found.first = t;
        }
    }
    return found;
}

/* How many are not 0, and the first of them. */
static int64_t count(int64_t *first, const double *of_frame, int64_t frames)
{
    int64_t found = 0;
    for (int64_t t = frames - 1; t >= 0; t--) {
        if (of_frame[t] != 0.0) {
            found++;
            *first = t;
        }
    }
    return found;
}

static void warn_of_moved(const struct judged *judged, int64_t frames,
                          const struct v2v_volumes_made *made)
{
    const struct explained found =
        judge_explained(judged, made->misfit, frames, v2v_recording_info(made->recording));
    if (found.moved > 0) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: of means of 8 x 8 pixels of the views its volume misses %.3g times "
                "their noise, that of frame %lld %.3g times: did views move, or change places? "
                "%lld of %lld frames looked at are such",
                (long long)(made->first + found.first), made->misfit[found.first].coarse,
                (long long)(made->first + found.best), made->misfit[found.best].coarse,
                (long long)found.moved, (long long)found.known);
    }
}

/* @param such how many of all frames are; 0: not looked at */
static void warn_of_zero(double above, double below, int64_t t, int64_t such,
                         const struct v2v_volumes_made *made)
{
    const double offset = made->scaling->offset;
    char others[64] = "";
    if (such > 0) {
        snprintf(others, sizeof others, " %lld of %lld frames are such", (long long)such,
                 (long long)v2v_recording_info(made->recording)->frames);
    }
    if (above > 0.0) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld is hardly anywhere darker than %.4g above its offset %.4g: light of "
                "the background, or another zero of the camera (--offset %.6g)?%s",
                (long long)(made->first + t), above, offset, offset + above, others);
    } else if (below > 0.0) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld is %.4g below its offset %.4g where it is dark, as no light is: is the "
                "camera's zero lower (--offset %.6g)?%s",
                (long long)(made->first + t), below, offset, offset - below, others);
    }
}

static void warn(const struct judged *judged, int64_t frames, int64_t shown,
                 const struct v2v_volumes_made *made)
{
    int64_t first = 0;
    const int64_t before = made->first;
    const int64_t unseen = count(&first, judged->unseen, frames);
    if (unseen > 0) {
        v2v_log(V2V_LOG_WARNING,
                "%lld of %lld frames, frame %lld the first of them, show nothing above their noise",
                (long long)unseen, (long long)frames, (long long)(before + first));
    }
    const int64_t odd = count(&first, judged->odd, frames);
    if (odd > 0) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: view %lld is %.2f times as bright as in frame %lld, beside the other "
                "views; %lld of %lld frames have such a view",
                (long long)(before + first), (long long)judged->odd[first] - 1,
                judged->times[first], (long long)(before + shown), (long long)odd,
                (long long)frames);
    }
    const int64_t above = count(&first, judged->above, frames);
    warn_of_zero(above > 0 ? judged->above[first] : 0.0, 0.0, first, above, made);
    const int64_t below = count(&first, judged->below, frames);
    warn_of_zero(0.0, below > 0 ? judged->below[first] : 0.0, first, below, made);
    const int64_t clipped = count(&first, judged->clipped, frames);
    if (clipped > 0) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: %.2g %% of its pixels are saturated: how bright its volume is there "
                "they don't tell; "
                "%lld of %lld frames are such",
                (long long)(before + first), 100.0 * judged->clipped[first], (long long)clipped,
                (long long)frames);
    }
}

/* Local. */
static enum v2v_status judge_own(struct judged *judged, const float *reference, int64_t shown,
                                 int is_zero_open, const struct v2v_volumes_made *made,
                                 const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(made->recording);
    const struct v2v_part mine =
        v2v_par_part(info->frames, v2v_comm_size(session->world), v2v_comm_rank(session->world));
    const int64_t samples = v2v_mem_product(info->views, info->height, info->width);
    struct v2v_match *of_view = NULL;
    float *views = NULL, *scratch = NULL;
    V2V_TRY(V2V_ALLOC(of_view, "cli.frames", info->views));
    V2V_TRY(V2V_ALLOC(views, "cli.frames", samples));
    V2V_TRY(V2V_ALLOC(scratch, "cli.frames", samples));
    for (int64_t t = mine.first; t < mine.first + mine.count; t++) {
        v2v_watchdog_beat("looking at the frames");
        if (t != shown) {
            double clipped = 0.0;
            V2V_TRY(read_frame(views, &clipped, made, t));
            judged->clipped[t] = clipped > V2V_MUCH_SATURATED ? clipped : 0.0;
            if (is_zero_open) {
                judge_zero(judged->above + t, judged->below + t, views, scratch, made, session);
            }
            v2v_blind_fill(views, info->views, info->height * info->width);
            judge(judged, t, of_view, views, reference, info);
        }
    }
done:
    v2v_mem_free(scratch);
    v2v_mem_free(views);
    v2v_mem_free(of_view);
    return rc;
}

enum v2v_status v2v_volumes_judge_frames(const float *reference, int64_t shown, int is_zero_open,
                                         const struct v2v_volumes_made *made,
                                         const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const int64_t frames = v2v_recording_info(made->recording)->frames;
    double *of_frames = NULL;
    V2V_TRY(v2v_par_agree(session->world, V2V_ALLOC(of_frames, "cli.frames",
                                                    v2v_mem_product(OF_A_FRAME, frames, 1))));
    struct judged judged = {of_frames,
                            of_frames + frames,
                            of_frames + 2 * frames,
                            of_frames + 3 * frames,
                            of_frames + 4 * frames,
                            of_frames + 5 * frames};
    rc = judge_own(&judged, reference, shown, is_zero_open, made, session);
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_par_sum_f64(session->world, of_frames, OF_A_FRAME * frames);
    if (v2v_step_on_root(session)) {
        warn(&judged, frames, shown, made);
        warn_of_moved(&judged, frames, made);
    }
done:
    v2v_mem_free(of_frames);
    return rc;
}

/* Rank 0: of the frame that is shown, else of the last one. */
static enum v2v_status find_zero(int *is_odd, const float *reference, int64_t shown,
                                 const struct v2v_volumes_made *made,
                                 const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(made->recording);
    const int64_t samples = v2v_mem_product(info->views, info->height, info->width);
    const int64_t last = info->frames - 1;
    double above = 0.0, below = 0.0;
    float *scratch = NULL, *views = NULL;
    V2V_TRY(V2V_ALLOC(scratch, "cli.frames", samples));
    V2V_TRY(V2V_ALLOC(views, "cli.frames", samples));
    judge_zero(&above, &below, reference, scratch, made, session);
    if (above + below > 0.0) {
        warn_of_zero(above, below, shown, 0, made);
    } else if (last != shown) {
        V2V_TRY(read_frame(views, NULL, made, last));
        judge_zero(&above, &below, views, scratch, made, session);
        warn_of_zero(above, below, last, 0, made);
    }
    *is_odd = above + below > 0.0;
done:
    v2v_mem_free(views);
    v2v_mem_free(scratch);
    return rc;
}

enum v2v_status v2v_volumes_judge_offset(int *is_odd, const float *reference, int64_t shown,
                                         const struct v2v_volumes_made *made,
                                         const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    *is_odd = 0;
    if (v2v_step_on_root(session)) {
        rc = find_zero(is_odd, reference, shown, made, session);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_par_broadcast(session->world, is_odd, (int64_t)sizeof *is_odd, 0);
done:
    return rc;
}
