#include "support.h"

#include "v2v3d/conf/cameras.h"

#include <stdio.h>
#include <string.h>

static struct v2v_cameras cameras_of(const char *list, int64_t views)
{
    struct v2v_synthesis_settings settings = {0};
    struct v2v_cameras cameras;
    snprintf(settings.cameras, sizeof settings.cameras, "%s", list);
    assert_ok(v2v_cameras_init(&cameras, &settings, views));
    return cameras;
}

static void assert_at(const struct v2v_cameras *cameras, int64_t v, double y, double x)
{
    assert_true(cameras->at[v][0] == y && cameras->at[v][1] == x);
}

static void without_a_list_they_stand_in_a_grid_about_0(void **state)
{
    (void)state;
    struct v2v_cameras cameras = cameras_of("", 0);
    assert_int_equal(cameras.views, 9);
    for (int64_t v = 0; v < 9; v++) {
        assert_at(&cameras, v, (double)(v / 3) - 1, (double)(v % 3) - 1);
    }
    v2v_cameras_fini(&cameras);
    cameras = cameras_of("", 5); /* three columns, the second row not full */
    assert_at(&cameras, 0, -0.5, -1);
    assert_at(&cameras, 2, -0.5, 1);
    assert_at(&cameras, 4, 0.5, 0);
    v2v_cameras_fini(&cameras);
}

static void a_list_says_where_they_stand(void **state)
{
    (void)state;
    struct v2v_cameras cameras = cameras_of("0 0, 1.5 -2,0 3e1", 0);
    assert_int_equal(cameras.views, 3);
    assert_at(&cameras, 1, 1.5, -2);
    assert_at(&cameras, 2, 0, 30);
    v2v_cameras_fini(&cameras);
}

static void refused(const char *list, int64_t views, const char *why)
{
    struct v2v_synthesis_settings settings = {0};
    struct v2v_cameras cameras;
    snprintf(settings.cameras, sizeof settings.cameras, "%s", list);
    assert_int_equal(v2v_cameras_init(&cameras, &settings, views), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), why));
    assert_null(cameras.at);
}

static void a_list_that_does_not_fit_is_refused(void **state)
{
    (void)state;
    refused("0 0, 1 1", 3, "synthesis.cameras: has 2 cameras for 3 views");
    refused("0 0, 1", 0, "synthesis.cameras: view 1 is not a pair 'y x': ' 1'");
    refused("0 0, 1 1,", 0, "view 2 is not a pair");
    refused("0 1e9", 0, "is outside");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(without_a_list_they_stand_in_a_grid_about_0),
        cmocka_unit_test(a_list_says_where_they_stand),
        cmocka_unit_test(a_list_that_does_not_fit_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
