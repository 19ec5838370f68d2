#include "v2v3d/io/apng.h"

#include "io/deflate.h"
#include "io/file_internal.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"

#include <errno.h>
#include <limits.h>
#include <string.h>
#include <zlib.h>

/* As libpng's usual one. */
enum { LEVEL = 6 };

struct v2v_apng {
    char path[V2V_PATH_BYTES], temporary[V2V_PATH_BYTES];
    FILE *stream;
    int64_t frames, put;
    int frames_per_second;
    int64_t height, width;
    uint32_t sequence; /* of chunks fcTL and fdAT */
    uint8_t *rows;     /* of a picture, each behind its filter */
    uint8_t *packed;   /* [room], behind the four bytes of a sequence number */
    int64_t room;
};

static void put_u32(uint8_t *at, uint32_t value)
{
    for (int i = 0; i < 4; i++) {
        at[i] = (uint8_t)(value >> (24 - 8 * i));
    }
}

static enum v2v_status write_chunk(struct v2v_apng *apng, const char *type, const uint8_t *data,
                                   int64_t bytes)
{
    uint8_t head[8], tail[4];
    put_u32(head, (uint32_t)bytes);
    memcpy(head + 4, type, 4);
    uLong crc = crc32(0, head + 4, 4);
    crc = bytes > 0 ? crc32(crc, data, (uInt)bytes) : crc;
    put_u32(tail, (uint32_t)crc);
    if (fwrite(head, 1, sizeof head, apng->stream) != sizeof head ||
        fwrite(data, 1, (size_t)bytes, apng->stream) != (size_t)bytes ||
        fwrite(tail, 1, sizeof tail, apng->stream) != sizeof tail) {
        return V2V_FAIL(V2V_E_IO, "%s: %s", apng->temporary, strerror(errno));
    }
    return V2V_OK;
}

enum v2v_status v2v_apng_create(struct v2v_apng **apng, const char *path, int64_t frames,
                                int frames_per_second)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_apng *fresh = NULL;
    *apng = NULL;
    V2V_ASSERT(frames > 0 && frames_per_second > 0);
    V2V_TRY(V2V_ALLOC(fresh, "io.apng", 1));
    fresh->frames = frames;
    fresh->frames_per_second = frames_per_second;
    V2V_TRY(v2v_text_format(fresh->path, sizeof fresh->path, "%s", path));
    V2V_TRY(v2v_file_begin(&fresh->stream, fresh->temporary, path));
    *apng = fresh;
    fresh = NULL;
done:
    v2v_apng_abandon(&fresh);
    return rc;
}

/* The first picture's size is that of all. */
static enum v2v_status begin(struct v2v_apng *apng, const struct v2v_canvas *canvas)
{
    enum v2v_status rc = V2V_OK;
    static const char signature[] = "\x89PNG\r\n\x1a\n";
    uint8_t header[13] = {[8] = 8, [9] = 2}; /* 8 bits of RGB */
    uint8_t control[8] = {0};
    const int64_t bytes = v2v_mem_product(canvas->height, 3 * canvas->width + 1, 1);
    if (bytes < 0 || bytes > INT_MAX / 2 || apng->frames > INT_MAX) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %lld pictures of %lld x %lld pixels cannot be written",
                         apng->path, (long long)apng->frames, (long long)canvas->height,
                         (long long)canvas->width));
    }
    apng->height = canvas->height;
    apng->width = canvas->width;
    apng->room = v2v_deflate_bound(bytes);
    V2V_TRY(V2V_ALLOC(apng->rows, "io.apng", bytes));
    V2V_TRY(V2V_ALLOC(apng->packed, "io.apng", apng->room + 4));
    if (fwrite(signature, 1, 8, apng->stream) != 8) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %s", apng->temporary, strerror(errno)));
    }
    put_u32(header, (uint32_t)canvas->width);
    put_u32(header + 4, (uint32_t)canvas->height);
    put_u32(control, (uint32_t)apng->frames); /* and over and over: 0 */
    V2V_TRY(write_chunk(apng, "IHDR", header, sizeof header));
    V2V_TRY(write_chunk(apng, "acTL", control, sizeof control));
done:
    return rc;
}

/* Each row as differences from the pixels to the left: filter "Sub". */
static void filter_rows(struct v2v_apng *apng, const struct v2v_canvas *canvas)
{
    const int64_t row = 3 * canvas->width;
    for (int64_t y = 0; y < canvas->height; y++) {
        const uint8_t *in = canvas->rgb + y * row;
        uint8_t *out = apng->rows + y * (row + 1);
        *out++ = 1;
        for (int64_t i = 0; i < row; i++) {
            out[i] = (uint8_t)(in[i] - (i >= 3 ? in[i - 3] : 0));
        }
    }
}

enum v2v_status v2v_apng_put(struct v2v_apng *apng, const struct v2v_canvas *canvas)
{
    enum v2v_status rc = V2V_OK;
    uint8_t control[26] = {0};
    int64_t bytes = 0;
    if (apng->put == 0) {
        V2V_TRY(begin(apng, canvas));
    }
    V2V_ASSERT(apng->put < apng->frames && canvas->height == apng->height &&
               canvas->width == apng->width);
    V2V_TRY(V2V_FAULT_POINT("png.write"));
    put_u32(control, apng->sequence++);
    put_u32(control + 4, (uint32_t)apng->width);
    put_u32(control + 8, (uint32_t)apng->height);
    control[21] = 1; /* a delay of 1 / .. */
    control[23] = (uint8_t)apng->frames_per_second;
    V2V_TRY(write_chunk(apng, "fcTL", control, sizeof control));
    filter_rows(apng, canvas);
    bytes = apng->room;
    V2V_TRY(v2v_deflate(apng->packed + 4, &bytes, apng->rows,
                        canvas->height * (3 * canvas->width + 1), LEVEL));
    if (apng->put == 0) { /* what other programs show */
        V2V_TRY(write_chunk(apng, "IDAT", apng->packed + 4, bytes));
    } else {
        put_u32(apng->packed, apng->sequence++);
        V2V_TRY(write_chunk(apng, "fdAT", apng->packed, bytes + 4));
    }
    apng->put++;
done:
    return rc;
}

enum v2v_status v2v_apng_finish(struct v2v_apng **apng)
{
    struct v2v_apng *own = *apng;
    V2V_ASSERT(own->put == own->frames);
    enum v2v_status rc = write_chunk(own, "IEND", own->packed, 0);
    rc = v2v_file_close_and_commit(rc, own->stream, own->temporary, own->path);
    own->stream = NULL;
    v2v_apng_abandon(apng);
    return rc;
}

void v2v_apng_abandon(struct v2v_apng **apng)
{
    struct v2v_apng *own = *apng;
    *apng = NULL;
    if (own == NULL) {
        return;
    }
    if (own->stream != NULL) {
        (void)fclose(own->stream);
        (void)!v2v_file_clear(own->temporary);
    }
    v2v_mem_free(own->packed);
    v2v_mem_free(own->rows);
    v2v_mem_free(own);
}
