/* An animated PNG: libpng reads its first picture; each other one, put in its place, as well. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/io/apng.h"
#include "v2v3d/io/file.h"

#include <png.h>
#include <stdio.h>
#include <string.h>
#include <zlib.h>

enum { FRAMES = 3, HEIGHT = 5, WIDTH = 7, MOST_BYTES = 1 << 14, SIGNATURE = 8 };

static char path[512];
static uint8_t content[MOST_BYTES];
static size_t size;

static void draw(struct v2v_canvas *canvas, int frame)
{
    assert_ok(v2v_canvas_init(canvas, HEIGHT, WIDTH));
    for (int i = 0; i < HEIGHT * WIDTH * 3; i++) {
        canvas->rgb[i] = (uint8_t)(i * i * 31 + frame * 77);
    }
}

static void write_film(void)
{
    struct v2v_apng *apng = NULL;
    snprintf(path, sizeof path, "%s/film.png", test_folder(NULL));
    assert_ok(v2v_apng_create(&apng, path, FRAMES, 8));
    for (int t = 0; t < FRAMES; t++) {
        struct v2v_canvas canvas;
        draw(&canvas, t);
        assert_ok(v2v_apng_put(apng, &canvas));
        v2v_canvas_fini(&canvas);
        assert_false(v2v_file_exists(path));
    }
    assert_ok(v2v_apng_finish(&apng));
    assert_null(apng);
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    size = fread(content, 1, sizeof content, file);
    assert_int_equal(fclose(file), 0);
    assert_true(size > 0 && size < sizeof content);
}

static uint32_t u32(const uint8_t *at)
{
    return (uint32_t)at[0] << 24 | (uint32_t)at[1] << 16 | (uint32_t)at[2] << 8 | at[3];
}

/* Chunk `nth` (from 0) of a type, whose check sum holds: its data; NULL: there are fewer. */
static const uint8_t *find(const char *type, int nth, uint32_t *bytes)
{
    for (size_t at = SIGNATURE; at < size; at += 12 + *bytes) {
        const uint8_t *chunk = content + at;
        *bytes = u32(chunk);
        assert_true(at + 12 + *bytes <= size);
        assert_int_equal(u32(chunk + 8 + *bytes), crc32(0, chunk + 4, 4 + *bytes));
        if (memcmp(chunk + 4, type, 4) == 0 && nth-- == 0) {
            return chunk + 8;
        }
    }
    return NULL;
}

static void assert_picture(const void *png, size_t bytes, int frame)
{
    struct v2v_canvas canvas;
    uint8_t found[HEIGHT * WIDTH * 3];
    png_image image = {.version = PNG_IMAGE_VERSION};
    draw(&canvas, frame);
    assert_true(png_image_begin_read_from_memory(&image, png, bytes));
    assert_true(image.height == HEIGHT && image.width == WIDTH && image.format == PNG_FORMAT_RGB);
    assert_true(png_image_finish_read(&image, NULL, found, 0, NULL));
    assert_memory_equal(found, canvas.rgb, sizeof found);
    v2v_canvas_fini(&canvas);
}

static uint8_t *add_chunk(uint8_t *to, const char *type, const uint8_t *data, uint32_t bytes)
{
    for (int i = 0; i < 4; i++) {
        to[i] = (uint8_t)(bytes >> (24 - 8 * i));
    }
    memcpy(to + 4, type, 4);
    memcpy(to + 8, data, bytes);
    const uLong crc = crc32(0, to + 4, 4 + bytes);
    for (int i = 0; i < 4; i++) {
        to[8 + bytes + i] = (uint8_t)(crc >> (24 - 8 * i));
    }
    return to + 12 + bytes;
}

static void every_picture_comes_back(void **state)
{
    (void)state;
    uint32_t bytes = 0, header_bytes = 0;
    write_film();
    assert_picture(content, size, 0);
    for (int t = 1; t < FRAMES; t++) {
        static uint8_t alone[MOST_BYTES];
        const uint8_t *header = find("IHDR", 0, &header_bytes), *data = find("fdAT", t - 1, &bytes);
        assert_non_null(data);
        memcpy(alone, content, SIGNATURE);
        uint8_t *end = add_chunk(alone + SIGNATURE, "IHDR", header, header_bytes);
        end = add_chunk(end, "IDAT", data + 4, bytes - 4);
        end = add_chunk(end, "IEND", data, 0);
        assert_picture(alone, (size_t)(end - alone), t);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void chunks_say_how_it_is_played(void **state)
{
    (void)state;
    uint32_t bytes = 0;
    write_film();
    const uint8_t *control = find("acTL", 0, &bytes);
    assert_true(bytes == 8 && u32(control) == FRAMES && u32(control + 4) == 0);
    for (int t = 0; t < FRAMES; t++) {
        control = find("fcTL", t, &bytes);
        assert_true(control != NULL && bytes == 26);
        /* fcTL, IDAT, fcTL, fdAT, fcTL, fdAT: only IDAT has no number */
        assert_int_equal(u32(control), t == 0 ? 0 : 2 * t - 1);
        assert_true(u32(control + 4) == WIDTH && u32(control + 8) == HEIGHT);
        assert_true(control[21] == 1 && control[23] == 8);
        if (t > 0) {
            assert_int_equal(u32(find("fdAT", t - 1, &bytes)), 2 * t);
        }
    }
    assert_null(find("fdAT", FRAMES - 1, &bytes));
    assert_null(find("fcTL", FRAMES, &bytes));
}

static void an_unfinished_film_does_not_appear(void **state)
{
    (void)state;
    struct v2v_apng *apng = NULL;
    struct v2v_canvas canvas;
    char temporary[V2V_PATH_BYTES];
    snprintf(path, sizeof path, "%s/half.png", test_folder(NULL));
    draw(&canvas, 0);
    assert_ok(v2v_apng_create(&apng, path, 2, 8));
    assert_ok(v2v_apng_put(apng, &canvas));
    v2v_apng_abandon(&apng);
    v2v_canvas_fini(&canvas);
    assert_ok(v2v_file_temporary(temporary, path));
    assert_false(v2v_file_exists(path) || v2v_file_exists(temporary));
    snprintf(path, sizeof path, "%s/no/such.png", test_folder(NULL));
    assert_int_equal(v2v_apng_create(&apng, path, 2, 8), V2V_E_IO);
    assert_null(apng);
    v2v_apng_abandon(&apng);
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_picture_comes_back),
        cmocka_unit_test(chunks_say_how_it_is_played),
        cmocka_unit_test(an_unfinished_film_does_not_appear),
    };
    return cmocka_run_group_tests_name("apng", tests, NULL, NULL);
}
