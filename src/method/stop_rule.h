/** When a deconvolution has seen enough: more iterations fit the noise, not the scene. */
#ifndef METHOD_STOP_RULE_H
#define METHOD_STOP_RULE_H

#include "v2v3d/method/estimator.h"

struct v2v_richardson_lucy;

struct v2v_view_list {
    const int32_t *view; /* [count] */
    int64_t count;
};

/** V2V_STOP_HELDOUT: every fourth view is held out; the iterations on the others go on while they
 *  predict those clearly better, and then as many are run on all views. */
struct v2v_stop_rule {
    int rule;       /* enum v2v_stop */
    int32_t *views; /* [2 v] of the lists */
    struct v2v_view_list all, used, held_out;
};

/** @kind Local. @return V2V_OK | V2V_E_CONFIG (a rule that needs more views) */
enum v2v_status v2v_stop_rule_check(const struct v2v_problem *problem) V2V_MUST_CHECK;
/** @kind Local. @return V2V_OK | V2V_E_MEMORY; v2v_stop_rule_fini after both */
enum v2v_status v2v_stop_rule_init(struct v2v_stop_rule *stop,
                                   const struct v2v_problem *problem) V2V_MUST_CHECK;
void v2v_stop_rule_fini(struct v2v_stop_rule *stop);

/** A monitor's context: one frame, judged by the views held out. */
struct v2v_judge {
    struct v2v_richardson_lucy *method;
    const float *views; /* [v,y,x] as recorded */
    double mean;        /* of them, the unit of the volume */
    double last;        /* squares that the views held out were missed by before .. */
    int64_t best;       /* .. and the last iteration that was worth it */
    int has_ended;      /* bool: one was not */
};

/** Looks at every judged_every-th iteration of the method.
 *  Enough when the squares that the views held out are missed by fall by less than their standard
 *  error, sqrt(2 / n) of them for n pixels of normally distributed noise.
 *  @kind Collective(shard), as struct v2v_monitor has it */
int v2v_judge_enough(void *context, int64_t iteration, const struct v2v_iterate *iterate);

#endif
