#include "v2v3d/io/level.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

/* Of the samples, those above the peak. */
static const double above_peak = 1e-3;

const char *v2v_level_name(enum v2v_level figure)
{
    static const char *const names[V2V_LEVEL_FIGURES] = {"mean", "peak", "noise",
                                                         "noise over mean"};
    return names[figure];
}

void v2v_level_of_frame(double level[V2V_LEVEL_FIGURES], float *scratch, const float *views,
                        int64_t count, int64_t height, int64_t width)
{
    const int64_t samples = v2v_mem_product(count, height, width);
    double sum = 0.0;
    for (int f = 0; f < V2V_LEVEL_FIGURES; f++) {
        level[f] = NAN;
    }
    for (int64_t i = 0; i < samples; i++) {
        sum += views[i] != V2V_BLIND ? (double)views[i] : 0.0;
    }
    if (!isfinite(sum)) {
        return;
    }
    const int64_t seen = samples - v2v_blind_count(views, samples);
    const double mean = sum / (double)seen;
    const double noise = v2v_noise_of_images(scratch, views, count, height, width);
    const double base = fmax(fabs(mean), V2V_LEVEL_LEAST_MEAN * noise);
    if (!(base > 0.0)) {
        return;
    }
    (void)v2v_blind_gather_seen(scratch, views, samples);
    level[V2V_LEVEL_MEAN] = mean;
    level[V2V_LEVEL_PEAK] =
        v2v_select(scratch, seen, seen - 1 - (int64_t)((double)seen * above_peak));
    level[V2V_LEVEL_NOISE] = noise;
    level[V2V_LEVEL_RATIO] = noise / base;
}

/* levels[t,figure] of all frames, on all ranks. */
static enum v2v_status measure(double **levels, struct v2v_recording *recording,
                               const struct v2v_scaling *scaling, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    const int64_t samples = v2v_mem_product(info->views, info->height, info->width);
    const struct v2v_part part =
        v2v_par_part(info->frames, v2v_comm_size(comm), v2v_comm_rank(comm));
    float *views = NULL, *scratch = NULL;
    rc = V2V_ALLOC(*levels, "io.level", v2v_mem_product(info->frames, V2V_LEVEL_FIGURES, 1));
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(views, "io.level", samples);
    }
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(scratch, "io.level", samples);
    }
    for (int64_t t = part.first; rc == V2V_OK && t < part.first + part.count; t++) {
        v2v_watchdog_beat("a frame's level");
        rc = v2v_recording_read_seen(recording, views, scaling->offset, NULL, t);
        if (rc == V2V_OK) {
            v2v_scaling_apply(scaling, views, samples);
            v2v_level_of_frame(*levels + t * V2V_LEVEL_FIGURES, scratch, views, info->views,
                               info->height, info->width);
        }
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    v2v_par_sum_f64(comm, *levels, info->frames * V2V_LEVEL_FIGURES);
done:
    v2v_mem_free(scratch);
    v2v_mem_free(views);
    return rc;
}

enum v2v_status v2v_level_range_add(struct v2v_level_range *range, struct v2v_recording *recording,
                                    const struct v2v_scaling *scaling, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const int64_t frames = v2v_recording_info(recording)->frames;
    double *levels = NULL;
    V2V_TRY(measure(&levels, recording, scaling, comm));
    for (int64_t t = 0; t < frames; t++) {
        const double *level = levels + t * V2V_LEVEL_FIGURES;
        if (isnan(level[V2V_LEVEL_MEAN])) {
            continue;
        }
        for (int f = 0; f < V2V_LEVEL_FIGURES; f++) {
            const int is_first = range->frames == 0;
            range->least[f] = is_first ? level[f] : fmin(range->least[f], level[f]);
            range->most[f] = is_first ? level[f] : fmax(range->most[f], level[f]);
        }
        range->frames++;
    }
done:
    v2v_mem_free(levels);
    return rc;
}

/* How many times a value is beyond the nearer end of the range; 1 inside, and where NaN. An end
 * that is not positive is no measure. */
static double factor_of(double value, double least, double most)
{
    if (value < least && least > 0.0) {
        return value > 0.0 ? least / value : INFINITY;
    }
    return value > most && most > 0.0 ? value / most : 1.0;
}

enum v2v_status v2v_level_judge(struct v2v_level_outlier *outlier,
                                const struct v2v_level_range *range, int is_homogeneous,
                                struct v2v_recording *recording, const struct v2v_scaling *scaling,
                                const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const int64_t frames = v2v_recording_info(recording)->frames;
    double *levels = NULL;
    *outlier = (struct v2v_level_outlier){.factor = 1.0};
    if (range->frames == 0) {
        return V2V_OK;
    }
    V2V_TRY(measure(&levels, recording, scaling, comm));
    for (int64_t t = 0; t < frames; t++) {
        for (int f = 0; f < V2V_LEVEL_FIGURES; f++) {
            const double value = levels[t * V2V_LEVEL_FIGURES + f];
            const double factor = factor_of(value, range->least[f], range->most[f]);
            if ((f == V2V_LEVEL_RATIO) == is_homogeneous && factor > outlier->factor) {
                *outlier = (struct v2v_level_outlier){t, (enum v2v_level)f, value, factor};
            }
        }
    }
done:
    v2v_mem_free(levels);
    return rc;
}
