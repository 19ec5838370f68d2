/** The views that the paper's two outputs are judged by: odd ones and even ones. */
#ifndef V2V_TEST_HELD_OUT_H
#define V2V_TEST_HELD_OUT_H

#include "v2v3d/loss/loss.h"

static const int32_t test_odd_views[] = {1, 3, 5, 7, 9, 11, 13, 15};
static const int32_t test_even_views[] = {0, 2, 4, 6, 8, 10, 12, 14};

/** Of up to 16 views. */
static inline void test_hold_out_halves(struct v2v_loss_setup *setup, int64_t views)
{
    setup->outputs = 2;
    setup->held_out[0] = (struct v2v_held_out){test_odd_views, views / 2};
    setup->held_out[1] = (struct v2v_held_out){test_even_views, (views + 1) / 2};
}

#endif
