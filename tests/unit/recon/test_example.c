/* The example of rld.h. */
#include "../../mpi/recon/small_optics.h"

#include "v2v3d/recon/rld.h"

enum { SIDE = 32, VOXELS = SLICES * SIDE * SIDE };

static enum v2v_status deconvolve(float *volume, const float *views, const struct v2v_psf_file *psf,
                                  const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_rld *rld = NULL;
    V2V_TRY(v2v_rld_create(&rld, psf, SIDE, SIDE, 0.5, V2V_SPLIT_SLICES, comm));
    V2V_TRY(v2v_rld_run(rld, volume, views, 10));
done:
    v2v_rld_destroy(&rld);
    return rc;
}

static void header_example_finds_the_bright_column(void **state)
{
    (void)state;
    static float volume[VOXELS], views[VIEWS * SIDE * SIDE];
    struct v2v_psf_file psf = small_psf();
    for (int v = 0; v < VIEWS; v++) {
        views[(v * SIDE + SIDE / 2) * SIDE + SIDE / 2] = 1.0f;
    }
    assert_ok(deconvolve(volume, views, &psf, NULL));
    int brightest = 0;
    for (int i = 0; i < VOXELS; i++) {
        brightest = volume[i] > volume[brightest] ? i : brightest;
    }
    /* the light of a spot comes from within a kernel of it */
    assert_in_range(brightest / SIDE % SIDE, SIDE / 2 - 5, SIDE / 2 + 5);
    assert_in_range(brightest % SIDE, SIDE / 2 - 5, SIDE / 2 + 5);
    v2v_psf_file_fini(&psf);
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(header_example_finds_the_bright_column),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
