/* The gradient of every term of the loss, and of the outputs apart. Volumes lie on kinks of most
 * terms (a modulus, what is below zero); all terms are convex. */
#include "gradient.h"
#include "held_out.h"
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/loss/loss.h"

#include <math.h>
#include <string.h>

enum { VIEWS = 5, SLICES = 6, SIDE = 32, KERNEL = 7, VOXELS = SLICES * SIDE * SIDE };

struct judged {
    struct v2v_psf_file psf;
    struct v2v_config config;
    struct v2v_projector *projector;
    struct v2v_loss *loss;
    float *views, *volume[2], *dvolume[2];
};

static float *draw(int64_t count, uint64_t stream, double mean, double spread)
{
    float *x = v2v_mem_alloc("test", count, sizeof *x);
    assert_non_null(x);
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)(mean + spread * v2v_random_normal(17, stream, (uint64_t)i));
    }
    return x;
}

static void setup(struct judged *j, int outputs, int profile, const double *weights)
{
    *j = (struct judged){
        .psf = {.views = VIEWS, .slices = SLICES, .height = KERNEL, .width = KERNEL}};
    v2v_config_defaults(&j->config);
    j->config.loss.profile = profile;
    for (int i = 0; i < V2V_LOSS_TOTAL && weights != NULL; i++) {
        j->config.loss.weight[i] = (struct v2v_number){V2V_NUMBER_GIVEN, weights[i]};
    }
    j->psf.data = draw(VIEWS * SLICES * KERNEL * KERNEL, 9, 0.5, 0.1);
    v2v_psf_normalize_views(&j->psf);
    j->views = draw(VIEWS * SIDE * SIDE, 1, 0.5, 0.2);
    for (int b = 0; b < 2; b++) {
        j->volume[b] = draw(VOXELS, (uint64_t)(2 + b), 0.3, 0.5);
        j->dvolume[b] = draw(VOXELS, 4, 0.0, 1.0);
    }
    assert_ok(v2v_projector_create(&j->projector, &j->psf, SIDE, SIDE, V2V_SPLIT_SLABS, NULL));
    struct v2v_loss_setup setup = {.settings = &j->config.loss,
                                   .psf = &j->psf,
                                   .reduce = V2V_REDUCE_SUM,
                                   .height = SIDE,
                                   .width = SIDE,
                                   .window = {3, 30, 2, 29},
                                   .projector = j->projector};
    test_hold_out_halves(&setup, VIEWS);
    if (outputs == 1) {
        setup.outputs = 1;
    }
    assert_ok(v2v_loss_create(&j->loss, &setup));
}

static void teardown(struct judged *j)
{
    for (int b = 0; b < 2; b++) {
        v2v_mem_free(j->volume[b]);
        v2v_mem_free(j->dvolume[b]);
    }
    v2v_mem_free(j->views);
    v2v_loss_destroy(&j->loss);
    v2v_projector_destroy(&j->projector);
    v2v_psf_file_fini(&j->psf);
    assert_int_equal(v2v_mem_held(), 0);
}

static void evaluate(struct judged *j, double *terms, unsigned outputs)
{
    const float *const volume[2] = {j->volume[0], j->volume[1]};
    v2v_loss_evaluate(j->loss, terms, outputs, j->dvolume, volume, j->views);
}

static void forward(void *self, double *total)
{
    double terms[V2V_LOSS_TERMS];
    evaluate(self, terms, 3);
    *total = terms[V2V_LOSS_TOTAL];
}

static void backward(void *self, const double *dtotal)
{
    struct judged *j = self;
    double total;
    forward(self, &total);
    for (int b = 0; b < 2; b++) {
        for (int64_t i = 0; i < VOXELS; i++) {
            j->dvolume[b][i] *= (float)*dtotal;
        }
    }
}

/* These have a Taylor remainder of second order; the others have kinks wherever a voxel lies on 0
 * or a frequency vanishes. */
static int is_quadratic(int profile, int term)
{
    return term == V2V_LOSS_MSE || (term == V2V_LOSS_FFT && profile == V2V_LOSS_PAPER);
}

/* Sums are double, of single numbers that float32 rounds each by itself: projections by three
 * transforms and their gradients by as many, of 2^11 samples, whose 33 stages round by eps each;
 * 6000 of them round in both directions. One voxel by itself is lost in such a sum. */
static void check_term(int outputs, int profile, int term)
{
    double weights[V2V_LOSS_TOTAL] = {0.0};
    struct judged j;
    weights[term] = 1.0;
    setup(&j, outputs, profile, weights);
    const struct test_argument volume[] = {{"first volume", j.volume[0], j.dvolume[0], VOXELS},
                                           {"second volume", j.volume[1], j.dvolume[1], VOXELS}};
    test_gradient(
        &(struct test_function){.name = v2v_loss_name(term),
                                .argument = volume,
                                .arguments = outputs,
                                .outs = 1,
                                .self = &j,
                                .forward = forward,
                                .backward = backward,
                                .step = is_quadratic(profile, term) ? 0x1p-4 : 0x1p-10,
                                .rounding = 33.0 * 0x1p-23 / sqrt(6000.0),
                                .backward_rounding = 33.0 * 0x1p-23,
                                .sees = 0.01,
                                .kinks = is_quadratic(profile, term) ? TEST_SMOOTH : TEST_CONVEX});
    teardown(&j);
}

static void every_term_has_its_gradient(void **state)
{
    (void)state;
    for (int profile = 0; profile < V2V_LOSS_PROFILES; profile++) {
        for (int term = 0; term < V2V_LOSS_TOTAL; term++) {
            check_term(1, profile, term);
            check_term(2, profile, term);
        }
    }
}

static void branches_apart_sum_to_both(void **state)
{
    (void)state;
    struct judged j;
    double both[V2V_LOSS_TERMS], one[V2V_LOSS_TERMS], two[V2V_LOSS_TERMS];
    static float gradient[2][VOXELS];
    setup(&j, 2, V2V_LOSS_REFERENCE, NULL);
    evaluate(&j, both, 3);
    for (int b = 0; b < 2; b++) {
        memcpy(gradient[b], j.dvolume[b], sizeof gradient[b]);
        memset(j.dvolume[b], 0, sizeof gradient[b]);
    }
    evaluate(&j, one, 1);
    evaluate(&j, two, 2);
    for (int i = 0; i < V2V_LOSS_TERMS; i++) {
        assert_true(fabs(one[i] + two[i] - both[i]) <= 1e-12 * fabs(both[i]));
    }
    for (int b = 0; b < 2; b++) {
        assert_memory_equal(gradient[b], j.dvolume[b], sizeof gradient[b]);
    }
    teardown(&j);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_term_has_its_gradient),
        cmocka_unit_test(branches_apart_sum_to_both),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
