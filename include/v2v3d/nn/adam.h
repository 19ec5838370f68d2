#ifndef V2V3D_NN_ADAM_H
#define V2V3D_NN_ADAM_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Adam with bias correction, as PyTorch's: step counts from 1. Fixed order, any thread count gives
 *  the same bits. @kind Local. */
struct v2v_adam {
    double learning_rate, beta1, beta2, epsilon;
};
void v2v_adam_step(const struct v2v_adam *adam, float *weights, float *m, float *v,
                   const float *gradients, int64_t count, int64_t step);

#ifdef __cplusplus
}
#endif

#endif
