#include "cli/volumes.h"

#include "cli/levels.h"
#include "cli/provenance.h"
#include "cli/steps.h"
#include "cli/unused_settings.h"
#include "cli/volumes_quality.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/eval/settle.h"
#include "v2v3d/io/file.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/nn/precision.h"
#include "v2v3d/op/tile_conv.h"
#include "v2v3d/recon/recon.h"
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>

/* What a run opens and makes. */
struct work {
    const struct v2v_volumes *given;
    const struct v2v_volumes_tools *tools;
    const struct v2v_estimator_ops *ops;
    const struct v2v_psf_file *psf;
    struct v2v_part frames;
    struct v2v_recording *recording;
    struct v2v_scaling scaling;
    struct v2v_problem problem;
    struct v2v_level_range levels; /* that the network was trained at */
    struct v2v_recon *recon;
    struct v2v_misfit *misfit; /* [frames] */
    struct v2v_volume_info info;
    unsigned datasets;
    struct v2v_provenance provenance;
    struct v2v_volume_writer *writer;
    int is_open; /* bool: frames are to be kept */
    struct v2v_volumes_result result;
};

double v2v_volumes_skip(const struct v2v_number *skip, const struct v2v_estimator_ops *ops,
                        const struct v2v_network_ops *network)
{
    /* where nothing can be skipped, auto is refused as any tolerance is */
    const double automatic = ops->inherit != NULL || network == NULL ? V2V_RECON_SKIP_AUTO
                             : network->traits & V2V_TRAIT_SKIPS     ? network->skip_auto
                                                                     : 1.0;
    return skip->mode == V2V_NUMBER_NONE   ? 0.0
           : skip->mode == V2V_NUMBER_AUTO ? automatic
                                           : skip->value;
}

enum v2v_status v2v_volumes_check(struct v2v_part *frames, const struct v2v_volumes *given)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume_storage storage;
    if (given->branches && v2v_file_kind_of_name(given->output) != V2V_FILE_HDF5) {
        return V2V_FAIL(V2V_E_USAGE, "--branches needs an HDF5 output (.h5), not %s",
                        given->output);
    }
    V2V_TRY(v2v_storage_settle(&storage, &given->storage, given->output));
    V2V_TRY(v2v_step_frames(frames, given->frames));
done:
    return rc;
}

/* The weights, and what convolutions compute in; what was decided against is not what the volume's
 * provenance shall say. Collective. */
static enum v2v_status settle_network(struct work *work, struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_weights_info network;
    const struct v2v_network_ops *ops = NULL;
    struct v2v_recon_settings *recon = &session->config.recon;
    struct v2v_problem *problem = &work->problem;
    V2V_TRY(v2v_step_weights_info(session, &network, work->given->weights, work->psf));
    V2V_TRY(v2v_precision_agree(&problem->precision, recon->precision, session->world));
    if (problem->precision == V2V_PRECISION_F32) {
        recon->precision = V2V_PRECISION_F32;
    }
    V2V_TRY(v2v_network_find(&ops, session->config.model.method));
    work->levels = network.levels;
    if (work->given->branches && ops->outputs == 1) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--branches: the network '%s' makes one volume", ops->name));
    }
    problem->skip = v2v_volumes_skip(&recon->skip, work->ops, ops);
    const int skips_light = problem->skip > 0.0 && work->ops->skips_light;
    if (skips_light && !session->config.model.winograd) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--skip needs model.winograd: true"));
    }
    if (skips_light && problem->precision != V2V_PRECISION_F32 && !v2v_tile_conv_usable() &&
        v2v_step_on_root(session)) {
        v2v_log(V2V_LOG_WARNING, "nothing is skipped where bf16 is emulated");
    }
done:
    return rc;
}

/* Frames that are unlike those of the training. Collective. */
static enum v2v_status warn_of_levels(const struct work *work, const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    char text[V2V_LEVELS_TEXT];
    const int is_homogeneous = !work->ops->has_gain || session->config.model.homogeneous;
    V2V_TRY(v2v_levels_compare(text, &work->levels, is_homogeneous, work->recording, &work->scaling,
                               work->frames.first, session));
    if (text[0] != '\0' && v2v_step_on_root(session)) {
        v2v_log(V2V_LOG_WARNING, "%s", text);
    }
done:
    return rc;
}

/* Inputs and the method, before anything is written. Collective. */
static enum v2v_status prepare(struct work *work, struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volumes *given = work->given;
    const struct v2v_input_settings input = v2v_estimator_input(work->ops, &session->config);
    V2V_TRY(v2v_step_recording(session, &work->recording, given->input, work->psf));
    V2V_TRY(v2v_recording_has_frame(work->recording, work->frames.first));
    const struct v2v_recording_info *info = v2v_recording_info(work->recording);
    work->problem = (struct v2v_problem){.config = &session->config,
                                         .psf = work->psf,
                                         .weights = given->weights,
                                         .height = info->height,
                                         .width = info->width,
                                         .precision = V2V_PRECISION_F32};
    if (work->ops->is_learned) {
        V2V_TRY(settle_network(work, session));
    } else {
        work->problem.skip = v2v_volumes_skip(&session->config.recon.skip, work->ops, NULL);
    }
    V2V_TRY(v2v_scaling_decide(&work->scaling, work->recording, &input, session->world));
    V2V_TRY(v2v_settle_by_frame(&session->config, work->ops, &work->problem, work->recording,
                                &work->scaling, session->world));
    /* after the whole recording has decided on the scaling: a range has the bits of the whole */
    V2V_TRY(v2v_recording_cut(work->recording, work->frames.first, work->frames.count));
done:
    return rc;
}

/* Each rank reads the weights by itself, and the provenance holds their checksum: these are one and
 * the same file. Collective. */
static enum v2v_status check_weights(const struct work *work, const struct v2v_session *session)
{
    const char *path = work->given->weights;
    return path == NULL ? V2V_OK
                        : v2v_par_agree(session->world,
                                        v2v_file_unchanged(V2V_OK, &work->tools->weights, path));
}

/* What the output will be, and of which task. Collective. */
static enum v2v_status describe(struct work *work, const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volumes *given = work->given;
    work->info = v2v_step_volume_of(session, v2v_recording_info(work->recording), work->psf);
    V2V_TRY(
        v2v_par_agree(session->world, V2V_ALLOC(work->misfit, "cli.quality", work->info.frames)));
    V2V_TRY(v2v_storage_settle(&work->info.storage, &given->storage, given->output));
    work->datasets = 1u << V2V_VOLUME_MEAN;
    if (given->branches) {
        work->datasets |= 1u << V2V_VOLUME_BRANCH1 | 1u << V2V_VOLUME_BRANCH2;
    }
    V2V_TRY(
        v2v_provenance_init(&work->provenance, session, work->psf, given->weights, &work->scaling));
    V2V_TRY(v2v_provenance_origin(&work->provenance, session, given->input, work->frames.first));
    V2V_TRY(v2v_provenance_task(&work->provenance, session, work->info.frames, work->datasets));
    V2V_TRY(check_weights(work, session));
done:
    return rc;
}

/* With --resume: is the output complete already? One of another task, or a damaged one, is never
 * taken for it. Collective. */
static enum v2v_status meet_output(int *is_complete, const struct work *work,
                                   const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const char *const output = work->given->output;
    const struct v2v_provenance *provenance = &work->provenance;
    char reason[512];
    int there = v2v_file_exists(output);
    *is_complete = 0;
    v2v_par_broadcast(session->world, &there, sizeof there, 0);
    if (!work->given->resume || !there) {
        return V2V_OK;
    }
    rc = v2v_volume_check(output, &work->info, work->datasets, provenance->item, provenance->count,
                          session->world);
    snprintf(reason, sizeof reason, "%s", v2v_status_message());
    if (rc == V2V_E_INPUT && session->force) {
        if (v2v_step_on_root(session)) {
            v2v_log(V2V_LOG_WARNING, "%s; it is made anew", reason);
        }
        return V2V_OK;
    }
    if (rc == V2V_E_INPUT) {
        V2V_TRY(V2V_FAIL(rc, "%s; --force makes it anew", reason));
    }
    V2V_TRY(rc);
    *is_complete = 1;
    v2v_log(V2V_LOG_INFO, "%s is complete already", output);
done:
    return rc;
}

/* With --resume: frames of another task are not thrown away unasked. Collective. */
static enum v2v_status meet_frames(const struct work *work, const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume_left left = {0};
    const int is_asked = work->given->resume && v2v_step_on_root(session);
    if (is_asked && v2v_file_kind_of_name(work->given->output) == V2V_FILE_TIFF) {
        v2v_log(V2V_LOG_WARNING,
                "%s: a TIFF is begun anew by every attempt; an .h5 is gone on with, and convert "
                "makes a TIFF of it",
                work->given->output);
    } else if (is_asked && !session->force) {
        rc = v2v_volume_left(&left, work->given->output, work->provenance.task);
    }
    if (rc == V2V_OK && left.done > 0 && !left.is_same) {
        rc =
            V2V_FAIL(V2V_E_INPUT,
                     "%s: the %lld of %lld frames that an interrupted run left are of another "
                     "task: inputs, frames, settings, datasets or program differ; --force discards "
                     "them",
                     work->given->output, (long long)left.done, (long long)left.frames);
    }
    return v2v_par_agree(session->world, rc);
}

static enum v2v_status open_output(struct work *work, const struct v2v_session *session)
{
    const struct v2v_provenance *provenance = &work->provenance;
    return (work->given->resume ? v2v_volume_resume : v2v_volume_create)(
        &work->writer, work->given->output, &work->info, work->datasets, provenance->item,
        provenance->count, session->world);
}

/* Frames that are done in the output. Local. */
static int64_t count_done(const struct work *work)
{
    int64_t done = 0;
    for (int64_t t = 0; t < work->info.frames; t++) {
        done += v2v_volume_is_done(work->writer, t);
    }
    return done;
}

/* One line: what was made, how fast, and what it took. Collective. */
static void report_made(const struct work *work, const struct v2v_session *session)
{
    const struct v2v_volume_info *info = &work->info;
    const struct v2v_volumes_result *result = &work->result;
    struct rusage used = {0};
    char before[64] = "";
    getrusage(RUSAGE_SELF, &used);
    double peak_gb = 1024e-9 * (double)used.ru_maxrss;
    v2v_par_max_f64(session->world, &peak_gb, 1);
    if (result->before > 0) {
        snprintf(before, sizeof before, ", %lld before", (long long)result->before);
    }
    v2v_log(V2V_LOG_INFO,
            "%s: %lld frames of %lld x %lld x %lld; %lld now in %.1f s, %.3g s a frame%s; %.2f GB "
            "on the largest rank",
            work->given->output, (long long)info->frames, (long long)info->slices,
            (long long)info->height, (long long)info->width, (long long)result->now,
            result->frames_s, result->now > 0 ? result->frames_s / (double)result->now : 0.0,
            before, peak_gb);
}

static void report_skipped(const struct work *work)
{
    const double part = v2v_recon_computed_part(work->recon);
    const double left = v2v_recon_left(work->recon);
    if (work->problem.skip > 0.0 && !work->ops->skips_light) {
        v2v_log(
            V2V_LOG_INFO,
            "computed %.1f %% of the frames; the rest changed by %.2g of the brightest light at "
            "most, and is taken over",
            100.0 * part, left);
    } else if (work->problem.skip > 0.0 &&
               (work->problem.precision == V2V_PRECISION_F32 || v2v_tile_conv_usable())) {
        v2v_log(V2V_LOG_INFO,
                "computed %.1f %% of the tiles; the rest holds less light than %g of the "
                "brightest, or than noise",
                100.0 * part, work->problem.skip);
    }
}

/* Once everything else is done. Collective. */
static void report_quality(struct work *work, const struct v2v_session *session)
{
    const struct v2v_volumes_made made = {.output = work->given->output,
                                          .ops = work->ops,
                                          .recon = &work->recon,
                                          .psf = work->psf,
                                          .recording = work->recording,
                                          .scaling = &work->scaling,
                                          .misfit = work->misfit,
                                          .first = work->frames.first};
    if (!work->given->common.quiet) {
        v2v_recon_misfits(work->recon, work->misfit);
        v2v_volumes_report_quality(&made, session);
    }
}

/* A failed run keeps the frames that it finished, and says so. Collective. */
static void keep_frames(struct work *work, const struct v2v_session *session)
{
    struct v2v_volume_left left;
    if (!work->is_open) {
        return;
    }
    v2v_volume_suspend(&work->writer);
    if (v2v_step_on_root(session)) {
        struct v2v_status_record failure;
        v2v_status_keep(&failure);
        if (v2v_volume_left(&left, work->given->output, NULL) != V2V_OK) {
            v2v_log(V2V_LOG_WARNING, "%s; frames may be done", v2v_status_message());
            v2v_status_restore(&failure);
            return;
        }
        work->result.now = left.done - work->result.before;
        if (left.done > 0) {
            v2v_log(V2V_LOG_WARNING, "%s: %lld of %lld frames are done; --resume goes on with them",
                    work->given->output, (long long)left.done, (long long)left.frames);
        }
    }
}

static void close_all(struct work *work, const struct v2v_session *session)
{
    keep_frames(work, session);
    if (work->given->result != NULL) {
        *work->given->result = work->result;
    }
    v2v_provenance_fini(&work->provenance);
    v2v_recon_destroy(&work->recon);
    v2v_mem_free(work->misfit);
    v2v_recording_close(&work->recording);
}

enum v2v_status v2v_volumes_begin(struct v2v_volumes_tools *tools, const struct v2v_volumes *given,
                                  const struct v2v_estimator_ops *ops, struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const double began = v2v_clock_now();
    *tools = (struct v2v_volumes_tools){.ops = ops};
    if (given->weights != NULL) {
        V2V_TRY(v2v_par_agree(session->world, v2v_file_remember(&tools->weights, given->weights)));
    }
    if (ops == NULL) {
        const struct v2v_network_ops *network = NULL;
        V2V_TRY(v2v_step_network(session, &network, given->weights, 0));
        tools->ops = v2v_estimator_of_network(network);
    }
    if (v2v_step_on_root(session)) {
        v2v_unused_settings_warn(tools->ops, session);
    }
    V2V_TRY(v2v_step_calibration(session, given->calibration));
    V2V_TRY(v2v_step_psf(session, &tools->psf, given->psf));
    tools->seconds = v2v_clock_now() - began;
done:
    return rc;
}

void v2v_volumes_end(struct v2v_volumes_tools *tools)
{
    v2v_psf_file_fini(&tools->psf);
}

enum v2v_status v2v_volumes_of(const struct v2v_volumes *given,
                               const struct v2v_volumes_tools *tools,
                               const struct v2v_monitor *monitor, struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct work work = {.given = given, .tools = tools, .ops = tools->ops, .psf = &tools->psf};
    const double began = v2v_clock_now();
    double ready = 0.0;
    int is_complete = 0;
    V2V_TRY(v2v_volumes_check(&work.frames, given));
    V2V_TRY(v2v_step_output_or_resume(
        session, given->output,
        (const char *const[]){given->psf, given->weights, given->calibration, given->input}, 4,
        given->resume));
    V2V_TRY(prepare(&work, session));
    V2V_TRY(describe(&work, session));
    work.result.frames = work.info.frames;
    V2V_TRY(meet_output(&is_complete, &work, session));
    if (is_complete) {
        work.result.before = work.info.frames;
        goto done;
    }
    V2V_TRY(meet_frames(&work, session));
    V2V_TRY(warn_of_levels(&work, session));
    V2V_TRY(
        v2v_recon_create(&work.recon, work.ops, &work.problem, work.info.frames, session->world));
    V2V_TRY(open_output(&work, session));
    work.is_open = 1;
    work.result.before = count_done(&work);
    v2v_scaling_warn(&work.scaling, given->input, session->world);
    v2v_step_announce(session);
    struct v2v_par_time running = v2v_par_time_now();
    v2v_stop_heed_ending();
    ready = v2v_clock_now();
    V2V_TRY(v2v_recon_run(work.recon, work.recording, &work.scaling, work.writer, given->branches,
                          monitor));
    v2v_step_communication(session, &running);
    report_skipped(&work);
    V2V_TRY(v2v_volume_finish(&work.writer)); /* which keeps frames as well, if it fails */
    work.is_open = 0;
    work.result.now = work.info.frames - work.result.before;
    work.result.ready_s = tools->seconds + ready - began;
    work.result.frames_s = v2v_clock_now() - ready;
    report_made(&work, session);
    report_quality(&work, session);
done:
    close_all(&work, session);
    return rc;
}

enum v2v_status v2v_volumes_make(const struct v2v_volumes *given,
                                 const struct v2v_estimator_ops *ops,
                                 const struct v2v_monitor *monitor, struct v2v_session *session)
{
    struct v2v_volumes_tools tools;
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_volumes_begin(&tools, given, ops, session));
    V2V_TRY(v2v_volumes_of(given, &tools, monitor, session));
done:
    v2v_volumes_end(&tools);
    return rc;
}
