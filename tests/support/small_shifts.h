/** Alignment shifts of a small, lopsided microscope. */
#ifndef TEST_SMALL_SHIFTS_H
#define TEST_SMALL_SHIFTS_H

#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/v2v/model.h"

static inline struct v2v_shifts small_shifts(int64_t views, int64_t slices)
{
    struct v2v_shifts shifts = {.views = views, .slices = slices};
    assert_ok(V2V_ALLOC(shifts.dy, "test", views * slices));
    assert_ok(V2V_ALLOC(shifts.dx, "test", views * slices));
    for (int64_t i = 0; i < views * slices; i++) {
        shifts.dy[i] = (int32_t)v2v_random_below(9, 0, (uint64_t)i, 7) - 3;
        shifts.dx[i] = (int32_t)v2v_random_below(9, 1, (uint64_t)i, 5) - 2;
    }
    return shifts;
}

#endif
