#include "support.h"

#include "v2v3d/eval/preview.h"

enum { SLICES = 4, HEIGHT = 9, WIDTH = 7, ZOOM = 3, GAP = 2 };

static int grey_at(const struct v2v_canvas *canvas, int64_t y, int64_t x)
{
    return canvas->rgb[3 * (y * canvas->width + x)];
}

static void one_voxel_shows_in_all_three_projections(void **state)
{
    (void)state;
    float volume[SLICES * HEIGHT * WIDTH] = {0};
    int64_t z = 2, y = 5, x = 1;
    volume[(z * HEIGHT + y) * WIDTH + x] = 7;
    struct v2v_canvas canvas = {0};
    assert_ok(v2v_preview_volume(&canvas, volume, SLICES, HEIGHT, WIDTH, ZOOM, 0, 7));
    assert_int_equal(canvas.height, HEIGHT + GAP + SLICES * ZOOM);
    assert_int_equal(canvas.width, WIDTH + GAP + SLICES * ZOOM);
    int64_t white = 0;
    for (int64_t i = 0; i < canvas.height * canvas.width; i++) {
        white += canvas.rgb[3 * i] == 255;
    }
    assert_int_equal(white, 1 + ZOOM + ZOOM);
    assert_int_equal(grey_at(&canvas, y, x), 255);
    for (int64_t k = 0; k < ZOOM; k++) {
        assert_int_equal(grey_at(&canvas, y, WIDTH + GAP + z * ZOOM + k), 255);
        assert_int_equal(grey_at(&canvas, HEIGHT + GAP + z * ZOOM + k, x), 255);
    }
    v2v_canvas_fini(&canvas);
}

static void an_automatic_range_shows_even_one_voxel_and_survives_none(void **state)
{
    (void)state;
    float volume[SLICES * HEIGHT * WIDTH] = {0};
    struct v2v_canvas canvas = {0};
    assert_ok(v2v_preview_volume(&canvas, volume, SLICES, HEIGHT, WIDTH, 1, 0, 0));
    assert_int_equal(grey_at(&canvas, 0, 0), 0);
    v2v_canvas_fini(&canvas);
    volume[0] = 1e-20f;
    assert_ok(v2v_preview_volume(&canvas, volume, SLICES, HEIGHT, WIDTH, 1, 0, 0));
    assert_int_equal(grey_at(&canvas, 0, 0), 255);
    v2v_canvas_fini(&canvas);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_voxel_shows_in_all_three_projections),
        cmocka_unit_test(an_automatic_range_shows_even_one_voxel_and_survives_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
