/** What is in a file of each kind, for `info`: sizes, where it comes from, its numbers. */
#ifndef V2V_CLI_INFORMATION_H
#define V2V_CLI_INFORMATION_H

#include "cli/command.h"
#include "cli/report.h"

/** One function a kind of file. Rank 0 fills the report, and reads frame `frame` where there are
 *  frames. @kind Collective(world). @return not agreed */
typedef enum v2v_status v2v_informer(struct v2v_report *report, const char *path, int64_t frame,
                                     const struct v2v_session *session);

v2v_informer v2v_inform_volume, v2v_inform_recording, v2v_inform_psf, v2v_inform_tiff;
/** YAML: a calibration, or settings. */
v2v_informer v2v_inform_yaml;
/** HDF5 or safetensors, also of other programs; a checkpoint. */
v2v_informer v2v_inform_weights;
/** The folder of a training: its newest weights, settings and losses. */
v2v_informer v2v_inform_run;

#endif
