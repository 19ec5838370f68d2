#include "v2v3d/eval/unlike.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/eval/as_recorded.h"
#include "v2v3d/eval/quality.h"
#include "v2v3d/optics/data_step.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/saturation.h"
#include "v2v3d/tensor/statistics.h"
#include <math.h>
#include <string.h>

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

struct v2v_dark v2v_unlike_zero(const float *views, float *scratch,
                                const struct v2v_unlike_input *input)
{
    const struct v2v_recording_info *info = v2v_recording_info(input->recording);
    struct v2v_dark dark =
        v2v_dark_of_images(scratch, views, info->views, info->height, info->width);
    dark.above = input->is_zero_told ? 0.0 : dark.above;
    return dark;
}

enum v2v_status v2v_unlike_read(float *views, int64_t *blind, double *clipped,
                                struct v2v_recording *recording, const struct v2v_scaling *scaling,
                                int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    struct v2v_scaling offset = *scaling;
    int64_t saturated = 0;
    offset.gain = 1.0;
    V2V_TRY(v2v_as_recorded_read(views, &saturated, blind, recording, &offset, t));
    if (clipped != NULL) {
        *clipped = (double)saturated / (double)(info->views * info->height * info->width);
    }
done:
    return rc;
}

/* Is a view of another brightness than in the reference? Local. */
static void judge(struct v2v_unlike *unlike, struct v2v_match *of_view, const float *views,
                  const struct v2v_unlike_input *input)
{
    const struct v2v_recording_info *info = v2v_recording_info(input->recording);
    const int64_t height = info->height, width = info->width;
    double times = 1.0;
    if (!v2v_structure_is_seen(views, info->views, height, width)) {
        unlike->figure[V2V_UNLIKE_UNSEEN] = 1.0;
        return;
    }
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < info->views; v++) {
        const int64_t first = v * height * width;
        of_view[v].structure =
            v2v_structure_of(views + first, input->reference + first, height, width);
    }
    const int64_t odd = v2v_match_odd_view(&times, of_view, info->views);
    if (odd >= 0 && (times < much_dimmer || times > 1.0 / much_dimmer)) {
        unlike->figure[V2V_UNLIKE_ODD] = (double)(odd + 1);
        unlike->figure[V2V_UNLIKE_TIMES] = times;
    }
}

/* Local: this rank's frames. */
static enum v2v_status judge_own(struct v2v_unlike *frames, const struct v2v_unlike_input *input,
                                 struct v2v_part mine)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(input->recording);
    const int64_t samples = v2v_mem_product(info->views, info->height, info->width);
    struct v2v_match *of_view = NULL;
    float *views = NULL, *scratch = NULL;
    V2V_TRY(V2V_ALLOC(of_view, "eval.unlike", info->views));
    V2V_TRY(V2V_ALLOC(views, "eval.unlike", samples));
    V2V_TRY(V2V_ALLOC(scratch, "eval.unlike", samples));
    for (int64_t t = mine.first; t < mine.first + mine.count; t++) {
        double *const figure = frames[t].figure;
        double clipped = 0.0;
        v2v_watchdog_beat("looking at the frames");
        if (t == input->shown) {
            continue;
        }
        V2V_TRY(v2v_unlike_read(views, NULL, &clipped, input->recording, input->scaling, t));
        figure[V2V_UNLIKE_CLIPPED] = clipped > V2V_MUCH_SATURATED ? clipped : 0.0;
        if (input->asks_zero) {
            const struct v2v_dark dark = v2v_unlike_zero(views, scratch, input);
            figure[V2V_UNLIKE_ABOVE] = dark.above;
            figure[V2V_UNLIKE_BELOW] = dark.below;
        }
        v2v_blind_fill(views, info->views, info->height * info->width);
        judge(&frames[t], of_view, views, input);
    }
done:
    v2v_mem_free(scratch);
    v2v_mem_free(views);
    v2v_mem_free(of_view);
    return rc;
}

enum v2v_status v2v_unlike_frames(struct v2v_unlike *frames, const struct v2v_unlike_input *input,
                                  const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const int64_t count = v2v_recording_info(input->recording)->frames;
    memset(frames, 0, (size_t)count * sizeof *frames);
    rc = judge_own(frames, input, v2v_par_part(count, v2v_comm_size(comm), v2v_comm_rank(comm)));
    V2V_TRY(v2v_par_agree(comm, rc));
    v2v_par_sum_f64(comm, frames->figure, V2V_UNLIKE_FIGURES * count);
done:
    return rc;
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

/* Frames that are unlike in another way count for nothing. */
static int is_known(const struct v2v_unlike *unlike, const struct v2v_misfit *misfit)
{
    int is_like = 1;
    for (int i = 0; i < V2V_UNLIKE_FIGURES; i++) {
        is_like = is_like && unlike->figure[i] == 0.0;
    }
    return is_like && misfit->coarse > 0.0;
}

struct v2v_unlike_explained v2v_unlike_explained(const struct v2v_unlike *frames,
                                                 const struct v2v_misfit *misfit,
                                                 const struct v2v_recording_info *info)
{
    struct v2v_unlike_explained found = {.best = -1};
    for (int64_t t = 0; t < info->frames; t++) {
        if (is_known(&frames[t], &misfit[t])) {
            const int is_best =
                found.best < 0 || left_of(&misfit[t]) < left_of(&misfit[found.best]);
            found.best = is_best ? t : found.best;
            found.known++;
        }
    }
    for (int64_t t = info->frames - 1; t >= 0 && found.best >= 0; t--) {
        if (is_known(&frames[t], &misfit[t]) && is_worse(&misfit[t], &misfit[found.best], info)) {
            found.moved++;
            found.first = t;
        }
    }
    return found;
}
