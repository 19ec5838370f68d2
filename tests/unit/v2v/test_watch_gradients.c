/* Who watches a backward pass hears of every gradient once, when it is final. */
#include "small_shifts.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/v2v/model.h"

#include <string.h>

enum { VIEWS = 5, SLICES = 4, SIDE = 32, PIXELS = SIDE * SIDE, BRANCHES = 2 };

struct watched {
    struct v2v_model *model;
    float *seen;    /* the gradients as they were when they were announced */
    int32_t *times; /* how often */
    int64_t calls, last_first;
    int rising; /* announcements that lie behind the one before */
};

static void watch(void *context, int64_t first, int64_t count)
{
    struct watched *watched = context;
    const float *gradients = v2v_model_gradients(watched->model);
    assert_true(first >= 0 && count > 0);
    assert_true(first + count <= v2v_model_fields(watched->model)->total);
    memcpy(watched->seen + first, gradients + first, (size_t)count * sizeof *gradients);
    for (int64_t i = first; i < first + count; i++) {
        watched->times[i]++;
    }
    watched->rising += watched->calls > 0 && first > watched->last_first;
    watched->last_first = first;
    watched->calls++;
}

static void check(unsigned branches)
{
    static float views[VIEWS * PIXELS], volume[BRANCHES][SLICES * PIXELS];
    struct v2v_model_spec spec = {.views = VIEWS,
                                  .slices = SLICES,
                                  .width = 4,
                                  .features = 4,
                                  .branches = branches,
                                  .volume_scale = 1.0};
    struct v2v_shifts shifts = small_shifts(VIEWS, SLICES);
    struct watched watched = {0};
    assert_ok(v2v_model_create(&watched.model, &spec, &shifts));
    int64_t total = v2v_model_fields(watched.model)->total;
    assert_ok(v2v_rule_weights(v2v_model_fields(watched.model), v2v_model_weights(watched.model),
                               V2V_RULE_HASH, 7));
    assert_ok(v2v_model_plan(watched.model, SIDE, SIDE, 1));
    assert_ok(V2V_ALLOC(watched.seen, "test", total));
    assert_ok(V2V_ALLOC(watched.times, "test", total));
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] = (float)(i % 17) * 0.1f;
    }
    v2v_model_forward(watched.model, volume[0], volume[1], views);
    v2v_model_watch_gradients(watched.model, watch, &watched);
    v2v_model_backward(watched.model, volume[0], volume[1]);
    for (int64_t i = 0; i < total; i++) {
        assert_int_equal(watched.times[i], 1);
    }
    assert_memory_equal(watched.seen, v2v_model_gradients(watched.model),
                        (size_t)total * sizeof *watched.seen);
    /* 16 layers a U-Net from the last to the first, then the encoder */
    int unets = branches == V2V_BRANCH_BOTH ? 2 : 1;
    assert_int_equal(watched.calls, 16 * unets + 1);
    assert_int_equal(watched.rising, unets - 1);
    v2v_mem_free(watched.seen);
    v2v_mem_free(watched.times);
    v2v_model_destroy(&watched.model);
    v2v_shifts_fini(&shifts);
}

static void every_gradient_is_announced_once_and_is_final(void **state)
{
    (void)state;
    check(V2V_BRANCH_BOTH);
    check(V2V_BRANCH_1);
    check(V2V_BRANCH_2);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_gradient_is_announced_once_and_is_final),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
