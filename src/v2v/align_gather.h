/* Planes that lie anywhere, copied into one array for a backend of room op, plain or blocked as it
 * takes them: how the blocks are convolved where Winograd is not. */
#ifndef V2V3D_V2V_ALIGN_GATHER_H
#define V2V3D_V2V_ALIGN_GATHER_H

#include "v2v3d/op/conv.h"
#include "v2v3d/op/winograd.h"

struct v2v_align_gather;

/* One image of spec->in planes [in], copied, with rows `pitch` apart. The workspace of the
 * specification's method holds the array during a call. */
enum v2v_status v2v_align_gather_create(struct v2v_align_gather **gather,
                                        const struct v2v_conv_spec *spec,
                                        const struct v2v_plane *plane,
                                        int64_t pitch) V2V_MUST_CHECK;
void v2v_align_gather_destroy(struct v2v_align_gather **gather);

/* As v2v_conv_set_weights: borrowed. */
void v2v_align_gather_set_weights(struct v2v_align_gather *gather, const float *weight,
                                  const float *bias);

/* out [out,y,x], or blocked as spec->out_form says: pixels whose kernel leaves the frame see zeros
 * there, whatever the planes hold. */
void v2v_align_gather_forward(struct v2v_align_gather *gather, float *out, const float *base);

/* dweight and the planes at dbase are added to, the latter in an order that depends on the list
 * alone. */
void v2v_align_gather_backward(struct v2v_align_gather *gather, float *dweight, float *dbase,
                               const float *base, const float *dout);

#endif
