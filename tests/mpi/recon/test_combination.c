/* The learned weights of slices: with them two volumes that are wrong in ways that cancel give the
 * one that the views are of, on one rank or on several. */
#include "recon/combination.h"
#include "small_optics.h"

#include "v2v3d/base/random.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

enum { HEIGHT = 40, WIDTH = 30, PIXELS = HEIGHT * WIDTH, VOXELS = SLICES * PIXELS };

/* Of the light; the weights do not depend on it. */
static const float brightness = 3.0f;

static struct v2v_psf_file psf;
static struct v2v_config config;
static float truth[VOXELS], volume[2][VOXELS], views[VIEWS * PIXELS];

/* Slice z is off by what the volumes share with opposite signs, but not in equal parts. */
static int setup(void **state)
{
    struct v2v_projector *projector = NULL;
    (void)state;
    psf = small_psf();
    v2v_config_defaults(&config);
    config.recon.combine = V2V_COMBINE_LEARNED;
    for (int i = 0; i < VOXELS; i++) {
        const int z = i / PIXELS;
        const float off = (float)v2v_random_normal(5, 0, (uint64_t)i);
        truth[i] = (float)v2v_random_below(3, 0, (uint64_t)i, 8);
        volume[0][i] = truth[i] + (float)z * off;
        volume[1][i] = truth[i] - (float)(SLICES - z) * off;
    }
    assert_ok(v2v_projector_create(&projector, &psf, HEIGHT, WIDTH, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, views, truth, NULL, VIEWS, brightness);
    v2v_projector_destroy(&projector);
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    v2v_psf_file_fini(&psf);
    return 0;
}

static void cut_rows(float *rows, const float *whole, struct v2v_part part)
{
    for (int z = 0; z < SLICES; z++) {
        memcpy(rows + z * part.count * WIDTH, whole + z * PIXELS + part.first * WIDTH,
               (size_t)(part.count * WIDTH) * sizeof *rows);
    }
}

/** The largest error, on any rank, in units of the truth's root mean square. */
static double combined(const float *expected, struct v2v_grid_shape shape)
{
    static float rows[2][VOXELS], wanted[VOXELS], result[VOXELS];
    struct v2v_grid grid;
    struct v2v_slicing *slicing = NULL;
    struct v2v_combination *combination = NULL;
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = HEIGHT, .width = WIDTH};
    double most = 0.0;
    assert_ok(v2v_grid_create(&grid, test_world(), &shape));
    if (!grid.idle) {
        struct v2v_part parts[8], own;
        for (int r = 0; r < grid.shard_size; r++) {
            parts[r] = v2v_par_part(HEIGHT, grid.shard_size, r);
        }
        own = parts[grid.shard_rank];
        if (grid.shard_size > 1) {
            assert_ok(v2v_slicing_create(&slicing, grid.shard, SLICES, HEIGHT, WIDTH, parts));
        }
        for (int o = 0; o < 2; o++) {
            cut_rows(rows[o], volume[o], own);
        }
        cut_rows(wanted, expected, own);
        const float *held[2] = {rows[0], rows[1]};
        if (grid.branch_size == 2) {
            held[1 - grid.branch_rank] = NULL;
        }
        assert_ok(v2v_combination_create(&combination, &problem, &grid, slicing, own.count));
        v2v_combination_run(combination, result, held, views);
        for (int64_t i = 0; i < SLICES * own.count * WIDTH; i++) {
            most = fmax(most, fabs((double)result[i] - (double)wanted[i]));
        }
    }
    v2v_combination_destroy(&combination);
    v2v_slicing_destroy(&slicing);
    v2v_grid_destroy(&grid);
    v2v_par_max_f64(test_world(), &most, 1);
    return most / sqrt(v2v_sum_of_squares(truth, VOXELS) / VOXELS);
}

static void for_each_shape(const float *expected, double bound)
{
    const int size = v2v_comm_size(test_world());
    for (int branches = 1; branches <= 2; branches++) {
        for (int shards = 1; branches * shards <= size; shards++) {
            const double error = combined(expected, (struct v2v_grid_shape){branches, shards});
            if (!(error <= bound)) {
                fail_msg("%d x %d ranks: %g of the truth", branches, shards, error);
            }
        }
    }
}

/* The fit ends at 1e-6 of its first gradient, and the normal equations have a condition of 67 (in
 * double precision): 7e-5 of the solution's norm, of which the mean is four times what a slice's
 * half is, and half a difference is three times the truth's root mean square at most. */
static void what_is_wrong_in_both_volumes_cancels(void **state)
{
    (void)state;
    for_each_shape(truth, 1e-3);
}

/* The truth is twice as far: the nearer volume is what is taken, not beyond. */
static void no_volume_is_left_behind(void **state)
{
    static float first[VOXELS];
    (void)state;
    for (int i = 0; i < VOXELS; i++) {
        const float off = (float)v2v_random_normal(5, 0, (uint64_t)i);
        first[i] = volume[0][i] = truth[i] + off;
        volume[1][i] = truth[i] + 2 * off;
    }
    for_each_shape(first, 1e-6);
}

static void of_equal_volumes_it_is_each(void **state)
{
    (void)state;
    memcpy(volume[1], volume[0], sizeof volume[0]);
    for_each_shape(volume[0], 1e-6);
}

/* Nothing is seen: the volumes are all that is known, and neither is better. */
static void without_light_it_is_the_mean(void **state)
{
    static float mean[VOXELS];
    (void)state;
    memset(views, 0, sizeof views);
    for (int i = 0; i < VOXELS; i++) {
        mean[i] = 0.5f * volume[0][i] + 0.5f * volume[1][i];
    }
    for_each_shape(mean, 0.0);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(what_is_wrong_in_both_volumes_cancels, setup, teardown),
        cmocka_unit_test_setup_teardown(no_volume_is_left_behind, setup, teardown),
        cmocka_unit_test_setup_teardown(of_equal_volumes_it_is_each, setup, teardown),
        cmocka_unit_test_setup_teardown(without_light_it_is_the_mean, setup, teardown),
    };
    return test_mpi_main(tests, argc, argv);
}
