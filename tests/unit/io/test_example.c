/* The example of file.h. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/recording.h"

#include <stdio.h>

enum { VIEWS = 13, HEIGHT = 3, WIDTH = 4, COUNT = VIEWS * HEIGHT * WIDTH };

static enum v2v_status read_first(float *last, const char *path, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    float *views = NULL;
    struct v2v_recording *recording = NULL;
    struct v2v_input_settings settings = {.views = 13};
    V2V_TRY(v2v_recording_open(&recording, path, &settings, comm));
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    V2V_TRY(V2V_ALLOC(views, "views", info->views * info->height * info->width));
    V2V_TRY(v2v_recording_read(recording, views, 0));
    *last = views[info->views * info->height * info->width - 1];
done:
    v2v_mem_free(views);
    v2v_recording_close(&recording);
    return rc;
}

static void header_example_reads_the_first_frame(void **state)
{
    (void)state;
    char path[512];
    float views[COUNT], last = 0.0f;
    struct v2v_recording_writer *writer = NULL;
    const struct v2v_recording_info info = {
        .frames = 1, .views = VIEWS, .height = HEIGHT, .width = WIDTH};
    for (int i = 0; i < COUNT; i++) {
        views[i] = (float)i;
    }
    snprintf(path, sizeof path, "%s/rec.h5", test_folder(NULL));
    assert_ok(v2v_recording_create(&writer, path, &info, NULL));
    assert_ok(v2v_recording_write(writer, views, 0, 0, VIEWS));
    assert_ok(v2v_recording_finish(&writer));
    assert_ok(read_first(&last, path, NULL));
    assert_true(last == (float)(COUNT - 1));
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(header_example_reads_the_first_frame),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
