#include "cli/projection.h"
#include "cli/provenance.h"
#include "cli/steps.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/calibration.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>

struct arguments {
    struct v2v_common common;
    const char *psf, *calibration, *volume, *input, *output;
    int adjoint;
};

static const struct v2v_option options[] = {
    V2V_OPTION_PSF(struct arguments, psf, 1),
    V2V_OPTION_FILE(struct arguments, volume, "volume", 0,
                    "volume to project (with --adjoint: recording, as --input)"),
    V2V_OPTION_FILE(struct arguments, input, "input", 0, "with --adjoint: recording",
                    .needs = "adjoint"),
    V2V_OPTION_OUTPUT(struct arguments, output, "recording (with --adjoint: volume) to write"),
    V2V_OPTION_SWITCH(struct arguments, adjoint, "adjoint", "back-project a recording instead"),
    V2V_OPTION_SET("offset", "input.offset", "none|auto|N",
                   "with --adjoint: subtracted from the counts; auto: as the file states",
                   .needs = "adjoint"),
    V2V_OPTION_SET("reduce", "psf.reduce", "sum|mean", "over depth"),
    V2V_OPTION_CALIBRATION(struct arguments, calibration),
    V2V_OPTION_NORMALIZE,
    V2V_OPTIONS_PAGES_WITH(.needs = "adjoint"),
    V2V_OPTION_SLICES,
    V2V_OPTIONS_INPUT,
    V2V_OPTIONS_SIZES,
    {0}};

static enum v2v_status check(const float *result, int64_t count, int64_t t)
{
    return v2v_first_not_finite(result, count) < 0
               ? V2V_OK
               : V2V_FAIL(V2V_E_NUMERIC, "frame %lld: the result leaves the range of float32",
                          (long long)t);
}

/* The fields of a calibration, which go into the views of a volume; a scratch where it has any. */
static enum v2v_status fields_init(float **scratch, const struct v2v_session *session,
                                   const struct v2v_recording_info *info, const char *path)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_calibration *calibration = &session->calibration;
    if (calibration->views > 0) {
        V2V_TRY(v2v_calibration_check(calibration, info->views, info->height, info->width, path));
        V2V_TRY(v2v_par_agree(session->world,
                              V2V_ALLOC(*scratch, "cli.distorted", info->height * info->width)));
    }
done:
    return rc;
}

static enum v2v_status forward(const struct arguments *given, const struct v2v_session *session,
                               const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume *volume = NULL;
    struct v2v_projection p = {0};
    struct v2v_recording_writer *writer = NULL;
    struct v2v_progress progress = {0};
    float *scratch = NULL;
    V2V_TRY(v2v_step_volume(session, &volume, given->volume, psf));
    struct v2v_recording_info info = v2v_step_recording_of(v2v_volume_info(volume), psf);
    V2V_TRY(fields_init(&scratch, session, &info, given->volume));
    V2V_TRY(v2v_projection_init(&p, session, psf, info.height, info.width));
    struct v2v_part out =
        v2v_par_part(info.views, v2v_comm_size(session->world), v2v_comm_rank(session->world));
    const float *own = p.views + out.first * p.pixels;
    V2V_TRY(v2v_recording_create(&writer, given->output, &info, session->world));
    v2v_progress_begin(&progress, "project", 0, info.frames);
    for (int64_t t = 0; t < info.frames; t++) {
        v2v_watchdog_beat("project: a frame");
        rc = v2v_volume_read(volume, p.slices, t, p.mine.first, p.mine.count);
        V2V_TRY(v2v_par_agree(session->world, rc));
        V2V_TRY(v2v_projection_forward(&p));
        if (scratch != NULL) {
            v2v_calibration_distort(p.views, scratch, &session->calibration, info.height,
                                    info.width);
        }
        V2V_TRY(v2v_par_agree(session->world, check(own, out.count * p.pixels, t)));
        V2V_TRY(v2v_recording_write(writer, own, t, out.first, out.count));
        v2v_progress_step(&progress, t + 1, NULL);
    }
    V2V_TRY(v2v_recording_finish(&writer));
done:
    v2v_progress_end(&progress);
    v2v_mem_free(scratch);
    v2v_recording_abandon(&writer);
    v2v_projection_fini(&p);
    v2v_volume_close(&volume);
    return rc;
}

/* What nothing states is not guessed here: the adjoint is linear. */
static double stated_offset(const struct v2v_session *session,
                            const struct v2v_recording *recording)
{
    const struct v2v_number *offset = &session->config.input.offset;
    if (offset->mode == V2V_NUMBER_AUTO) {
        const double stated = v2v_recording_info(recording)->offset;
        return isnan(stated) ? 0.0 : stated;
    }
    return offset->mode == V2V_NUMBER_GIVEN ? offset->value : 0.0;
}

static enum v2v_status adjoint(const char *input, const struct arguments *given,
                               const struct v2v_session *session, const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_recording *recording = NULL;
    struct v2v_projection p = {0};
    struct v2v_volume_writer *writer = NULL;
    struct v2v_provenance provenance = {0};
    struct v2v_progress progress = {0};
    float *scratch = NULL;
    struct v2v_session as_recorded =
        *session; /* fields are put into A, not taken out of the views */
    as_recorded.calibration = (struct v2v_calibration){0};
    V2V_TRY(v2v_step_recording(&as_recorded, &recording, input, psf));
    V2V_TRY(fields_init(&scratch, session, v2v_recording_info(recording), input));
    struct v2v_volume_info info = v2v_step_volume_of(session, v2v_recording_info(recording), psf);
    V2V_TRY(v2v_projection_init(&p, session, psf, info.height, info.width));
    const struct v2v_scaling scaling = {.gain = 1.0, .offset = stated_offset(session, recording)};
    V2V_TRY(v2v_provenance_init(&provenance, session, psf, NULL, &scaling));
    V2V_TRY(v2v_volume_create(&writer, given->output, &info, 1u << V2V_VOLUME_MEAN, provenance.item,
                              provenance.count, session->world));
    v2v_progress_begin(&progress, "back-project", 0, info.frames);
    for (int64_t t = 0; t < info.frames; t++) {
        v2v_watchdog_beat("back-project: a frame");
        rc = v2v_recording_read(recording, p.views, t);
        V2V_TRY(v2v_par_agree(session->world, rc));
        v2v_scaling_apply(&scaling, p.views, psf->views * p.pixels);
        if (scratch != NULL) {
            v2v_calibration_distort_transpose(p.views, scratch, &session->calibration, info.height,
                                              info.width);
        }
        V2V_TRY(v2v_projection_adjoint(&p));
        V2V_TRY(v2v_par_agree(session->world, check(p.slices, p.mine.count * p.pixels, t)));
        V2V_TRY(v2v_step_write_slices(session, writer, p.slices, t, p.mine));
        v2v_progress_step(&progress, t + 1, NULL);
    }
    V2V_TRY(v2v_volume_finish(&writer));
done:
    v2v_progress_end(&progress);
    v2v_volume_abandon(&writer);
    v2v_provenance_fini(&provenance);
    v2v_mem_free(scratch);
    v2v_projection_fini(&p);
    v2v_recording_close(&recording);
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file psf = {0};
    const char *recording = given->input != NULL ? given->input : given->volume;
    if (given->adjoint && given->input != NULL && given->volume != NULL) {
        V2V_TRY(
            V2V_FAIL(V2V_E_USAGE, "--adjoint is of a recording (--input), not of --volume, too"));
    }
    if (given->adjoint ? recording == NULL : given->volume == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--%s FILE is missing", given->adjoint ? "input" : "volume"));
    }
    V2V_TRY(v2v_step_output(
        session, given->output,
        (const char *const[]){given->psf, given->calibration, given->volume, given->input}, 4));
    V2V_TRY(v2v_step_calibration(session, given->calibration));
    V2V_TRY(v2v_step_psf(session, &psf, given->psf));
    session->config.input.hot_pixels = V2V_HOT_PIXELS_KEEP; /* the adjoint is linear */
    V2V_TRY(given->adjoint ? adjoint(recording, given, session, &psf)
                           : forward(given, session, &psf));
done:
    v2v_psf_file_fini(&psf);
    return rc;
}

const struct v2v_command v2v_command_project = {.name = "project",
                                                .summary = "views of a volume, or the adjoint",
                                                .options = options,
                                                .bytes = sizeof(struct arguments),
                                                .run = run};
