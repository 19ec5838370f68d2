#ifndef V2V3D_NN_PRECISION_H
#define V2V3D_NN_PRECISION_H

#include "v2v3d/base/status.h"
#include "v2v3d/par/comm.h"

#ifdef __cplusplus
extern "C" {
#endif

/** What all ranks compute in: bf16 where each of them has the instructions (bf16-always: or
 *  emulates them), else float32 after one warning, so that one configuration serves any mixture of
 *  nodes and all ranks round alike.
 *  @kind   Collective(comm)
 *  @param  precision V2V_PRECISION_F32 or _BF16, for the network; out
 *  @param  wanted enum v2v_precision
 *  @return V2V_OK | V2V_E_CONFIG (bf16-always on a processor that cannot emulate it); the same on
 *          all ranks */
enum v2v_status v2v_precision_agree(int *precision, int wanted,
                                    const struct v2v_comm *comm) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
