/* A frame or a step may take longer than the watchdog's time: the network shows all along that it
 * goes on, by a beat in every block of layers. */
#include "small_shifts.h"
#include "support.h"

#include "v2v3d/nn/rule.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/v2v/model.h"

enum { VIEWS = 5, SLICES = 4, SIDE = 64, PIXELS = SIDE * SIDE };

/* Two convolutions at most stand between two beats. */
enum { CONVOLUTIONS_A_BEAT = 2 };

static float views[VIEWS * PIXELS], volume[2][SLICES * PIXELS];

static void count(void *context)
{
    (*(int64_t *)context)++;
}

static int64_t count_convolutions(const struct v2v_fields *fields)
{
    int64_t convolutions = 0;
    for (int64_t i = 0; i < fields->count; i++) {
        convolutions += fields->item[i].rank == 4;
    }
    return convolutions;
}

static int64_t count_beats(struct v2v_model *model, int backward)
{
    int64_t beats = 0;
    v2v_watchdog_listen(count, &beats);
    if (backward) {
        v2v_model_backward(model, volume[0], volume[1]);
    } else {
        v2v_model_forward(model, volume[0], volume[1], views);
    }
    v2v_watchdog_listen(NULL, NULL);
    return beats;
}

static void check_passes(enum v2v_backend backend, int training)
{
    const struct v2v_model_spec spec = {.views = VIEWS,
                                        .slices = SLICES,
                                        .width = 16,
                                        .features = 4,
                                        .branches = V2V_BRANCH_BOTH,
                                        .backend = backend,
                                        .volume_scale = 1.0};
    struct v2v_model *model = NULL;
    struct v2v_shifts shifts = small_shifts(VIEWS, SLICES);
    assert_ok(v2v_model_create(&model, &spec, &shifts));
    assert_ok(
        v2v_rule_weights(v2v_model_fields(model), v2v_model_weights(model), V2V_RULE_HASH, 7));
    assert_ok(v2v_model_plan(model, SIDE, SIDE, training));
    const int64_t least = count_convolutions(v2v_model_fields(model)) / CONVOLUTIONS_A_BEAT;
    assert_true(least > 10);
    for (int backward = 0; backward <= training; backward++) {
        const int64_t beats = count_beats(model, backward);
        if (beats < least) {
            fail_msg("backend %d, training %d, backward %d: %d beats of %d", (int)backend, training,
                     backward, (int)beats, (int)least);
        }
    }
    v2v_model_destroy(&model);
    v2v_shifts_fini(&shifts);
}

static void every_block_of_layers_beats(void **state)
{
    (void)state;
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] = (float)(i % 17) * 0.1f;
    }
    for (int training = 0; training < 2; training++) {
        check_passes(V2V_BACKEND_ONEDNN, training);
        check_passes(V2V_BACKEND_OPENBLAS, training);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_block_of_layers_beats)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
