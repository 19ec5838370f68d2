#include "support.h"

#include "v2v3d/par/comm.h"

static void parts_cover_everything_once_and_differ_by_at_most_one(void **state)
{
    (void)state;
    static const int64_t sizes[] = {0, 1, 2, 3, 13, 39, 100, 1000003};
    for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++) {
        for (int64_t parts = 1; parts <= 40; parts++) {
            int64_t next = 0;
            for (int64_t i = 0; i < parts; i++) {
                struct v2v_part part = v2v_par_part(sizes[s], parts, i);
                assert_int_equal(part.first, next);
                assert_true(part.count == sizes[s] / parts ||
                            part.count == (sizes[s] + parts - 1) / parts);
                next += part.count;
            }
            assert_int_equal(next, sizes[s]);
        }
    }
}

static void part_of_the_largest_number_does_not_overflow(void **state)
{
    (void)state;
    struct v2v_part last = v2v_par_part(INT64_MAX, 1000, 999);
    assert_true(last.first + last.count == INT64_MAX);
    last = v2v_par_part(INT64_MAX, INT64_MAX, INT64_MAX - 1);
    assert_true(last.first == INT64_MAX - 1 && last.count == 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(parts_cover_everything_once_and_differ_by_at_most_one),
        cmocka_unit_test(part_of_the_largest_number_does_not_overflow),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
