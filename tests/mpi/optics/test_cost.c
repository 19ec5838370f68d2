/* The cost model of projections: agreed figures, and predictions that fall where they must. */
#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/cost.h"
#include <math.h>
#include <string.h>

enum { SIDE = 512 };

static const struct v2v_psf_file paper = {.views = 13, .slices = 39, .height = 128, .width = 128};

/* An idle core and a network of which one figure is set. */
static struct v2v_projector_cost machine(double message_s, double byte_s)
{
    return (struct v2v_projector_cost){.threads = 1,
                                       .transform_s = 2e-10,
                                       .product_s = 1e-9,
                                       .network = {2, message_s, byte_s, message_s, byte_s}};
}

static double there_and_back(const struct v2v_projector_cost *cost, int64_t count,
                             enum v2v_split split, int ranks)
{
    const struct v2v_projector_times times =
        v2v_projector_predict(cost, &paper, SIDE, SIDE, count, split, ranks);
    assert_true(times.forward_s > 0 && times.adjoint_s > 0);
    return times.forward_s + times.adjoint_s;
}

static void measured_figures_are_the_same_on_all_ranks_and_positive(void **state)
{
    struct v2v_projector_cost cost;
    const size_t held = v2v_mem_held();
    (void)state;
    assert_ok(v2v_projector_cost_measure(&cost, test_world()));
    assert_int_equal(v2v_mem_held(), held);
    double figures[] = {cost.transform_s, cost.product_s,   cost.wait_s,
                        cost.own_s,       cost.fftw3_mpi_s, cost.network.byte_s};
    double first[6];
    memcpy(first, figures, sizeof first);
    v2v_par_broadcast(test_world(), first, (int64_t)sizeof first, 0);
    for (int i = 0; i < 6; i++) {
        assert_true(figures[i] == first[i] && isfinite(figures[i]));
    }
    assert_true(cost.transform_s > 0 && cost.product_s > 0 && cost.wait_s >= 0);
    assert_int_equal(cost.network.ranks, v2v_comm_size(test_world()));
    assert_int_equal(cost.own_s > 0 && cost.fftw3_mpi_s > 0, v2v_comm_size(test_world()) > 1);
}

static void a_rank_short_of_memory_fails_the_measurement_on_all(void **state)
{
    static const size_t allowed[] = {1000, 3 << 20, 12 << 20, 24 << 20};
    (void)state;
    for (int i = 0; i < 4; i++) {
        struct v2v_projector_cost cost;
        const size_t held = v2v_mem_held();
        if (v2v_comm_rank(test_world()) == v2v_comm_size(test_world()) - 1) {
            v2v_mem_set_limit(held + allowed[i]);
        }
        enum v2v_status rc = v2v_projector_cost_measure(&cost, test_world());
        v2v_mem_set_limit(0);
        assert_int_equal(rc, V2V_E_MEMORY);
        assert_int_equal(v2v_mem_held(), held);
    }
}

static void one_rank_takes_the_same_time_by_either_split(void **state)
{
    const struct v2v_projector_cost cost = machine(1e-5, 1e-9);
    (void)state;
    for (int64_t count = 1; count <= paper.views; count += 6) {
        assert_true(there_and_back(&cost, count, V2V_SPLIT_SLICES, 1) ==
                    there_and_back(&cost, count, V2V_SPLIT_SLABS, 1));
    }
}

/* Slabs share all work evenly; 39 slices leave one of four ranks with 10. */
static void slabs_win_where_messages_cost_nothing(void **state)
{
    const struct v2v_projector_cost cost = machine(0, 0);
    (void)state;
    for (int ranks = 4; ranks <= 64; ranks *= 2) {
        assert_true(there_and_back(&cost, 13, V2V_SPLIT_SLABS, ranks) <
                    there_and_back(&cost, 13, V2V_SPLIT_SLICES, ranks));
    }
    const double alone = there_and_back(&cost, 13, V2V_SPLIT_SLABS, 1);
    const double four = there_and_back(&cost, 13, V2V_SPLIT_SLABS, 4);
    assert_true(four >= alone / 4 && four <= alone / 4 * 1.02); /* 73 of 289 columns */
}

/* One view at a time, slices move the sum of one view, slabs all slices. */
static void slices_win_for_single_views_over_a_slow_network(void **state)
{
    const struct v2v_projector_cost slow = machine(1e-4, 8e-9); /* 1 Gbit/s */
    (void)state;
    for (int ranks = 2; ranks <= 8; ranks++) {
        assert_true(there_and_back(&slow, 1, V2V_SPLIT_SLICES, ranks) <
                    there_and_back(&slow, 1, V2V_SPLIT_SLABS, ranks));
    }
}

/* Transforms take two thirds of the time, the products between them all of it. */
static void slabs_gain_what_fftw3_mpi_is_measured_to_gain(void **state)
{
    struct v2v_projector_cost cost = machine(1e-5, 1e-9);
    (void)state;
    cost.own_s = 3e-3;
    cost.fftw3_mpi_s = 2e-3;
    const double slabs = there_and_back(&cost, 13, V2V_SPLIT_SLABS, 4);
    const double products = 2 * cost.product_s * 39 * 13 * 576 * 73;
    const double expected = products + (slabs - products) * 2 / 3;
    assert_true(fabs(there_and_back(&cost, 13, V2V_SPLIT_SLABS_FFTW3_MPI, 4) - expected) <=
                1e-12 * slabs);
    assert_true(there_and_back(&cost, 13, V2V_SPLIT_SLABS_FFTW3_MPI, 1) ==
                there_and_back(&cost, 13, V2V_SPLIT_SLABS, 1));
}

static void a_frame_beyond_all_counts_takes_for_ever(void **state)
{
    const struct v2v_projector_cost cost = machine(0, 0);
    (void)state;
    assert_true(
        isinf(v2v_projector_predict(&cost, &paper, INT32_MAX, INT32_MAX, 1, V2V_SPLIT_SLABS, 2)
                  .forward_s));
}

/* Measured times would choose one thing here and another there. */
static void reproducible_projections_are_by_slabs(void **state)
{
    static struct v2v_config config;
    const int is_alone = v2v_comm_size(test_world()) == 1;
    enum v2v_split split = V2V_SPLIT_AUTO;
    (void)state;
    v2v_config_defaults(&config);
    config.parallel.reproducible = 1;
    for (int transform = V2V_TRANSFORM_AUTO; transform <= V2V_TRANSFORM_FFTW3_MPI && !is_alone;
         transform++) {
        config.parallel.transform = transform;
        assert_ok(v2v_projector_choose_split(&split, &config, &paper, SIDE, SIDE, 1, test_world()));
        assert_int_equal(split, v2v_split_of_slabs(&config));
    }
    config.parallel.split = V2V_SPLIT_SLICES;
    const enum v2v_status rc =
        v2v_projector_choose_split(&split, &config, &paper, SIDE, SIDE, 1, test_world());
    assert_int_equal(rc, is_alone ? V2V_OK : V2V_E_CONFIG);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(measured_figures_are_the_same_on_all_ranks_and_positive),
        cmocka_unit_test(a_rank_short_of_memory_fails_the_measurement_on_all),
        cmocka_unit_test(one_rank_takes_the_same_time_by_either_split),
        cmocka_unit_test(slabs_win_where_messages_cost_nothing),
        cmocka_unit_test(slices_win_for_single_views_over_a_slow_network),
        cmocka_unit_test(slabs_gain_what_fftw3_mpi_is_measured_to_gain),
        cmocka_unit_test(a_frame_beyond_all_counts_takes_for_ever),
        cmocka_unit_test(reproducible_projections_are_by_slabs),
    };
    return test_mpi_main(tests, argc, argv);
}
