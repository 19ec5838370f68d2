#include "support.h"

#include "v2v3d/conf/kept_views.h"

#include <string.h>

static void assert_kept(const char *without, int64_t views, int64_t count, const int64_t *view)
{
    struct v2v_kept_views kept;
    assert_ok(v2v_kept_views_init(&kept, without, views));
    assert_int_equal(kept.count, count);
    for (int64_t i = 0; i < count; i++) {
        assert_int_equal(kept.view[i], view[i]);
        assert_int_equal(v2v_kept_views_number(without, i), view[i]);
    }
    v2v_kept_views_fini(&kept);
    assert_null(kept.view);
}

static void those_that_are_not_listed_are_kept(void **state)
{
    (void)state;
    assert_kept("", 3, 3, (const int64_t[]){0, 1, 2});
    assert_kept("0", 3, 2, (const int64_t[]){1, 2});
    assert_kept("4,1", 5, 3, (const int64_t[]){0, 2, 3});
    assert_kept(" 2 , 0,3 ", 5, 2, (const int64_t[]){1, 4});
    assert_int_equal(v2v_kept_views_number(" 2 , 0,13 ", 11), 14);
}

static void refused(const char *without, int64_t views, const char *why)
{
    struct v2v_kept_views kept;
    assert_int_equal(v2v_kept_views_init(&kept, without, views), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "input.without_views: "));
    assert_non_null(strstr(v2v_status_message(), why));
    assert_null(kept.view);
}

static void a_list_of_anything_else_is_refused(void **state)
{
    (void)state;
    refused("3", 3, "3 is outside [0, 2]");
    refused("-1", 3, "outside [0, 2]");
    refused("1, 1", 3, "has view 1 twice");
    refused("0,1,2", 3, "leaves none of 3 views");
    refused("1 2", 3, "not '1 2'");
    refused("1,", 3, "not '1,'");
    refused(",1", 3, "not ',1'");
    refused("0,,1", 3, "not '0,,1'");
    refused(" ", 3, "not ' '");
    refused("one", 3, "'one'");
    refused("1.0", 3, "'1.0'");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(those_that_are_not_listed_are_kept),
        cmocka_unit_test(a_list_of_anything_else_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
