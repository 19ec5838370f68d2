/** Weights from one format into another. */
#ifndef V2V_CLI_WEIGHTS_CONVERSION_H
#define V2V_CLI_WEIGHTS_CONVERSION_H

#include "cli/command.h"

/** HDF5 or safetensors, of this program or another, into either; what a checkpoint has beside its
 *  weights is left out. Rank 0 reads and writes.
 *  @kind Collective(world), agreed */
enum v2v_status v2v_convert_weights(const struct v2v_session *session, const char *input,
                                    const char *output) V2V_MUST_CHECK;

#endif
