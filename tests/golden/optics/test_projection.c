/* The reference's projection of a real volume through the real 2pSAM PSFs (REFERENCE.md 2, 9). */
#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/optics/psf.h"
#include <string.h>

enum { SIDE = 64 };

struct golden {
    struct v2v_psf_file psf;
    struct v2v_projector *projector;
    float *volume, *views;
    double *sums, *means;
    int64_t pixels; /* of all views */
};

static double *read_golden(const char *dataset, int64_t expected)
{
    int64_t count = 0;
    double *values = test_h5_read(test_shared("golden/projection.h5"), dataset, &count);
    assert_int_equal(count, expected);
    return values;
}

static void setup(struct golden *g)
{
    memset(g, 0, sizeof *g);
    if (test_shared("psf/2psam") == NULL || test_shared("golden/projection.h5") == NULL) {
        skip();
    }
    assert_ok(v2v_psf_read(&g->psf, test_shared("psf/2psam"), "", V2V_NORMALIZE_NONE, NULL));
    const int64_t voxels = g->psf.slices * SIDE * SIDE;
    g->pixels = g->psf.views * SIDE * SIDE;
    double *volume = read_golden("volume", voxels);
    g->sums = read_golden("views_sum_over_z", g->pixels);
    g->means = read_golden("views_mean_over_z", g->pixels);
    assert_ok(V2V_ALLOC(g->volume, "test", voxels));
    assert_ok(V2V_ALLOC(g->views, "test", g->pixels));
    for (int64_t i = 0; i < voxels; i++) {
        g->volume[i] = (float)volume[i];
    }
    test_release(volume);
    assert_ok(v2v_projector_create(&g->projector, &g->psf, SIDE, SIDE, V2V_SPLIT_SLICES, NULL));
}

static void teardown(struct golden *g)
{
    v2v_projector_destroy(&g->projector);
    v2v_mem_free(g->views);
    v2v_mem_free(g->volume);
    test_release(g->means);
    test_release(g->sums);
    v2v_psf_file_fini(&g->psf);
}

/* The project's bar, 1e-5. Expected: three transforms of 2^14 samples round by about
 * 3 * sqrt(14) * 6e-8 = 7e-7. */
static void assert_close(const struct golden *g, const double *expected)
{
    const double error = test_relative_l2_to_double(g->views, expected, g->pixels);
    print_message("relative L2 error %.3g\n", error);
    assert_true(error <= 1e-5);
}

static void projection_summed_over_z_matches_the_reference(void **state)
{
    struct golden g;
    (void)state;
    setup(&g);
    v2v_projector_forward(g.projector, g.views, g.volume, NULL, g.psf.views, 1.0f);
    assert_close(&g, g.sums);
    teardown(&g);
}

static void projection_averaged_over_z_matches_the_reference(void **state)
{
    struct golden g;
    (void)state;
    setup(&g);
    v2v_projector_forward(g.projector, g.views, g.volume, NULL, g.psf.views,
                          1.0f / (float)g.psf.slices);
    assert_close(&g, g.means);
    teardown(&g);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(projection_summed_over_z_matches_the_reference),
        cmocka_unit_test(projection_averaged_over_z_matches_the_reference),
    };
    return cmocka_run_group_tests_name("optics.projection", tests, NULL, NULL);
}
