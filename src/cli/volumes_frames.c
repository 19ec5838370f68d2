#include "cli/volumes_frames.h"

#include "cli/steps.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/conf/kept_views.h"
#include "v2v3d/eval/unlike.h"

#include <stdio.h>

static int64_t frames_of(const struct v2v_volumes_made *made)
{
    return v2v_recording_info(made->recording)->frames;
}

static struct v2v_unlike_input input_of(const float *reference, int64_t shown,
                                        const struct v2v_volumes_made *made,
                                        const struct v2v_session *session)
{
    return (struct v2v_unlike_input){.recording = made->recording,
                                     .scaling = made->scaling,
                                     .reference = reference,
                                     .shown = shown,
                                     .is_zero_told =
                                         session->config.input.offset.mode == V2V_NUMBER_NONE ||
                                         made->scaling->pedestal > 0.0};
}

/* @param such how many of all frames are; 0: not looked at */
static void warn_of_zero(struct v2v_dark dark, int64_t t, int64_t such,
                         const struct v2v_volumes_made *made)
{
    const double offset = made->scaling->offset;
    char others[64] = "";
    if (such > 0) {
        snprintf(others, sizeof others, " %lld of %lld frames are such", (long long)such,
                 (long long)frames_of(made));
    }
    if (dark.above > 0.0) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld is hardly anywhere darker than %.4g above its offset %.4g: light of "
                "the background, or another zero of the camera (--offset %.6g)?%s",
                (long long)(made->first + t), dark.above, offset, offset + dark.above, others);
    } else if (dark.below > 0.0) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld is %.4g below its offset %.4g where it is dark, as no light is: is the "
                "camera's zero lower (--offset %.6g)?%s",
                (long long)(made->first + t), dark.below, offset, offset - dark.below, others);
    }
}

/* How many frames have a figure that is not 0, and the first of them. */
static int64_t count(int64_t *first, const struct v2v_unlike *frames, enum v2v_unlike_figure figure,
                     int64_t all)
{
    int64_t found = 0;
    for (int64_t t = all - 1; t >= 0; t--) {
        if (frames[t].figure[figure] != 0.0) {
            found++;
            *first = t;
        }
    }
    return found;
}

static void warn(const struct v2v_unlike *frames, int64_t shown,
                 const struct v2v_volumes_made *made, const struct v2v_session *session)
{
    int64_t first = 0;
    const int64_t before = made->first, all = frames_of(made);
    const int64_t unseen = count(&first, frames, V2V_UNLIKE_UNSEEN, all);
    if (unseen > 0) {
        v2v_log(V2V_LOG_WARNING,
                "%lld of %lld frames, frame %lld the first of them, show nothing above their noise",
                (long long)unseen, (long long)all, (long long)(before + first));
    }
    const int64_t odd = count(&first, frames, V2V_UNLIKE_ODD, all);
    if (odd > 0) {
        const int64_t view = (int64_t)frames[first].figure[V2V_UNLIKE_ODD] - 1;
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: view %lld is %.2f times as bright as in frame %lld, beside the other "
                "views; %lld of %lld frames have such a view",
                (long long)(before + first),
                (long long)v2v_kept_views_number(session->config.input.without_views, view),
                frames[first].figure[V2V_UNLIKE_TIMES], (long long)(before + shown), (long long)odd,
                (long long)all);
    }
    const int64_t above = count(&first, frames, V2V_UNLIKE_ABOVE, all);
    if (above > 0) {
        warn_of_zero((struct v2v_dark){.above = frames[first].figure[V2V_UNLIKE_ABOVE]}, first,
                     above, made);
    }
    const int64_t below = count(&first, frames, V2V_UNLIKE_BELOW, all);
    if (below > 0) {
        warn_of_zero((struct v2v_dark){.below = frames[first].figure[V2V_UNLIKE_BELOW]}, first,
                     below, made);
    }
    const int64_t clipped = count(&first, frames, V2V_UNLIKE_CLIPPED, all);
    if (clipped > 0) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: %.2g %% of its pixels are saturated: how bright its volume is there "
                "they don't tell; "
                "%lld of %lld frames are such",
                (long long)(before + first), 100.0 * frames[first].figure[V2V_UNLIKE_CLIPPED],
                (long long)clipped, (long long)all);
    }
}

static void warn_of_moved(const struct v2v_unlike *frames, const struct v2v_volumes_made *made)
{
    const struct v2v_unlike_explained found =
        v2v_unlike_explained(frames, made->misfit, v2v_recording_info(made->recording));
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

enum v2v_status v2v_volumes_judge_frames(const float *reference, int64_t shown, int is_zero_open,
                                         const struct v2v_volumes_made *made,
                                         const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_unlike *frames = NULL;
    struct v2v_unlike_input input = input_of(reference, shown, made, session);
    input.asks_zero = is_zero_open;
    V2V_TRY(v2v_par_agree(session->world, V2V_ALLOC(frames, "cli.frames", frames_of(made))));
    V2V_TRY(v2v_unlike_frames(frames, &input, session->world));
    if (v2v_step_on_root(session)) {
        warn(frames, shown, made, session);
        warn_of_moved(frames, made);
    }
done:
    v2v_mem_free(frames);
    return rc;
}

/* Rank 0: of the frame that is shown, else of the last one. */
static enum v2v_status find_zero(int *is_odd, const struct v2v_unlike_input *input,
                                 const struct v2v_volumes_made *made)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(made->recording);
    const int64_t samples = v2v_mem_product(info->views, info->height, info->width);
    const int64_t last = info->frames - 1;
    float *scratch = NULL, *views = NULL;
    V2V_TRY(V2V_ALLOC(scratch, "cli.frames", samples));
    V2V_TRY(V2V_ALLOC(views, "cli.frames", samples));
    struct v2v_dark dark = v2v_unlike_zero(input->reference, scratch, input);
    if (dark.above + dark.below > 0.0) {
        warn_of_zero(dark, input->shown, 0, made);
    } else if (last != input->shown) {
        V2V_TRY(v2v_unlike_read(views, NULL, NULL, made->recording, made->scaling, last));
        dark = v2v_unlike_zero(views, scratch, input);
        warn_of_zero(dark, last, 0, made);
    }
    *is_odd = dark.above + dark.below > 0.0;
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
    const struct v2v_unlike_input input = input_of(reference, shown, made, session);
    *is_odd = 0;
    if (v2v_step_on_root(session)) {
        rc = find_zero(is_odd, &input, made);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_par_broadcast(session->world, is_odd, (int64_t)sizeof *is_odd, 0);
done:
    return rc;
}
