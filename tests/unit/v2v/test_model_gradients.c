/* Gradients of the two-branch network: what must not change them. */
#include "small_model.h"

#include "v2v3d/conf/config.h"
#include "v2v3d/op/gemm.h"
#include "v2v3d/v2v/schema.h"

#include <string.h>

/* `left`: what lies in the gradients before they are set. */
static void run_training(struct v2v_model *model, float *gradients, float left)
{
    static float volume[BRANCHES][VOXELS], dvolume[VOXELS];
    int64_t floats = v2v_model_fields(model)->total;
    fill(views, VIEWS * PIXELS, 0);
    fill(dvolume, VOXELS, 5);
    v2v_model_forward(model, volume[0], volume[1], views);
    for (int64_t i = 0; i < floats; i++) {
        v2v_model_gradients(model)[i] = left;
    }
    v2v_model_backward(model, dvolume, dvolume);
    memcpy(gradients, v2v_model_gradients(model), (size_t)floats * sizeof *gradients);
}

/* However the layers are computed, but for the padding between fields. */
static void gradients_are_set_whatever_lay_there(void **state)
{
    (void)state;
    static const struct {
        int backend, winograd, every_slice;
    } ways[] = {{V2V_BACKEND_ONEDNN, 1, 0},
                {V2V_BACKEND_ONEDNN, 1, 1},
                {V2V_BACKEND_ONEDNN, 0, 0},
                {V2V_BACKEND_OPENBLAS, 0, 0}};
    for (size_t way = 0; way < sizeof ways / sizeof *ways; way++) {
        struct v2v_model_spec spec = small;
        float *gradients[2];
        spec.backend = ways[way].backend;
        spec.winograd = ways[way].winograd;
        spec.every_slice = ways[way].every_slice;
        struct v2v_model *model = create(&spec);
        const struct v2v_fields *fields = v2v_model_fields(model);
        assert_ok(v2v_model_plan(model, SIDE, SIDE, 1));
        for (int i = 0; i < 2; i++) {
            assert_ok(V2V_ALLOC(gradients[i], "test", fields->total));
            run_training(model, gradients[i], 7.0f * (float)i);
        }
        for (int64_t i = 0; i < fields->count; i++) {
            const struct v2v_fields_item *field = &fields->item[i];
            assert_memory_equal(gradients[0] + field->offset, gradients[1] + field->offset,
                                (size_t)field->count * sizeof **gradients);
        }
        v2v_mem_free(gradients[0]);
        v2v_mem_free(gradients[1]);
        v2v_model_destroy(&model);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void training_under_a_memory_limit_gives_the_same_bits(void **state)
{
    (void)state;
    struct v2v_model_spec spec = small;
    struct v2v_fields fields;
    float *gradients[2];
    size_t held[2];
    spec.winograd = 1;
    assert_ok(v2v_model_schema(&fields, &spec));
    for (int i = 0; i < 2; i++) {
        assert_ok(V2V_ALLOC(gradients[i], "test", fields.total));
    }
    for (int i = 0; i < 2; i++) {
        struct v2v_model *model = create(&spec);
        v2v_mem_set_limit(i > 0 ? held[0] - 1 : 0);
        assert_ok(v2v_model_plan(model, SIDE, SIDE, 1));
        held[i] = v2v_mem_held();
        run_training(model, gradients[i], 0.0f);
        v2v_model_destroy(&model);
    }
    v2v_mem_set_limit(0);
    assert_true(held[1] < held[0]);
    assert_memory_equal(gradients[0], gradients[1], (size_t)fields.total * sizeof **gradients);
    v2v_mem_free(gradients[0]);
    v2v_mem_free(gradients[1]);
    v2v_fields_fini(&fields);
}

/* Gradients of a network on one thread and on two. What reaches the encoder comes by way of matrix
 * products at the frame's border, by oneDNN, whose sums' order depends on the threads with AVX2:
 * there they agree to the round-off of products of up to a thousand terms. */
static void check_gradients(const struct v2v_fields *fields, const float *one, const float *two)
{
    int64_t unets = 0;
    for (int64_t i = 0; i < fields->count; i++) {
        const struct v2v_fields_item *field = &fields->item[i];
        const float *a = one + field->offset, *b = two + field->offset;
        if (strncmp(field->name, "feat_extract.", 13) == 0) {
            assert_true(test_relative_l2(a, b, field->count) <= 1000 * 0x1p-24);
        } else {
            assert_memory_equal(a, b, (size_t)field->count * sizeof *a);
            unets++;
        }
    }
    assert_true(unets > 0);
}

static void two_threads_give_the_gradients_of_one(void **state)
{
    (void)state;
    struct v2v_model_spec spec = small;
    float *volume[2] = {NULL, NULL}, *gradients = NULL;
    spec.winograd = 1;
    for (int b = 0; b < BRANCHES; b++) {
        assert_ok(V2V_ALLOC(volume[b], "test", VOXELS));
    }
    fill(views, VIEWS * PIXELS, 0);
    for (int threads = 1; threads <= 2; threads++) {
        v2v_op_set_threads(threads);
        struct v2v_model *model = create(&spec);
        int64_t total = v2v_model_fields(model)->total;
        assert_ok(v2v_model_plan(model, SIDE, SIDE, 1));
        v2v_model_forward(model, volume[0], volume[1], views);
        v2v_model_backward(model, volume[0], volume[1]);
        if (threads == 1) {
            assert_ok(V2V_ALLOC(gradients, "test", total));
            memcpy(gradients, v2v_model_gradients(model), (size_t)total * sizeof *gradients);
        }
        check_gradients(v2v_model_fields(model), gradients, v2v_model_gradients(model));
        v2v_model_destroy(&model);
    }
    v2v_op_set_threads(1);
    v2v_mem_free(gradients);
    v2v_mem_free(volume[0]);
    v2v_mem_free(volume[1]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gradients_are_set_whatever_lay_there),
        cmocka_unit_test(training_under_a_memory_limit_gives_the_same_bits),
        cmocka_unit_test(two_threads_give_the_gradients_of_one),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
