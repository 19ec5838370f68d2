#include "v2v3d/train/train.h"

#include "train/alike.h"
#include "train/checkpoint.h"
#include "train/run_folder.h"
#include "train/trainer.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/io/weights_file.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/par/time.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/bulk.h"

#include <math.h>
#include <stdio.h>

/* A step whose loss or gradient is not finite leaves the weights alone; after this many in a row,
 * or after more at its end than chance makes, the run gives up. */
enum { NOT_FINITE_IN_A_ROW = 10, BY_CHANCE = 1 };

struct run {
    const struct v2v_train_job *job;
    struct v2v_comm *comm;
    struct v2v_run_folder folder;
    struct v2v_trainer trainer;
    struct v2v_progress progress;
    int64_t step;         /* steps done */
    int64_t checkpointed; /* steps in the newest checkpoint, -1: none */
    int not_finite;
    enum v2v_status unwritten; /* a line of the log that could not be written: ends the run with the
                                  next step */
    double started, last_checkpoint; /* seconds */
    double earlier_s;                /* of training by earlier attempts */
};

static enum v2v_status set_weights(struct run *run)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_network *network = run->trainer.network;
    const struct v2v_fields *fields = &network->schema.fields;
    if (run->job->weights != NULL) {
        V2V_TRY(v2v_weights_file_read(network->weights, run->job->weights, "weights", fields));
    } else {
        V2V_TRY(v2v_rule_weights(fields, network->weights, (int)run->job->config->train.init,
                                 run->job->config->train.seed));
    }
done:
    return rc;
}

/* Ranks beyond the batch wait for the others. */
static void tell_of_no_sample(const struct run *run)
{
    const int ranks = run->trainer.grid.data_size;
    const int64_t batch = run->job->config->train.batch;
    if (v2v_comm_rank(run->comm) == 0 && ranks > batch) {
        v2v_log(V2V_LOG_WARNING,
                "train.batch=%lld: %lld of %d data ranks have no sample and wait; %lld would train "
                "as fast",
                (long long)batch, (long long)(ranks - batch), ranks, (long long)batch);
    }
}

/* Start from a checkpoint, given weights or fresh ones. Collective(comm), agreed. */
static enum v2v_status start(struct run *run)
{
    enum v2v_status rc = V2V_OK;
    if (run->job->resume) {
        struct v2v_trained trained = {0};
        V2V_TRY(v2v_checkpoint_read(&run->trainer, run->job->folder, &trained));
        run->step = trained.steps;
        run->earlier_s = (double)trained.seconds;
        if (run->step > 0) {
            run->checkpointed = run->step;
            v2v_log(V2V_LOG_INFO, "resuming after step %lld%s%s", (long long)run->step,
                    run->job->weights != NULL ? " by its own weights, not " : "",
                    run->job->weights != NULL ? run->job->weights : "");
        }
    }
    if (run->step == 0) {
        V2V_TRY(v2v_par_agree(run->comm, set_weights(run)));
    }
    if (!run->trainer.grid.idle) { /* whose network is planned */
        run->trainer.ops->weights_changed(run->trainer.network);
    }
    if (run->trainer.average != NULL && run->step == 0) {
        v2v_bulk_copy(run->trainer.average, run->trainer.network->weights,
                      run->trainer.network->schema.fields.total);
    }
    if (run->step < run->job->config->train.steps) {
        V2V_TRY(v2v_trainer_try(&run->trainer, run->step));
    }
    V2V_TRY(v2v_par_agree(run->comm, v2v_run_folder_start(&run->folder, run->step)));
    tell_of_no_sample(run);
done:
    return rc;
}

static enum v2v_status write_checkpoint(struct run *run)
{
    enum v2v_status rc = V2V_OK;
    if (run->checkpointed == run->step) {
        goto done;
    }
    const struct v2v_trained trained = {run->step,
                                        (int64_t)(run->earlier_s + v2v_clock_now() - run->started)};
    v2v_watchdog_beat("writing a checkpoint");
    if (run->job->config->train.check_every > 0) { /* else a bad one could replace a good one */
        V2V_TRY(v2v_alike_weights(&run->trainer, run->step));
    }
    V2V_TRY(
        v2v_checkpoint_write(&run->trainer, run->job->folder, &trained, run->folder.config_text));
    run->checkpointed = run->step;
    run->last_checkpoint = v2v_clock_now();
done:
    return rc;
}

/* Not of weights that the last loss wasn't finite of, which would replace better ones. */
static enum v2v_status checkpoint(struct run *run)
{
    return run->not_finite > 0 ? V2V_OK : write_checkpoint(run);
}

/* Is it time for a checkpoint? Rank 0's clock says it for all, with the votes. */
static int checkpoint_due(const struct run *run)
{
    return v2v_comm_rank(run->comm) == 0 &&
           v2v_clock_now() - run->last_checkpoint >= run->job->config->train.checkpoint_every_s;
}

/* Seconds of earlier attempts that count against the time that is given: with a linear schedule all
 * of them, as the checkpoint says, else none. */
static double taken_before(const struct run *run)
{
    return run->job->config->train.schedule == V2V_SCHEDULE_LINEAR ? run->earlier_s : 0.0;
}

/* The part of the time that is gone, by rank 0's clock. */
static double spent(const struct run *run)
{
    const double limit = run->job->max_time_s;
    const double now = v2v_clock_now() - run->started + taken_before(run);
    return limit > 0.0 && v2v_comm_rank(run->comm) == 0 ? now / limit : 0.0;
}

/* Rank 0's clock and every rank's signals decide; the votes travel with the gradients. */
static struct v2v_step_votes vote(const struct run *run)
{
    const double part = spent(run);
    return (struct v2v_step_votes){.spent = part,
                                   .stop = part >= 1.0 || v2v_stop_requested(),
                                   .checkpoint = checkpoint_due(run),
                                   .earlier = run->unwritten};
}

static enum v2v_status give_up(const struct run *run)
{
    const long long steps = run->not_finite, last = run->step, kept = run->checkpointed;
    return kept >= 0
               ? V2V_FAIL(V2V_E_NUMERIC,
                          "the loss of the last %lld steps, up to step %lld, was not finite; the "
                          "checkpoint is of step %lld, before them: lower train.learning_rate and "
                          "resume, by " V2V_RUN_WEIGHTS_BEFORE " in its place if that doesn't help",
                          steps, last, kept)
               : V2V_FAIL(V2V_E_NUMERIC,
                          "the loss of the last %lld steps, up to step %lld, was not finite, and "
                          "there is no checkpoint from before them: lower train.learning_rate",
                          steps, last);
}

static enum v2v_status judge(struct run *run, const struct v2v_step_result *result)
{
    if (result->finite) {
        run->not_finite = 0;
        return V2V_OK;
    }
    run->not_finite++;
    if (v2v_comm_rank(run->comm) == 0) {
        v2v_log(V2V_LOG_WARNING,
                "step %lld: loss %g, gradient norm %g: not finite or too large, weights "
                "not stepped",
                (long long)run->step, result->terms[V2V_LOSS_TOTAL], result->grad_norm);
    }
    return run->not_finite < NOT_FINITE_IN_A_ROW ? V2V_OK : give_up(run);
}

static void show(struct run *run, const struct v2v_step_result *result)
{
    char note[96];
    snprintf(note, sizeof note, "loss %.6g  gradient %.3g", result->terms[V2V_LOSS_TOTAL],
             result->grad_norm);
    v2v_progress_step(&run->progress, run->step, note);
}

/* A learning rate that has fallen to its end with the time has done what it should. */
static int is_over(const struct run *run, const struct v2v_step_result *result)
{
    const struct v2v_train_settings *settings = &run->job->config->train;
    return run->step >= settings->steps ||
           (settings->schedule == V2V_SCHEDULE_LINEAR && result->spent >= 1.0);
}

/* Steps since the newest checkpoint are made again. */
static enum v2v_status stopped(const struct run *run)
{
    const long long step = run->step, steps = run->job->config->train.steps;
    return run->checkpointed == run->step
               ? V2V_FAIL(V2V_STOPPED, "stopped after step %lld of %lld; go on with --resume", step,
                          steps)
               : V2V_FAIL(V2V_STOPPED,
                          "stopped after step %lld of %lld, of which the loss of the last %d was "
                          "not finite; --resume goes on after step %lld",
                          step, steps, run->not_finite,
                          (long long)v2v_larger(run->checkpointed, 0));
}

/* What follows a step on all ranks alike. Collective(comm), agreed. */
static enum v2v_status after_step(struct run *run, const struct v2v_step_result *result,
                                  const struct v2v_par_time *began)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_train_settings *settings = &run->job->config->train;
    V2V_TRY(judge(run, result));
    if (settings->check_every > 0 && run->step % settings->check_every == 0) {
        V2V_TRY(v2v_alike_weights(&run->trainer, run->step));
    }
    if (run->step % settings->log_every == 0 || is_over(run, result)) {
        run->unwritten = v2v_run_folder_log(&run->folder, run->step, result, began);
    }
    show(run, result);
    if (is_over(run, result)) {
        goto done;
    }
    if (result->stop) {
        V2V_TRY(checkpoint(run));
        V2V_TRY(v2v_par_agree(run->comm, run->unwritten));
        V2V_TRY(stopped(run));
    }
    if (result->checkpoint) {
        V2V_TRY(checkpoint(run));
    }
done:
    return rc;
}

/* Steps until the end or a stop. Collective(comm), agreed. */
static enum v2v_status loop(struct run *run, struct v2v_train_report *report)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_step_result result = {0};
    v2v_stop_heed_ending();
    while (!is_over(run, &result)) {
        struct v2v_par_time began = v2v_par_time_now();
        v2v_watchdog_beat("a training step");
        const struct v2v_step_votes votes = vote(run);
        V2V_TRY(v2v_trainer_step(&run->trainer, &result, run->step, &votes));
        run->step++;
        report->now++;
        report->last_total = result.terms[V2V_LOSS_TOTAL];
        V2V_TRY(after_step(run, &result, &began));
    }
    V2V_TRY(v2v_par_agree(run->comm, run->unwritten));
    V2V_TRY(run->not_finite > BY_CHANCE ? give_up(run) : write_checkpoint(run));
done:
    return rc;
}

enum v2v_status v2v_train_run(const struct v2v_train_job *job, struct v2v_train_report *report,
                              struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct run run = {.job = job, .comm = comm, .checkpointed = -1, .folder.lock = -1};
    *report = (struct v2v_train_report){0};
    run.started = run.last_checkpoint = v2v_clock_now();
    V2V_TRY(v2v_alike_processors(job->config, comm));
    V2V_TRY(v2v_run_folder_enter(&run.folder, job, comm));
    V2V_TRY(v2v_trainer_create(&run.trainer, job, comm));
    V2V_TRY(start(&run));
    if (run.step >= job->config->train.steps) { /* resumed: its checkpoint is all there is to do */
        goto done;
    }
    v2v_sources_warn(v2v_sampler_sources(run.trainer.sampler), comm);
    v2v_progress_begin(&run.progress, "training", run.step, job->config->train.steps);
    if (job->max_time_s > 0.0) {
        run.progress.most_s = fmax(job->max_time_s - taken_before(&run), 1.0);
    }
    struct v2v_par_time began = v2v_par_time_now();
    rc = loop(&run, report);
    v2v_progress_end(&run.progress);
    if (rc == V2V_OK || rc == V2V_STOPPED) {
        struct v2v_par_shares shares = v2v_par_shares_since(comm, &began);
        v2v_par_log_shares(comm, &shares);
    }
done:
    v2v_watchdog_beat("the end of training");
    report->steps = run.step;
    report->seconds = v2v_clock_now() - run.started;
    v2v_trainer_destroy(&run.trainer);
    v2v_run_folder_leave(&run.folder, rc != V2V_OK);
    return rc;
}
