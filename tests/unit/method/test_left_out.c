/* Which views are left out of a frame, and in which order the list has them. */
#include "support.h"

#include "method/tv.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/method/left_out.h"

enum { SIDE = 8, KERNEL = 3, MOST_VIEWS = 13 };

static struct v2v_config config;
static struct v2v_psf_file psf;
static struct v2v_problem problem;

/* Every view sees the one slice as it is. */
static void make(int64_t views)
{
    v2v_config_defaults(&config);
    psf = (struct v2v_psf_file){.views = views, .slices = 1, .height = KERNEL, .width = KERNEL};
    assert_ok(V2V_ALLOC(psf.data, "test", views * KERNEL * KERNEL));
    for (int64_t v = 0; v < views; v++) {
        psf.data[v * KERNEL * KERNEL + KERNEL * KERNEL / 2] = 1.0f;
    }
    problem = (struct v2v_problem){.config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
}

static void unmake(void)
{
    v2v_psf_file_fini(&psf);
    assert_int_equal(v2v_mem_held(), 0);
}

/* Every view is listed once, those left out last; counts how often each was left out. */
static void check(int *times, struct v2v_left_out *left_out, int64_t without)
{
    int listed[MOST_VIEWS] = {0};
    assert_int_equal(left_out->views - left_out->used, without);
    for (int64_t i = 0; i < left_out->views; i++) {
        listed[left_out->view[i]]++;
        times[left_out->view[i]] += i >= left_out->used;
    }
    for (int64_t v = 0; v < left_out->views; v++) {
        assert_int_equal(listed[v], 1);
    }
    v2v_left_out_destroy(&left_out);
}

static void folds_leave_every_view_out_once(void **state)
{
    (void)state;
    static const int64_t views[] = {2, 6, 7, 8, 13}, folds[] = {2, 6, 4, 4, 7};
    for (int i = 0; i < 5; i++) {
        int times[MOST_VIEWS] = {0};
        make(views[i]);
        assert_int_equal(v2v_left_out_folds(views[i]), folds[i]);
        for (int64_t f = 0; f < folds[i]; f++) {
            struct v2v_left_out *left_out = NULL;
            const int64_t without = f + folds[i] < views[i] ? 2 : 1;
            assert_ok(v2v_left_out_create(&left_out, &v2v_estimator_tv, &problem,
                                          v2v_left_out_fold(views[i], f), 1, NULL));
            assert_int_equal(left_out->predicted, without);
            assert_int_equal(left_out->view[left_out->used], f);
            check(times, left_out, without);
        }
        for (int64_t v = 0; v < views[i]; v++) {
            assert_int_equal(times[v], 1);
        }
        unmake();
    }
}

static void none_left_out_predicts_all(void **state)
{
    (void)state;
    int times[MOST_VIEWS] = {0};
    struct v2v_left_out *left_out = NULL;
    make(5);
    assert_ok(v2v_left_out_create(&left_out, &v2v_estimator_tv, &problem,
                                  (struct v2v_left_out_views){0}, 1, NULL));
    assert_int_equal(left_out->predicted, 5);
    check(times, left_out, 0);
    unmake();
}

static void choices_share_no_view(void **state)
{
    (void)state;
    static const int64_t views[] = {3, 6, 7, 8, 13}, count[] = {1, 1, 3, 3, 3};
    for (int i = 0; i < 5; i++) {
        int times[MOST_VIEWS] = {0};
        make(views[i]);
        for (int64_t choice = 0; choice < V2V_LEFT_OUT_CHOICES; choice++) {
            struct v2v_left_out *left_out = NULL;
            assert_ok(v2v_left_out_choose(&left_out, &v2v_estimator_tv, &problem, choice, NULL));
            check(times, left_out, count[i]);
        }
        for (int64_t v = 0; v < views[i]; v++) {
            assert_true(times[v] <= 1);
        }
        unmake();
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(folds_leave_every_view_out_once),
        cmocka_unit_test(none_left_out_predicts_all),
        cmocka_unit_test(choices_share_no_view),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
