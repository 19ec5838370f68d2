/* The limits in which the time on many ranks is known without a model. */
#include "small_shifts.h"

#include "network/forecast.h"
#include <float.h>
#include <math.h>

enum { VIEWS = 13, SLICES = 39, SIDE = 512, CROP = 128, MOST_RANKS = 600 };

/* Sums of a few terms in double precision, of which none is larger than the sum. */
static const double round_off = 64 * DBL_EPSILON;

static const struct v2v_forecast_machine ideal = {
    .cores = 1 << 20, .threads = 1, .mac_s = 1e-11, .crowd = 1.0};

static struct v2v_forecast_machine with_network(void)
{
    struct v2v_forecast_machine machine = ideal;
    machine.cores = 2;
    machine.crowd = 1.1;
    machine.file_byte_s = 1e-9;
    machine.inside = (struct v2v_comm_cost){2, 1e-6, 1e-10, 1e-6, 2e-10};
    machine.link_byte_s = 1e-9;
    machine.link_message_s = 2e-5;
    return machine;
}

static int make_network(void **state)
{
    static struct v2v_forecast_network network;
    struct v2v_shifts shifts = small_shifts(VIEWS, SLICES);
    struct v2v_model_spec spec = {
        .views = VIEWS, .slices = SLICES, .width = 128, .features = 4, .winograd = 1};
    assert_ok(v2v_forecast_network_of(&network, &spec, &shifts));
    v2v_shifts_fini(&shifts);
    *state = &network;
    return 0;
}

static struct v2v_forecast_job frames_of(void **state, int64_t frames)
{
    return (struct v2v_forecast_job){
        .network = *state, .items = frames, .height = SIDE, .width = SIDE};
}

static struct v2v_forecast_job batch_of(void **state, int64_t samples)
{
    return (struct v2v_forecast_job){
        .network = *state, .training = 1, .items = samples, .height = CROP, .width = CROP};
}

static struct v2v_forecast forecast(const struct v2v_forecast_machine *machine,
                                    const struct v2v_forecast_job *job, int ranks, int hosts)
{
    struct v2v_forecast result;
    assert_ok(v2v_forecast(&result, machine, job, ranks, hosts));
    return result;
}

/* One frame, or sample, on one rank. */
static double item_s(const struct v2v_forecast_job *job)
{
    double pass_s = ideal.mac_s * v2v_forecast_macs(job->network, job->height, job->width);
    return job->training ? V2V_FORECAST_STEP_PASSES * pass_s : pass_s;
}

static void assert_near(double value, double expected, double tolerance)
{
    if (!(fabs(value - expected) <= tolerance * fabs(expected))) {
        fail_msg("%.17g is not %.17g", value, expected);
    }
}

static void the_example_of_the_header_runs(void **state)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_forecast_network network;
    const struct v2v_forecast_machine machine = with_network();
    struct v2v_forecast result;
    struct v2v_shifts shifts = small_shifts(5, 4);
    struct v2v_model_spec spec = {.views = 5, .slices = 4, .width = 4, .features = 4};
    struct v2v_forecast_job job = {.network = &network, .items = 100, .height = 512, .width = 512};
    (void)state;
    V2V_TRY(v2v_forecast_network_of(&network, &spec, &shifts));
    V2V_TRY(v2v_forecast(&result, &machine, &job, 64, 32));
    assert_true(result.seconds > 0.0);
done:
    v2v_shifts_fini(&shifts);
    assert_ok(rc);
    assert_int_equal(v2v_mem_held(), 0);
}

static void one_rank_computes_and_writes(void **state)
{
    struct v2v_forecast_machine machine = with_network();
    machine.inside = (struct v2v_comm_cost){0}; /* as a rank alone measures it */
    struct v2v_forecast_job jobs[] = {frames_of(state, 3), batch_of(state, 3)};
    for (int i = 0; i < 2; i++) {
        struct v2v_forecast one = forecast(&machine, &jobs[i], 1, 1);
        double images = jobs[i].training ? VIEWS : VIEWS + SLICES;
        double bytes = 4.0 * images * 3.0 * (double)(jobs[i].height * jobs[i].width);
        assert_near(one.compute_s, 3.0 * item_s(&jobs[i]), round_off);
        assert_near(one.file_s, 1e-9 * bytes, round_off);
        assert_near(one.seconds, one.compute_s + one.file_s, round_off);
        assert_int_equal(one.rounds, 3);
    }
}

static void frames_take_as_many_rounds_as_ranks_need(void **state)
{
    struct v2v_forecast_job job = frames_of(state, 120);
    struct v2v_forecast many = forecast(&ideal, &job, 64, 1);
    assert_int_equal(many.data, 64);
    assert_int_equal(many.rounds, 2);
    assert_near(many.seconds, 2.0 * item_s(&job), round_off);
    /* 8 of 128 places are empty */
    assert_near(many.uneven_s, 8.0 / 64.0 * item_s(&job), 100 * round_off);
    assert_near(forecast(&ideal, &job, 60, 1).seconds, 2.0 * item_s(&job), round_off);
    assert_near(forecast(&ideal, &job, 120, 1).seconds, item_s(&job), round_off);
    /* of 128 places 28 would be empty: frames in parts take less than two rounds */
    job.items = 100;
    assert_true(forecast(&ideal, &job, 64, 1).seconds < 2.0 * item_s(&job));
}

static void a_pair_of_branches_takes_the_larger_one(void **state)
{
    struct v2v_forecast_job job = batch_of(state, 1);
    struct v2v_forecast pair = forecast(&ideal, &job, 2, 1);
    assert_int_equal(pair.shape.branches, 2);
    /* seven views of thirteen are more than half of the encoder's work, and of the first layer's */
    assert_true(pair.seconds > 0.5 * item_s(&job) && pair.seconds < 0.56 * item_s(&job));
    assert_near(pair.seconds, pair.compute_s + pair.repeated_s, round_off);
}

static void a_frame_in_slabs_keeps_its_small_layers_whole(void **state)
{
    const struct v2v_forecast_network *network = *state;
    struct v2v_forecast_job job = frames_of(state, 1);
    struct v2v_forecast two = forecast(&ideal, &job, 4, 1);
    struct v2v_forecast most = forecast(&ideal, &job, 32, 1);
    double small = network->branch[0].whole_macs * SIDE * SIDE * ideal.mac_s;
    assert_int_equal(two.shape.branches, 2);
    assert_int_equal(two.shape.shards, 2);
    /* half the branch, eight rows of 256 more, and half of the small layers: 3 % of the work */
    assert_true(two.seconds > 0.25 * item_s(&job) && two.seconds < 0.29 * item_s(&job));
    assert_int_equal(most.shape.shards, 16);
    assert_true(most.seconds > small + item_s(&job) / 32 && most.seconds < item_s(&job) / 10);
}

static void parts_are_no_less_than_nothing_and_add_up(void **state)
{
    const struct v2v_forecast_machine machine = with_network();
    struct v2v_forecast_job jobs[] = {frames_of(state, 100), frames_of(state, 1),
                                      batch_of(state, 1), batch_of(state, 48)};
    for (int i = 0; i < 4; i++) {
        for (int ranks = 1; ranks <= MOST_RANKS; ranks += ranks < 20 ? 1 : 29) {
            struct v2v_forecast f = forecast(&machine, &jobs[i], ranks, (ranks + 1) / 2);
            double least = -round_off * f.seconds;
            assert_true(f.compute_s > 0.0 && f.crowded_s >= least && f.repeated_s >= least);
            assert_true(f.uneven_s >= least && f.network_s >= 0.0 && f.file_s > 0.0);
            assert_near(f.compute_s + f.crowded_s + f.repeated_s + f.uneven_s + f.network_s +
                            f.file_s,
                        f.seconds, round_off);
            assert_true(f.data * f.shape.branches * f.shape.shards + f.idle == ranks);
            assert_true(f.rounds * f.data >= jobs[i].items);
        }
    }
}

static void dearer_bytes_and_messages_never_make_it_faster(void **state)
{
    struct v2v_forecast_job jobs[] = {frames_of(state, 5), batch_of(state, 1), batch_of(state, 8)};
    for (int i = 0; i < 3; i++) {
        for (int ranks = 2; ranks <= 64; ranks *= 2) {
            struct v2v_forecast_machine machine = with_network();
            double *cost[] = {&machine.inside.message_s,  &machine.inside.byte_s,
                              &machine.inside.sum_step_s, &machine.inside.sum_byte_s,
                              &machine.link_byte_s,       &machine.link_message_s,
                              &machine.file_byte_s};
            double before = forecast(&machine, &jobs[i], ranks, (ranks + 3) / 4).seconds;
            for (size_t k = 0; k < sizeof cost / sizeof *cost; k++) {
                *cost[k] *= 10.0;
                double after = forecast(&machine, &jobs[i], ranks, (ranks + 3) / 4).seconds;
                assert_true(after >= before);
                before = after;
            }
            assert_true(before > forecast(&ideal, &jobs[i], ranks, 1).seconds);
        }
    }
}

static void more_ranks_than_cores_share_the_cores(void **state)
{
    struct v2v_forecast_machine machine = ideal;
    machine.cores = 2;
    machine.crowd = 1.25;
    struct v2v_forecast_job job = frames_of(state, 4);
    struct v2v_forecast one = forecast(&machine, &job, 1, 1);
    struct v2v_forecast two = forecast(&machine, &job, 2, 1);
    struct v2v_forecast four = forecast(&machine, &job, 4, 1);
    assert_near(one.seconds, 4.0 * item_s(&job), round_off);
    assert_near(two.seconds, 2.0 * 1.25 * item_s(&job), round_off);
    assert_near(four.seconds, two.seconds, round_off);
    assert_near(forecast(&machine, &job, 4, 2).seconds, 1.25 * item_s(&job), round_off);
    machine.cores = 3; /* two of three busy: half of what three lose */
    assert_near(forecast(&machine, &job, 2, 1).seconds, 2.0 * 1.125 * item_s(&job), round_off);
}

static void gradients_travel_behind_the_backward_pass(void **state)
{
    const struct v2v_forecast_network *network = *state;
    struct v2v_forecast_machine machine = ideal;
    struct v2v_forecast_job job = batch_of(state, 2);
    double bytes = network->encoder_bytes, free_s = forecast(&machine, &job, 2, 2).seconds;
    for (int b = 0; b < 2; b++) {
        for (int i = 0; i < network->layers; i++) {
            bytes += network->branch[b].layer[i].bytes;
        }
    }
    /* both ranks send half of all gradients for the sums and get as much of them back */
    machine.link_byte_s = 0.2 * free_s / bytes;
    double hidden = forecast(&machine, &job, 2, 2).network_s;
    assert_true(hidden > 0.0 && hidden < 0.3 * bytes * machine.link_byte_s);
    /* a link that is busy much longer than the step takes hides nothing but that step */
    machine.link_byte_s = 100.0 * free_s / bytes;
    double bound = forecast(&machine, &job, 2, 2).network_s;
    assert_true(bound > 99.0 * free_s && bound < 100.0 * free_s * (1.0 + round_off));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_example_of_the_header_runs),
        cmocka_unit_test(one_rank_computes_and_writes),
        cmocka_unit_test(frames_take_as_many_rounds_as_ranks_need),
        cmocka_unit_test(a_pair_of_branches_takes_the_larger_one),
        cmocka_unit_test(a_frame_in_slabs_keeps_its_small_layers_whole),
        cmocka_unit_test(parts_are_no_less_than_nothing_and_add_up),
        cmocka_unit_test(dearer_bytes_and_messages_never_make_it_faster),
        cmocka_unit_test(more_ranks_than_cores_share_the_cores),
        cmocka_unit_test(gradients_travel_behind_the_backward_pass),
    };
    return cmocka_run_group_tests(tests, make_network, NULL);
}
