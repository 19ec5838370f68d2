/** The runner of MPI tests itself: what it makes of a rank that fails, in jobs that this program
 *  starts out of itself. */
#include "capture.h"
#include "support.h"

#include <string.h>

static void fails_on_rank_1(void **state)
{
    (void)state;
    assert_int_not_equal(v2v_comm_rank(test_world()), 1);
}

static void passes(void **state)
{
    (void)state;
    v2v_par_barrier(test_world());
}

static void job_fails_when_another_rank_than_0_does_and_shows_its_report(void **state)
{
    (void)state;
    char text[1 << 14];
    assert_int_equal(test_own_job(3, "fail", text, sizeof text), 1);
    assert_non_null(strstr(text, "[rank 1] [  FAILED  ] fails_on_rank_1"));
    assert_null(strstr(text, "[rank 2]"));
}

static void job_that_passes_shows_the_report_of_rank_0_alone(void **state)
{
    (void)state;
    char text[1 << 14];
    assert_int_equal(test_own_job(3, "pass", text, sizeof text), 0);
    const char *first = strstr(text, "OK ] passes");
    assert_non_null(first);
    assert_null(strstr(first + 1, "OK ] passes"));
}

int main(int argc, char **argv)
{
    const struct CMUnitTest failing[] = {
        cmocka_unit_test(fails_on_rank_1),
        cmocka_unit_test(passes),
    };
    const struct CMUnitTest passing[] = {
        cmocka_unit_test(passes),
    };
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(job_fails_when_another_rank_than_0_does_and_shows_its_report),
        cmocka_unit_test(job_that_passes_shows_the_report_of_rank_0_alone),
    };
    if (argc > 1 && strcmp(argv[1], "fail") == 0) {
        return test_mpi_main(failing, argc, argv);
    }
    if (argc > 1) {
        return test_mpi_main(passing, argc, argv);
    }
    return cmocka_run_group_tests(tests, NULL, NULL);
}
