#include "counted_stack.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/io/recording.h"

#include <stdio.h>
#include <string.h>

static char path[512];

static void assert_says(const char *part)
{
    if (strstr(v2v_status_message(), part) == NULL) {
        fail_msg("\"%s\" does not say \"%s\"", v2v_status_message(), part);
    }
}

/* Channels are fastest, then slices, then frames. */
static void views_of_a_hyperstack_are_its_channels_or_one_channels_slices(void **state)
{
    (void)state;
    static const struct {
        int64_t channels, slices, frames, views, channel;
        int64_t found_views, found_frames;
        float last[3];      /* views of the last frame */
        const char *reason; /* refused */
    } cases[] = {
        {3, 1, 2, 0, 0, 3, 2, {3, 4, 5}, NULL},
        {3, 1, 2, 3, 0, 3, 2, {3, 4, 5}, NULL},
        {3, 1, 1, 3, 0, 3, 1, {0, 1, 2}, NULL},
        {2, 3, 2, 3, 2, 3, 2, {7, 9, 11}, NULL},
        {2, 3, 2, 0, 1, 3, 2, {6, 8, 10}, NULL},
        {2, 1, 6, 3, 1, 3, 2, {6, 8, 10}, NULL},
        {2, 6, 1, 3, 2, 3, 2, {7, 9, 11}, NULL},
        {2, 3, 2, 0, 0, 0, 0, {0}, "has 2 channels and 3 slices: --channel K (from 1)"},
        {2, 3, 2, 2, 0, 0, 0, {0}, "has 2 channels and 3 slices: --channel K (from 1)"},
        {2,
         1,
         6,
         3,
         0,
         0,
         0,
         {0},
         "a frame has 2 channels, but 3 are asked for as views; --channel K"},
        {2, 1, 6, 3, 3, 0, 0, {0}, "has 2 channels: there is no channel 3 (from 1)"},
        {1, 3, 2, 0, 2, 0, 0, {0}, "has 1 channel: there is no channel 2 (from 1)"},
        {1, 2, 3, 3, 0, 0, 0, {0}, "a frame has 2 slices, but 3 are asked for"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const struct v2v_input_settings settings = {.views = cases[i].views,
                                                    .channel = cases[i].channel};
        struct v2v_recording *recording = NULL;
        float views[3];
        counted_stack(path, cases[i].channels, cases[i].slices, cases[i].frames);
        if (cases[i].reason != NULL) {
            assert_int_equal(v2v_recording_open(&recording, path, &settings, NULL), V2V_E_INPUT);
            assert_says(path);
            assert_says(cases[i].reason);
            continue;
        }
        assert_ok(v2v_recording_open(&recording, path, &settings, NULL));
        const struct v2v_recording_info *info = v2v_recording_info(recording);
        assert_int_equal(info->views, cases[i].found_views);
        assert_int_equal(info->frames, cases[i].found_frames);
        assert_ok(v2v_recording_read(recording, views, info->frames - 1));
        for (int v = 0; v < 3; v++) {
            assert_true(views[v] == cases[i].last[v]);
        }
        v2v_recording_close(&recording);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(views_of_a_hyperstack_are_its_channels_or_one_channels_slices),
    };
    snprintf(path, sizeof path, "%s/stack.tif", test_folder(NULL));
    return cmocka_run_group_tests(tests, NULL, NULL);
}
