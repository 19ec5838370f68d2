#include "support.h"

#include "io/font.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/png.h"

#include <math.h>
#include <png.h>
#include <stdio.h>
#include <string.h>

static char folder[256];

static uint32_t pixel(const struct v2v_canvas *canvas, int64_t y, int64_t x)
{
    const uint8_t *rgb = canvas->rgb + (y * canvas->width + x) * 3;
    return (uint32_t)rgb[0] << 16 | (uint32_t)rgb[1] << 8 | rgb[2];
}

static int64_t count_pixels(const struct v2v_canvas *canvas, uint32_t rgb)
{
    int64_t count = 0;
    for (int64_t y = 0; y < canvas->height; y++) {
        for (int64_t x = 0; x < canvas->width; x++) {
            count += pixel(canvas, y, x) == rgb;
        }
    }
    return count;
}

static void a_picture_comes_back_from_its_file(void **state)
{
    (void)state;
    char path[512];
    uint8_t pixels[5 * 7 * 3], found[5 * 7 * 3];

    (void)snprintf(path, sizeof path, "%s/picture.png", folder);
    for (size_t i = 0; i < sizeof pixels; i++) {
        pixels[i] = (uint8_t)(i * 53 + 7);
    }
    for (int channels = 1; channels <= 3; channels += 2) {
        png_image image = {.version = PNG_IMAGE_VERSION};
        assert_ok(v2v_png_write(path, pixels, 5, 7, channels));
        assert_true(png_image_begin_read_from_file(&image, path));
        assert_int_equal(image.height, 5);
        assert_int_equal(image.width, 7);
        assert_int_equal(image.format, channels == 1 ? PNG_FORMAT_GRAY : PNG_FORMAT_RGB);
        assert_true(png_image_finish_read(&image, NULL, found, 0, NULL));
        assert_memory_equal(found, pixels, (size_t)(5 * 7 * channels));
    }
}

static void a_picture_that_cannot_be_written_is_an_io_error(void **state)
{
    (void)state;
    char path[512];
    const uint8_t pixels[3] = {0};

    (void)snprintf(path, sizeof path, "%s/no/such.png", folder);
    assert_int_equal(v2v_png_write(path, pixels, 1, 1, 1), V2V_E_IO);
    assert_non_null(strstr(v2v_status_message(), path));
    (void)snprintf(path, sizeof path, "%s/empty.png", folder);
    assert_int_equal(v2v_png_write(path, pixels, 0, 1, 1), V2V_E_IO);
    assert_int_equal(v2v_png_write(path, pixels, 1, 1, 2), V2V_E_IO);
    /* libpng takes no more than a million columns. */
    assert_int_equal(v2v_png_write(path, pixels, 1, INT32_MAX, 1), V2V_E_IO);
    assert_false(v2v_file_exists(path));
}

static void an_image_is_mapped_to_grey_and_clipped(void **state)
{
    (void)state;
    struct v2v_canvas canvas;
    const float image[] = {0, 1, 2, 3, -5, NAN};

    assert_ok(v2v_canvas_init(&canvas, 4, 6));
    v2v_canvas_image(&canvas, 0, 0, image, 2, 3, 1, 2, 2);
    assert_int_equal(pixel(&canvas, 0, 0), 0);
    assert_int_equal(pixel(&canvas, 1, 5), 0xffffff);
    assert_int_equal(pixel(&canvas, 2, 1), 0xffffff);
    assert_int_equal(pixel(&canvas, 3, 3), 0);
    assert_int_equal(pixel(&canvas, 3, 5), 0);
    assert_int_equal(count_pixels(&canvas, 0xffffff), 2 * 4);
    v2v_canvas_image(&canvas, -3, 5, image, 2, 3, 0, 6, 3);
    /* 0 .. 6 maps 3 to the middle: 127.5, rounded up. */
    assert_int_equal(pixel(&canvas, 0, 5), 0x808080);
    v2v_canvas_fini(&canvas);
    assert_int_equal(v2v_mem_held(), 0);
    assert_int_equal(v2v_canvas_init(&canvas, INT64_MAX / 2, 6), V2V_E_MEMORY);
}

static void a_rectangle_is_clipped_to_the_canvas(void **state)
{
    (void)state;
    struct v2v_canvas canvas;
    assert_ok(v2v_canvas_init(&canvas, 9, 9));
    v2v_canvas_fill(&canvas, 2, 3, 4, 2, 0x123456);
    assert_int_equal(pixel(&canvas, 2, 3), 0x123456);
    assert_int_equal(pixel(&canvas, 5, 4), 0x123456);
    assert_int_equal(count_pixels(&canvas, 0x123456), 4 * 2);
    v2v_canvas_fill(&canvas, -3, 7, 5, 9, 0xff);
    assert_int_equal(count_pixels(&canvas, 0xff), 2 * 2);
    v2v_canvas_fini(&canvas);
}

static void text_is_drawn_in_cells_of_six_columns(void **state)
{
    (void)state;
    struct v2v_canvas canvas;

    assert_ok(v2v_canvas_init(&canvas, 14, 40));
    v2v_canvas_text(&canvas, 0, 0, "- |", 2, 0x00ff00);
    /* '-' is five pixels of 2 x 2, '|' seven. */
    assert_int_equal(count_pixels(&canvas, 0x00ff00), (5 + 7) * 4);
    assert_int_equal(pixel(&canvas, 6, 9), 0x00ff00);
    assert_int_equal(pixel(&canvas, 13, 2 * 6 * 2 + 4), 0x00ff00);
    v2v_canvas_text(&canvas, -3, 35, "clipped", 3, 0xff0000);
    v2v_canvas_fini(&canvas);
}

static void every_character_has_a_picture_of_its_own(void **state)
{
    (void)state;
    for (char a = ' '; a <= '~'; a++) {
        for (char b = (char)(a + 1); b <= '~'; b++) {
            assert_memory_not_equal(v2v_font_glyph(a), v2v_font_glyph(b), V2V_FONT_ROWS);
        }
    }
    assert_ptr_equal(v2v_font_glyph('\n'), v2v_font_glyph('?'));
    assert_ptr_equal(v2v_font_glyph((char)0xe9), v2v_font_glyph('?'));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_picture_comes_back_from_its_file),
        cmocka_unit_test(a_picture_that_cannot_be_written_is_an_io_error),
        cmocka_unit_test(an_image_is_mapped_to_grey_and_clipped),
        cmocka_unit_test(a_rectangle_is_clipped_to_the_canvas),
        cmocka_unit_test(text_is_drawn_in_cells_of_six_columns),
        cmocka_unit_test(every_character_has_a_picture_of_its_own),
    };
    (void)snprintf(folder, sizeof folder, "%s", test_folder(NULL));
    return cmocka_run_group_tests_name("io.png", tests, NULL, NULL);
}
