#ifndef V2V_CLI_CONTENT_H
#define V2V_CLI_CONTENT_H

#include "cli/command.h"

/** What is in a file; the order of `convert --kind`. */
enum v2v_content {
    V2V_CONTENT_AUTO, /**< not looked at yet */
    V2V_CONTENT_VOLUME,
    V2V_CONTENT_RECORDING,
    V2V_CONTENT_PSF,
    V2V_CONTENT_WEIGHTS,
    V2V_CONTENT_TIFF, /**< a TIFF stack: volume or recording, it does not say */
    V2V_CONTENT_YAML, /**< calibration or settings */
    V2V_CONTENT_RUN   /**< folder of a training */
};

/** Look into a file by opening it as one kind after the other; a folder is a PSF set,
 *  where it has a psf_1.tif, that of a training, where it has a config.yaml, else a recording.
 *  @kind Collective(world). @return V2V_OK | V2V_E_INPUT (none of them); agreed */
enum v2v_status v2v_content_of(enum v2v_content *content, const char *path,
                               const struct v2v_session *session) V2V_MUST_CHECK;

#endif
