#include "cli/evaluation.h"
#include "cli/steps.h"
#include "cli/unused_settings.h"

struct arguments {
    struct v2v_common common;
    const char *truth, *volume, *psf, *calibration, *input, *weights;
    const char *uncertainty, *volume_dataset, *truth_dataset;
    int64_t frames;
    int fit_scale, json;
};

static const struct v2v_option options[] = {
    V2V_OPTION_FILE(struct arguments, volume, "volume", 1, "volume to judge"),
    V2V_OPTION_FILE(
        struct arguments, truth, "truth", 0,
        "true volume, its frames in turn from the recording's first on; integers are read as "
        "fractions of their type's maximum"),
    V2V_OPTION_PSF(struct arguments, psf, 0, .needs = "input"),
    V2V_OPTION_FILE(struct arguments, calibration, "calibration", 0, "of the views",
                    .needs = "psf"),
    V2V_OPTION_FILE(struct arguments, input, "input", 0,
                    "recording: with --psf, how the volume meets its views", .needs = "psf"),
    {.name = "frames",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, frames),
     .value = "N",
     .initial = "1",
     .help = "leave views out of N frames: how well the others, by total variation, predict them; "
             "0: none",
     .needs = "psf",
     .least = 0,
     .most = 1e9},
    V2V_OPTION_FILE(struct arguments, weights, "weights", 0,
                    "of the network that made the volume: warn of frames unlike those of its "
                    "training (--frames 0); unrolled is to correct total variation there",
                    .needs = "psf"),
    V2V_OPTION_FILE(
        struct arguments, uncertainty, "uncertainty", 0,
        "write HDF5: /volume, of all views by total variation, and /uncertainty, what it "
        "may be wrong by",
        .needs = "psf"),
    V2V_OPTION_SET("lambda", "deconv.lambda", "L|auto",
                   "weight of the variation there, as of deconvolve", .needs = "psf"),
    V2V_OPTION_SWITCH(struct arguments, fit_scale, "fit-scale",
                      "allow the volume one least-squares scale", .needs = "truth"),
    V2V_OPTION_SWITCH(struct arguments, json, "json", "one JSON object instead of a table"),
    V2V_OPTION_OFFSET,
    V2V_OPTION_NORMALIZE,
    V2V_OPTIONS_PAGES,
    V2V_OPTION_SLICES,
    V2V_OPTION_CHANNEL,
    V2V_OPTION_DATASET("HDF5: of the recording, not /views"),
    V2V_OPTION_PIXEL_SIZE,
    V2V_OPTIONS_SIZES,
    {.name = "volume-dataset",
     .kind = V2V_OPTION_TEXT,
     .at = offsetof(struct arguments, volume_dataset),
     .value = "NAME",
     .help = "HDF5: of the volume, such as /branch1, not /volume"},
    {.name = "truth-dataset",
     .kind = V2V_OPTION_TEXT,
     .at = offsetof(struct arguments, truth_dataset),
     .value = "NAME",
     .help = "HDF5: of the truth, not /volume",
     .needs = "truth"},
    {0}};

/* Settings that say how the recording is read, or its volume measured. */
static const char *const of_recordings[] = {
    "input.dataset",          "input.offset",           "input.views",
    "input.stride",           "input.first_view",       "input.layout",
    "input.pixel_size_um",    "input.slice_spacing_um", "input.without_views",
    "input.frame_interval_s", "psf.normalize"};
enum { OF_RECORDINGS = sizeof of_recordings / sizeof *of_recordings };

/* Do the words fit together? Local: the same on all ranks. */
static enum v2v_status check_words(const struct arguments *given)
{
    enum v2v_status rc = V2V_OK;
    if (given->truth == NULL && given->psf == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--truth FILE, or --psf FILE and --input FILE, is missing"));
    }
    for (int i = 0; given->input == NULL && i < OF_RECORDINGS; i++) {
        if (v2v_options_set(&given->common, of_recordings[i])) {
            V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s is of the recording: --input FILE is missing",
                             of_recordings[i]));
        }
    }
    if (given->uncertainty != NULL && given->frames == 0) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--uncertainty needs --frames above 0"));
    }
    if (given->uncertainty != NULL && v2v_file_kind_of_name(given->uncertainty) != V2V_FILE_HDF5) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--uncertainty needs an HDF5 output (.h5), not %s",
                         given->uncertainty));
    }
done:
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    const struct v2v_network_ops *network = NULL;
    struct v2v_evaluation evaluation = {0};
    struct v2v_psf_file psf = {0};
    struct v2v_weights_info info;
    struct v2v_evaluation_job job = {.volume = given->volume,
                                     .truth = given->truth,
                                     .volume_dataset = given->volume_dataset,
                                     .truth_dataset = given->truth_dataset,
                                     .psf = given->psf,
                                     .input = given->input,
                                     .weights = given->weights,
                                     .heldout_frames = given->frames,
                                     .uncertainty = given->uncertainty,
                                     .fit_scale = given->fit_scale};
    V2V_TRY(check_words(given));
    if (v2v_step_on_root(session)) {
        v2v_unused_settings_warn_command("evaluate", session);
    }
    if (given->uncertainty != NULL) {
        const char *const inputs[] = {given->volume,      given->truth, given->psf,
                                      given->calibration, given->input, given->weights};
        V2V_TRY(v2v_step_output(session, given->uncertainty, inputs,
                                (int64_t)(sizeof inputs / sizeof inputs[0])));
    }
    if (given->weights != NULL) {
        V2V_TRY(v2v_step_network(session, &network, given->weights, 0));
        if (!(network->traits & V2V_TRAIT_CORRECTS) && given->frames > 0) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                             "%s: the network '%s' cannot do without some of its views (--frames 0 "
                             "leaves none out)",
                             given->weights, network->name));
        }
    }
    V2V_TRY(v2v_step_calibration(session, given->calibration));
    if (given->weights != NULL && given->psf != NULL) { /* which tell what of the weights holds */
        V2V_TRY(v2v_step_psf(session, &psf, given->psf));
        V2V_TRY(v2v_step_weights_info(session, &info, given->weights, &psf));
    }
    V2V_TRY(v2v_evaluation_run(&evaluation, &job, session));
    if (v2v_step_on_root(session)) {
        if (given->json) {
            rc = v2v_evaluation_json(&evaluation, given->fit_scale);
        } else {
            v2v_evaluation_print(&evaluation, given->fit_scale);
        }
    }
done:
    v2v_psf_file_fini(&psf);
    v2v_evaluation_fini(&evaluation);
    return rc;
}

const struct v2v_command v2v_command_evaluate = {
    .name = "evaluate",
    .summary = "PSNR and SSIM against a truth; without one, by the views",
    .options = options,
    .bytes = sizeof(struct arguments),
    .run = run};
