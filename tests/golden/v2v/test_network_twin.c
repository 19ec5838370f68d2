/* The double-precision twin that errors are measured against, and the multiply-adds of
 * its floors, on the reference's golden frame and the real PSFs. */
#include "support.h"

#include "network/network_twin.h"
#include "network/work.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/v2v/schema.h"
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { VIEWS = 13, SLICES = 39, SIDE = 64, PATH = 512 };

/* Both sides are double precision over the same float32 weights: 18 layers of sums of at most 9828
 * terms lose 18 * sqrt(9828) * 1.1e-16 = 2e-13 for uncorrelated round-off; the bar leaves room for
 * a correlated one and none for a float32 anywhere (6e-8). */
#define TOLERANCE 1e-9

static struct v2v_model_spec full_network(void)
{
    return (struct v2v_model_spec){.views = VIEWS,
                                   .slices = SLICES,
                                   .width = 128,
                                   .features = 4,
                                   .branches = V2V_BRANCH_BOTH,
                                   .every_slice = 1,
                                   .volume_scale = 1.0};
}

/* Shifts of the real PSFs, or 0 without them. */
static int find_shifts(struct v2v_shifts *shifts)
{
    struct v2v_psf_file psf = {0};
    char path[PATH];
    const char *first = test_shared("psf/2psam/psf_1.tif");
    if (first == NULL) {
        return 0;
    }
    snprintf(path, sizeof path, "%.*s", (int)(strrchr(first, '/') - first), first);
    assert_ok(v2v_psf_read(&psf, path, "", V2V_NORMALIZE_NONE, NULL));
    assert_ok(v2v_shifts_from_psf(shifts, &psf));
    v2v_psf_file_fini(&psf);
    return 1;
}

static double error_of(const double *volume, const char *path, const char *dataset)
{
    int64_t count = 0;
    double *golden = test_h5_read(path, dataset, &count), difference = 0.0, norm = 0.0;
    assert_int_equal(count, SLICES * SIDE * SIDE);
    for (int64_t i = 0; i < count; i++) {
        difference += (volume[i] - golden[i]) * (volume[i] - golden[i]);
        norm += golden[i] * golden[i];
    }
    test_release(golden);
    print_message("%s: relative L2 error %.2e\n", dataset, sqrt(difference / norm));
    return sqrt(difference / norm);
}

static void twin_matches_golden_volumes_in_double_precision(void **state)
{
    struct v2v_model_spec spec = full_network();
    struct v2v_shifts shifts = {0};
    struct v2v_fields fields = {0};
    float *weights = NULL, *views = NULL;
    double *volume[2] = {NULL, NULL};
    int64_t count = 0;
    char golden[PATH];
    const char *found = test_shared("golden/network.h5");
    (void)state;
    snprintf(golden, sizeof golden, "%s", found != NULL ? found : "");
    if (found == NULL || !find_shifts(&shifts)) {
        skip();
    }
    double *lfi = test_h5_read(golden, "lfi", &count);
    assert_int_equal(count, VIEWS * SIDE * SIDE);
    assert_ok(V2V_ALLOC(views, "test", count));
    for (int64_t i = 0; i < count; i++) {
        views[i] = (float)lfi[i];
    }
    assert_ok(V2V_ALLOC(volume[0], "test", SLICES * SIDE * SIDE));
    assert_ok(V2V_ALLOC(volume[1], "test", SLICES * SIDE * SIDE));
    assert_ok(v2v_model_schema(&fields, &spec));
    assert_ok(V2V_ALLOC(weights, "test", fields.total));
    assert_ok(v2v_rule_weights(&fields, weights, V2V_RULE_HASH,
                               (int64_t)test_h5_attribute(golden, "/", "seed")));
    assert_ok(v2v_network_twin(volume, &spec, &shifts, &fields, weights, views, SIDE, SIDE));
    assert_true(error_of(volume[0], golden, "volume1") <= TOLERANCE);
    assert_true(error_of(volume[1], golden, "volume2") <= TOLERANCE);
    v2v_mem_free(volume[0]);
    v2v_mem_free(volume[1]);
    v2v_mem_free(weights);
    v2v_mem_free(views);
    test_release(lfi);
    v2v_fields_fini(&fields);
    v2v_shifts_fini(&shifts);
    assert_int_equal(v2v_mem_held(), 0);
}

/* REFERENCE.md 8: 13 * 351 = 4563 taps a feature become 909; what leaves is their difference, times
 * 4 features and 1024 outputs a pixel. */
static void merging_saves_what_the_real_psfs_allow(void **state)
{
    struct v2v_model_spec spec = full_network();
    struct v2v_shifts shifts = {0};
    struct v2v_work reference, merged;
    (void)state;
    if (!find_shifts(&shifts)) {
        skip();
    }
    assert_ok(v2v_work_of(&reference, &spec, &shifts, SIDE, SIDE));
    spec.every_slice = 0;
    assert_ok(v2v_work_of(&merged, &spec, &shifts, SIDE, SIDE));
    assert_true(reference.macs - merged.macs == (4563.0 - 909.0) * 4 * 1024 * SIDE * SIDE);
    v2v_shifts_fini(&shifts);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(twin_matches_golden_volumes_in_double_precision),
        cmocka_unit_test(merging_saves_what_the_real_psfs_allow),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
