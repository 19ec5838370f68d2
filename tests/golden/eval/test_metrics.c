#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/eval/metrics.h"

#include <math.h>

enum { SLICES = 39, SIDE = 64 }; /* golden/metrics.h5 */

static float *read_volume(const char *path, const char *dataset)
{
    int64_t count = 0;
    float *volume = NULL;
    double *values = test_h5_read(path, dataset, &count);
    assert_int_equal(count, SLICES * SIDE * SIDE);
    assert_ok(V2V_ALLOC(volume, "test", count));
    for (int64_t i = 0; i < count; i++) {
        volume[i] = (float)values[i]; /* stored as float32: exact */
    }
    test_release(values);
    return volume;
}

/** Both sides are double precision on the same float32 voxels: 1.6e5 additions of eps 1.1e-16 give
 *  2e-11 at the very worst; what remains is in which precision the reference subtracted the
 *  background (float32: 6e-8 of a voxel). */
static void assert_equals_golden(double value, const char *path, const char *name)
{
    double golden = test_h5_attribute(path, "/", name);
    if (!(fabs(value - golden) <= 1e-7 * fabs(golden))) {
        fail_msg("%s: %.12g, golden %.12g", name, value, golden);
    }
}

static void scores_match_the_reference(void **state)
{
    (void)state;
    const char *path = test_shared("golden/metrics.h5");
    if (path == NULL) {
        skip();
    }
    float *truth = read_volume(path, "ground_truth");
    float *volume = read_volume(path, "reconstruction");
    struct v2v_scores scores;
    assert_ok(v2v_scores_of(&scores, truth, volume, SLICES, SIDE, SIDE, 0));
    assert_equals_golden(scores.background_truth, path, "background_gt");
    assert_equals_golden(scores.background_volume, path, "background_reconstruction");
    assert_equals_golden(scores.psnr, path, "psnr");
    assert_equals_golden(scores.ssim, path, "ssim");
    v2v_mem_free(truth);
    v2v_mem_free(volume);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(scores_match_the_reference)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
