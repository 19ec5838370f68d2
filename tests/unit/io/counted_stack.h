/** A TIFF stack of 1 x 1 pixels whose page p holds p. */
#ifndef V2V_TEST_COUNTED_STACK_H
#define V2V_TEST_COUNTED_STACK_H

#include "support.h"
#include "v2v3d/io/tiff.h"

static inline void counted_stack(const char *path, int64_t channels, int64_t slices, int64_t frames)
{
    const struct v2v_tiff_info info = {.pages = channels * slices * frames,
                                       .height = 1,
                                       .width = 1,
                                       .channels = channels,
                                       .slices = slices,
                                       .frames = frames,
                                       .bits = 32,
                                       .is_float = 1,
                                       .type_max = 1.0};
    struct v2v_tiff_writer *writer = NULL;
    assert_ok(v2v_tiff_create(&writer, path, &info));
    for (int64_t p = 0; p < info.pages; p++) {
        assert_ok(v2v_tiff_write_page(writer, &(float){(float)p}));
    }
    assert_ok(v2v_tiff_finish(&writer));
}

#endif
