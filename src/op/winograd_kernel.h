/** Winograd minimal filtering F(4 x 4, 3 x 3): 4 x 4 outputs of a 3 x 3 convolution from 6 x 6
 *  products, the values of polynomials at 0, 1, -1, 2, -2 and infinity (S. Winograd 1980; A. Lavin,
 *  S. Gray, CVPR 2016). Transforms along one axis, one set for each instruction set; a vector holds
 *  neighbouring tiles or filters.
 */
#ifndef OP_WINOGRAD_KERNEL_H
#define OP_WINOGRAD_KERNEL_H

#include <stdint.h>

/** Pixels of a tile's side, points of a transform, values of a tile. */
enum { WINOGRAD_TILE = 4, WINOGRAD_POINTS = 6, WINOGRAD_VALUES = 36 };

/** out[j * out_step + t] from in[i * in_step + t], t < count. */
typedef void winograd_axis(float *out, int64_t out_step, const float *in, int64_t in_step,
                           int64_t count);

struct winograd_kernel {
    winograd_axis *input;              /**< 6 points from 6 pixels */
    winograd_axis *input_past;         /**< the same, past the caches where it can */
    winograd_axis *input_turned;       /**< its adjoint */
    winograd_axis *output;             /**< 4 pixels from 6 points */
    winograd_axis *output_turned;      /**< its adjoint */
    winograd_axis *output_turned_past; /**< the same, past the caches where it can */
    winograd_axis *weights;            /**< both axes: 36 values from 9 taps, likewise */
    winograd_axis *weights_turned;     /**< its adjoint */
};

extern const struct winograd_kernel v2v_winograd_avx512;
extern const struct winograd_kernel v2v_winograd_avx2;
extern const struct winograd_kernel v2v_winograd_any;

/** The set for this processor. @kind Local. */
const struct winograd_kernel *v2v_winograd_choose(void);

#endif
