#include "v2v3d/nn/adam.h"

#include <math.h>

void v2v_adam_step(const struct v2v_adam *adam, float *weights, float *m, float *v,
                   const float *gradients, int64_t count, int64_t step)
{
    /* 1 - 0.999f would be off by 1e-5 */
    const float new1 = (float)(1.0 - adam->beta1), new2 = (float)(1.0 - adam->beta2);
    const float epsilon = (float)adam->epsilon;
    const float size = (float)(adam->learning_rate / (1.0 - pow(adam->beta1, (double)step)));
    const float root = (float)(1.0 / sqrt(1.0 - pow(adam->beta2, (double)step)));
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < count; i++) {
        float g = gradients[i];
        m[i] += new1 * (g - m[i]);
        v[i] += new2 * (g * g - v[i]);
        weights[i] -= size * m[i] / (sqrtf(v[i]) * root + epsilon);
    }
}
