#include "cli/picture.h"
#include "cli/psf_picture.h"
#include "cli/psf_report.h"
#include "cli/steps.h"

#include "v2v3d/base/log.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/optics/shifts.h"
#include "v2v3d/par/agreement.h"
#include <inttypes.h>

struct simulate_arguments {
    struct v2v_common common;
    const char *output;
};

static const struct v2v_option simulate_options[] = {
    V2V_OPTION_OUTPUT(struct simulate_arguments, output, "PSFs to write, HDF5"), {0}};

struct simulated {
    const struct v2v_optics_settings *optics;
    const char *output;
    struct v2v_psf_file psf;
};

/* The work of rank 0. */
static enum v2v_status simulate_alone(void *context)
{
    enum v2v_status rc = V2V_OK;
    struct simulated *simulated = context;
    V2V_TRY(v2v_psf_simulate(&simulated->psf, simulated->optics));
    V2V_TRY(v2v_psf_file_write(&simulated->psf, simulated->output));
    V2V_TRY(v2v_psf_report_warnings(stderr, &simulated->psf));
done:
    return rc;
}

/* Settings that are of others, which aren't given. Rank 0. */
static void warn_of_optics(const struct v2v_session *session)
{
    const struct v2v_optics_settings *optics = &session->config.optics;
    const int has_rings = v2v_options_set(session->common, "optics.rings") ||
                          v2v_options_set(session->common, "optics.views_per_ring");
    const struct {
        int is_vain;
        const char *of;
    } rows[] = {
        {optics->pinhole_um == 0.0 && optics->pinhole_defocus_um != 0.0,
         "pinhole_defocus_um is of a pinhole, which there is none of (optics.pinhole_um)"},
        {optics->immersion_index == 0.0 && optics->depth_um != 0.0,
         "depth_um is of an interface, which there is none of (optics.immersion_index)"},
        {optics->tilts[0] != '\0' && has_rings, "tilts say where views are, and how many: "
                                                "rings and views_per_ring are left aside"},
    };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        if (rows[i].is_vain) {
            v2v_log(V2V_LOG_WARNING, "optics.%s", rows[i].of);
        }
    }
}

static enum v2v_status simulate(const void *arguments, struct v2v_session *session)
{
    const struct simulate_arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct simulated simulated = {.optics = &session->config.optics, .output = given->output};
    const struct v2v_psf_file *psf = &simulated.psf;
    V2V_TRY(v2v_step_output(session, given->output, NULL, 0));
    if (v2v_step_on_root(session)) {
        warn_of_optics(session);
    }
    V2V_TRY(v2v_agreement_alone(session->world, simulate_alone, &simulated));
    v2v_log(V2V_LOG_INFO,
            "%s: %" PRId64 " views, %" PRId64 " slices of %" PRId64 " x %" PRId64 " pixels",
            given->output, psf->views, psf->slices, psf->height, psf->width);
done:
    v2v_psf_file_fini(&simulated.psf);
    return rc;
}

const struct v2v_command v2v_command_psf_simulate = {
    .name = "psf simulate",
    .summary = "point spread functions by wave optics (section optics)",
    .options = simulate_options,
    .bytes = sizeof(struct simulate_arguments),
    .run = simulate};

struct info_arguments {
    struct v2v_common common;
    const char *psf, *picture;
};

static const struct v2v_option info_options[] = {
    V2V_OPTION_NAMELESS(struct info_arguments, psf, "PSF", "folder of psf_1.tif .. or HDF5 /psf"),
    V2V_OPTION_FILE(struct info_arguments, picture, "picture", 0,
                    "projections of every view, .png to write"),
    V2V_OPTION_NORMALIZE,
    {0}};

/* Sums of 1 would tell nothing. */
static const char *const info_preset[] = {"psf.normalize=none", NULL};

static enum v2v_status info(const void *arguments, struct v2v_session *session)
{
    const struct info_arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file psf = {0};
    struct v2v_shifts shifts = {0};
    if (given->picture != NULL) {
        V2V_TRY(v2v_picture_check_name(given->picture));
        V2V_TRY(v2v_step_output(session, given->picture, &given->psf, 1));
    }
    session->config.input.without_views[0] = '\0'; /* the whole set is looked at */
    V2V_TRY(v2v_step_psf(session, &psf, given->psf));
    V2V_TRY(v2v_shifts_from_psf(&shifts, &psf));
    if (v2v_step_on_root(session)) {
        rc = v2v_psf_report(stdout, given->psf, &psf, &shifts);
        if (rc == V2V_OK && given->picture != NULL) {
            rc = v2v_psf_picture(given->picture, &psf);
        }
    }
done:
    v2v_shifts_fini(&shifts);
    v2v_psf_file_fini(&psf);
    return rc;
}

const struct v2v_command v2v_command_psf_info = {
    .name = "psf info",
    .summary = "support, energy by slice, centroids, shifts and pictures of a PSF set",
    .options = info_options,
    .bytes = sizeof(struct info_arguments),
    .preset = info_preset,
    .run = info};
