/* Cubic convolution on images that it keeps exactly: polynomials of the second degree. */
#include "support.h"

#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/warp.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { HEIGHT = 23, WIDTH = 31, PIXELS = HEIGHT * WIDTH, EDGE = 4 };

static const double none[V2V_FIELD_TERMS] = {0.0};

/* In the 5 rows and 7 columns at an edge, a quarter of these sides, fields are as inside them. */
enum { MARGIN_Y = 5, MARGIN_X = 7 };

static double place(double i, int margin, int side)
{
    const double inside = i < margin ? margin : i > side - 1 - margin ? side - 1 - margin : i;
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

static double legendre(int n, double t)
{
    const double values[] = {1.0, t, 1.5 * t * t - 0.5, 2.5 * t * t * t - 1.5 * t};
    return values[n];
}

/* Of terms to the third degree, in the order of a field. */
static double field_at(const double *field, double y, double x)
{
    static const int degrees[][2] = {{1, 0}, {0, 1}, {2, 0}, {1, 1}, {0, 2},
                                     {3, 0}, {2, 1}, {1, 2}, {0, 3}}; /* of x, y */
    double sum = 0.0;
    for (int k = 0; k < 9; k++) {
        sum += field[k] * legendre(degrees[k][0], place(x, MARGIN_X, WIDTH)) *
               legendre(degrees[k][1], place(y, MARGIN_Y, HEIGHT));
    }
    return sum;
}

static const double field_y[V2V_FIELD_TERMS] = {0.3, -0.7, 0.4, 0.2, -0.5, 0.1, -0.2, 0.3, 0.4};
static const double field_x[V2V_FIELD_TERMS] = {-1.1, 0.6, 0.3, -0.4, 0.2, -0.3, 0.2, 0.1, -0.1};

static void a_parabola_is_taken_from_where_the_field_says(void **state)
{
    (void)state;
    float from[PIXELS], to[PIXELS];
    fill(from);
    v2v_warp_image(to, from, HEIGHT, WIDTH, field_y, field_x);
    for (int y = EDGE; y < HEIGHT - EDGE; y++) {
        for (int x = EDGE; x < WIDTH - EDGE; x++) {
            const double dy = field_at(field_y, y, x), dx = field_at(field_x, y, x);
            /* values up to 20: float32's rounding of pixels and of the result */
            assert_true(fabs((double)to[y * WIDTH + x] - parabola(y - dy, x - dx)) < 8e-6);
        }
    }
}

/* Each pixel goes back to where it came from: p - field(p), p found here to the last digit. A
 * displacement changes by less than half a pixel a pixel, so that a last change of 0.001 is at
 * least as far as what is left, and the parabola by less than 2 a pixel. Where fields stop
 * changing, at the margins, they have kinks, which are not looked at. */
static void a_parabola_goes_back_to_where_it_came_from(void **state)
{
    (void)state;
    enum { BEYOND_KINK = 3 };
    float from[PIXELS], to[PIXELS], scratch[2 * PIXELS];
    fill(from);
    v2v_unwarp_image(to, from, scratch, HEIGHT, WIDTH, field_y, field_x);
    for (int y = MARGIN_Y + BEYOND_KINK; y < HEIGHT - MARGIN_Y - BEYOND_KINK; y++) {
        for (int x = MARGIN_X + BEYOND_KINK; x < WIDTH - MARGIN_X - BEYOND_KINK; x++) {
            double at_y = y, at_x = x;
            for (int pass = 0; pass < 100; pass++) {
                const double dy = field_at(field_y, at_y, at_x);
                at_x = x + field_at(field_x, at_y, at_x);
                at_y = y + dy;
            }
            assert_true(fabs(at_y - y) < BEYOND_KINK && fabs(at_x - x) < BEYOND_KINK);
            assert_true(fabs((double)to[y * WIDTH + x] - parabola(at_y, at_x)) < 0.002);
        }
    }
}

static void beyond_the_image_its_edge_goes_on(void **state)
{
    (void)state;
    static const double far[V2V_FIELD_TERMS] = {0.0, -500.0, 0.0, 0.0, 0.0};
    float from[PIXELS], to[PIXELS];
    fill(from);
    v2v_warp_image(to, from, HEIGHT, WIDTH, far, none);
    for (int x = 0; x < WIDTH; x++) {
        assert_true(to[x] == from[x]);
        assert_true(to[(HEIGHT - 1) * WIDTH + x] == from[(HEIGHT - 1) * WIDTH + x]);
    }
}

static void without_a_field_nothing_changes(void **state)
{
    (void)state;
    float from[PIXELS], to[PIXELS], scratch[2 * PIXELS];
    fill(from);
    v2v_warp_image(to, from, HEIGHT, WIDTH, none, none);
    assert_memory_equal(to, from, sizeof to);
    v2v_unwarp_image(to, from, scratch, HEIGHT, WIDTH, none, none);
    assert_memory_equal(to, from, sizeof to);
    v2v_shade_image(to, HEIGHT, WIDTH, none, 1.0);
    assert_memory_equal(to, from, sizeof to);
}

/* What a blind sample has no part in is as without it; what it has a part in is blind. */
static void what_is_made_of_a_blind_sample_is_blind(void **state)
{
    (void)state;
    enum { AT = HEIGHT / 2 * WIDTH + WIDTH / 2 };
    float from[PIXELS], whole[PIXELS], part[PIXELS], other[PIXELS], scratch[2 * PIXELS];
    int64_t blind = 0;
    fill(from);
    v2v_unwarp_image(whole, from, scratch, HEIGHT, WIDTH, field_y, field_x);
    from[AT] += 1.0f;
    v2v_unwarp_image(other, from, scratch, HEIGHT, WIDTH, field_y, field_x);
    from[AT] = V2V_BLIND;
    v2v_unwarp_image(part, from, scratch, HEIGHT, WIDTH, field_y, field_x);
    for (int i = 0; i < PIXELS; i++) {
        blind += part[i] == V2V_BLIND;
        assert_true(part[i] == V2V_BLIND ? whole[i] != other[i] : part[i] == whole[i]);
    }
    assert_in_range(blind, 9, 25); /* 4 x 4, more or less where pixels move apart */
    v2v_shade_image(from, HEIGHT, WIDTH, field_y, -1.0);
    assert_int_equal(v2v_blind_count(from, PIXELS), 1);
    assert_true(from[AT] == V2V_BLIND);
}

/* Each pixel of a row its own way, those that are short none, beyond the image its edge. */
static void a_row_is_taken_from_where_its_pixels_lie(void **state)
{
    (void)state;
    float from[PIXELS], to[WIDTH], way_y[WIDTH], way_x[WIDTH], part[WIDTH];
    const struct v2v_way way = {way_y, way_x, part, 0.3f, -0.2f, 0.1f};
    fill(from);
    for (int x = 0; x < WIDTH; x++) {
        way_y[x] = 0.07f * (float)(x - WIDTH / 2) - 0.3f;
        way_x[x] = -0.05f * (float)(x - WIDTH / 2) + 0.2f;
        part[x] = x < WIDTH / 4 ? 0.5f : 1.0f;
    }
    for (int y = EDGE; y < HEIGHT - EDGE; y++) {
        v2v_warp_row(to, from, HEIGHT, WIDTH, y, &way);
        for (int x = EDGE; x < WIDTH - EDGE; x++) {
            const double far_y = (double)part[x] * ((double)way_y[x] + 0.3);
            const double far_x = (double)part[x] * ((double)way_x[x] - 0.2);
            if (hypot(far_y, far_x) < 0.1) { /* the middle and what is beside it */
                assert_true(to[x] == from[y * WIDTH + x] && abs(x - WIDTH / 2) < 2);
            } else { /* of 16 taps of values up to 20 */
                const double moved = parabola(y + far_y, x + far_x);
                assert_true(fabs((double)to[x] - moved) < test_rounding(16) * 20.0);
            }
        }
    }
    for (int x = 0; x < WIDTH; x++) {
        way_y[x] = 1000.0f;
        way_x[x] = -1000.0f;
    }
    v2v_warp_row(to, from, HEIGHT, WIDTH, 3, &way);
    for (int x = 0; x < WIDTH; x++) {
        assert_true(fabs((double)(to[x] - from[PIXELS - WIDTH])) < test_rounding(16) * 20.0);
    }
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
        const double sum = field_at(shading, i / WIDTH, i % WIDTH);
        assert_true(fabs((double)image[i] / (2.0 * exp(-sum)) - 1.0) < 1e-6);
    }
}

static void the_last_term_is_the_tenth_polynomial_of_y(void **state)
{
    (void)state;
    double shading[V2V_FIELD_TERMS] = {0.0};
    float image[PIXELS];
    shading[V2V_FIELD_TERMS - 1] = 1.0;
    for (int i = 0; i < PIXELS; i++) {
        image[i] = 1.0f;
    }
    v2v_shade_image(image, HEIGHT, WIDTH, shading, 1.0);
    for (int i = 0; i < PIXELS; i++) {
        const double y = place(i / WIDTH, MARGIN_Y, HEIGHT), s = y * y;
        const double p =
            (((((46189 * s - 109395) * s + 90090) * s - 30030) * s + 3465) * s - 63) / 256;
        assert_true(fabs((double)image[i] / exp(p) - 1.0) < 1e-6); /* float32 */
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_parabola_is_taken_from_where_the_field_says),
        cmocka_unit_test(a_parabola_goes_back_to_where_it_came_from),
        cmocka_unit_test(beyond_the_image_its_edge_goes_on),
        cmocka_unit_test(without_a_field_nothing_changes),
        cmocka_unit_test(what_is_made_of_a_blind_sample_is_blind),
        cmocka_unit_test(a_row_is_taken_from_where_its_pixels_lie),
        cmocka_unit_test(shading_is_the_exponential_of_its_field),
        cmocka_unit_test(the_last_term_is_the_tenth_polynomial_of_y),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
