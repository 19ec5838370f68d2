/** TIFF stacks of float32 whose pixels count on. */
#ifndef V2V_TEST_COUNTED_STACK_H
#define V2V_TEST_COUNTED_STACK_H

#include "support.h"
#include "v2v3d/io/tiff.h"

/** Pixel i of page p is first + step * (p * pixels + i). @param info of a page at most 6 pixels */
static inline void counting_stack(const char *path, const struct v2v_tiff_info *info, float first,
                                  float step)
{
    struct v2v_tiff_writer *writer = NULL;
    const int64_t pixels = info->height * info->width;
    float page[6];
    assert_true(pixels <= 6);
    assert_ok(v2v_tiff_create(&writer, path, info));
    for (int64_t p = 0; p < info->pages; p++) {
        for (int64_t i = 0; i < pixels; i++) {
            page[i] = first + step * (float)(p * pixels + i);
        }
        assert_ok(v2v_tiff_write_page(writer, page));
    }
    assert_ok(v2v_tiff_finish(&writer));
}

/** Of 1 x 1 pixels; page p holds p. */
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
    counting_stack(path, &info, 0.0f, 1.0f);
}

#endif
