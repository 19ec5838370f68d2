/* The encoder in lines, against the same encoder that keeps every image as a whole. */
#include "small_draw.h"
#include "support.h"
#include "v2v/encoder.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/op/gemm.h"

#include <math.h>
#include <string.h>

enum { FEATURES = 5 };

struct run {
    struct v2v_encoder *encoder;
    float *workspace;
    const float *features;
};

/* Whatever lay in the workspace before must not be seen: it begins as NaN. */
static struct run encode(const struct v2v_encoder *like, const struct v2v_parameters *parameters,
                         const float *view, int64_t height, int64_t width, int training,
                         int precision)
{
    struct run run = {0};
    struct v2v_conv_method method = {.backend = V2V_BACKEND_ONEDNN, .precision = precision};
    assert_ok(v2v_encoder_twin(&run.encoder, like));
    int64_t floats = v2v_encoder_workspace(run.encoder, 1, height, width, training);
    run.workspace = v2v_mem_alloc("test", floats, sizeof *run.workspace);
    assert_non_null(run.workspace);
    for (int64_t i = 0; i < floats; i++) {
        run.workspace[i] = NAN;
    }
    assert_ok(v2v_encoder_plan(run.encoder, run.workspace, &method));
    v2v_encoder_weights_changed(run.encoder, parameters);
    run.features = v2v_encoder_forward(run.encoder, view);
    return run;
}

static void run_fini(struct run *run)
{
    v2v_encoder_destroy(&run->encoder);
    v2v_mem_free(run->workspace);
}

static void check(const struct v2v_encoder *like, const struct v2v_parameters *parameters,
                  int64_t height, int64_t width, int threads, int precision)
{
    float *view = small_draw(height * width, 2, 0.3);
    v2v_op_set_threads(threads);
    struct run whole = encode(like, parameters, view, height, width, 1, precision);
    struct run lines = encode(like, parameters, view, height, width, 0, precision);
    for (int again = 0; again < 2; again++) { /* with what the first time left in the rings */
        assert_true(isfinite(lines.features[0]));
        assert_memory_equal(lines.features, whole.features,
                            (size_t)(FEATURES * height * width) * sizeof *view);
        lines.features = v2v_encoder_forward(lines.encoder, view);
    }
    run_fini(&whole);
    run_fini(&lines);
    v2v_mem_free(view);
}

static void lines_give_the_bits_of_whole_images(void **unused)
{
    /* One band shorter than a ring and longer; bands of unequal rows; too few rows for bands;
     * columns beyond vectors, and more of them than bilinear upsampling takes at a time. */
    static const struct {
        int64_t height, width;
        int threads;
    } cases[] = {{8, 8, 1}, {48, 72, 1}, {80, 64, 2}, {104, 24, 3}, {48, 16, 3}, {64, 520, 2}};
    struct v2v_fields fields = {0};
    struct v2v_encoder *like = NULL;
    (void)unused;
    assert_ok(v2v_encoder_create(&like, &fields, FEATURES));
    struct v2v_parameters parameters = {.fields = &fields,
                                        .weights = small_draw(fields.total, 1, 0.3)};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        for (int precision = V2V_PRECISION_F32; precision <= V2V_PRECISION_BF16; precision++) {
            check(like, &parameters, cases[i].height, cases[i].width, cases[i].threads, precision);
        }
    }
    v2v_op_set_threads(1);
    v2v_encoder_destroy(&like);
    v2v_mem_free(parameters.weights);
    v2v_fields_fini(&fields);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(lines_give_the_bits_of_whole_images)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
