#include "v2v3d/io/png.h"

#include "io/file_internal.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"

#include <errno.h>
#include <png.h>
#include <string.h>

enum v2v_status v2v_png_write(const char *path, const uint8_t *pixels, int64_t height,
                              int64_t width, int channels)
{
    enum v2v_status rc = V2V_OK;
    char temporary[V2V_PATH_BYTES];
    FILE *stream = NULL;
    png_image image = {.version = PNG_IMAGE_VERSION};

    if (height < 1 || width < 1 || (channels != 1 && channels != 3) ||
        v2v_mem_product(height, width, channels) < 1 || height > INT32_MAX || width > INT32_MAX) {
        V2V_TRY(V2V_FAIL(V2V_E_IO,
                         "%s: a picture of %lld x %lld pixels, %d channels, cannot be "
                         "written",
                         path, (long long)height, (long long)width, channels));
    }
    V2V_TRY(v2v_file_begin(&stream, temporary, path));
    V2V_TRY(V2V_FAULT_POINT("png.write"));
    image.width = (png_uint_32)width;
    image.height = (png_uint_32)height;
    image.format = channels == 1 ? PNG_FORMAT_GRAY : PNG_FORMAT_RGB;
    /* libpng's one-call interface: its errors come back as text, without longjmp. */
    if (!png_image_write_to_stdio(&image, stream, 0, pixels, 0, NULL)) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %s", temporary, image.message));
    }
done:
    png_image_free(&image);
    return v2v_file_close_and_commit(rc, stream, temporary, path);
}
