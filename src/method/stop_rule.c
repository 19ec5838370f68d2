#include "method/stop_rule.h"

#include "method/richardson_lucy.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/blind.h"

#include <math.h>

enum { EVERY = 4, HELD_OUT = 2 }; /* of every four views the third */

enum v2v_status v2v_stop_rule_check(const struct v2v_problem *problem)
{
    if (problem->config->deconv.stop == V2V_STOP_HELDOUT && problem->psf->views <= HELD_OUT) {
        return V2V_FAIL(V2V_E_CONFIG, "--stop heldout needs %d views or more, not %lld",
                        HELD_OUT + 1, (long long)problem->psf->views);
    }
    return V2V_OK;
}

enum v2v_status v2v_stop_rule_init(struct v2v_stop_rule *stop, const struct v2v_problem *problem)
{
    enum v2v_status rc = V2V_OK;
    const int64_t views = problem->psf->views;
    stop->rule = problem->config->deconv.stop;
    V2V_TRY(V2V_ALLOC(stop->views, "rld.stop", 2 * views));
    int32_t *const first = stop->views + views;
    int32_t *used = first, *held_out = first + views;
    for (int32_t v = 0; v < views; v++) {
        stop->views[v] = v;
        if (v % EVERY == HELD_OUT) {
            *--held_out = v;
        } else {
            *used++ = v;
        }
    }
    stop->all = (struct v2v_view_list){stop->views, views};
    stop->used = (struct v2v_view_list){first, used - first};
    stop->held_out = (struct v2v_view_list){held_out, first + views - held_out};
done:
    return rc;
}

void v2v_stop_rule_fini(struct v2v_stop_rule *stop)
{
    v2v_mem_free(stop->views);
}

/** Squared differences of recorded and predicted light over the views held out, and of how many
 *  pixels. Collective(shard). */
static void miss(double sums[2], const struct v2v_judge *judge, const float *volume)
{
    struct v2v_richardson_lucy *self = judge->method;
    const struct v2v_view_list *list = &self->stop.held_out;
    const int64_t count = v2v_richardson_lucy_pixels(self);
    const int64_t first = self->share.view_rows.first * self->width;
    sums[0] = sums[1] = 0.0;
    for (int64_t i = 0; i < list->count; i++) {
        const int32_t v = list->view[i];
        v2v_watchdog_beat("a view that is held out");
        const float *recorded = judge->views + v * self->height * self->width + first;
        v2v_projector_forward(self->projector, self->ratio, volume, &v, 1, 1.0f);
        for (int64_t p = 0; p < count; p++) {
            const double d = (double)recorded[p] / judge->mean - (double)self->ratio[p];
            const int lit = !self->unlit[v * count + p] && recorded[p] != V2V_BLIND;
            sums[0] += lit ? d * d : 0.0;
            sums[1] += lit;
        }
    }
    v2v_par_sum_f64(self->comm, sums, 2);
}

int v2v_judge_enough(void *context, int64_t iteration, const struct v2v_iterate *iterate)
{
    struct v2v_judge *judge = context;
    double sums[2];
    if (iteration % judge->method->variant->judged_every != 0) {
        return 0;
    }
    miss(sums, judge, iterate->volume);
    if (judge->best > 0 && !(judge->last - sums[0] >= sqrt(2.0 / sums[1]) * sums[0])) {
        judge->has_ended = 1;
        return 1;
    }
    judge->last = sums[0];
    judge->best = iteration;
    return 0;
}
