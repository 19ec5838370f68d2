/** A recording's file out of frames in memory. */
#ifndef TEST_SMALL_RECORDING_H
#define TEST_SMALL_RECORDING_H

#include "support.h"

#include "v2v3d/io/recording.h"

#include <stdio.h>

/** Written by all ranks and opened again. @param data [t,v,y,x] as `info` says */
static struct v2v_recording *small_recording(const char *folder, const float *data,
                                             const struct v2v_recording_info *info)
{
    char path[1024];
    struct v2v_recording_writer *writer = NULL;
    struct v2v_recording *recording = NULL;
    const struct v2v_input_settings settings = {.views = info->views};
    const int64_t samples = info->views * info->height * info->width;
    snprintf(path, sizeof path, "%s/recording.h5", folder);
    assert_ok(v2v_recording_create(&writer, path, info, test_world()));
    for (int64_t t = 0; t < info->frames; t++) {
        int64_t count = v2v_comm_rank(test_world()) == 0 ? info->views : 0;
        assert_ok(v2v_recording_write(writer, data + t * samples, t, 0, count));
    }
    assert_ok(v2v_recording_finish(&writer));
    assert_ok(v2v_recording_open(&recording, path, &settings, test_world()));
    return recording;
}

#endif
