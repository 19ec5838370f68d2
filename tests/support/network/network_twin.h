/** The whole network forward in double precision, by REFERENCE.md 3 and 4 alone: nothing of rooms
 *  nn and optics that computes is used, so that it can judge them. */
#ifndef V2V_TEST_NETWORK_TWIN_H
#define V2V_TEST_NETWORK_TWIN_H

#include "v2v3d/v2v/model.h"

/** Both branches' volumes of one frame. Every slice is shifted by itself; convolutions are matrix
 *  products over strips of patches.
 *  @kind   Local, deterministic for a thread count
 *  @param  volume [2]: [z,y,x] out
 *  @param  spec views, slices, width, features and volume_scale are read; backend, winograd and
 *          every_slice are not
 *  @param  fields, weights all parameters of both branches, by name
 *  @param  views [v,y,x], sides multiples of V2V_MODEL_GRID
 *  @return V2V_OK | V2V_E_MEMORY | V2V_E_INTERNAL (a parameter is missing or has another shape)
 *  @cost   33 M double multiply-adds a pixel at width 128; about 12 * width * height * width(frame)
 *          doubles */
enum v2v_status v2v_network_twin(double *const *volume, const struct v2v_model_spec *spec,
                                 const struct v2v_shifts *shifts, const struct v2v_fields *fields,
                                 const float *weights, const float *views, int64_t height,
                                 int64_t width) V2V_MUST_CHECK;

#endif
