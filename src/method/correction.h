/** Volumes of whole frames, corrected by the network of slices in tiles, so that what the layers
 *  hold is bounded. Having no biases, the network takes features of any brightness.
 *  Invariants: as one pass over the frame, to the round-off; nothing is allocated after creation.
 */
#ifndef V2V3D_METHOD_CORRECTION_H
#define V2V3D_METHOD_CORRECTION_H

#include "v2v3d/nn/network.h"

struct v2v_correction;

/** Plans the network, which is borrowed, for tiles of frames of [height,width].
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY | V2V_E_INTERNAL */
enum v2v_status v2v_correction_create(struct v2v_correction **correction,
                                      struct v2v_network *network, int64_t height,
                                      int64_t width) V2V_MUST_CHECK;
void v2v_correction_destroy(struct v2v_correction **correction);

/** Others were put in their place. @kind Local, no allocation. */
void v2v_correction_weights_changed(struct v2v_correction *correction);

/** Bytes that it and the network's layers take at most, of so many slices. @kind Local. */
int64_t v2v_correction_bytes(int64_t slices);

/** The network's volume, none below zero. The network pools pixels by two: of frames with an odd
 *  side it sees the last line but one once more behind the last. @kind Local, no allocation.
 *  @param volume [z,height,width] out @param features [V2V_FEATURES,z,height,width] */
void v2v_correction_run(struct v2v_correction *correction, float *volume, const float *features);

#endif
