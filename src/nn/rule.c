#include "v2v3d/nn/rule.h"

#include "v2v3d/base/random.h"
#include "v2v3d/conf/config.h"

#include <math.h>
#include <string.h>

/* Weights of a field, from its fan_in (in*kh*kw): REFERENCE.md 9 and 4. */
static void fill_hash(float *x, const struct v2v_fields_item *field, double fan_in, int is_bias,
                      int64_t seed)
{
    double factor = is_bias ? 0.01 : sqrt(6.0 / ((1.0 + 0.01 * 0.01) * fan_in));
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < field->count; i++) {
        x[i] = (float)(v2v_random_rule(field->name, (uint64_t)seed, (uint64_t)i) * factor);
    }
}

static void fill_uniform(float *x, const struct v2v_fields_item *field, double bound, int64_t seed)
{
    uint64_t stream = v2v_random_fnv1a64(field->name);
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < field->count; i++) {
        double u = v2v_random_uniform((uint64_t)seed, stream, (uint64_t)i);
        x[i] = (float)((2.0 * u - 1.0) * bound);
    }
}

/* kaiming-uniform with a = sqrt(5): sqrt(6 / ((1 + 5) fan_in)), and the same for the bias. */
static double kaiming_bound(double fan_in)
{
    return 1.0 / sqrt(fan_in);
}

/* He et al. 2015 for a leaky ReLU of slope 0.01: a signal keeps its size through the layers, where
 * PyTorch's default shrinks it to a third at each, to nothing after eighteen. Biases start at 0,
 * the last layer small: training starts at an almost empty volume. */
static double he_bound(const struct v2v_fields_item *field, double fan_in, int is_bias)
{
    double gain = field->starts_small ? 0.1 : 1.0;
    return is_bias ? 0.0 : sqrt(6.0 / ((1.0 + 0.01 * 0.01) * fan_in)) * gain;
}

enum v2v_status v2v_rule_weights(const struct v2v_fields *fields, float *weights, int rule,
                                 int64_t seed)
{
    double fan_in = 0.0;
    for (int64_t i = 0; i < fields->count; i++) {
        const struct v2v_fields_item *field = &fields->item[i];
        int is_bias = field->rank == 1;
        if (!is_bias) {
            fan_in = (double)(field->shape[1] * field->shape[2] * field->shape[3]);
        } else if (i == 0 || fields->item[i - 1].rank == 1) {
            return V2V_FAIL(V2V_E_INTERNAL, "%s: a bias must follow its weight", field->name);
        }
        float *x = weights + field->offset;
        if (rule == V2V_RULE_HASH) {
            fill_hash(x, field, fan_in, is_bias, seed);
        } else if (rule == V2V_RULE_KAIMING) {
            fill_uniform(x, field, kaiming_bound(fan_in), seed);
        } else {
            fill_uniform(x, field, he_bound(field, fan_in, is_bias), seed);
        }
    }
    return V2V_OK;
}
