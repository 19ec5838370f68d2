#include "v2v3d/recon/network.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/par/agreement.h"
#include "v2v3d/par/slicing.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/pad.h"
#include "v2v3d/tensor/statistics.h"

struct job {
    struct v2v_model *model;
    struct v2v_recording *recording;
    const struct v2v_scaling *scaling;
    struct v2v_volume_writer *writer;
    const struct v2v_grid *grid;
    int64_t frames, views, slices;
    int64_t *todo;                       /* [frames] those that are not done yet, in order */
    int64_t height, width;               /* of a frame */
    int64_t padded_height, padded_width; /* multiples of V2V_MODEL_GRID */
    struct v2v_part rows;                /* of the padded frame that this rank computes .. */
    int64_t own_rows;                    /* .. and what of them is not padding */
    float *recorded;                     /* [v,y,x] as recorded */
    float *padded;                       /* [v,y,x] what the network takes */
    float *output[2];                    /* [z,rows,x] padded; NULL for a branch not held */
    float *branch[2];            /* [z,own rows,x] in units of the recording; NULL likewise */
    float *mean;                 /* [z,own rows,x] */
    struct v2v_slicing *slicing; /* rows of all ranks of the shard and whole slices; NULL: alone */
    float *whole;                /* [z of this rank,y,x], in an output that was cut already */
    double parts[2];             /* computed of the frames so far, and how many */
    int branches;                /* are written, too */
    int64_t rounds;              /* done: every attempt gets one further (RELIABILITY 5) */
    struct v2v_agreement *agreement; /* of all ranks, on the rounds */
};

/** Local: does this rank compute branch b? An idle rank holds none. */
static int holds(const struct v2v_grid *grid, int b)
{
    return !grid->idle && (grid->branch_size == 1 || grid->branch_rank == b);
}

/** Local: rows of the frame, without its padding, that a rank of the shard computes. */
static struct v2v_part own_rows(const struct job *job, int rank)
{
    struct v2v_part rows = v2v_model_rows_of(job->model, rank);
    return (struct v2v_part){rows.first, v2v_within(job->height - rows.first, 0, rows.count)};
}

/** Local: where ranks share frames. */
static enum v2v_status plan_slicing(struct job *job)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_comm *shard = job->grid->shard;
    struct v2v_part *rows = NULL;
    V2V_TRY(V2V_ALLOC(rows, "recon.slices", v2v_comm_size(shard)));
    for (int r = 0; r < v2v_comm_size(shard); r++) {
        rows[r] = own_rows(job, r);
    }
    V2V_TRY(v2v_slicing_create(&job->slicing, shard, job->slices, job->height, job->width, rows));
done:
    v2v_mem_free(rows);
    return rc;
}

/** Local: the outputs of the branches held; the first one's memory is that of whole slices too. */
static enum v2v_status take_volumes(struct job *job)
{
    enum v2v_status rc = V2V_OK;
    int64_t volume = v2v_mem_product(job->slices, job->own_rows, job->width);
    int64_t output = v2v_mem_product(job->slices, job->rows.count, job->padded_width);
    int64_t whole = job->slicing == NULL ? 0
                                         : v2v_mem_product(v2v_slicing_own(job->slicing).count,
                                                           job->height, job->width);
    V2V_TRY(V2V_ALLOC(job->mean, "recon.volumes", volume));
    for (int b = 0; b < 2; b++) {
        if (holds(job->grid, b)) {
            int is_first = job->whole == NULL;
            int64_t floats = is_first && whole > output ? whole : output;
            V2V_TRY(V2V_ALLOC(job->output[b], "recon.volumes", floats));
            V2V_TRY(V2V_ALLOC(job->branch[b], "recon.volumes", volume));
            job->whole = is_first ? job->output[b] : job->whole;
        }
    }
done:
    return rc;
}

/** Local: for the views, and for take_volumes: of every row the mean and two of each branch held,
 *  and whole slices. */
static void leave_room(struct job *job)
{
    int64_t pixels = job->height * job->width, padded = job->padded_height * job->padded_width;
    int64_t images = 1 + 2 * (int64_t)(holds(job->grid, 0) + holds(job->grid, 1));
    int64_t ranks = job->grid->shard_size, slices = ranks > 1 ? v2v_parts(job->slices, ranks) : 0;
    v2v_model_leave_room(job->model, job->views * (pixels + padded) + slices * pixels,
                         images * job->slices * job->padded_width);
}

/** Local: sizes, plan and memory. An idle rank needs none of them. */
static enum v2v_status job_plan(struct job *job)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(job->recording);
    V2V_TRY(v2v_agreement_create(&job->agreement, job->grid->world));
    V2V_TRY(V2V_ALLOC(job->todo, "recon.frames", info->frames));
    for (int64_t t = 0; t < info->frames; t++) {
        if (!v2v_volume_is_done(job->writer, t)) {
            job->todo[job->frames++] = t;
        }
    }
    if (job->grid->idle) {
        goto done;
    }
    const struct v2v_model_spec *spec = v2v_model_spec(job->model);
    if (info->views != spec->views) {
        return V2V_FAIL(V2V_E_INPUT, "the recording has %lld views, the network takes %lld",
                        (long long)info->views, (long long)spec->views);
    }
    job->views = info->views;
    job->slices = spec->slices;
    job->height = info->height;
    job->width = info->width;
    job->padded_height = v2v_pad_size(info->height, V2V_MODEL_GRID);
    job->padded_width = v2v_pad_size(info->width, V2V_MODEL_GRID);
    leave_room(job);
    V2V_TRY(v2v_model_plan(job->model, job->padded_height, job->padded_width, 0));
    job->rows = v2v_model_rows(job->model);
    job->own_rows = own_rows(job, v2v_comm_rank(job->grid->shard)).count;
    V2V_TRY(V2V_ALLOC(job->recorded, "recon.views",
                      v2v_mem_product(job->views, job->height, job->width)));
    V2V_TRY(V2V_ALLOC(job->padded, "recon.views",
                      v2v_mem_product(job->views, job->padded_height, job->padded_width)));
    if (job->grid->shard_size > 1) {
        V2V_TRY(plan_slicing(job));
    }
    V2V_TRY(take_volumes(job));
done:
    return rc;
}

static void job_fini(struct job *job)
{
    for (int b = 0; b < 2; b++) {
        v2v_mem_free(job->branch[b]);
        v2v_mem_free(job->output[b]);
    }
    v2v_agreement_destroy(&job->agreement);
    v2v_slicing_destroy(&job->slicing);
    v2v_mem_free(job->mean);
    v2v_mem_free(job->padded);
    v2v_mem_free(job->recorded);
    v2v_mem_free(job->todo);
}

/** Cut the padding off branch b and bring it to the recording's units. */
static enum v2v_status cut(struct job *job, int b, int64_t t)
{
    double units = 1 / job->scaling->gain;
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < job->slices; z++) {
        for (int64_t y = 0; y < job->own_rows; y++) {
            const float *in = job->output[b] + (z * job->rows.count + y) * job->padded_width;
            float *out = job->branch[b] + (z * job->own_rows + y) * job->width;
            for (int64_t x = 0; x < job->width; x++) {
                out[x] = (float)(in[x] * units);
            }
        }
    }
    int64_t pixels = job->own_rows * job->width;
    int64_t bad = v2v_first_not_finite(job->branch[b], job->slices * pixels);
    if (bad >= 0) {
        int64_t row = job->rows.first + bad / job->width % job->own_rows;
        return V2V_FAIL(V2V_E_NUMERIC,
                        "frame %lld, branch %d: NaN or Inf at slice %lld, row %lld, column %lld",
                        (long long)t, b + 1, (long long)(bad / pixels), (long long)row,
                        (long long)(bad % job->width));
    }
    return V2V_OK;
}

/** Local: this rank was asked to stop, after its first round. */
static enum v2v_status heed_stop(const struct job *job)
{
    if (job->rounds > 0 && v2v_stop_requested()) {
        return V2V_FAIL(V2V_STOPPED, "stopped on request");
    }
    return V2V_OK;
}

/** Local: the views of frame t, as the network takes them. */
static enum v2v_status load(struct job *job, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(V2V_FAULT_POINT("reconstruct.frame"));
    V2V_TRY(heed_stop(job));
    V2V_TRY(v2v_recording_read(job->recording, job->recorded, t));
    v2v_scaling_apply(job->scaling, job->recorded, job->views * job->height * job->width);
    v2v_pad_reflect(job->padded, job->recorded, job->views, job->height, job->width,
                    job->padded_height, job->padded_width);
done:
    return rc;
}

/** Collective(shard): the volumes of the branches that this rank holds. The status is this rank's.
 */
static enum v2v_status compute(struct job *job, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    v2v_model_forward(job->model, job->output[0], job->output[1], job->padded);
    job->parts[0] += v2v_model_computed_part(job->model);
    job->parts[1] += 1.0;
    for (int b = 0; b < 2; b++) {
        if (holds(job->grid, b)) {
            V2V_TRY(cut(job, b, t));
        }
    }
done:
    return rc;
}

/** Collective(pair): both ranks of a pair hold the mean of the two volumes. Halves are added, so
 *  that nothing overflows, and x + y = y + x: one rank and two give the same bits. */
static void average(struct job *job)
{
    int64_t count = job->slices * job->own_rows * job->width;
    const float *first = job->branch[0] != NULL ? job->branch[0] : job->branch[1];
    const float *second = first == job->branch[0] ? job->branch[1] : NULL;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < count; i++) {
        float sum = 0.0f + 0.5f * first[i];
        job->mean[i] = second != NULL ? sum + 0.5f * second[i] : sum;
    }
    if (job->grid->branch_size == 2) {
        v2v_par_sum_f32(job->grid->pair, job->mean, count);
    }
}

/** Collective(shard): the slices of a volume that this rank writes; `rows` itself on a rank alone.
 */
static const float *make_slices(struct job *job, const float *rows)
{
    if (job->slicing == NULL) {
        return rows;
    }
    v2v_slicing_to_slices(job->slicing, job->whole, rows);
    return job->whole;
}

/** Collective(sample): frame t's volumes. The status is that of all its ranks. */
static enum v2v_status make_frame(struct job *job, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_par_agree(job->grid->sample, load(job, t)));
    V2V_TRY(v2v_par_agree(job->grid->sample, compute(job, t)));
    average(job);
done:
    return rc;
}

/** Collective(world) as v2v_volume_put: every rank of a shard gets some slices as a whole. It puts
 *  those of its branch, and a pair's ranks half of the mean each; a rank without a frame (t = -1)
 *  takes part with nothing. The status is this rank's. */
static enum v2v_status put_frame(struct job *job, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_grid *grid = job->grid;
    struct v2v_part own = {0, 0}, half = {0, 0};
    const float *slices = NULL;
    int64_t frame = t >= 0 ? t : 0;
    if (t >= 0) {
        own = v2v_par_part(job->slices, grid->shard_size, grid->shard_rank);
        half = v2v_par_part(own.count, grid->branch_size, grid->branch_rank);
        slices = make_slices(job, job->mean) + half.first * job->height * job->width;
    }
    rc = v2v_volume_put(job->writer, V2V_VOLUME_MEAN, slices, frame, own.first + half.first,
                        half.count);
    for (int b = 0; job->branches && b < 2; b++) {
        int is_held = t >= 0 && holds(grid, b);
        slices = is_held ? make_slices(job, job->branch[b]) : NULL; /* with the other ranks */
        if (rc == V2V_OK) {
            rc = v2v_volume_put(job->writer, V2V_VOLUME_BRANCH1 + b, slices, frame, own.first,
                                is_held ? own.count : 0);
        }
    }
    return rc;
}

/** Collective(world) as v2v_volume_put, Collective(sample) but for that: a round of this rank, with
 *  frame t, or none (t = -1), or after a failure, of which the others do not know yet. The status
 * is that of the frame's ranks. */
static enum v2v_status run_round(struct job *job, int64_t t, enum v2v_status earlier)
{
    enum v2v_status rc = earlier, put = V2V_OK;
    const struct v2v_comm *sample = job->grid->sample;
    if (rc == V2V_OK && t >= 0) {
        v2v_watchdog_beat("reconstructing a frame");
        rc = make_frame(job, t);
    } else if (rc == V2V_OK && job->grid->idle) {
        rc = heed_stop(job);
    }
    int has_frame = rc == V2V_OK && t >= 0;
    put = put_frame(job, has_frame ? t : -1);
    if (has_frame) {
        V2V_TRY(v2v_par_agree(sample, put));
        V2V_TRY(v2v_volume_mark_done(job->writer, t, sample));
    }
    job->rounds++;
    rc = rc == V2V_OK ? put : rc;
done:
    return rc;
}

/** Collective(world): the frames of all ranks, each rank's as fast as it can. */
static enum v2v_status run_rounds(struct job *job)
{
    enum v2v_status rc = V2V_OK, mine = V2V_OK;
    const struct v2v_grid *grid = job->grid;
    struct v2v_progress progress;
    v2v_progress_begin(&progress, "reconstruct", 0, job->frames);
    for (int64_t done = 0; done < job->frames; done += grid->data_size) {
        const int64_t i = done + grid->data_rank;
        const int64_t t = grid->idle || i >= job->frames ? -1 : job->todo[i];
        mine = run_round(job, t, mine);
        V2V_TRY(v2v_agreement_tell(job->agreement, mine));
        v2v_progress_step(&progress, v2v_smaller(done + grid->data_size, job->frames), NULL);
    }
    V2V_TRY(v2v_agreement_end(job->agreement));
    v2v_progress_end(&progress);
done:
    return rc;
}

/** Collective(world): everything is planned, and nothing of it was touched yet. */
static void announce_memory(const struct v2v_grid *grid)
{
    double held = (double)v2v_mem_held();
    v2v_par_max_f64(grid->world, &held, 1);
    v2v_log(V2V_LOG_INFO, "memory: %.2f GB planned on the largest rank", 1e-9 * held);
}

enum v2v_status v2v_reconstruct(struct v2v_model *model, struct v2v_recording *recording,
                                const struct v2v_scaling *scaling, struct v2v_volume_writer *writer,
                                int branches, const struct v2v_grid *grid, double *computed_part)
{
    enum v2v_status rc = V2V_OK;
    struct job job = {.model = model,
                      .recording = recording,
                      .scaling = scaling,
                      .writer = writer,
                      .grid = grid,
                      .branches = branches};
    V2V_TRY(v2v_par_agree(grid->world, job_plan(&job)));
    announce_memory(grid);
    V2V_TRY(run_rounds(&job));
    v2v_par_sum_f64(grid->world, job.parts, 2);
    *computed_part = job.parts[1] > 0.0 ? job.parts[0] / job.parts[1] : 1.0;
done:
    job_fini(&job);
    return rc;
}
