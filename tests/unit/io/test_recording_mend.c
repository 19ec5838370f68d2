#include "capture.h"
#include "support.h"

#include "h5_files.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/recording.h"

#include <stdio.h>
#include <string.h>

enum { FRAMES = 2, HEIGHT = 12, WIDTH = 12, PIXELS = HEIGHT * WIDTH };

static char path[512];

/* A slope of light, and in each frame a hot pixel. */
static struct v2v_recording *open_recording(void)
{
    static double values[FRAMES * PIXELS];
    struct v2v_recording *recording = NULL;
    for (int64_t i = 0; i < FRAMES * PIXELS; i++) {
        values[i] = 100.0 + 10.0 * (double)(i % WIDTH);
    }
    values[5 * WIDTH + 5] = 5000.0;
    values[PIXELS + 7 * WIDTH + 3] = 9000.0;
    snprintf(path, sizeof path, "%s/hot.h5", test_folder(NULL));
    test_h5_make(path, &(struct test_h5_spec){.dataset = "/views",
                                              .type = TEST_H5_U16,
                                              .rank = 4,
                                              .shape = {FRAMES, 1, HEIGHT, WIDTH},
                                              .values = values});
    assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){0}, NULL));
    return recording;
}

/* As they are read, where it is asked for; and nothing else. */
static void hot_pixels_are_mended_as_they_are_read(void **state)
{
    (void)state;
    float views[PIXELS];
    char text[512];
    struct v2v_recording *recording = open_recording();
    assert_ok(v2v_recording_read(recording, views, 0));
    assert_true(views[5 * WIDTH + 5] == 5000.0f);
    assert_ok(v2v_recording_mend(recording, 0.2));
    test_capture_begin();
    assert_ok(v2v_recording_read(recording, views, 0));
    test_capture_end(text, sizeof text);
    assert_non_null(strstr(text, "hot.h5: frame 0 has 1 pixels that no light"));
    assert_non_null(strstr(text, "become the largest there are?")); /* one of 144 is many */
    for (int64_t t = 0; t < FRAMES; t++) {
        assert_ok(v2v_recording_read(recording, views, t));
        for (int64_t i = 0; i < PIXELS; i++) { /* neighbours' median: of three columns the middle */
            assert_true(views[i] == 100.0f + 10.0f * (float)(i % WIDTH));
        }
    }
    v2v_recording_close(&recording);
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hot_pixels_are_mended_as_they_are_read),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
