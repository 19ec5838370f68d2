#ifndef V2V3D_TENSOR_SLOTS_H
#define V2V3D_TENSOR_SLOTS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** A buffer that is needed from one step of a computation to another. Buffers that are never needed
 *  together may share memory. */
struct v2v_slot {
    float **memory; /**< where the buffer's address goes */
    int64_t floats;
    int first, last; /**< steps, both included */
    int64_t offset;  /**< in floats, a multiple of 16: set by v2v_slots_pack */
};

/** Give every slot a place, the largest first and each at the lowest one free; returns the floats
 *  that all take. @kind Local. */
int64_t v2v_slots_pack(struct v2v_slot *slots, int64_t count);

/** Point every buffer to its place in `arena`. @kind Local. */
void v2v_slots_place(const struct v2v_slot *slots, int64_t count, float *arena);

#ifdef __cplusplus
}
#endif

#endif
