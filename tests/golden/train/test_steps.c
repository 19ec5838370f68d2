/* Three training steps against the reference in double precision (golden/network.h5): losses, all
 * gradient norms, sampled gradients and weights after the first step. */
#include "held_out.h"
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/loss/loss.h"
#include "v2v3d/nn/adam.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/tensor/statistics.h"
#include "v2v3d/v2v/model.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { VIEWS = 13, SLICES = 39, SIDE = 64, STEPS = 3, COLUMNS = 7, PATH = 512 };

#define LEARNING_RATE 8e-5

static char golden_path[PATH];

struct golden_run {
    struct v2v_psf_file psf;
    struct v2v_shifts shifts;
    struct v2v_model *model;
    struct v2v_projector *projector;
    struct v2v_loss *loss;
    float *views, *volume[2], *dvolume[2], *m, *v, *before;
};

/* A way to compute, and what it may err by in step 3. */
struct way {
    int backend, winograd, every_slice;
    double last;
};

static void setup(struct golden_run *run, const char *psf_path, const struct way *way)
{
    struct v2v_config config;
    int64_t count = 0, voxels = SLICES * SIDE * SIDE;
    v2v_config_defaults(&config);
    double *lfi = test_h5_read(golden_path, "lfi", &count);
    assert_ok(V2V_ALLOC(run->views, "test", count));
    for (int64_t i = 0; i < count; i++) {
        run->views[i] = (float)lfi[i];
    }
    test_release(lfi);
    for (int b = 0; b < 2; b++) {
        assert_ok(V2V_ALLOC(run->volume[b], "test", voxels));
        assert_ok(V2V_ALLOC(run->dvolume[b], "test", voxels));
    }
    assert_ok(v2v_psf_read(&run->psf, psf_path, "", V2V_NORMALIZE_NONE, NULL));
    assert_ok(v2v_shifts_from_psf(&run->shifts, &run->psf));
    struct v2v_model_spec spec = {.views = VIEWS,
                                  .slices = SLICES,
                                  .width = 128,
                                  .features = 4,
                                  .branches = V2V_BRANCH_BOTH,
                                  .backend = way->backend,
                                  .winograd = way->winograd,
                                  .every_slice = way->every_slice,
                                  .volume_scale = 1.0};
    assert_ok(v2v_model_create(&run->model, &spec, &run->shifts));
    const struct v2v_fields *fields = v2v_model_fields(run->model);
    int64_t seed = (int64_t)test_h5_attribute(golden_path, "/", "seed");
    assert_ok(v2v_rule_weights(fields, v2v_model_weights(run->model), V2V_RULE_HASH, seed));
    assert_ok(v2v_model_plan(run->model, SIDE, SIDE, 1));
    assert_ok(V2V_ALLOC(run->m, "test", fields->total));
    assert_ok(V2V_ALLOC(run->v, "test", fields->total));
    assert_ok(V2V_ALLOC(run->before, "test", fields->total));
    assert_ok(v2v_projector_create(&run->projector, &run->psf, SIDE, SIDE, V2V_SPLIT_SLABS, NULL));
    struct v2v_loss_setup loss = {.settings = &config.loss,
                                  .psf = &run->psf,
                                  .reduce = V2V_REDUCE_MEAN,
                                  .height = SIDE,
                                  .width = SIDE,
                                  .window = {0, SIDE, 0, SIDE},
                                  .projector = run->projector};
    test_hold_out_halves(&loss, VIEWS);
    assert_ok(v2v_loss_create(&run->loss, &loss));
}

static void teardown(struct golden_run *run)
{
    float *memory[] = {run->views,      run->volume[0], run->volume[1], run->dvolume[0],
                       run->dvolume[1], run->m,         run->v,         run->before};
    v2v_loss_destroy(&run->loss);
    v2v_projector_destroy(&run->projector);
    v2v_model_destroy(&run->model);
    v2v_shifts_fini(&run->shifts);
    v2v_psf_file_fini(&run->psf);
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static double relative(double a, double b)
{
    return fabs(a - b) / fabs(b);
}

/* Bars: 1e-4 at step 1, 1e-3 at steps 2 and 3 for losses, 1e-3 for gradient norms.
 * `last`: of step 3. An activation within round-off of its kink changes the gradient at once: with
 * a forward error e a share e of them does, and the gradient errs by about sqrt(e), 2e-3 for the
 * largest layers; Adam turns that into whole steps of other signs. After two steps the reference in
 * float32 (PyTorch) is off by 7e-4 to 8e-4, oneDNN with merged taps as much, OpenBLAS without
 * merging by 6e-4 to 9e-4; Winograd and oneDNN's unmerged taps, with more round-off before
 * the first kinks, by 1e-3 to 4e-3: otherwise in every build and for every number of threads. */
static void check_step(const double *terms, double norm, const double *golden, int step,
                       double last)
{
    static const int term[COLUMNS - 1] = {V2V_LOSS_MSE, V2V_LOSS_FFT, V2V_LOSS_POS,
                                          V2V_LOSS_DC,  V2V_LOSS_TV,  V2V_LOSS_TOTAL};
    double bar = step == 0 ? 1e-4 : step == 1 ? 1e-3 : last;
    for (int i = 0; i < COLUMNS - 1; i++) {
        double error = relative(terms[term[i]], golden[i]);
        print_message("step %d %-5s %.8g golden %.8g relative %.1e\n", step + 1,
                      v2v_loss_name(term[i]), terms[term[i]], golden[i], error);
        assert_true(error <= bar);
    }
    print_message("step %d norm  %.8g golden %.8g relative %.1e\n", step + 1, norm,
                  golden[COLUMNS - 1], relative(norm, golden[COLUMNS - 1]));
    assert_true(relative(norm, golden[COLUMNS - 1]) <= (step == 2 ? last : 1e-3));
}

/* Every field that the golden file samples, at its stride, against `arena`. */
static void check_fields(const struct golden_run *run, const float *gradients)
{
    const struct v2v_fields *fields = v2v_model_fields(run->model);
    const float *after = v2v_model_weights(run->model);
    int64_t compared = 0, tiny = 0;
    double worst_norm = 0.0, worst_step = 0.0;
    for (int64_t i = 0; i < fields->count; i++) {
        const struct v2v_fields_item *field = &fields->item[i];
        const float *g = gradients + field->offset, *before = run->before + field->offset;
        char gradient[128], weights[128];
        int64_t count = 0;
        snprintf(gradient, sizeof gradient, "/gradient/%s", field->name);
        snprintf(weights, sizeof weights, "/after_step_1/%s", field->name);
        double golden_norm = test_h5_attribute(golden_path, gradient, "norm");
        int64_t stride = (int64_t)test_h5_attribute(golden_path, gradient, "stride");
        double norm = sqrt(v2v_sum_of_squares(g, field->count));
        worst_norm = fmax(worst_norm, relative(norm, golden_norm));
        double *golden_gradient = test_h5_read(golden_path, gradient, &count);
        double *golden_after = test_h5_read(golden_path, weights, NULL);
        double rms = golden_norm / sqrt((double)field->count);
        for (int64_t j = 0; j < count; j++) {
            int64_t at = j * stride;
            double error =
                fabs((after[field->offset + at] - before[at]) - (golden_after[j] - before[at]));
            /* Adam's first step is lr * g/(|g| + eps): it has the sign of g, so an element whose
             * gradient is within round-off of 0 may step either way */
            if (fabs(golden_gradient[j]) < 1e-2 * rms) {
                tiny++;
                continue;
            }
            compared++;
            worst_step = fmax(worst_step, error / LEARNING_RATE);
        }
        test_release(golden_gradient);
        test_release(golden_after);
    }
    print_message("gradient norms: worst relative error %.1e; first step: worst error %.1e of its "
                  "size in %lld samples, %lld left out (|g| < 1e-2 of the field's RMS)\n",
                  worst_norm, worst_step, (long long)compared, (long long)tiny);
    assert_true(worst_norm <= 1e-3);
    assert_true(worst_step <= 1e-3);
    assert_true(compared > 4 * tiny); /* the comparison is of most of them */
}

static void run_steps(const struct way *way)
{
    struct golden_run run = {0};
    char psf_path[PATH];
    const char *found = test_shared("golden/network.h5");
    snprintf(golden_path, sizeof golden_path, "%s", found != NULL ? found : "");
    found = found != NULL ? test_shared("psf/2psam/psf_1.tif") : NULL;
    if (found == NULL) {
        skip();
    }
    snprintf(psf_path, sizeof psf_path, "%.*s", (int)(strrchr(found, '/') - found), found);
    setup(&run, psf_path, way);
    double *golden = test_h5_read(golden_path, "steps", NULL);
    int64_t total = v2v_model_fields(run.model)->total;
    float *weights = v2v_model_weights(run.model), *gradients = v2v_model_gradients(run.model);
    struct v2v_adam adam = {LEARNING_RATE, 0.9, 0.999, 1e-8};
    for (int step = 0; step < STEPS; step++) {
        double terms[V2V_LOSS_TERMS];
        memcpy(run.before, weights, (size_t)total * sizeof *weights);
        memset(gradients, 0, (size_t)total * sizeof *gradients);
        v2v_model_forward(run.model, run.volume[0], run.volume[1], run.views);
        const float *const volume[2] = {run.volume[0], run.volume[1]};
        v2v_loss_evaluate(run.loss, terms, V2V_BRANCH_BOTH, run.dvolume, volume, run.views);
        v2v_model_backward(run.model, run.dvolume[0], run.dvolume[1]);
        check_step(terms, sqrt(v2v_sum_of_squares(gradients, total)), golden + step * COLUMNS, step,
                   way->last);
        v2v_adam_step(&adam, weights, run.m, run.v, gradients, total, step + 1);
        v2v_model_weights_changed(run.model);
        if (step == 0) {
            check_fields(&run, gradients);
        }
    }
    test_release(golden);
    teardown(&run);
}

/* What oneDNN may err by in step 3. Plain kernels round every product before it is added, the
 * encoder's on other processors and the projector's where sanitizers allow no clones: more
 * round-off before the first kinks, too. So have oneDNN's kernels of AVX2 (3e-3). */
static double last_of_onednn(void)
{
#if defined V2V_X86 && !defined __SANITIZE_ADDRESS__
    return __builtin_cpu_supports("avx512f") ? 1e-3 : 1e-2;
#else
    return 1e-2;
#endif
}

static void three_steps_match_the_reference(void **state)
{
    (void)state;
    run_steps(&(struct way){V2V_BACKEND_ONEDNN, 0, 0, last_of_onednn()});
}

static void three_steps_by_minimal_filtering_match_the_reference(void **state)
{
    (void)state;
    run_steps(&(struct way){V2V_BACKEND_ONEDNN, 1, 0, 1e-2});
}

static void three_steps_without_merging_match_the_reference(void **state)
{
    (void)state;
    run_steps(&(struct way){V2V_BACKEND_OPENBLAS, 0, 1, 1e-2});
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(three_steps_match_the_reference),
        cmocka_unit_test(three_steps_without_merging_match_the_reference),
        cmocka_unit_test(three_steps_by_minimal_filtering_match_the_reference),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
