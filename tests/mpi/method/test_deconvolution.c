#include "small_optics.h"

#include "v2v3d/base/random.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/method/estimator.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/statistics.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>

enum { HEIGHT = 24, WIDTH = 28, PIXELS = HEIGHT * WIDTH };
enum { VOXELS = SLICES * PIXELS, SAMPLES = VIEWS * PIXELS };

static struct v2v_psf_file psf;
static struct v2v_projector *projector; /* of this rank alone: all slices */
static float truth[VOXELS], views[SAMPLES];
static struct v2v_config config; /* of the run under test: method, split */
static int is_rl, is_frl, is_planned;

static int setup(void **state)
{
    (void)state;
    psf = small_psf();
    for (int64_t i = 0; i < VOXELS; i++) { /* a few bright points */
        int bright = v2v_random_below(11, 0, (uint64_t)i, 60) == 0;
        truth[i] = bright ? (float)(1 + v2v_random_uniform(11, 1, (uint64_t)i)) : 0;
    }
    assert_ok(v2v_projector_create(&projector, &psf, HEIGHT, WIDTH, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, views, truth, NULL, VIEWS, 1.0f);
    return 0;
}

static int setup_as(void **state, const char *method, enum v2v_split split)
{
    v2v_config_defaults(&config);
    snprintf(config.deconv.method, sizeof config.deconv.method, "%s", method);
    config.parallel.split = split;
    config.parallel.transform = V2V_TRANSFORM_OWN;
    is_rl = strcmp(method, "rl") == 0;
    is_frl = strcmp(method, "frl") == 0;
    is_planned = 0;
    return setup(state);
}

static int setup_rl_slices(void **state)
{
    return setup_as(state, "rl", V2V_SPLIT_SLICES);
}

static int setup_rl_slabs(void **state)
{
    return setup_as(state, "rl", V2V_SPLIT_SLABS);
}

static int setup_rld_slices(void **state)
{
    return setup_as(state, "rld", V2V_SPLIT_SLICES);
}

static int setup_rld_slabs(void **state)
{
    return setup_as(state, "rld", V2V_SPLIT_SLABS);
}

static int setup_rld_fftw3_mpi(void **state)
{
    const int failed = setup_as(state, "rld", V2V_SPLIT_SLABS);
    config.parallel.transform = V2V_TRANSFORM_FFTW3_MPI;
    return failed;
}

static int setup_frl_slices(void **state)
{
    return setup_as(state, "frl", V2V_SPLIT_SLICES);
}

static int setup_frl_slabs(void **state)
{
    return setup_as(state, "frl", V2V_SPLIT_SLABS);
}

/* Exactly as many iterations as a test asks for. */
static int setup_tv(void **state)
{
    const int failed = setup_as(state, "tv", V2V_SPLIT_SLABS);
    config.deconv.tolerance = 0.0;
    return failed;
}

static int setup_tv_fftw3_mpi(void **state)
{
    const int failed = setup_tv(state);
    config.parallel.transform = V2V_TRANSFORM_FFTW3_MPI;
    return failed;
}

/* A weight of the volume itself, and next to none of the variation. */
static int setup_tv_sparse(void **state)
{
    const int failed = setup_tv(state);
    config.deconv.lambda.value = 0.002;
    config.deconv.sparsity = (struct v2v_number){V2V_NUMBER_GIVEN, 1.0};
    return failed;
}

/* Learning rates fall to the last step: fewer of them are not the first of more. */
static int setup_diner(void **state)
{
    const int failed = setup_as(state, "diner", V2V_SPLIT_SLABS);
    config.diner.width = 32;
    is_planned = 1;
    return failed;
}

static int setup_diner_fftw3_mpi(void **state)
{
    const int failed = setup_diner(state);
    config.parallel.transform = V2V_TRANSFORM_FFTW3_MPI;
    return failed;
}

/* Views that grow brighter to the right, of photons, weighted by their noise. */
static int setup_tv_photons(void **state)
{
    const int failed = setup_tv(state);
    config.deconv.noise = V2V_NOISE_MODEL_POISSON;
    for (int64_t i = 0; i < SAMPLES; i++) {
        const double photons = 8.0 * (double)(i % WIDTH) / WIDTH;
        views[i] = 0.5f * (float)v2v_random_poisson(11, 2, (uint64_t)i, photons);
    }
    return failed;
}

/* A dead view, and dead rows and columns, which ranks share. */
static void leave_blind(void)
{
    for (int64_t i = 0; i < SAMPLES; i++) {
        const int64_t v = i / PIXELS, y = i / WIDTH % HEIGHT, x = i % WIDTH;
        const int is_blind = v == 2 || (y >= 9 && y < 14) || (v == 0 && (x < 5 || y == HEIGHT - 1));
        views[i] = is_blind ? V2V_BLIND : views[i];
    }
}

static int setup_tv_blind(void **state)
{
    const int failed = setup_tv(state);
    leave_blind();
    return failed;
}

static int setup_tv_photons_blind(void **state)
{
    const int failed = setup_tv_photons(state);
    leave_blind();
    return failed;
}

static int teardown(void **state)
{
    (void)state;
    v2v_projector_destroy(&projector);
    v2v_psf_file_fini(&psf);
    return 0;
}

/** A run over the ranks of comm, watched; `volume` gets all slices on all of them. */
static enum v2v_status run_watched(float volume[VOXELS], const float recorded[SAMPLES],
                                   int64_t iterations, const struct v2v_monitor *monitor,
                                   const struct v2v_comm *comm)
{
    const struct v2v_estimator_ops *ops = NULL;
    struct v2v_estimator *estimator = NULL;
    float *mine = NULL;
    config.deconv.iterations = iterations;
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = HEIGHT, .width = WIDTH};
    assert_ok(v2v_estimator_find(&ops, config.deconv.method));
    assert_ok(v2v_estimator_create(&estimator, ops, &problem, comm));
    struct v2v_part slices = estimator->slices;
    assert_ok(V2V_ALLOC(mine, "test", slices.count * PIXELS));
    size_t peak = v2v_mem_peak(), held = v2v_mem_held();
    enum v2v_status rc = ops->run(estimator, &mine, recorded, monitor);
    assert_true(v2v_mem_held() == held && v2v_mem_peak() == peak); /* no allocation in the run */
    memset(volume, 0, VOXELS * sizeof *volume);
    memcpy(volume + slices.first * PIXELS, mine, (size_t)(slices.count * PIXELS) * sizeof *mine);
    v2v_par_sum_f32(comm, volume, VOXELS);
    v2v_mem_free(mine);
    v2v_estimator_destroy(&estimator);
    return rc;
}

static enum v2v_status run(float volume[VOXELS], const float recorded[SAMPLES], int64_t iterations,
                           const struct v2v_comm *comm)
{
    return run_watched(volume, recorded, iterations, NULL, comm);
}

/** One view of the plain twin, in double precision: view = A_v volume, or volume = A_v^T view. */
static void plain_view(double view[PIXELS], double volume[VOXELS], int v, int adjoint)
{
    memset(adjoint ? volume : view, 0, (adjoint ? VOXELS : PIXELS) * sizeof(double));
    for (int i = 0; i < VOXELS; i++) {
        int z = i / PIXELS, y = i / WIDTH % HEIGHT, x = i % WIDTH;
        const float *taps = psf.data + (v * SLICES + z) * KERNEL_HEIGHT * KERNEL_WIDTH;
        for (int k = 0; k < KERNEL_HEIGHT * KERNEL_WIDTH; k++) { /* centre ceil(K/2)-1: 4 and 5 */
            int row = y + k / KERNEL_WIDTH - 4, column = x + k % KERNEL_WIDTH - 5;
            if (row >= 0 && row < HEIGHT && column >= 0 && column < WIDTH) {
                double *pixel = view + row * WIDTH + column;
                *(adjoint ? volume + i : pixel) += (double)taps[k] * (adjoint ? *pixel : volume[i]);
            }
        }
    }
}

/** A'1 of every view, and a constant volume that projects to the true views' mean, which it
 *  returns. */
static double plain_start(double seen[VIEWS][VOXELS], double x[VOXELS])
{
    static double image[PIXELS];
    double sum = 0, sensitivity = 0;
    for (int v = 0; v < VIEWS; v++) {
        for (int i = 0; i < PIXELS; i++) {
            image[i] = 1;
            sum += views[v * PIXELS + i] > 0 ? views[v * PIXELS + i] : 0;
        }
        plain_view(image, seen[v], v, 1);
        for (int i = 0; i < VOXELS; i++) {
            sensitivity += seen[v][i];
        }
    }
    for (int i = 0; i < VOXELS; i++) {
        x[i] = sum / sensitivity;
    }
    return sum / SAMPLES;
}

/** x <- x * A'((y + b) / (Ax + b)) / A'1 over all views, on the true ones, by plain loops. */
static void plain_at_once(double x[VOXELS], int64_t iterations)
{
    static double seen[VIEWS][VOXELS], above[VOXELS], one[VOXELS], image[PIXELS];
    static float scratch[SAMPLES];
    const double least = 1e-6 * plain_start(seen, x);
    for (int i = 0; i < VOXELS; i++) {
        x[i] *= 0.05;
    }
    const double b = 3.0 * v2v_noise_of_images(scratch, views, VIEWS, HEIGHT, WIDTH);
    for (int64_t step = 0; step < iterations; step++) {
        memset(above, 0, sizeof above);
        for (int v = 0; v < VIEWS; v++) {
            plain_view(image, x, v, 0);
            for (int i = 0; i < PIXELS; i++) {
                image[i] = fmax(views[v * PIXELS + i] + b, 0) / fmax(image[i] + b, least);
            }
            plain_view(image, one, v, 1);
            for (int i = 0; i < VOXELS; i++) {
                above[i] += one[i];
            }
        }
        for (int i = 0; i < VOXELS; i++) {
            double below = 0;
            for (int v = 0; v < VIEWS; v++) {
                below += seen[v][i];
            }
            x[i] *= above[i] / below;
        }
    }
}

/** x <- x * (1/2 + 1/2 numerator / denominator), view by view, on the true views, by plain loops:
 *  of rld A'(y / Ax) and A'1, of frl A'y and A'Ax. */
static void plain_deconvolution(double x[VOXELS], int64_t iterations)
{
    static double seen[VIEWS][VOXELS], above[VOXELS], below[VOXELS], image[PIXELS], view[PIXELS];
    const double least = 1e-6 * plain_start(seen, x);
    for (int64_t step = 0; step < iterations * VIEWS; step++) {
        int v = (int)(step % VIEWS);
        plain_view(image, x, v, 0);
        for (int i = 0; i < PIXELS; i++) {
            double recorded = views[v * PIXELS + i];
            image[i] = fmax(image[i], least);
            view[i] = is_frl ? recorded : fmax(recorded, 0) / image[i];
        }
        plain_view(view, above, v, 1);
        plain_view(image, below, v, 1);
        for (int i = 0; i < VOXELS; i++) {
            double denominator = is_frl ? below[i] : seen[v][i];
            x[i] *= seen[v][i] > 1e-4 ? 0.5 + 0.5 * fmax(above[i], 0) / denominator : 1;
        }
    }
}

static void volume_equals_the_plain_definition(void **state)
{
    (void)state;
    static double plain[VOXELS];
    static float volume[VOXELS];
    for (int64_t n = 1; n <= 5; n += 2) {
        (is_rl ? plain_at_once : plain_deconvolution)(plain, n);
        assert_ok(run(volume, views, n, test_world()));
        /* 4n updates, each with two float32 transforms of 10 levels x eps 6e-8; times four because
         * the round-off of a bright pixel weighs more in a dim one. */
        assert_true(test_relative_l2_to_double(volume, plain, VOXELS) < 1e-6 + 2e-5 * (double)n);
    }
}

/** |views - A volume| / |views| */
static double residual_of(const float volume[VOXELS])
{
    static float projection[SAMPLES];
    v2v_projector_forward(projector, projection, volume, NULL, VIEWS, 1.0f);
    return test_relative_l2(projection, views, SAMPLES);
}

static void residual_falls_with_every_iteration_on_clean_views(void **state)
{
    (void)state;
    static float volume[VOXELS];
    double last = 0;
    for (int64_t n = 1; n <= 6; n++) {
        assert_ok(run(volume, views, n, test_world()));
        double residual = residual_of(volume);
        assert_true(n == 1 || residual < last);
        last = residual;
    }
}

static void a_constant_scene_is_found_at_once_and_kept(void **state)
{
    (void)state;
    static float constant[VOXELS], volume[VOXELS], flat[SAMPLES];
    for (int64_t i = 0; i < VOXELS; i++) {
        constant[i] = 3;
    }
    v2v_projector_forward(projector, flat, constant, NULL, VIEWS, 1.0f);
    for (int64_t n = 1; n <= 5; n += 2) {
        assert_ok(run(volume, flat, n, test_world()));
        /* Each of the 4n updates carries the round-off of two transforms (10 levels x eps 6e-8);
         * at the border that is divided by a sensitivity some ten times below the mean. */
        assert_true(test_relative_l2(volume, constant, VOXELS) < 1e-6 + 4e-6 * (double)n);
    }
}

static void any_number_of_ranks_gives_the_same_volume(void **state)
{
    (void)state;
    static float together[VOXELS], alone[VOXELS];
    assert_ok(run(together, views, 5, test_world()));
    assert_ok(run(alone, views, 5, NULL));
    if (config.parallel.split == V2V_SPLIT_SLABS) {
        assert_memory_equal(together, alone, sizeof alone);
    } else {
        /* Sums in double precision: one number in 2^53 / 2^24 may round another way, by eps 6e-8
         * of it; times ten for ratios of dim pixels. */
        assert_true(test_relative_l2(together, alone, VOXELS) <= 6e-7);
    }
}

/* Else the tests above would have none. */
static void weights_change_the_volume(void **state)
{
    (void)state;
    static float weighted[VOXELS], even[VOXELS];
    assert_ok(run(weighted, views, 8, test_world()));
    config.deconv.noise = V2V_NOISE_MODEL_GAUSSIAN;
    assert_ok(run(even, views, 8, test_world()));
    const double moved = test_relative_l2(weighted, even, VOXELS);
    if (!(moved > 0.01)) {
        fail_msg("moved by %g", moved);
    }
}

static void sparsity_changes_the_volume(void **state)
{
    (void)state;
    static float sparse[VOXELS], plain[VOXELS];
    assert_ok(run(sparse, views, 8, test_world()));
    config.deconv.sparsity.value = 0.0;
    assert_ok(run(plain, views, 8, test_world()));
    const double moved = test_relative_l2(sparse, plain, VOXELS);
    if (!(moved > 0.01)) {
        fail_msg("moved by %g", moved);
    }
}

static void scaled_views_give_the_scaled_volume(void **state)
{
    (void)state;
    static const double scales[] = {0x1p20, 0x1p-20, 1e6, 1e-6, 1e30, 1e-30};
    static float volume[VOXELS], scaled[VOXELS], recorded[SAMPLES];
    assert_ok(run(volume, views, 5, test_world()));
    for (int k = 0; k < 6; k++) {
        for (int64_t i = 0; i < SAMPLES; i++) {
            recorded[i] = (float)(views[i] * scales[k]);
        }
        assert_ok(run(scaled, recorded, 5, test_world()));
        for (int64_t i = 0; i < VOXELS; i++) {
            scaled[i] = (float)(scaled[i] / scales[k]);
        }
        if (k < 2) { /* powers of two round nowhere */
            assert_memory_equal(scaled, volume, sizeof volume);
        } else { /* the views' own rounding, eps 6e-8, through 20 updates */
            assert_true(test_relative_l2(scaled, volume, VOXELS) < 1e-5);
        }
    }
}

/* Of rld: of rl and frl they count as they are. */
static void negative_samples_count_as_zero(void **state)
{
    (void)state;
    if (is_rl || is_frl) {
        test_skip("rl and frl take negative samples as they are");
    }
    static float clipped[SAMPLES], negative[SAMPLES], a[VOXELS], b[VOXELS];
    for (int64_t i = 0; i < SAMPLES; i++) {
        clipped[i] = i % 3 == 0 ? 0 : views[i];
        negative[i] = i % 3 == 0 ? -fabsf(views[i]) : views[i]; /* dark views round below 0 */
    }
    assert_ok(run(a, clipped, 3, test_world()));
    assert_ok(run(b, negative, 3, test_world()));
    assert_memory_equal(a, b, sizeof a);
}

/* Light that the volume shows beyond that of the views, a pixel, in standard deviations of their
 * noise: of samples that are clipped at zero, where there is hardly light, sqrt(1 / (2 pi)). Its
 * own error is that of the noise's mean, 1 / sqrt(SAMPLES) = 0.022. */
static void noise_about_zero_leaves_a_pedestal_only_where_it_is_clipped(void **state)
{
    (void)state;
    static float noisy[SAMPLES], volume[VOXELS], projection[SAMPLES];
    const double sigma = 0.1;
    double pedestal = 0;
    for (int64_t i = 0; i < SAMPLES; i++) {
        noisy[i] = views[i] + (float)(sigma * v2v_random_normal(12, 0, (uint64_t)i));
    }
    assert_ok(run(volume, noisy, 30, test_world()));
    v2v_projector_forward(projector, projection, volume, NULL, VIEWS, 1.0f);
    for (int64_t i = 0; i < SAMPLES; i++) {
        pedestal += ((double)projection[i] - (double)views[i]) / (sigma * SAMPLES);
    }
    print_message("%s: %.3f sigma\n", config.deconv.method, pedestal);
    assert_true(is_rl || is_frl ? fabs(pedestal) < 0.1 : pedestal > 0.2);
}

static void dark_views_give_a_dark_volume(void **state)
{
    (void)state;
    static float dark[SAMPLES], volume[VOXELS];
    dark[5] = -1;
    assert_ok(run(volume, dark, 3, test_world()));
    for (int64_t i = 0; i < VOXELS; i++) {
        assert_true(volume[i] == 0);
    }
}

static void lone_and_hot_pixels_leave_the_volume_finite_and_positive(void **state)
{
    (void)state;
    static float recorded[SAMPLES], volume[VOXELS];
    static const float values[] = {1e-37f, 1, 1e36f};
    for (int k = 0; k < 3; k++) {
        memset(recorded, 0, sizeof recorded);
        recorded[PIXELS + 3] = values[k];
        recorded[2 * PIXELS + PIXELS / 2] = values[k];
        assert_ok(run(volume, recorded, 20, test_world()));
        for (int64_t i = 0; i < VOXELS; i++) {
            assert_true(isfinite(volume[i]) && volume[i] >= 0);
        }
    }
}

static void slices_that_no_view_sees_stay_empty(void **state)
{
    (void)state;
    static float volume[VOXELS];
    const int64_t blind = 2, taps = KERNEL_HEIGHT * KERNEL_WIDTH;
    for (int64_t v = 0; v < VIEWS; v++) {
        memset(psf.data + (v * SLICES + blind) * taps, 0, (size_t)taps * sizeof(float));
    }
    assert_ok(run(volume, views, 3, test_world()));
    v2v_psf_file_fini(&psf);
    psf = small_psf();
    double others = 0;
    for (int64_t i = 0; i < VOXELS; i++) {
        others += volume[i];
        assert_true(i / PIXELS != blind || volume[i] == 0);
    }
    assert_true(others > 0);
}

static void a_nan_in_the_views_is_named(void **state)
{
    (void)state;
    static float recorded[SAMPLES], volume[VOXELS];
    memcpy(recorded, views, sizeof recorded);
    recorded[PIXELS + 2 * WIDTH + 7] = NAN;
    assert_int_equal(run(volume, recorded, 3, test_world()), V2V_E_NUMERIC);
    assert_non_null(strstr(v2v_status_message(), "view 1, row 2, column 7"));
}

struct seen {
    int64_t calls, enough; /* the last iteration that is wanted */
    float volume[VOXELS];
};

/* Takes the volume of the last call. */
static int watch(void *context, int64_t iteration, const struct v2v_iterate *iterate)
{
    struct seen *seen = context;
    struct v2v_part slices = iterate->estimator->slices;
    assert_int_equal(iteration, ++seen->calls);
    memset(seen->volume, 0, sizeof seen->volume);
    v2v_iterate_slices(iterate, seen->volume + slices.first * PIXELS);
    v2v_par_sum_f32(test_world(), seen->volume, VOXELS);
    return iteration == seen->enough;
}

static void a_monitor_sees_every_iteration_and_ends_them(void **state)
{
    (void)state;
    static struct seen seen;
    static float volume[VOXELS], same[VOXELS];
    const struct v2v_monitor monitor = {watch, &seen};
    for (int64_t enough = 2; enough <= 5; enough += 3) {
        seen.calls = 0;
        seen.enough = enough;
        assert_ok(run_watched(volume, views, 4, &monitor, test_world()));
        assert_int_equal(seen.calls, enough < 4 ? enough : 4);
        assert_memory_equal(seen.volume, volume, sizeof volume);
        if (!is_planned || seen.calls == 4) {
            assert_ok(run(same, views, seen.calls, test_world()));
            assert_memory_equal(same, volume, sizeof volume);
        }
    }
}

static void a_request_to_one_rank_stops_all(void **state)
{
    (void)state;
    static float volume[VOXELS];
    if (v2v_comm_rank(test_world()) == v2v_comm_size(test_world()) - 1) {
        v2v_stop_install();
        raise(SIGUSR1); /* for good: this test stays the last one */
    }
    assert_int_equal(run(volume, views, 3, test_world()), V2V_STOPPED);
}

int main(int argc, char **argv)
{
#define WITH_ALL(test)                                                                             \
    WITH(test), cmocka_unit_test_setup_teardown(test, setup_tv, teardown),                         \
        cmocka_unit_test_setup_teardown(test, setup_diner, teardown)
#define WITH(test)                                                                                 \
    cmocka_unit_test_setup_teardown(test, setup_rl_slices, teardown),                              \
        cmocka_unit_test_setup_teardown(test, setup_rl_slabs, teardown),                           \
        cmocka_unit_test_setup_teardown(test, setup_rld_slices, teardown),                         \
        cmocka_unit_test_setup_teardown(test, setup_rld_slabs, teardown),                          \
        cmocka_unit_test_setup_teardown(test, setup_frl_slices, teardown),                         \
        cmocka_unit_test_setup_teardown(test, setup_frl_slabs, teardown)
    const struct CMUnitTest tests[] = {
        WITH(volume_equals_the_plain_definition),
        WITH(residual_falls_with_every_iteration_on_clean_views),
        WITH(a_constant_scene_is_found_at_once_and_kept),
        WITH_ALL(any_number_of_ranks_gives_the_same_volume),
        cmocka_unit_test_setup_teardown(any_number_of_ranks_gives_the_same_volume,
                                        setup_rld_fftw3_mpi, teardown),
        cmocka_unit_test_setup_teardown(any_number_of_ranks_gives_the_same_volume,
                                        setup_tv_fftw3_mpi, teardown),
        cmocka_unit_test_setup_teardown(any_number_of_ranks_gives_the_same_volume, setup_tv_photons,
                                        teardown),
        cmocka_unit_test_setup_teardown(any_number_of_ranks_gives_the_same_volume, setup_tv_sparse,
                                        teardown),
        cmocka_unit_test_setup_teardown(any_number_of_ranks_gives_the_same_volume, setup_tv_blind,
                                        teardown),
        cmocka_unit_test_setup_teardown(any_number_of_ranks_gives_the_same_volume,
                                        setup_tv_photons_blind, teardown),
        cmocka_unit_test_setup_teardown(scaled_views_give_the_scaled_volume, setup_tv_photons,
                                        teardown),
        cmocka_unit_test_setup_teardown(weights_change_the_volume, setup_tv_photons, teardown),
        cmocka_unit_test_setup_teardown(sparsity_changes_the_volume, setup_tv_sparse, teardown),
        WITH_ALL(scaled_views_give_the_scaled_volume),
        WITH(negative_samples_count_as_zero),
        WITH(noise_about_zero_leaves_a_pedestal_only_where_it_is_clipped),
        WITH_ALL(dark_views_give_a_dark_volume),
        WITH_ALL(lone_and_hot_pixels_leave_the_volume_finite_and_positive),
        WITH(slices_that_no_view_sees_stay_empty),
        cmocka_unit_test_setup_teardown(slices_that_no_view_sees_stay_empty, setup_diner, teardown),
        cmocka_unit_test_setup_teardown(any_number_of_ranks_gives_the_same_volume,
                                        setup_diner_fftw3_mpi, teardown),
        WITH_ALL(a_nan_in_the_views_is_named),
        WITH_ALL(a_monitor_sees_every_iteration_and_ends_them),
        WITH_ALL(a_request_to_one_rank_stops_all),
    };
    return test_mpi_main(tests, argc, argv);
}
