/* Frames whose volumes explain their views worse than the best one's does, by more than noise. */
#include "support.h"

#include "v2v3d/eval/unlike.h"

enum { FRAMES = 3 };
static const struct v2v_recording_info info = {
    .frames = FRAMES, .views = 4, .height = 48, .width = 48};

static struct v2v_unlike_explained explained(const double *coarse, const struct v2v_unlike *frames)
{
    struct v2v_misfit misfit[FRAMES];
    for (int t = 0; t < FRAMES; t++) {
        misfit[t] = (struct v2v_misfit){.noise_of_coarse = 0.01, .coarse = coarse[t]};
    }
    return v2v_unlike_explained(frames, misfit, &info);
}

/* 144 sums of noise: their root mean square is known to a twelfth, of two frames together. */
static void what_few_sums_may_differ_by_is_no_move(void **state)
{
    (void)state;
    static const struct v2v_unlike like[FRAMES];
    const struct v2v_unlike_explained found = explained((const double[]){1.2, 1.25, 1.8}, like);
    assert_int_equal(found.known, FRAMES);
    assert_int_equal(found.best, 0);
    assert_int_equal(found.moved, 0);
}

static void a_frame_explained_far_worse_has_moved(void **state)
{
    (void)state;
    static const struct v2v_unlike like[FRAMES];
    const struct v2v_unlike_explained found = explained((const double[]){1.2, 1.25, 3.2}, like);
    assert_int_equal(found.moved, 1);
    assert_int_equal(found.first, 2);
}

/* Dark ones, and those of which nothing is known. */
static void frames_unlike_in_another_way_count_for_nothing(void **state)
{
    (void)state;
    struct v2v_unlike frames[FRAMES] = {{{0.0}}};
    frames[2].figure[V2V_UNLIKE_CLIPPED] = 0.01;
    struct v2v_unlike_explained found = explained((const double[]){1.2, 0.0, 3.2}, frames);
    assert_int_equal(found.known, 1);
    assert_int_equal(found.moved, 0);
    found = explained((const double[]){0.0, 0.0, 3.2}, frames);
    assert_int_equal(found.known, 0);
    assert_int_equal(found.best, -1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_few_sums_may_differ_by_is_no_move),
        cmocka_unit_test(a_frame_explained_far_worse_has_moved),
        cmocka_unit_test(frames_unlike_in_another_way_count_for_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
