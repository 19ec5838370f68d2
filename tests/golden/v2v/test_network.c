/* The network against the reference in double precision (golden/network.h5), with both backends. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/op/bf16.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/v2v/model.h"

#include <stdio.h>
#include <string.h>

enum { VIEWS = 13, SLICES = 39, SIDE = 64, PATH = 512 };

/* For float32 at width 128. The sums have at most 9828 terms (fewer when merged) in
 * a chain of 18 layers: 18 * sqrt(9828) * 6e-8 = 1.1e-4 at worst for uncorrelated round-off. */
#define TOLERANCE 1e-4

/* For bf16. In each of the 16 layers of the chain two factors and an image are
 * rounded by 2^-8 / sqrt(3) at most in the mean square: 1.6e-2, sqrt(3 * 16) of them, if nothing
 * averaged out in a layer's sums; what factors lose does. */
#define BF16_TOLERANCE 2e-2

static char golden_path[PATH], psf_path[PATH];

static int find_data(void)
{
    const char *golden = test_shared("golden/network.h5");
    snprintf(golden_path, sizeof golden_path, "%s", golden != NULL ? golden : "");
    const char *psf = golden != NULL ? test_shared("psf/2psam/psf_1.tif") : NULL;
    snprintf(psf_path, sizeof psf_path, "%s", psf != NULL ? psf : "");
    char *slash = strrchr(psf_path, '/');
    if (slash != NULL) {
        *slash = '\0';
    }
    return psf != NULL;
}

static void compare(const float *volume, const char *dataset, double tolerance)
{
    int64_t count = 0;
    double *golden = test_h5_read(golden_path, dataset, &count);
    assert_int_equal(count, SLICES * SIDE * SIDE);
    double error = test_relative_l2_to_double(volume, golden, count);
    print_message("%s: relative L2 error %.2e\n", dataset, error);
    assert_true(error <= tolerance);
    test_release(golden);
}

/* A way to compute the network. */
struct way {
    int backend, winograd, every_slice, precision;
    double tolerance;
};

static void run_network(const struct way *way)
{
    struct v2v_psf_file psf = {0};
    struct v2v_shifts shifts = {0};
    struct v2v_model *model = NULL;
    float *views = NULL, *volume1 = NULL, *volume2 = NULL;
    int64_t count = 0, voxels = SLICES * SIDE * SIDE;
    double *lfi = test_h5_read(golden_path, "lfi", &count);
    assert_int_equal(count, VIEWS * SIDE * SIDE);
    assert_ok(V2V_ALLOC(views, "test", count));
    assert_ok(V2V_ALLOC(volume1, "test", voxels));
    assert_ok(V2V_ALLOC(volume2, "test", voxels));
    for (int64_t i = 0; i < count; i++) {
        views[i] = (float)lfi[i];
    }
    assert_ok(v2v_psf_read(&psf, psf_path, "", V2V_NORMALIZE_NONE, NULL));
    assert_ok(v2v_shifts_from_psf(&shifts, &psf));
    struct v2v_model_spec spec = {.views = VIEWS,
                                  .slices = SLICES,
                                  .width = 128,
                                  .features = 4,
                                  .branches = V2V_BRANCH_BOTH,
                                  .backend = way->backend,
                                  .winograd = way->winograd,
                                  .precision = way->precision,
                                  .every_slice = way->every_slice,
                                  .volume_scale = 1.0};
    assert_ok(v2v_model_create(&model, &spec, &shifts));
    int64_t seed = (int64_t)test_h5_attribute(golden_path, "/", "seed");
    assert_ok(
        v2v_rule_weights(v2v_model_fields(model), v2v_model_weights(model), V2V_RULE_HASH, seed));
    assert_ok(v2v_model_plan(model, SIDE, SIDE, 0));
    v2v_model_forward(model, volume1, volume2, views);
    compare(volume1, "volume1", way->tolerance);
    compare(volume2, "volume2", way->tolerance);
    v2v_model_destroy(&model);
    v2v_shifts_fini(&shifts);
    v2v_psf_file_fini(&psf);
    v2v_mem_free(volume2);
    v2v_mem_free(volume1);
    v2v_mem_free(views);
    test_release(lfi);
    assert_int_equal(v2v_mem_held(), 0);
}

static void network_matches_golden_volumes_with_onednn(void **state)
{
    (void)state;
    if (!find_data()) {
        skip();
    }
    run_network(&(struct way){V2V_BACKEND_ONEDNN, 0, 0, V2V_PRECISION_F32, TOLERANCE});
}

static void network_matches_golden_volumes_with_openblas(void **state)
{
    (void)state;
    if (!find_data()) {
        skip();
    }
    run_network(&(struct way){V2V_BACKEND_OPENBLAS, 0, 0, V2V_PRECISION_F32, TOLERANCE});
}

static void network_matches_golden_volumes_with_winograd(void **state)
{
    (void)state;
    if (!find_data()) {
        skip();
    }
    run_network(&(struct way){V2V_BACKEND_ONEDNN, 1, 0, V2V_PRECISION_F32, TOLERANCE});
}

static void network_matches_golden_volumes_with_winograd_and_every_slice_by_itself(void **state)
{
    (void)state;
    if (!find_data()) {
        skip();
    }
    run_network(&(struct way){V2V_BACKEND_ONEDNN, 1, 1, V2V_PRECISION_F32, TOLERANCE});
}

static void network_in_bf16_matches_golden_volumes_within_its_rounding(void **state)
{
    (void)state;
    if (!find_data()) {
        skip();
    }
    if (v2v_op_bf16() == V2V_BF16_NONE) {
        test_skip("no bf16 convolutions on this processor");
    }
    run_network(&(struct way){V2V_BACKEND_ONEDNN, 1, 0, V2V_PRECISION_BF16, BF16_TOLERANCE});
    run_network(&(struct way){V2V_BACKEND_ONEDNN, 1, 1, V2V_PRECISION_BF16, BF16_TOLERANCE});
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(network_matches_golden_volumes_with_onednn),
        cmocka_unit_test(network_matches_golden_volumes_with_openblas),
        cmocka_unit_test(network_matches_golden_volumes_with_winograd),
        cmocka_unit_test(network_matches_golden_volumes_with_winograd_and_every_slice_by_itself),
        cmocka_unit_test(network_in_bf16_matches_golden_volumes_within_its_rounding),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
