/* Every term's gradient against central differences, and the branch bookkeeping. */
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
    float *views, *volume[2], *dvolume[2], *moved[2], *direction[2];
};

static void fill(float *x, int64_t count, uint64_t stream, double mean, double spread)
{
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)(mean + spread * v2v_random_normal(17, stream, (uint64_t)i));
    }
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
    int64_t taps = VIEWS * SLICES * KERNEL * KERNEL;
    assert_ok(V2V_ALLOC(j->psf.data, "test", taps));
    for (int64_t i = 0; i < taps; i++) {
        j->psf.data[i] = (float)v2v_random_uniform(17, 9, (uint64_t)i);
    }
    v2v_psf_normalize_views(&j->psf);
    assert_ok(V2V_ALLOC(j->views, "test", VIEWS * SIDE * SIDE));
    fill(j->views, VIEWS * SIDE * SIDE, 1, 0.5, 0.2);
    for (int b = 0; b < 2; b++) {
        float **memory[] = {&j->volume[b], &j->dvolume[b], &j->moved[b], &j->direction[b]};
        for (int i = 0; i < 4; i++) {
            assert_ok(V2V_ALLOC(*memory[i], "test", VOXELS));
        }
        fill(j->volume[b], VOXELS, (uint64_t)(2 + b), 0.3, 0.5);
        fill(j->direction[b], VOXELS, (uint64_t)(4 + b), 1.0, 0.3);
        for (int64_t i = 0; i < VOXELS; i++) {
            j->direction[b][i] += j->volume[b][i]; /* along it no term's slope cancels out */
        }
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
        v2v_mem_free(j->moved[b]);
        v2v_mem_free(j->direction[b]);
    }
    v2v_mem_free(j->views);
    v2v_loss_destroy(&j->loss);
    v2v_projector_destroy(&j->projector);
    v2v_psf_file_fini(&j->psf);
    assert_int_equal(v2v_mem_held(), 0);
}

static double total_at(struct judged *j, double step)
{
    double terms[V2V_LOSS_TERMS];
    for (int b = 0; b < 2; b++) {
        for (int64_t i = 0; i < VOXELS; i++) {
            j->moved[b][i] = j->volume[b][i] + (float)step * j->direction[b][i];
        }
    }
    const float *const volume[2] = {j->moved[0], j->moved[1]};
    v2v_loss_evaluate(j->loss, terms, 3, j->dvolume, volume, j->views);
    return terms[V2V_LOSS_TOTAL];
}

/* Of the volumes of all outputs. */
static double slope_by_gradient(struct judged *j)
{
    double sum = 0.0;
    (void)total_at(j, 0.0);
    for (int b = 0; b < 2; b++) {
        for (int64_t i = 0; i < VOXELS; i++) {
            sum += (double)j->dvolume[b][i] * j->direction[b][i];
        }
    }
    return sum;
}

/* Central difference with step h = 1e-3: truncation about h^2, round-off of float sums 6e-8 / h =
 * 6e-5, and for terms with kinks the elements that cross theirs within h, about 1e-3 of them, in
 * both directions: all below 5e-3 of the slope. */
static void check_term(int outputs, int profile, int term)
{
    const double h = 1e-3;
    double weights[V2V_LOSS_TOTAL] = {0.0};
    struct judged j;
    weights[term] = 1.0;
    setup(&j, outputs, profile, weights);
    double by_gradient = slope_by_gradient(&j);
    double by_difference = (total_at(&j, h) - total_at(&j, -h)) / (2.0 * h);
    print_message("%d outputs, profile %d, %s: gradient %.6g difference %.6g\n", outputs, profile,
                  v2v_loss_name(term), by_gradient, by_difference);
    assert_true(fabs(by_gradient) > 0.0);
    assert_true(fabs(by_gradient - by_difference) <= 5e-3 * fabs(by_difference));
    teardown(&j);
}

static void gradients_match_central_differences(void **state)
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
    setup(&j, 2, V2V_LOSS_REFERENCE, NULL);
    const float *const volume[2] = {j.volume[0], j.volume[1]};
    v2v_loss_evaluate(j.loss, both, 3, j.dvolume, volume, j.views);
    for (int b = 0; b < 2; b++) {
        memcpy(j.moved[b], j.dvolume[b], VOXELS * sizeof(float));
        memset(j.dvolume[b], 0, VOXELS * sizeof(float));
    }
    v2v_loss_evaluate(j.loss, one, 1, j.dvolume, volume, j.views);
    v2v_loss_evaluate(j.loss, two, 2, j.dvolume, volume, j.views);
    for (int i = 0; i < V2V_LOSS_TERMS; i++) {
        assert_true(fabs(one[i] + two[i] - both[i]) <= 1e-12 * fabs(both[i]));
    }
    for (int b = 0; b < 2; b++) {
        assert_memory_equal(j.moved[b], j.dvolume[b], VOXELS * sizeof(float));
    }
    teardown(&j);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gradients_match_central_differences),
        cmocka_unit_test(branches_apart_sum_to_both),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
