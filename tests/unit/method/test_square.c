/* Where a frame varies most. */
#include "method/square.h"

#include "support.h"
#include "v2v3d/base/random.h"
#include "v2v3d/tensor/blind.h"

#include <math.h>

enum { HEIGHT = 150, WIDTH = 190 };

static float image[HEIGHT * WIDTH];

static double variation_of(const struct v2v_square *square)
{
    const double count = (double)(square->rows.count * square->columns.count);
    double sum = 0.0, squares = 0.0;
    for (int64_t y = square->rows.first; y < square->rows.first + square->rows.count; y++) {
        for (int64_t x = 0; x < square->columns.count; x++) {
            const double p = (double)image[y * WIDTH + square->columns.first + x];
            sum += p;
            squares += p * p;
        }
    }
    return squares - sum * sum / count;
}

/* Of every 16th row and column of a part of the image. */
static void assert_best(struct v2v_part rows, struct v2v_part columns, int64_t side)
{
    const struct v2v_square best = v2v_square_find(image, WIDTH, rows, columns, side);
    const int64_t high = best.rows.count, wide = best.columns.count;
    assert_int_equal(high, side < rows.count ? side : rows.count);
    assert_int_equal(wide, side < columns.count ? side : columns.count);
    assert_int_equal((best.rows.first - rows.first) % 16, 0);
    assert_int_equal((best.columns.first - columns.first) % 16, 0);
    for (int64_t top = rows.first; top + high <= rows.first + rows.count; top += 16) {
        for (int64_t left = columns.first; left + wide <= columns.first + columns.count;
             left += 16) {
            const struct v2v_square other = {{top, high}, {left, wide}};
            assert_true(variation_of(&best) >= variation_of(&other));
        }
    }
}

static void no_other_square_varies_more(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= 20; seed++) {
        for (int64_t i = 0; i < HEIGHT * WIDTH; i++) {
            image[i] = (float)v2v_random_normal(seed, 0, (uint64_t)i);
        }
        const int64_t spot = (int64_t)v2v_random_below(seed, 1, 0, HEIGHT * WIDTH);
        image[spot] = 30.0f;
        assert_best((struct v2v_part){0, HEIGHT}, (struct v2v_part){0, WIDTH}, 48);
        assert_best((struct v2v_part){7, 130}, (struct v2v_part){21, 160}, 100);
        assert_best((struct v2v_part){7, 12}, (struct v2v_part){21, 160}, 100);
        assert_best((struct v2v_part){HEIGHT - 5, 5}, (struct v2v_part){WIDTH - 3, 3}, 100);
    }
}

/* Two views of noise 1 about an even light, but for `light` in all columns below `columns`. */
static void assert_judged_from(int64_t edge, float light, int64_t columns)
{
    enum { VIEWS = 2, SIDE = 100 };
    static float views[VIEWS * SIDE * SIDE];
    const struct v2v_psf_file psf = {.views = VIEWS};
    const struct v2v_problem problem = {.psf = &psf, .height = SIDE, .width = SIDE};
    struct v2v_square_views square;
    for (int64_t i = 0; i < VIEWS * SIDE * SIDE; i++) {
        views[i] =
            (float)v2v_random_normal(3, 1, (uint64_t)i) + (i % SIDE < columns ? light : 0.0f);
    }
    assert_ok(v2v_square_views_init(&square, &problem, views, NULL, SIDE));
    assert_int_equal(square.judged.rows.first, edge);
    assert_int_equal(square.judged.rows.count, SIDE - 2 * edge);
    assert_int_equal(square.judged.columns.first, edge);
    assert_int_equal(square.judged.columns.count, SIDE - 2 * edge);
    v2v_square_views_fini(&square);
}

static void what_is_judged_holds_light(void **state)
{
    (void)state;
    assert_judged_from(24, 5.0f, 100); /* its share */
    assert_judged_from(24, 5.0f, 45);  /* 21 of 45 columns where the square has 52 of 100 */
    assert_judged_from(8, 5.0f, 30);   /* 6 of 30: the noise inside counts as none */
    assert_judged_from(8, 5.0f, 20);
    assert_judged_from(8, 2.0f, 15); /* none of 15: there is noise alone inside */
}

/* Of three views the first is all blind; the second has a spot. */
static void the_square_is_where_a_view_that_sees_varies_most(void **state)
{
    (void)state;
    enum { VIEWS = 3, PIXELS = HEIGHT * WIDTH, SIDE = 48, Y = 100, X = 150 };
    static float views[VIEWS * PIXELS], frames[VIEWS * PIXELS];
    const struct v2v_psf_file psf = {.views = VIEWS};
    const struct v2v_problem problem = {.psf = &psf, .height = HEIGHT, .width = WIDTH};
    const struct v2v_averaging averaging = {.frames = frames};
    struct v2v_square_views square;
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] = i < PIXELS ? V2V_BLIND : (float)v2v_random_normal(5, 1, (uint64_t)i);
        frames[i] = (float)i;
    }
    views[PIXELS + Y * WIDTH + X] = 100.0f;
    assert_ok(v2v_square_views_init(&square, &problem, views, &averaging, SIDE));
    float most = 0.0f;
    int64_t at = -1;
    for (int64_t i = SIDE * SIDE; i < 2 * SIDE * SIDE; i++) {
        at = square.views[i] > most ? i : at;
        most = fmaxf(most, square.views[i]);
    }
    assert_true(most == 100.0f);
    assert_true(v2v_square_averaging(&square)->frames[at] == (float)(PIXELS + Y * WIDTH + X));
    v2v_square_views_fini(&square);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_other_square_varies_more),
        cmocka_unit_test(what_is_judged_holds_light),
        cmocka_unit_test(the_square_is_where_a_view_that_sees_varies_most),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
