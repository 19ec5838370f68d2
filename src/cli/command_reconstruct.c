#include "cli/recordings.h"

static const struct v2v_option options[] = {
    V2V_OPTION_PSF(struct v2v_volumes, psf, 1),
    V2V_OPTION_FILE(struct v2v_volumes, weights, "weights", 1, "of the trained network"),
    V2V_OPTION_RECORDINGS,
    V2V_OPTION_VOLUMES_OUTPUT("volume to write: .h5; .tif or .ome.tif (mean only)"),
    V2V_OPTION_SWITCH(struct v2v_volumes, branches, "branches",
                      "write /branch1 and /branch2 beside their mean"),
    V2V_OPTIONS_VOLUMES,
    V2V_OPTION_NEIGHBOURS,
    V2V_OPTION_SET("strength", "recon.strength", "C|auto",
                   "unrolled: part of the network's correction, 0 to 1; auto: as views left out of "
                   "the first frame speak for"),
    V2V_OPTION_SET("precision", "recon.precision", "f32|bf16|bf16-always",
                   "of the convolutions; bf16: if processors have it; -always: or emulate it"),
    V2V_OPTION_SET("skip", "recon.skip", "off|auto|N",
                   "leave out tiles with less light than N (auto: 0.055) of the brightest, or than "
                   "noise; unrolled: take over from the last whole frame what changed by less than "
                   "N (auto: 0.02), or than noise"),
    V2V_OPTION_REFRESH,
    V2V_OPTION_OFFSET,
    V2V_OPTION_GAIN,
    V2V_OPTION_NORMALIZE,
    V2V_OPTIONS_PAGES,
    V2V_OPTIONS_INPUT,
    V2V_OPTIONS_SIZES,
    {0}};

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    return v2v_recordings_make(arguments, NULL, session);
}

const struct v2v_command v2v_command_reconstruct = {
    .name = "reconstruct",
    .summary = "volumes of a recording by the trained network",
    .options = options,
    .bytes = sizeof(struct v2v_volumes),
    .run = run};
