#include "cli/projection.h"
#include "cli/steps.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/recon/rld.h"

enum { STOP_FIXED, STOP_HELDOUT, STOP_DISCREPANCY };

struct arguments {
    struct v2v_common common;
    const char *psf, *input, *output;
    int stop;
    int64_t iterations;
    double weight;
};

static const struct v2v_option options[] = {
    V2V_OPTION_PSF(struct arguments, psf, 1),
    V2V_OPTION_FILE(struct arguments, input, "input", 1, "recording"),
    V2V_OPTION_OUTPUT(struct arguments, output, "volume to write: .h5 or .tif"),
    {.name = "iterations",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, iterations),
     .value = "N",
     .help = "over all views",
     .initial = "10",
     .least = 1,
     .most = 10000},
    {.name = "stop",
     .kind = V2V_OPTION_CHOICE,
     .at = offsetof(struct arguments, stop),
     .value = "fixed|heldout|discrepancy",
     .help = "stopping rule",
     .initial = "fixed"},
    {.name = "weight",
     .kind = V2V_OPTION_NUMBER,
     .at = offsetof(struct arguments, weight),
     .value = "W",
     .help = "of a view's correction",
     .initial = "0.5",
     .least = 1e-6,
     .most = 1},
    V2V_OPTION_OFFSET,
    V2V_OPTION_NORMALIZE,
    V2V_OPTIONS_PAGES,
    {0}};

static enum v2v_status frames(const struct arguments *given, const struct v2v_session *session,
                              struct v2v_recording *recording, const struct v2v_scaling *scaling,
                              struct v2v_volume_writer *writer, struct v2v_rld *rld)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    struct v2v_part mine = v2v_rld_slices(rld);
    int64_t pixels = info->height * info->width;
    float *views = NULL, *slices = NULL;
    struct v2v_progress progress;
    rc = V2V_ALLOC(views, "deconvolve.views", info->views * pixels);
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(slices, "deconvolve.slices", mine.count * pixels);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_progress_begin(&progress, "deconvolve", 0, info->frames);
    for (int64_t t = 0; t < info->frames; t++) {
        v2v_watchdog_beat("deconvolve: a frame");
        rc = v2v_recording_read(recording, views, t);
        V2V_TRY(v2v_par_agree(session->world, rc));
        v2v_scaling_apply(scaling, views, info->views * pixels);
        V2V_TRY(v2v_rld_run(rld, slices, views, given->iterations));
        V2V_TRY(v2v_step_write_slices(session, writer, slices, t, mine));
        v2v_progress_step(&progress, t + 1, NULL);
    }
    v2v_progress_end(&progress);
done:
    v2v_mem_free(slices);
    v2v_mem_free(views);
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file psf = {0};
    struct v2v_recording *recording = NULL;
    struct v2v_provenance provenance = {0};
    struct v2v_volume_writer *writer = NULL;
    struct v2v_rld *rld = NULL;
    struct v2v_scaling scaling;
    enum v2v_split split;
    if (given->stop != STOP_FIXED) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--stop %s is not there yet, only fixed",
                         given->stop == STOP_HELDOUT ? "heldout" : "discrepancy"));
    }
    V2V_TRY(v2v_step_output(session, given->output, (const char *const[]){given->psf, given->input},
                            2));
    V2V_TRY(v2v_step_psf(session, &psf, given->psf));
    V2V_TRY(v2v_step_recording(session, &recording, given->input, &psf));
    V2V_TRY(v2v_step_offset(session, &scaling, recording));
    struct v2v_volume_info info = v2v_step_volume_of(v2v_recording_info(recording), &psf);
    V2V_TRY(v2v_projection_split(&split, session, &psf, info.height, info.width, 1));
    V2V_TRY(
        v2v_rld_create(&rld, &psf, info.height, info.width, given->weight, split, session->world));
    V2V_TRY(v2v_provenance_init(&provenance, session, &psf, NULL, &scaling));
    V2V_TRY(v2v_volume_create(&writer, given->output, &info, 1u << V2V_VOLUME_MEAN, provenance.item,
                              provenance.count, session->world));
    v2v_step_announce(session);
    struct v2v_par_time began = v2v_par_time_now();
    V2V_TRY(frames(given, session, recording, &scaling, writer, rld));
    v2v_step_communication(session, &began);
    V2V_TRY(v2v_volume_finish(&writer));
done:
    v2v_volume_abandon(&writer);
    v2v_provenance_fini(&provenance);
    v2v_rld_destroy(&rld);
    v2v_recording_close(&recording);
    v2v_psf_file_fini(&psf);
    return rc;
}

const struct v2v_command v2v_command_deconvolve = {
    .name = "deconvolve",
    .summary = "volumes of a recording by Richardson-Lucy iterations",
    .options = options,
    .bytes = sizeof(struct arguments),
    .run = run};
