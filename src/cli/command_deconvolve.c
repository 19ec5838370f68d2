#include "cli/recordings.h"

static const struct v2v_option options[] = {
    V2V_OPTION_PSF(struct v2v_volumes, psf, 1),
    V2V_OPTION_RECORDINGS,
    V2V_OPTION_VOLUMES_OUTPUT("volume to write: .h5, .tif or .ome.tif"),
    V2V_OPTION_SET("method", "deconv.method", "tv|rl|rld|frl|diner",
                   "total variation (default); A'(y / Ax) / A'1 of all views at once, or of one "
                   "after the other; A'y / A'Ax; an implicit field, for small frames"),
    V2V_OPTION_SET(
        "iterations", "deconv.iterations", "N",
        "at most; 0: rl 30, rld and frl 10, diner 1500, tv until it stands still, 500 at "
        "most"),
    V2V_OPTION_SET("stop", "deconv.stop", "fixed|heldout",
                   "rl, rld, frl: after N iterations, or when views held out are predicted no "
                   "better"),
    V2V_OPTION_SET("weight", "deconv.weight", "W", "rld, frl: of a view's correction (0.5)"),
    V2V_OPTION_SET(
        "lambda", "deconv.lambda", "L|auto",
        "tv: weight of the variation, in noise of the views; auto: by views left out of "
        "the first frame; default: by the noise, but auto where more than noise is missed, and "
        "where points and lines of light want less, or few slices more"),
    V2V_OPTION_SET(
        "noise", "deconv.noise", "auto|gaussian|poisson",
        "tv: the same for all samples, or of photons; auto (default): as the first frame shows"),
    V2V_OPTION_SET("electrons-per-count", "deconv.electrons_per_count", "E|auto",
                   "tv: of the camera (EMCCD: half of it), instead of an estimate"),
    V2V_OPTION_SET("read-noise", "deconv.read_noise", "E|auto",
                   "tv: of the camera, electrons, rms, instead of an estimate"),
    V2V_OPTIONS_VOLUMES,
    V2V_OPTION_NEIGHBOURS,
    V2V_OPTION_SET("skip", "recon.skip", "off|auto|N",
                   "tv: take over from the last whole frame what changed by less than N (auto: "
                   "0.02) of the brightest light, or than noise"),
    V2V_OPTION_REFRESH,
    V2V_OPTION_OFFSET,
    V2V_OPTION_NORMALIZE,
    V2V_OPTIONS_PAGES,
    V2V_OPTIONS_INPUT,
    V2V_OPTIONS_SIZES,
    {0}};

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_estimator_ops *ops = NULL;
    V2V_TRY(v2v_estimator_find(&ops, session->config.deconv.method));
    if (ops->is_learned) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--method %s takes weights: v2v3d reconstruct", ops->name));
    }
    V2V_TRY(v2v_recordings_make(arguments, ops, session));
done:
    return rc;
}

const struct v2v_command v2v_command_deconvolve = {
    .name = "deconvolve",
    .summary = "volumes of a recording by deconvolution",
    .options = options,
    .bytes = sizeof(struct v2v_volumes),
    .run = run,
};
