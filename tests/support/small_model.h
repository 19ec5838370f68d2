/** A small network with hashed weights, and noise to feed it. */
#ifndef TEST_SMALL_MODEL_H
#define TEST_SMALL_MODEL_H

#include "small_shifts.h"

#include "v2v3d/conf/config.h"
#include "v2v3d/nn/rule.h"

enum { VIEWS = 5, SLICES = 4, SIDE = 64, WIDTH = 16, BRANCHES = 2 };
enum { PIXELS = SIDE * SIDE, VOXELS = SLICES * PIXELS };

static float views[VIEWS * PIXELS];

static const struct v2v_model_spec small = {.views = VIEWS,
                                            .slices = SLICES,
                                            .width = WIDTH,
                                            .features = 4,
                                            .branches = V2V_BRANCH_BOTH,
                                            .backend = V2V_BACKEND_ONEDNN,
                                            .volume_scale = 1.0};

static inline void fill(float *x, int64_t count, uint64_t stream)
{
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)(0.2 + 0.1 * v2v_random_normal(31, stream, (uint64_t)i));
    }
}

static inline struct v2v_model *create(const struct v2v_model_spec *spec)
{
    struct v2v_model *model = NULL;
    struct v2v_shifts shifts = small_shifts(spec->views, spec->slices);
    assert_ok(v2v_model_create(&model, spec, &shifts));
    assert_ok(
        v2v_rule_weights(v2v_model_fields(model), v2v_model_weights(model), V2V_RULE_HASH, 7));
    v2v_shifts_fini(&shifts);
    return model;
}

#endif
