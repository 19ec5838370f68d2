/* The frame that others are taken over from is neither odd nor dim, unless noise makes it so. */
#include "recon/key_frame.h"
#include "small_recording.h"
#include "support.h"

#include "v2v3d/base/random.h"

enum { FRAMES = 3, VIEWS = 4, SIDE = 32, PIXELS = SIDE * SIDE, SAMPLES = VIEWS * PIXELS };

/* Of frames of these levels with noise of 1, and `more` in view 1 of the first. */
static int64_t key_of(const double *level, double more)
{
    static float frames[FRAMES][SAMPLES], views[SAMPLES];
    const struct v2v_recording_info info = {
        .frames = FRAMES, .views = VIEWS, .height = SIDE, .width = SIDE};
    const struct v2v_scaling scaling = {.gain = 1.0};
    struct v2v_key_frames *keys = NULL;
    int64_t key = -1;
    for (int t = 0; t < FRAMES; t++) {
        for (int i = 0; i < SAMPLES; i++) {
            const double odd = t == 0 && i / PIXELS == 1 ? more : 0.0;
            frames[t][i] =
                (float)(level[t] + odd + v2v_random_normal(11, (uint64_t)t, (uint64_t)i));
        }
    }
    struct v2v_recording *recording = small_recording(test_folder(NULL), frames[0], &info);
    assert_ok(v2v_key_frames_create(&keys, VIEWS, SIDE, SIDE));
    assert_ok(v2v_key_frames_choose(keys, &key, views, recording, &scaling, 0, FRAMES));
    v2v_key_frames_destroy(&keys);
    v2v_recording_close(&recording);
    return key;
}

static void frames_alike_are_led_by_the_first(void **state)
{
    (void)state;
    assert_int_equal(key_of((const double[]){5.0, 5.0, 5.0}, 0.0), 0);
}

static void a_frame_that_shows_more_in_one_view_leads_none(void **state)
{
    (void)state;
    assert_int_equal(key_of((const double[]){5.0, 5.0, 5.0}, 5.0), 1);
    assert_int_equal(key_of((const double[]){5.0, 5.0, 5.0}, -5.0), 1);
}

/* 0.3 more is seventeen times its noise, but a sixteenth of the view's light. */
static void what_hardly_matters_makes_none_odd(void **state)
{
    (void)state;
    assert_int_equal(key_of((const double[]){5.0, 5.0, 5.0}, 0.3), 0);
}

static void what_all_views_change_by_makes_none_odd(void **state)
{
    (void)state;
    assert_int_equal(key_of((const double[]){5.45, 5.0, 5.0}, 0.3), 0);
}

static void a_dim_frame_leads_none(void **state)
{
    (void)state;
    assert_int_equal(key_of((const double[]){1.0, 5.0, 5.0}, 0.0), 1);
    assert_int_equal(key_of((const double[]){3.0, 5.0, 5.0}, 0.0), 0);
}

/* The mean of all samples scatters by 0.016: of noise alone no frame is dimmer than others. */
static void of_noise_alone_the_first_leads(void **state)
{
    (void)state;
    assert_int_equal(key_of((const double[]){-0.02, 0.05, 0.05}, 0.0), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(frames_alike_are_led_by_the_first),
        cmocka_unit_test(a_frame_that_shows_more_in_one_view_leads_none),
        cmocka_unit_test(what_hardly_matters_makes_none_odd),
        cmocka_unit_test(what_all_views_change_by_makes_none_odd),
        cmocka_unit_test(a_dim_frame_leads_none),
        cmocka_unit_test(of_noise_alone_the_first_leads),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
