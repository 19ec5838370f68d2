/* The gradient of the paper's network against differences of its double-precision twin: steps a
 * thousand times smaller than float32 could tell, within which hardly a kink lies. */
#include "gradient.h"
#include "network/network_twin.h"
#include "small_model.h"

enum { ROWS = 32, AREA = ROWS * ROWS, OUTS = SLICES * AREA, MOST_FIELDS = 160 };

struct trial {
    struct v2v_model_spec spec;
    struct v2v_shifts shifts;
    struct v2v_model *model;
    float volume[BRANCHES][OUTS], dvolume[BRANCHES][OUTS];
    int64_t wrong; /* the array of parameters whose gradient is 1.02 times too large; 0: none */
};

static void forward(void *self, double *out)
{
    struct trial *t = self;
    double *const volume[BRANCHES] = {out, out + OUTS};
    assert_ok(v2v_network_twin(volume, &t->spec, &t->shifts, v2v_model_fields(t->model),
                               v2v_model_weights(t->model), views, ROWS, ROWS));
}

static void backward(void *self, const double *dout)
{
    struct trial *t = self;
    for (int b = 0; b < BRANCHES; b++) {
        for (int64_t i = 0; i < OUTS; i++) {
            t->dvolume[b][i] = (float)dout[b * OUTS + i];
        }
    }
    v2v_model_weights_changed(t->model);
    v2v_model_forward(t->model, t->volume[0], t->volume[1], views);
    v2v_model_backward(t->model, t->dvolume[0], t->dvolume[1]);
    const struct v2v_fields_item *field = &v2v_model_fields(t->model)->item[t->wrong];
    for (int64_t i = 0; i < field->count && t->wrong > 0; i++) {
        v2v_model_gradients(t->model)[field->offset + i] *= 1.02f;
    }
}

static void setup(struct trial *t)
{
    *t = (struct trial){.spec = small, .shifts = small_shifts(VIEWS, SLICES)};
    t->spec.width = 4;
    t->spec.winograd = 1;
    t->model = create(&t->spec);
    fill(views, VIEWS * AREA, 0);
    assert_ok(v2v_model_plan(t->model, ROWS, ROWS, 1));
}

static void teardown(struct trial *t)
{
    v2v_shifts_fini(&t->shifts);
    v2v_model_destroy(&t->model);
    assert_int_equal(v2v_mem_held(), 0);
}

/* Rounding errors of layers add up in squares: the gradient's as many as the sums of all layers
 * have terms, and those for a weight pixels; the twin's are 2^-29 of that. Of the
 * arrays of parameters from `first` to before `last`. */
static const char *fault_of(struct trial *t, int64_t first, int64_t last)
{
    struct test_argument argument[MOST_FIELDS];
    const struct v2v_fields *fields = v2v_model_fields(t->model);
    double terms = AREA;
    assert_true(last - first <= MOST_FIELDS);
    for (int64_t i = 0; i < fields->count; i++) {
        terms += (double)fields->item[i].count / (double)fields->item[i].shape[0];
    }
    for (int64_t i = first; i < last; i++) {
        const struct v2v_fields_item *field = &fields->item[i];
        argument[i - first] =
            (struct test_argument){.name = field->name,
                                   .x = v2v_model_weights(t->model) + field->offset,
                                   .gradient = v2v_model_gradients(t->model) + field->offset,
                                   .count = field->count};
    }
    return test_gradient_fault(&(struct test_function){.name = "network",
                                                       .argument = argument,
                                                       .arguments = last - first,
                                                       .outs = BRANCHES * OUTS,
                                                       .self = t,
                                                       .forward = forward,
                                                       .backward = backward,
                                                       .step = 0x1p-12,
                                                       .rounding = 0x1p-29 * test_rounding(terms),
                                                       .backward_rounding = test_rounding(terms),
                                                       .sees = 0.01,
                                                       .kinks = TEST_KINKS});
}

static void the_gradient_is_that_of_the_twin(void **state)
{
    static struct trial t;
    (void)state;
    setup(&t);
    const char *wrong = fault_of(&t, 0, v2v_model_fields(t.model)->count);
    if (wrong != NULL) {
        fail_msg("%s", wrong);
    }
    teardown(&t);
}

static void a_gradient_that_is_off_by_two_per_cent_fails(void **state)
{
    static struct trial t;
    (void)state;
    setup(&t);
    for (int64_t i = 3; i < v2v_model_fields(t.model)->count; i += 13) {
        t.wrong = i;
        if (fault_of(&t, i, i + 1) == NULL) {
            fail_msg("%s: passes", v2v_model_fields(t.model)->item[i].name);
        }
    }
    teardown(&t);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_gradient_is_that_of_the_twin),
        cmocka_unit_test(a_gradient_that_is_off_by_two_per_cent_fails)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
