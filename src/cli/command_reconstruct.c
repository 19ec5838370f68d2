#include "cli/steps.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"
#include "v2v3d/nn/network.h"
#include "v2v3d/nn/precision.h"
#include "v2v3d/optics/shifts.h"
#include "v2v3d/recon/network.h"
#include "v2v3d/v2v/model.h"
#include <string.h>

struct arguments {
    struct v2v_common common;
    const char *psf, *weights, *input, *output;
    const char *frames; /* FIRST:COUNT */
    int branches, resume;
};

static const struct v2v_option options[] = {
    V2V_OPTION_PSF(struct arguments, psf, 1),
    V2V_OPTION_FILE(struct arguments, weights, "weights", 1, "of the trained network"),
    V2V_OPTION_FILE(struct arguments, input, "input", 1, "recording"),
    V2V_OPTION_OUTPUT(struct arguments, output, "volume to write: .h5, or .tif (mean only)"),
    V2V_OPTION_SWITCH(struct arguments, branches, "branches",
                      "write /branch1 and /branch2 beside their mean"),
    V2V_OPTION_SWITCH(struct arguments, resume, "resume",
                      "go on with what an interrupted run left; a complete output stays"),
    {.name = "frames",
     .kind = V2V_OPTION_TEXT,
     .at = offsetof(struct arguments, frames),
     .value = "FIRST:COUNT",
     .help = "these of the recording, from 0; fewer where it ends"},
    V2V_OPTION_SET("precision", "recon.precision", "f32|bf16|bf16-always",
                   "of the convolutions; bf16: if processors have it; -always: or emulate it"),
    V2V_OPTION_SET(
        "skip", "recon.skip", "off|auto|N",
        "leave out tiles with less light than N (auto: 0.085) of the brightest, or than noise"),
    V2V_OPTION_OFFSET,
    V2V_OPTION_GAIN,
    V2V_OPTION_NORMALIZE,
    V2V_OPTIONS_PAGES,
    {0}};

static double skip_of(const struct v2v_recon_settings *recon)
{
    return recon->skip.mode == V2V_NUMBER_NONE   ? 0.0
           : recon->skip.mode == V2V_NUMBER_AUTO ? V2V_SKIP_AUTO
                                                 : recon->skip.value;
}

/* FIRST:COUNT; all frames when it is not given. */
static enum v2v_status parse_frames(struct v2v_part *frames, const char *text)
{
    enum v2v_status rc = V2V_OK;
    static const char what[] = "--frames FIRST:COUNT";
    char first[32];
    *frames = (struct v2v_part){0, INT64_MAX};
    if (text != NULL) {
        const int digits = (int)strcspn(text, ":");
        V2V_TRY(v2v_text_format(first, sizeof first, "%.*s", digits, text));
        V2V_TRY(v2v_text_to_i64(&frames->first, first, 0, INT64_MAX, what, V2V_E_USAGE));
        V2V_TRY(v2v_text_to_i64(&frames->count, text[digits] == ':' ? text + digits + 1 : "", 1,
                                INT64_MAX, what, V2V_E_USAGE));
    }
done:
    return rc;
}

static enum v2v_status check(const struct arguments *given, struct v2v_part *frames,
                             const struct v2v_session *session)
{
    const struct v2v_recon_settings *recon = &session->config.recon;
    if (skip_of(recon) > 0.0 && !session->config.model.winograd) {
        return V2V_FAIL(V2V_E_USAGE, "--skip needs model.winograd: true");
    }
    if (given->branches && !v2v_step_is_hdf5_name(given->output)) {
        return V2V_FAIL(V2V_E_USAGE, "--branches needs an HDF5 output (.h5), not %s",
                        given->output);
    }
    return parse_frames(frames, given->frames);
}

static struct v2v_model_spec describe_model(const struct v2v_weights_info *info,
                                            const struct v2v_session *session, int precision)
{
    return (struct v2v_model_spec){.views = info->views,
                                   .slices = info->slices,
                                   .width = session->config.model.width,
                                   .features = session->config.model.features,
                                   .branches = V2V_BRANCH_BOTH,
                                   .backend = session->config.model.backend,
                                   .winograd = session->config.model.winograd,
                                   .precision = precision,
                                   .every_slice = !session->config.model.merge,
                                   .volume_scale = session->config.model.volume_scale,
                                   .skip = skip_of(&session->config.recon)};
}

/* Ranks take frames; where there are too few of them, branches and slabs of rows. Collective. */
static enum v2v_status lay_out(struct v2v_grid *grid, struct v2v_session *session,
                               const struct v2v_model_spec *spec,
                               const struct v2v_recording_info *recording,
                               const struct v2v_part *frames)
{
    struct v2v_grid_work work;
    struct v2v_grid_shape wanted = {(int)session->config.parallel.branches,
                                    (int)session->config.parallel.shards};
    v2v_model_describe_work(&work, spec, recording->height, recording->width);
    work.items = v2v_smaller(recording->frames - frames->first, frames->count);
    work.most_bytes = (int64_t)(session->config.parallel.max_mem_gb * 1e9);
    work.most_shards = session->config.parallel.reproducible ? 1 : v2v_comm_size(session->world);
    return v2v_grid_lay_out(grid, session->world, &wanted, &work);
}

/* Local: the network with its weights; this rank holds the branches that the grid gives it. */
static enum v2v_status load_model(struct v2v_model **model, const char *path,
                                  const struct v2v_model_spec *whole,
                                  const struct v2v_psf_file *psf, const struct v2v_grid *grid)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_shifts shifts = {0};
    struct v2v_model_spec spec = *whole;
    if (grid->branch_size > 1) {
        spec.branches = grid->branch_rank == 0 ? V2V_BRANCH_1 : V2V_BRANCH_2;
    }
    spec.slabs = grid->shard_size;
    spec.shard = grid->shard;
    V2V_TRY(v2v_shifts_from_psf(&shifts, psf));
    V2V_TRY(v2v_model_create(model, &spec, &shifts));
    V2V_TRY(v2v_weights_file_read(v2v_model_weights(*model), path, "weights",
                                  v2v_model_fields(*model)));
done:
    v2v_shifts_fini(&shifts);
    return rc;
}

/* What was decided against is not what the volume's provenance shall say. Collective. */
static enum v2v_status decide_precision(int *precision, struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_recon_settings *recon = &session->config.recon;
    V2V_TRY(v2v_precision_agree(precision, recon->precision, session->world));
    if (*precision == V2V_PRECISION_F32) {
        recon->precision = V2V_PRECISION_F32;
    }
done:
    return rc;
}

/* Outputs get their names only when they are complete. Collective. */
static int is_done(const struct arguments *given, const struct v2v_session *session)
{
    int done = given->resume && v2v_file_exists(given->output);
    v2v_par_broadcast(session->world, &done, sizeof done, 0);
    if (done) {
        v2v_log(V2V_LOG_INFO, "%s is complete already", given->output);
    }
    return done;
}

static void report_skipped(double part, double tolerance, int precision)
{
    if (tolerance > 0.0 && precision == V2V_PRECISION_F32) {
        v2v_log(V2V_LOG_INFO,
                "computed %.1f %% of the tiles; the rest holds less light than %g of the "
                "brightest, or than noise",
                100.0 * part, tolerance);
    }
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file psf = {0};
    struct v2v_recording *recording = NULL;
    struct v2v_grid grid = {0};
    struct v2v_weights_info network;
    struct v2v_model *model = NULL;
    struct v2v_scaling scaling;
    struct v2v_provenance provenance = {0};
    struct v2v_volume_writer *writer = NULL;
    struct v2v_part frames;
    double part = 1.0;
    unsigned datasets = 1u << V2V_VOLUME_MEAN;
    int precision = V2V_PRECISION_F32;
    V2V_TRY(check(given, &frames, session));
    if (is_done(given, session)) {
        goto done;
    }
    V2V_TRY(v2v_step_output(session, given->output,
                            (const char *const[]){given->psf, given->weights, given->input}, 3));
    V2V_TRY(v2v_step_psf(session, &psf, given->psf));
    V2V_TRY(v2v_step_recording(session, &recording, given->input, &psf));
    V2V_TRY(v2v_step_weights_info(session, &network, given->weights, &psf));
    V2V_TRY(decide_precision(&precision, session));
    if (skip_of(&session->config.recon) > 0.0 && precision != V2V_PRECISION_F32) {
        v2v_log(V2V_LOG_WARNING, "nothing is skipped in bf16");
    }
    struct v2v_model_spec spec = describe_model(&network, session, precision);
    V2V_TRY(lay_out(&grid, session, &spec, v2v_recording_info(recording), &frames));
    if (!grid.idle) {
        rc = load_model(&model, given->weights, &spec, &psf, &grid);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    V2V_TRY(v2v_scaling_decide(&scaling, recording, &session->config.input, session->world));
    /* after the whole recording has decided on the scaling: a range has the bits of the whole */
    V2V_TRY(v2v_recording_cut(recording, frames.first, frames.count));
    V2V_TRY(v2v_provenance_init(&provenance, session, &psf, given->weights, &scaling));
    V2V_TRY(v2v_provenance_task(&provenance, session, given->input, frames.first));
    struct v2v_volume_info info = v2v_step_volume_of(v2v_recording_info(recording), &psf);
    if (given->branches) {
        datasets |= 1u << V2V_VOLUME_BRANCH1 | 1u << V2V_VOLUME_BRANCH2;
    }
    V2V_TRY((given->resume ? v2v_volume_resume
                           : v2v_volume_create)(&writer, given->output, &info, datasets,
                                                provenance.item, provenance.count, session->world));
    v2v_step_announce(session);
    struct v2v_par_time began = v2v_par_time_now();
    V2V_TRY(v2v_reconstruct(model, recording, &scaling, writer, given->branches, &grid, &part));
    v2v_step_communication(session, &began);
    report_skipped(part, skip_of(&session->config.recon), precision);
    V2V_TRY(v2v_volume_finish(&writer));
done:
    if (rc == V2V_STOPPED || rc == V2V_E_IO) {
        v2v_volume_suspend(&writer);
    }
    v2v_volume_abandon(&writer);
    v2v_provenance_fini(&provenance);
    v2v_model_destroy(&model);
    v2v_grid_destroy(&grid);
    v2v_recording_close(&recording);
    v2v_psf_file_fini(&psf);
    return rc;
}

const struct v2v_command v2v_command_reconstruct = {
    .name = "reconstruct",
    .summary = "volumes of a recording by the trained network",
    .options = options,
    .bytes = sizeof(struct arguments),
    .run = run};
