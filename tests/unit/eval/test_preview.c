#include "support.h"

#include "v2v3d/eval/preview.h"

#include <math.h>

enum { SLICES = 4, HEIGHT = 9, WIDTH = 7, ZOOM = 3, GAP = 2 };

static int grey_at(const struct v2v_canvas *canvas, int64_t y, int64_t x)
{
    return canvas->rgb[3 * (y * canvas->width + x)];
}

static const struct v2v_preview shape = {
    .slices = SLICES, .height = HEIGHT, .width = WIDTH, .z_zoom = 1, .high = 8.0};

static void one_voxel_shows_in_all_three_projections(void **state)
{
    (void)state;
    float volume[SLICES * HEIGHT * WIDTH] = {0};
    int64_t z = 2, y = 5, x = 1;
    volume[(z * HEIGHT + y) * WIDTH + x] = 7;
    struct v2v_canvas canvas = {0};
    struct v2v_preview preview = shape;
    preview.z_zoom = ZOOM;
    preview.high = 7;
    assert_ok(v2v_preview_draw(&canvas, &preview, volume));
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
    struct v2v_preview preview = shape;
    preview.low = preview.high = NAN;
    assert_ok(v2v_preview_widen(&preview, volume));
    assert_ok(v2v_preview_draw(&canvas, &preview, volume));
    assert_int_equal(grey_at(&canvas, 0, 0), 0);
    v2v_canvas_fini(&canvas);
    volume[0] = 1e-20f;
    preview.low = preview.high = NAN;
    assert_ok(v2v_preview_widen(&preview, volume));
    assert_ok(v2v_preview_draw(&canvas, &preview, volume));
    assert_int_equal(grey_at(&canvas, 0, 0), 255);
    v2v_canvas_fini(&canvas);
}

/* Ten voxels of ten values: the percentile is beyond the last but one. */
static void a_range_whose_low_end_is_given_ends_where_the_volume_does(void **state)
{
    (void)state;
    enum { VALUES = 10 };
    const struct {
        double low, high; /* the end that it gets */
    } ranges[] = {{4.0, 9.0}, {-3.0, 9.0}, {12.0, 12.0}};
    float volume[VALUES];
    for (int i = 0; i < VALUES; i++) {
        volume[i] = (float)i;
    }
    for (size_t i = 0; i < sizeof ranges / sizeof *ranges; i++) {
        struct v2v_preview preview = {.slices = 1,
                                      .height = 1,
                                      .width = VALUES,
                                      .z_zoom = 1,
                                      .low = ranges[i].low,
                                      .high = NAN};
        assert_ok(v2v_preview_widen(&preview, volume));
        assert_true(preview.low == ranges[i].low);
        assert_true(fabs(preview.high - ranges[i].high) < 0.1);
    }
}

static uint32_t colour_at(const struct v2v_canvas *canvas, int64_t y, int64_t x)
{
    const uint8_t *rgb = canvas->rgb + 3 * (y * canvas->width + x);
    return (uint32_t)rgb[0] << 16 | (uint32_t)rgb[1] << 8 | rgb[2];
}

static void the_brightest_voxel_has_the_hue_of_its_depth(void **state)
{
    (void)state;
    struct v2v_canvas canvas = {0};
    struct v2v_preview preview = shape;
    float volume[SLICES * HEIGHT * WIDTH] = {0};
    preview.kind = V2V_PREVIEW_DEPTH;
    for (int64_t z = 0; z < SLICES; z++) {
        volume[(z * HEIGHT + z) * WIDTH] = 8.0f;
        volume[(z * HEIGHT + z) * WIDTH + 1] = 4.0f;
        volume[((SLICES - 1 - z) * HEIGHT + z) * WIDTH + 1] = 3.0f;
    }
    assert_ok(v2v_preview_draw(&canvas, &preview, volume));
    assert_true(canvas.height == HEIGHT && canvas.width > WIDTH);
    for (int64_t z = 0; z < SLICES; z++) {
        assert_int_equal(colour_at(&canvas, z, 0), v2v_preview_hue(z, SLICES, 1.0));
        assert_int_equal(colour_at(&canvas, z, 1), v2v_preview_hue(z, SLICES, 0.5));
    }
    assert_int_equal(colour_at(&canvas, HEIGHT - 1, WIDTH - 1), 0);
    v2v_canvas_fini(&canvas);
}

/* Relative luminance by the sRGB standard; hues that are equally light differ by less than a fifth:
 * OKLab's lightness is fitted to what people see, not to it. */
static void no_depth_is_lighter_than_another(void **state)
{
    (void)state;
    double least = 1.0, most = 0.0;
    for (int64_t z = 0; z < 39; z++) {
        const uint32_t colour = v2v_preview_hue(z, 39, 1.0);
        double light = 0.0;
        for (int i = 0; i < 3; i++) {
            const double part = (double)(colour >> (16 - 8 * i) & 0xff) / 255.0;
            light += (double[]){0.2126, 0.7152, 0.0722}[i] * pow((part + 0.055) / 1.055, 2.4);
        }
        least = fmin(least, light);
        most = fmax(most, light);
        assert_true(z == 0 || colour != v2v_preview_hue(z - 1, 39, 1.0));
    }
    assert_true(most < 1.2 * least);
}

static void a_montage_shows_every_slice_once(void **state)
{
    (void)state;
    struct v2v_canvas canvas = {0};
    struct v2v_preview preview = shape;
    float volume[SLICES * HEIGHT * WIDTH] = {0};
    int counts[256] = {0};
    preview.kind = V2V_PREVIEW_MONTAGE;
    for (int64_t z = 0; z < SLICES; z++) {
        volume[z * HEIGHT * WIDTH + z] = (float)(2 * z + 2);
    }
    assert_ok(v2v_preview_draw(&canvas, &preview, volume));
    for (int64_t i = 0; i < canvas.height * canvas.width; i++) {
        counts[canvas.rgb[3 * i]]++;
    }
    assert_true(counts[64] >= 1 && counts[128] == 1 && counts[191] == 1 && counts[255] == 1);
    v2v_canvas_fini(&canvas);
}

static void a_deep_stack_is_a_montage_of_slices_all_along_it(void **state)
{
    (void)state;
    enum { DEEP = 200, SIDE = 4 };
    struct v2v_canvas canvas = {0};
    const struct v2v_preview preview = {.kind = V2V_PREVIEW_MONTAGE,
                                        .slices = DEEP,
                                        .height = SIDE,
                                        .width = SIDE,
                                        .z_zoom = 1,
                                        .high = 1.0};
    static float volume[DEEP * SIDE * SIDE];
    volume[(DEEP - 200 / 48 - 1) * SIDE * SIDE] = 1.0f; /* the last that is shown: 47 * 200 / 48 */
    assert_ok(v2v_preview_draw(&canvas, &preview, volume));
    assert_int_equal(canvas.height * canvas.width, (6 * 6 - 2) * (8 * 6 - 2));
    int white = 0;
    for (int64_t i = 0; i < canvas.height * canvas.width; i++) {
        white += canvas.rgb[3 * i] == 255;
    }
    assert_int_equal(white, 1);
    v2v_canvas_fini(&canvas);
}

static void one_range_holds_for_all_volumes_that_it_was_widened_by(void **state)
{
    (void)state;
    struct v2v_preview preview = shape;
    float volume[SLICES * HEIGHT * WIDTH] = {0};
    preview.high = 0.0;
    assert_ok(v2v_preview_widen(&preview, volume));
    assert_true(preview.high == 0.0);
    for (int64_t i = 0; i < SLICES * HEIGHT * WIDTH; i++) {
        volume[i] = 5.0f;
    }
    assert_ok(v2v_preview_widen(&preview, volume));
    assert_true(preview.high == 5.0);
    volume[0] = 1e-3f;
    for (int64_t i = 1; i < SLICES * HEIGHT * WIDTH; i++) {
        volume[i] = 2.0f;
    }
    assert_ok(v2v_preview_widen(&preview, volume));
    assert_true(preview.high == 5.0 && preview.low == 0.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_voxel_shows_in_all_three_projections),
        cmocka_unit_test(an_automatic_range_shows_even_one_voxel_and_survives_none),
        cmocka_unit_test(a_range_whose_low_end_is_given_ends_where_the_volume_does),
        cmocka_unit_test(the_brightest_voxel_has_the_hue_of_its_depth),
        cmocka_unit_test(no_depth_is_lighter_than_another),
        cmocka_unit_test(a_montage_shows_every_slice_once),
        cmocka_unit_test(a_deep_stack_is_a_montage_of_slices_all_along_it),
        cmocka_unit_test(one_range_holds_for_all_volumes_that_it_was_widened_by),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
