#include "v2v3d/nn/rule.h"

#include "v2v3d/base/random.h"
#include "v2v3d/conf/config.h"

#include <math.h>
#include <string.h>

/* Weights of a field, from its fan_in (in*kh*kw): REFERENCE.md 9 and 4. */
static void fill_hash(float *x, const struct v2v_field *field, double fan_in, int is_bias,
                      int64_t seed)
{
    double factor = is_bias ? 0.01 : sqrt(6.0 / ((1.0 + 0.01 * 0.01) * fan_in));
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < field->count; i++) {
        x[i] = (float)(v2v_random_rule(field->name, (uint64_t)seed, (uint64_t)i) * factor);
    }
}

/* kaiming-uniform with a = sqrt(5): bound sqrt(6 / ((1 + 5) fan_in)) = 1/sqrt(fan_in), as the bias.
 */
static void fill_kaiming(float *x, const struct v2v_field *field, double fan_in, int64_t seed)
{
    double bound = 1.0 / sqrt(fan_in);
    uint64_t stream = v2v_random_fnv1a64(field->name);
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < field->count; i++) {
        double u = v2v_random_uniform((uint64_t)seed, stream, (uint64_t)i);
        x[i] = (float)((2.0 * u - 1.0) * bound);
    }
}

enum v2v_status v2v_rule_weights(const struct v2v_fields *fields, float *weights, int rule,
                                 int64_t seed)
{
    double fan_in = 0.0;
    for (int64_t i = 0; i < fields->count; i++) {
        const struct v2v_field *field = &fields->item[i];
        int is_bias = field->rank == 1;
        if (!is_bias) {
            fan_in = (double)(field->shape[1] * field->shape[2] * field->shape[3]);
        } else if (i == 0 || fields->item[i - 1].rank == 1) {
            return V2V_FAIL(V2V_E_INTERNAL, "%s: a bias must follow its weight", field->name);
        }
        if (rule == V2V_RULE_HASH) {
            fill_hash(weights + field->offset, field, fan_in, is_bias, seed);
        } else {
            fill_kaiming(weights + field->offset, field, fan_in, seed);
        }
    }
    return V2V_OK;
}
