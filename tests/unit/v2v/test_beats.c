/* A frame or a step may take longer than the watchdog's time: the network shows all along that it
 * goes on. */
#include "capture.h"
#include "small_shifts.h"

#include "v2v3d/base/clock.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/v2v/model.h"

#include <stdio.h>
#include <unistd.h>

/* PERIODS: of the watchdog in one pass, which has some 60 layers. A machine that stands still for a
 * whole period would end a good one: one of TRIALS has to live. */
enum { PERIODS = 4, TRIALS = 3, LIVES = 3 };
enum { VIEWS = 5, SLICES = 4, SIDE = 128, PIXELS = SIDE * SIDE, BRANCHES = 2 };

static float views[VIEWS * PIXELS], volume[BRANCHES][SLICES * PIXELS];

static const struct v2v_model_spec spec = {.views = VIEWS,
                                           .slices = SLICES,
                                           .width = 16,
                                           .features = 4,
                                           .branches = V2V_BRANCH_BOTH,
                                           .backend = V2V_BACKEND_ONEDNN,
                                           .volume_scale = 1.0};

static void run(struct v2v_model *model, int backward)
{
    if (backward) {
        v2v_model_backward(model, volume[0], volume[1]);
    } else {
        v2v_model_forward(model, volume[0], volume[1], views);
    }
}

/* Exits with LIVES, or the watchdog ends it. */
static void outlast(int training, int backward)
{
    struct v2v_model *model = NULL;
    struct v2v_shifts shifts = small_shifts(VIEWS, SLICES);
    assert_ok(v2v_model_create(&model, &spec, &shifts));
    assert_ok(
        v2v_rule_weights(v2v_model_fields(model), v2v_model_weights(model), V2V_RULE_HASH, 7));
    assert_ok(v2v_model_plan(model, SIDE, SIDE, training));
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] = (float)(i % 17) * 0.1f;
    }
    run(model, 0);
    double start = v2v_clock_now();
    run(model, backward);
    v2v_watchdog_set_period((v2v_clock_now() - start) / PERIODS);
    v2v_watchdog_beat("a pass");
    run(model, backward);
    v2v_watchdog_disarm();
    _exit(LIVES);
}

static void forward(void)
{
    outlast(0, 0);
}

static void forward_in_training(void)
{
    outlast(1, 0);
}

static void backward(void)
{
    outlast(1, 1);
}

static void pass_of_four_periods_lives(void **state)
{
    (void)state;
    static void (*const passes[])(void) = {forward, forward_in_training, backward};
    for (size_t i = 0; i < sizeof passes / sizeof *passes; i++) {
        char text[1024] = "";
        int code = 0;
        for (int trial = 0; trial < TRIALS && code != LIVES; trial++) {
            code = test_in_child(passes[i], text, sizeof text);
        }
        if (code != LIVES) {
            fail_msg("pass %d ended with %d: %s", (int)i, code, text);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(pass_of_four_periods_lives)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
