#include "v2v3d/recon/recon.h"

#include "recon/recon_state.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/pad.h"
#include "v2v3d/tensor/statistics.h"
#include <string.h>

#define NO_FRAME INT64_MIN

/** Local: of frame t before the recording was cut, as users count. */
static int64_t number_of(const struct v2v_recon *recon, int64_t t)
{
    return v2v_recording_info(recon->recording)->before + t;
}

/** Cut the padding off output o and bring it to the recording's units. */
static enum v2v_status cut(struct v2v_recon *recon, int o, int64_t t)
{
    const struct v2v_estimator *estimator = recon->estimator;
    const int64_t slices = estimator->slices.count;
    double units = estimator->units / recon->level;
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < slices; z++) {
        for (int64_t y = 0; y < recon->own_rows; y++) {
            const float *in = recon->output[o] + (z * recon->rows + y) * estimator->width;
            float *out = recon->cut[o] + (z * recon->own_rows + y) * recon->width;
            for (int64_t x = 0; x < recon->width; x++) {
                out[x] = (float)(in[x] * units);
            }
        }
    }
    int64_t pixels = recon->own_rows * recon->width;
    int64_t bad = v2v_first_not_finite(recon->cut[o], slices * pixels);
    if (bad >= 0) {
        int64_t row = recon->first_row + bad / recon->width % recon->own_rows;
        return V2V_FAIL(V2V_E_NUMERIC,
                        "frame %lld, output %d: NaN or Inf at slice %lld, row %lld, column %lld",
                        (long long)number_of(recon, t), o + 1,
                        (long long)(estimator->slices.first + bad / pixels), (long long)row,
                        (long long)(bad % recon->width));
    }
    return V2V_OK;
}

/** Local: this rank was asked to stop, after its first round. */
static enum v2v_status heed_stop(const struct v2v_recon *recon)
{
    if (recon->rounds > 0 && v2v_stop_requested()) {
        return V2V_FAIL(V2V_STOPPED, "stopped on request");
    }
    return V2V_OK;
}

/** Local: the views of frame t, as the method takes them. */
static enum v2v_status load(struct v2v_recon *recon, struct v2v_fusion *fusion, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(V2V_FAULT_POINT("reconstruct.frame"));
    V2V_TRY(heed_stop(recon));
    V2V_TRY(v2v_fusion_read(fusion, recon->recorded, recon->recording, recon->scaling, t));
    recon->estimator->averaging = v2v_fusion_averaging(fusion);
    if (recon->is_homogeneous) {
        recon->level = v2v_scaling_level(recon->recorded, recon->padded, recon->views,
                                         recon->height, recon->width);
    }
    v2v_pad_reflect(recon->padded, recon->recorded, recon->views, recon->height, recon->width,
                    recon->estimator->height, recon->estimator->width);
done:
    return rc;
}

/** Collective(shard): frame t by itself. The status is this rank's. */
static enum v2v_status run_whole(struct v2v_recon *recon, int64_t t)
{
    struct v2v_estimator *estimator = recon->estimator;
    estimator->frame = number_of(recon, t);
    return estimator->ops->run(estimator, recon->output, recon->padded, recon->monitor);
}

/** Collective(shard): what of frame t is not as in the key frame. The status is this rank's.
 *  @param part of the frame that was computed; out */
static enum v2v_status run_rest(struct v2v_recon *recon, double *part, int64_t t)
{
    recon->estimator->frame = number_of(recon, t);
    return v2v_still_run(recon->still, part, recon->output[0], recon->padded,
                         v2v_fusion_recorded(recon->fusion));
}

/** Collective(shard): the outputs that this rank holds. The status is this rank's. */
static enum v2v_status compute(struct v2v_recon *recon, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    double part = 1.0; /* of a key frame */
    if (recon->still == NULL) {
        V2V_TRY(run_whole(recon, t));
        part = recon->estimator->computed_part;
        recon->misfit[t] = recon->estimator->misfit;
    } else if (t != recon->key) {
        V2V_TRY(run_rest(recon, &part, t));
        recon->misfit[t] = recon->estimator->misfit;
    } else {
        v2v_still_recall(recon->still, recon->output[0]);
        recon->misfit[t] = recon->key_misfit;
    }
    recon->parts[0] += part;
    recon->parts[1] += 1.0;
    V2V_TRY(v2v_volume_wait(recon->writer)); /* the frame before has left these volumes */
    for (int o = 0; o < recon->outputs; o++) {
        if (v2v_estimator_holds(recon->estimator, o)) {
            V2V_TRY(cut(recon, o, t));
        }
    }
done:
    return rc;
}

/** Collective(sample): the result of a frame, which both ranks of a pair hold. */
static const float *combine(struct v2v_recon *recon)
{
    if (recon->outputs == 1) {
        return recon->cut[0];
    }
    v2v_combination_run(recon->combination, recon->mean,
                        (const float *const[]){recon->cut[0], recon->cut[1]}, recon->recorded);
    return recon->mean;
}

/** Collective(shard): slices of a volume that this rank writes; `rows` itself if they are whole. */
static const float *make_slices(struct v2v_recon *recon, const float *rows)
{
    if (recon->slicing == NULL) {
        return rows;
    }
    v2v_slicing_to_slices(recon->slicing, recon->whole, rows);
    return recon->whole;
}

/** Collective(sample): the key frame of frame t: of its `refresh` frames, counted from the
 *  recording's first, so that a range has the bits of the whole. */
static enum v2v_status make_key(struct v2v_recon *recon, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_comm *sample = recon->grid.sample;
    const int64_t before = v2v_recording_info(recon->recording)->before;
    const int64_t group = t - (t + before) % recon->refresh;
    struct v2v_fusion *fusion = recon->of_key != NULL ? recon->of_key : recon->fusion;
    if (group != recon->group) {
        int64_t key = group;
        recon->group = NO_FRAME;
        rc = v2v_key_frames_choose(recon->keys, &key, recon->recorded, recon->recording,
                                   recon->scaling, group, recon->refresh);
        V2V_TRY(v2v_par_agree(sample, rc));
        /* one answer for all: ranks on other processors may round another way */
        v2v_par_broadcast(sample, &key, (int64_t)sizeof key, 0);
        V2V_TRY(v2v_par_agree(sample, load(recon, fusion, key)));
        V2V_TRY(v2v_par_agree(sample, run_whole(recon, key)));
        recon->key_misfit = recon->estimator->misfit;
        v2v_still_keep(recon->still, recon->padded, recon->output[0]);
        recon->group = group;
        recon->key = key;
    }
done:
    return rc;
}

/** Collective(sample): frame t's outputs; a key frame's are there. The status is that of all its
 *  ranks. */
static enum v2v_status make_frame(struct v2v_recon *recon, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    if (recon->still != NULL) {
        V2V_TRY(make_key(recon, t));
    }
    if (t != recon->key) {
        V2V_TRY(v2v_par_agree(recon->grid.sample, load(recon, recon->fusion, t)));
    }
    V2V_TRY(v2v_par_agree(recon->grid.sample, compute(recon, t)));
done:
    return rc;
}

/** Collective(world) as v2v_volume_put: every rank of a shard gets some slices as a whole. It puts
 *  those of its outputs, and a pair's ranks half of the mean each; a rank without a frame (t = -1)
 *  takes part with nothing. The status is this rank's. */
static enum v2v_status put_frame(struct v2v_recon *recon, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_grid *grid = &recon->grid;
    struct v2v_part own = {0, 0}, half = {0, 0};
    const float *slices = NULL;
    int64_t frame = t >= 0 ? t : 0;
    if (t >= 0) {
        own = recon->own;
        half = v2v_par_part(own.count, grid->branch_size, grid->branch_rank);
        slices = make_slices(recon, combine(recon)) + half.first * recon->height * recon->width;
    }
    rc = v2v_volume_put_later(recon->writer, V2V_VOLUME_MEAN, slices, frame, own.first + half.first,
                              half.count);
    for (int o = 0; recon->branches && o < recon->outputs; o++) {
        int is_held = t >= 0 && v2v_estimator_holds(recon->estimator, o);
        if (rc == V2V_OK && recon->slicing != NULL) {
            rc = v2v_volume_wait(recon->writer); /* its slices come where the last ones are */
        }
        slices = is_held ? make_slices(recon, recon->cut[o]) : NULL; /* with the other ranks */
        if (rc == V2V_OK) {
            rc = v2v_volume_put_later(recon->writer, V2V_VOLUME_BRANCH1 + o, slices, frame,
                                      own.first, is_held ? own.count : 0);
        }
    }
    return rc;
}

/** Collective(sample): a round of this rank, with frame t, or none (t = -1), or after a failure, of
 *  which the others do not know yet. The status is that of the frame's ranks. */
static enum v2v_status make_round(struct v2v_recon *recon, int64_t t, enum v2v_status earlier)
{
    enum v2v_status rc = earlier;
    if (rc == V2V_OK && t >= 0) {
        v2v_watchdog_beat("reconstructing a frame");
        rc = make_frame(recon, t);
    } else if (rc == V2V_OK && recon->grid.idle) {
        rc = heed_stop(recon);
    }
    return rc;
}

/** Collective(world) as v2v_volume_put, Collective(sample) but for that: what was made here. */
static enum v2v_status put_round(struct v2v_recon *recon, int64_t t, enum v2v_status made)
{
    enum v2v_status rc = made, put = V2V_OK;
    const struct v2v_comm *sample = recon->grid.sample;
    int has_frame = rc == V2V_OK && t >= 0;
    put = put_frame(recon, has_frame ? t : -1);
    if (has_frame) {
        V2V_TRY(v2v_par_agree(sample, put));
        V2V_TRY(v2v_volume_mark_later(recon->writer, t, sample));
    }
    recon->rounds++;
    rc = rc == V2V_OK ? put : rc;
done:
    return rc;
}

/** How ranks take turns: `run` frames that follow one another each time, the first one's run `lead`
 *  shorter; so many rounds in all. */
struct turns {
    int64_t run, lead, rounds;
};

/** Local: where frames have a key frame, each rank takes all of its frames from one place, so that
 *  few key frames are made twice; but for a file that is written in order, those of a key frame, or
 *  the file would keep most of the others' frames waiting. */
static struct turns take_turns(const struct v2v_recon *recon)
{
    const int64_t ranks = recon->grid.data_size, refresh = recon->refresh;
    const int64_t first = v2v_recording_info(recon->recording)->before + recon->todo[0];
    struct turns turns = {.run = 1};
    if (refresh > 1) {
        turns.run = v2v_larger(v2v_parts(recon->frames, ranks), 1);
    }
    if (v2v_volume_keeps_step(recon->writer) && turns.run > refresh) {
        turns.run = refresh;
        turns.lead = first % refresh;
    }
    turns.rounds = v2v_parts(v2v_parts(recon->frames + turns.lead, turns.run), ranks) * turns.run;
    return turns;
}

/** Local: this rank's, or -1. */
static int64_t frame_of_round(const struct v2v_recon *recon, const struct turns *turns,
                              int64_t round)
{
    const struct v2v_grid *grid = &recon->grid;
    const int64_t turn = round / turns->run * grid->data_size + grid->data_rank;
    const int64_t i = turn * turns->run + round % turns->run - turns->lead;
    return !grid->idle && i >= 0 && i < recon->frames ? recon->todo[i] : -1;
}

/** Collective(world): the frames of all ranks, each rank's as fast as it can. */
static enum v2v_status run_rounds(struct v2v_recon *recon)
{
    enum v2v_status rc = V2V_OK, mine = V2V_OK;
    const int64_t ranks = recon->grid.data_size;
    const struct turns turns = take_turns(recon);
    struct v2v_progress progress;
    v2v_progress_begin(&progress, recon->title, 0, recon->frames);
    V2V_TRY(v2v_agreement_meet(recon->agreement)); /* all are connected: beats get through */
    for (int64_t round = 0; round < turns.rounds; round++) {
        const int64_t t = frame_of_round(recon, &turns, round);
        mine = make_round(recon, t, mine);
        if (v2v_volume_keeps_step(recon->writer)) {
            V2V_TRY(v2v_agreement_meet(recon->agreement));
        }
        mine = put_round(recon, t, mine);
        V2V_TRY(v2v_agreement_tell(recon->agreement, mine));
        if (mine == V2V_OK) {
            v2v_progress_step(&progress, v2v_smaller((round + 1) * ranks, recon->frames), NULL);
        }
    }
    V2V_TRY(v2v_agreement_end(recon->agreement));
done:
    v2v_progress_end(&progress);
    return rc;
}

/** Collective(world): whatever ended the run, frames that were made come to the disk. */
static enum v2v_status end_writing(const struct v2v_recon *recon, enum v2v_status rc)
{
    struct v2v_status_record earlier;
    v2v_status_keep(&earlier);
    v2v_watchdog_beat("writing the last frames");
    const enum v2v_status written = v2v_volume_wait(recon->writer);
    if (written > rc) {
        rc = written;
    } else {
        v2v_status_restore(&earlier);
    }
    return v2v_par_agree(recon->grid.world, rc);
}

/** Local: the frames that are not done yet. */
static enum v2v_status list_frames(struct v2v_recon *recon)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(recon->recording);
    recon->frames = 0;
    v2v_mem_free(recon->todo);
    v2v_mem_free(recon->misfit);
    recon->todo = NULL;
    recon->misfit = NULL;
    V2V_TRY(V2V_ALLOC(recon->todo, "recon.frames", info->frames));
    V2V_TRY(V2V_ALLOC(recon->misfit, "recon.frames", info->frames));
    if (info->views != recon->views) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "the recording has %lld views, the method takes %lld",
                         (long long)info->views, (long long)recon->views));
    }
    for (int64_t t = 0; t < info->frames; t++) {
        if (!v2v_volume_is_done(recon->writer, t)) {
            recon->todo[recon->frames++] = t;
        }
    }
done:
    return rc;
}

enum v2v_status v2v_recon_run(struct v2v_recon *recon, struct v2v_recording *recording,
                              const struct v2v_scaling *scaling, struct v2v_volume_writer *writer,
                              int branches, const struct v2v_monitor *monitor)
{
    enum v2v_status rc = V2V_OK;
    recon->recording = recording;
    recon->scaling = scaling;
    recon->writer = writer;
    recon->branches = branches;
    recon->monitor = monitor;
    recon->group = NO_FRAME;
    recon->key = NO_FRAME;
    if (recon->estimator != NULL) {
        recon->estimator->units = 1 / scaling->gain;
    }
    V2V_TRY(v2v_par_agree(recon->grid.world, list_frames(recon)));
    V2V_TRY(end_writing(recon, run_rounds(recon)));
done:
    return rc;
}

void v2v_recon_misfits(const struct v2v_recon *recon, struct v2v_misfit *misfit)
{
    const int64_t frames = v2v_recording_info(recon->recording)->frames;
    memcpy(misfit, recon->misfit, (size_t)frames * sizeof *misfit);
    v2v_par_max_f64(recon->grid.world, &misfit->missed,
                    frames * (int64_t)(sizeof *misfit / sizeof misfit->missed));
}

/* By the ranks of one frame: others hold the same. */
enum v2v_status v2v_recon_project(struct v2v_recon *recon, float *views, struct v2v_volume *volumes,
                                  int64_t t)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_estimator *estimator = recon->estimator;
    const struct v2v_grid *grid = &recon->grid;
    const int is_mine = !grid->idle && grid->data_rank == 0;
    const int64_t samples = v2v_mem_product(recon->views, recon->height, recon->width);
    if (is_mine) {
        V2V_ASSERT(estimator->height == recon->height && estimator->width == recon->width);
        rc = v2v_volume_read(volumes, recon->output[0], t, estimator->slices.first,
                             estimator->slices.count);
    }
    V2V_TRY(v2v_par_agree(grid->world, rc));
    if (is_mine) {
        estimator->ops->project(estimator, views, recon->output[0]);
    } else {
        memset(views, 0, (size_t)samples * sizeof *views);
    }
    v2v_par_sum_f32(grid->world, views, samples);
done:
    return rc;
}

double v2v_recon_computed_part(const struct v2v_recon *recon)
{
    double parts[2] = {recon->parts[0], recon->parts[1]};
    v2v_par_sum_f64(recon->grid.world, parts, 2);
    return parts[1] > 0.0 ? parts[0] / parts[1] : 1.0;
}

double v2v_recon_left(const struct v2v_recon *recon)
{
    double left = recon->still != NULL ? v2v_still_left(recon->still) : 0.0;
    v2v_par_max_f64(recon->grid.world, &left, 1);
    return left;
}
