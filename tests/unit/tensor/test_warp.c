/* Cubic convolution on images that it keeps exactly: polynomials of the second degree. */
#include "support.h"

#include "v2v3d/tensor/warp.h"

#include <math.h>
#include <string.h>

enum { HEIGHT = 23, WIDTH = 31, PIXELS = HEIGHT * WIDTH, EDGE = 4 };

static const double none[V2V_FIELD_TERMS] = {0.0};

/* In the 5 rows and 7 columns at an edge, a quarter of these sides, fields are as inside them. */
enum { MARGIN_Y = 5, MARGIN_X = 7 };

static double place(int i, int margin, int side)
{
    const int inside = i < margin ? margin : i > side - 1 - margin ? side - 1 - margin : i;
    return 2.0 * inside / (side - 1) - 1.0;
}

static double parabola(double y, double x)
{
    return 3.0 + 0.25 * y - 0.5 * x + 0.02 * y * y - 0.03 * x * y + 0.01 * x * x;
}

static void fill(float *image)
{
    for (int i = 0; i < PIXELS; i++) {
        image[i] = (float)parabola(i / WIDTH, i % WIDTH);
    }
}

static void a_parabola_is_taken_from_where_the_field_says(void **state)
{
    (void)state;
    static const double field_y[V2V_FIELD_TERMS] = {0.3, -0.7, 0.4, 0.2, -0.5, 0.1, -0.2, 0.3, 0.4};
    static const double field_x[V2V_FIELD_TERMS] = {-1.1, 0.6, 0.3, -0.4, 0.2,
                                                    -0.3, 0.2, 0.1, -0.1};
    float from[PIXELS], to[PIXELS];
    fill(from);
    for (int sign = -1; sign <= 1; sign += 2) {
        v2v_warp_image(to, from, HEIGHT, WIDTH, field_y, field_x, sign);
        for (int y = EDGE; y < HEIGHT - EDGE; y++) {
            for (int x = EDGE; x < WIDTH - EDGE; x++) {
                const double v = place(y, MARGIN_Y, HEIGHT), u = place(x, MARGIN_X, WIDTH);
                const double dy = 0.3 * u - 0.7 * v + 0.4 * u * u + 0.2 * u * v - 0.5 * v * v +
                                  0.1 * u * u * u - 0.2 * u * u * v + 0.3 * u * v * v +
                                  0.4 * v * v * v;
                const double dx = -1.1 * u + 0.6 * v + 0.3 * u * u - 0.4 * u * v + 0.2 * v * v -
                                  0.3 * u * u * u + 0.2 * u * u * v + 0.1 * u * v * v -
                                  0.1 * v * v * v;
                /* values up to 20: float32's rounding of pixels and of the result */
                assert_true(fabs((double)to[y * WIDTH + x] -
                                 parabola(y + sign * dy, x + sign * dx)) < 8e-6);
            }
        }
    }
}

static void beyond_the_image_its_edge_goes_on(void **state)
{
    (void)state;
    static const double far[V2V_FIELD_TERMS] = {0.0, 500.0, 0.0, 0.0, 0.0};
    float from[PIXELS], to[PIXELS];
    fill(from);
    v2v_warp_image(to, from, HEIGHT, WIDTH, far, none, 1.0);
    for (int x = 0; x < WIDTH; x++) {
        assert_true(to[x] == from[x]);
        assert_true(to[(HEIGHT - 1) * WIDTH + x] == from[(HEIGHT - 1) * WIDTH + x]);
    }
}

static void without_a_field_nothing_changes(void **state)
{
    (void)state;
    float from[PIXELS], to[PIXELS];
    fill(from);
    v2v_warp_image(to, from, HEIGHT, WIDTH, none, none, 1.0);
    assert_memory_equal(to, from, sizeof to);
    v2v_shade_image(to, HEIGHT, WIDTH, none, 1.0);
    assert_memory_equal(to, from, sizeof to);
}

static void shading_is_the_exponential_of_its_field(void **state)
{
    (void)state;
    static const double shading[V2V_FIELD_TERMS] = {0.5, -0.25, 0.125, 1.0, -0.75,
                                                    0.0, 0.25,  0.0,   0.0};
    float image[PIXELS];
    for (int i = 0; i < PIXELS; i++) {
        image[i] = 2.0f;
    }
    v2v_shade_image(image, HEIGHT, WIDTH, shading, -1.0);
    for (int i = 0; i < PIXELS; i++) {
        const double v = place(i / WIDTH, MARGIN_Y, HEIGHT), u = place(i % WIDTH, MARGIN_X, WIDTH);
        const double sum =
            0.5 * u - 0.25 * v + 0.125 * u * u + u * v - 0.75 * v * v + 0.25 * u * u * v;
        assert_true(fabs((double)image[i] / (2.0 * exp(-sum)) - 1.0) < 1e-6);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_parabola_is_taken_from_where_the_field_says),
        cmocka_unit_test(beyond_the_image_its_edge_goes_on),
        cmocka_unit_test(without_a_field_nothing_changes),
        cmocka_unit_test(shading_is_the_exponential_of_its_field),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
