/* A failure on one of the threads that encode a frame is told in its words. */
#include "support.h"

#include "v2v3d/io/volume.h"

#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Slice by slice to the next free thread, each slice a while's work. */
enum { THREADS = 8, SLICES = 64, HEIGHT = 64, WIDTH = 64 };

static void what_fails_on_a_thread_says_why(void **state)
{
    (void)state;
#ifndef V2V_FAULTS
    test_skip("this build has no fault points");
#endif
    static float frame[SLICES * HEIGHT * WIDTH];
    const struct v2v_volume_info info = {.frames = 1,
                                         .slices = SLICES,
                                         .height = HEIGHT,
                                         .width = WIDTH,
                                         .storage = {.sample = V2V_SAMPLE_UINT16, .deflate = 9}};
    struct v2v_volume_writer *writer = NULL;
    char path[512];
    snprintf(path, sizeof path, "%s/volume.h5", test_folder(NULL));
    omp_set_num_threads(THREADS);
    assert_ok(v2v_volume_create(&writer, path, &info, 1, NULL, 0, NULL));
    assert_ok(v2v_volume_write(writer, V2V_VOLUME_MEAN, frame, 0, 0, SLICES));
    v2v_status_set_message("an older failure", "nowhere:1");
    assert_int_equal(v2v_volume_finish(&writer), V2V_E_IO);
    assert_non_null(strstr(v2v_status_message(), "volume.encode: injected fault"));
}

int main(void)
{
    setenv("V2V_FAULT", "volume.encode:0:3", 1);
    const struct CMUnitTest tests[] = {cmocka_unit_test(what_fails_on_a_thread_says_why)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
