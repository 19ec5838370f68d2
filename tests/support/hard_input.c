#include "hard_input.h"

#include "v2v3d/base/random.h"

#include <math.h>

static const struct {
    const char *name;
    double scale;
} inputs[TEST_HARD_INPUTS] = {
    [TEST_HARD_1E_6] = {"x 1e-6", 1e-6},
    [TEST_HARD_1E_3] = {"x 1e-3", 1e-3},
    [TEST_HARD_1] = {"x 1", 1.0},
    [TEST_HARD_1E3] = {"x 1e3", 1e3},
    [TEST_HARD_1E6] = {"x 1e6", 1e6},
    [TEST_HARD_ZERO] = {"zero", 0.0},
    [TEST_HARD_CONSTANT] = {"constant", 100.0},
    [TEST_HARD_HOT] = {"hot pixel", 1.0},
    [TEST_HARD_SATURATED] = {"saturated", 55000.0},
    [TEST_HARD_SUBNORMAL] = {"subnormal", 1e-40},
};

const char *test_hard_name(enum test_hard which)
{
    return inputs[which].name;
}

float test_hard_sample(enum test_hard which, int64_t i, int64_t width, int64_t hot)
{
    double wave = 1.0 + 0.5 * sin((double)(i % width) * 0.3) * cos((double)(i / width) * 0.2);
    wave += 0.1 * v2v_random_normal(61, 0, (uint64_t)i);
    double value = inputs[which].scale * (which == TEST_HARD_CONSTANT ? 1.0 : wave);
    if (which == TEST_HARD_HOT && i == hot) {
        value = 1e4;
    }
    if (which == TEST_HARD_SATURATED && value > 65535.0) {
        value = 65535.0;
    }
    return (float)value;
}
