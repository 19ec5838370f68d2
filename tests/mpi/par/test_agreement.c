/* Ranks that tell each other how their rounds went, and go one round ahead. */
#include "support.h"

#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/agreement.h"
#include "v2v3d/par/watchdog.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

enum { ROUNDS = 12 };

static void sleep_for(double seconds)
{
    const struct timespec time = {.tv_nsec = (long)(1e9 * seconds)};
    nanosleep(&time, NULL);
}

static void rounds_that_go_well_agree(void **state)
{
    (void)state;
    struct v2v_agreement *agreement = NULL;
    const int rank = v2v_comm_rank(test_world());
    assert_ok(v2v_agreement_create(&agreement, test_world()));
    assert_ok(v2v_agreement_end(agreement)); /* nothing was told */
    for (int again = 0; again < 2; again++) {
        for (int n = 0; n < ROUNDS; n++) {
            sleep_for((n + rank) % 3 == 0 ? 0.003 : 0.0);
            assert_ok(v2v_agreement_tell(agreement, V2V_OK));
        }
        assert_ok(v2v_agreement_end(agreement));
    }
    v2v_agreement_destroy(&agreement);
    assert_null(agreement);
}

/* Rank `who` fails in round `when`: the round before is well for all, this one for nobody, and what
 * comes next on this communicator meets no old message. */
static void check_failure(int who, int when)
{
    struct v2v_agreement *agreement = NULL;
    enum v2v_status mine = V2V_OK, rc = V2V_OK;
    const int rank = v2v_comm_rank(test_world());
    char name[32];
    int learnt = -1;
    assert_ok(v2v_agreement_create(&agreement, test_world()));
    for (int n = 0; n < ROUNDS && rc == V2V_OK; n++) {
        if (rank == who && n == when) {
            mine = V2V_FAIL(V2V_E_IO, "round %d", n);
        }
        rc = v2v_agreement_tell(agreement, mine);
        learnt = n;
    }
    if (rc == V2V_OK) {
        rc = v2v_agreement_end(agreement);
        learnt = ROUNDS;
    }
    assert_int_equal(rc, V2V_E_IO);
    assert_int_equal(learnt, when + 1);
    snprintf(name, sizeof name, "round %d", when);
    assert_non_null(strstr(v2v_status_message(), name));
    v2v_agreement_destroy(&agreement);
    assert_ok(v2v_par_agree(test_world(), V2V_OK));
}

static void all_learn_of_a_failure_in_the_round_after_it(void **state)
{
    (void)state;
    for (int who = 0; who < v2v_comm_size(test_world()); who++) {
        check_failure(who, 0);
        check_failure(who, 5);
        check_failure(who, ROUNDS - 1);
    }
}

/* A request to stop is the least of failures. */
static void of_two_failures_in_a_round_the_worse_is_told(void **state)
{
    (void)state;
    struct v2v_agreement *agreement = NULL;
    const int rank = v2v_comm_rank(test_world()), last = v2v_comm_size(test_world()) - 1;
    enum v2v_status mine = V2V_OK;
    if (last == 0) {
        test_skip("one rank has nobody to agree with");
    }
    assert_ok(v2v_agreement_create(&agreement, test_world()));
    if (rank == 0 || rank == last) {
        mine = V2V_FAIL(rank == 0 ? V2V_STOPPED : V2V_E_NUMERIC, "of rank %d's own", rank);
    }
    char name[32];
    snprintf(name, sizeof name, "of rank %d's own", last);
    assert_ok(v2v_agreement_tell(agreement, mine));
    assert_int_equal(v2v_agreement_tell(agreement, mine), V2V_E_NUMERIC);
    assert_non_null(strstr(v2v_status_message(), name));
    v2v_agreement_destroy(&agreement);
}

/* Rank 0 sleeps in its second round: the others end theirs before it, and wait in the third. */
static void a_rank_is_one_round_ahead_at_most(void **state)
{
    (void)state;
    struct v2v_agreement *agreement = NULL;
    const double sleep = 0.2;
    const int rank = v2v_comm_rank(test_world());
    assert_ok(v2v_agreement_create(&agreement, test_world()));
    v2v_par_barrier(test_world());
    const double began = v2v_clock_now();
    for (int n = 0; n < 3; n++) {
        sleep_for(rank == 0 && n == 1 ? sleep : 0.0);
        assert_ok(v2v_agreement_tell(agreement, V2V_OK));
    }
    assert_true(v2v_clock_now() - began >= 0.9 * sleep); /* two rounds ahead of rank 0 is nobody */
    assert_ok(v2v_agreement_end(agreement));
    v2v_agreement_destroy(&agreement);
}

/* The others tell their second round while rank 0 has not told its own: they would wait for ever if
 * they had to keep step. */
static void a_rank_may_be_one_round_ahead(void **state)
{
    (void)state;
    struct v2v_agreement *agreement = NULL;
    assert_ok(v2v_agreement_create(&agreement, test_world()));
    assert_ok(v2v_agreement_tell(agreement, V2V_OK));
    if (v2v_comm_rank(test_world()) == 0) {
        v2v_par_barrier(test_world());
    }
    assert_ok(v2v_agreement_tell(agreement, V2V_OK));
    if (v2v_comm_rank(test_world()) != 0) {
        v2v_par_barrier(test_world());
    }
    assert_ok(v2v_agreement_end(agreement));
    v2v_agreement_destroy(&agreement);
}

static enum v2v_status work_alone(void *context)
{
    ++*(int *)context;
    return V2V_FAIL(V2V_E_IO, "what rank 0 found");
}

static void what_rank_0_does_alone_all_learn(void **state)
{
    (void)state;
    int calls = 0;
    assert_int_equal(v2v_agreement_alone(test_world(), work_alone, &calls), V2V_E_IO);
    assert_int_equal(calls, v2v_comm_rank(test_world()) == 0);
    assert_non_null(strstr(v2v_status_message(), "what rank 0 found"));
}

/* Tests that wait for seconds run at one of the rank counts, the largest. */
enum { MOST_RANKS = 4 };
static void only_among_most_ranks(void)
{
    if (v2v_comm_size(test_world()) < MOST_RANKS) {
        test_skip("runs on four ranks: it waits for seconds");
    }
}

/* Rank 0 works for PERIODS of the watchdog, and beats. It leaves the watchdog armed. */
enum { PERIODS = 2, BEATS = 30 };
static const double period = 3.0; /* a machine that stands still for so long ends the test */

static enum v2v_status work_long(void *context)
{
    (void)context;
    for (int i = 0; i < BEATS; i++) {
        v2v_watchdog_beat("a part of long work");
        sleep_for(PERIODS * period / BEATS);
    }
    return V2V_OK;
}

static void ranks_wait_for_rank_0_that_works_alone(void **state)
{
    (void)state;
    only_among_most_ranks();
    v2v_watchdog_set_period(period);
    const double began = v2v_clock_now();
    assert_ok(v2v_agreement_alone(test_world(), work_long, NULL));
    assert_true(v2v_clock_now() - began >= 0.9 * PERIODS * period); /* nobody left before it */
    v2v_watchdog_set_period(0.0);
}

/* The last rank computes for PERIODS of the watchdog, beating; the others wait for it and live. The
 * last test: it leaves the watchdog armed with its period. */
static void a_rank_waits_for_one_that_is_alive(void **state)
{
    (void)state;
    struct v2v_agreement *agreement = NULL;
    const int is_slow = v2v_comm_rank(test_world()) == v2v_comm_size(test_world()) - 1;
    only_among_most_ranks();
    assert_ok(v2v_agreement_create(&agreement, test_world()));
    v2v_watchdog_set_period(period);
    const double began = v2v_clock_now();
    for (int i = 0; is_slow && i < BEATS; i++) {
        v2v_watchdog_beat("a part of a long frame");
        sleep_for(PERIODS * period / BEATS);
    }
    assert_ok(v2v_agreement_meet(agreement));
    assert_true(v2v_clock_now() - began >= 0.9 * PERIODS * period); /* nobody left before it */
    v2v_watchdog_set_period(0.0);
    v2v_agreement_destroy(&agreement);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rounds_that_go_well_agree),
        cmocka_unit_test(all_learn_of_a_failure_in_the_round_after_it),
        cmocka_unit_test(of_two_failures_in_a_round_the_worse_is_told),
        cmocka_unit_test(a_rank_may_be_one_round_ahead),
        cmocka_unit_test(a_rank_is_one_round_ahead_at_most),
        cmocka_unit_test(what_rank_0_does_alone_all_learn),
        cmocka_unit_test(ranks_wait_for_rank_0_that_works_alone),
        cmocka_unit_test(a_rank_waits_for_one_that_is_alive),
    };
    return test_mpi_main(tests, argc, argv);
}
