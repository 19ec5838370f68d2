/* How much brighter than another frame what is about a pixel is, against plain loops and against
 * what noise makes of it. */
#include "method/local_brightness.h"
#include "support.h"

#include "v2v3d/base/random.h"

#include <math.h>
#include <string.h>

enum { VIEWS = 2, HEIGHT = 61, WIDTH = 90, SAMPLES = VIEWS * HEIGHT * WIDTH };
enum { SIDE = 4, ROWS = (HEIGHT + SIDE - 1) / SIDE, COLUMNS = (WIDTH + SIDE - 1) / SIDE };
static const double noise = 2.0;

static float frame[SAMPLES], neighbour[SAMPLES], photons[SAMPLES], found[SAMPLES];

/* Light of 40 and more; from row 30 on it is `part` times as bright in the frame. */
static void make(double scale, double part, uint64_t seed)
{
    for (int64_t i = 0; i < SAMPLES; i++) {
        const double y = (double)(i / WIDTH % HEIGHT), x = (double)(i % WIDTH);
        const double light = 40.0 + 25.0 * (1.0 + sin(x / 5.0) * cos(y / 4.0));
        frame[i] = (float)((y < 30.0 ? 1.0 : part) * light +
                           noise * v2v_random_normal(seed, 1, (uint64_t)i));
        neighbour[i] = (float)(light / scale + noise * v2v_random_normal(seed, 2, (uint64_t)i));
        photons[i] = 0.0f;
    }
}

static void find_with(double factor, double unit, double even)
{
    struct v2v_local_brightness *local = NULL;
    assert_ok(v2v_local_brightness_create(&local, VIEWS, HEIGHT, WIDTH));
    v2v_local_brightness_begin(local, frame, photons, unit, even);
    v2v_local_brightness_find(local, found, neighbour, factor);
    v2v_local_brightness_destroy(&local);
}

static void find(double factor)
{
    find_with(factor, noise * noise, 1.0);
}

/* ---- the twin ---- */

static double mean_of_square(const float *view, int row, int column)
{
    double sum = 0.0, count = 0.0;
    for (int y = row * SIDE; y < HEIGHT && y < (row + 1) * SIDE; y++) {
        for (int x = column * SIDE; x < WIDTH && x < (column + 1) * SIDE; x++) {
            sum += (double)view[y * WIDTH + x];
            count += 1.0;
        }
    }
    return sum / count;
}

static int within(int i, int count)
{
    return i < 0 ? 0 : i < count ? i : count - 1;
}

/* Over 3 x 3 squares, edges repeated. */
static void smooth(double *image)
{
    static double from[ROWS * COLUMNS];
    memcpy(from, image, sizeof from);
    for (int i = 0; i < ROWS * COLUMNS; i++) {
        image[i] = 0.0;
        for (int k = 0; k < 9; k++) {
            const int y = within(i / COLUMNS + k / 3 - 1, ROWS);
            image[i] += from[y * COLUMNS + within(i % COLUMNS + k % 3 - 1, COLUMNS)] / 9.0;
        }
    }
}

/* Factors of the squares of a view, as REFERENCE.md 12 has them, of noise that is even. */
static void factors_of(double *factor, const float *t, const float *u, double f)
{
    static double light[ROWS * COLUMNS], product[ROWS * COLUMNS];
    const double of_b = noise * noise / 16.0, count = pow(3.0 * 27.0 / 19.0, 2.0);
    const double over = (1.0 + f * f) * of_b;
    for (int i = 0; i < ROWS * COLUMNS; i++) {
        const double a = mean_of_square(t, i / COLUMNS, i % COLUMNS);
        const double b = mean_of_square(u, i / COLUMNS, i % COLUMNS);
        light[i] = (pow(fmax(b, 0.0), 2.0) - of_b) / over;
        product[i] = (fmax(b, 0.0) * (a - f * b) + f * of_b) / over;
    }
    for (int pass = 0; pass < 2; pass++) {
        smooth(light);
        smooth(product);
    }
    for (int i = 0; i < ROWS * COLUMNS; i++) {
        const double drawn = (light[i] + of_b / over) / light[i] / (f * f), p = count * product[i];
        const double more = light[i] > 0.0 ? p / (count * light[i] + drawn) : 0.0;
        const double by_noise = p * more > 0.0 ? fmin(3.0 / (p * more), 1.0) : 1.0;
        factor[i] = fmin(fmax(f + (1.0 - by_noise) * more, f / 4.0), 4.0 * f);
    }
}

static double between(const double *factor, int y, int x)
{
    const double row = fmin(fmax((y + 0.5) / SIDE - 0.5, 0.0), ROWS - 1.0);
    const double column = fmin(fmax((x + 0.5) / SIDE - 0.5, 0.0), COLUMNS - 1.0);
    const int top = (int)row, left = (int)column;
    const double *above = factor + top * COLUMNS, *below = factor + within(top + 1, ROWS) * COLUMNS;
    const int right = within(left + 1, COLUMNS);
    const double down = row - top, over = column - left;
    return (1.0 - down) * ((1.0 - over) * above[left] + over * above[right]) +
           down * ((1.0 - over) * below[left] + over * below[right]);
}

/* A factor goes by p / l, and by 3 / p^2 of what l is: light of 40 to 90 and its noise of 2 to
 * test_rounding of what sums to them, 16 samples, squares and 4 lines of 3. */
static void factors_match_plain_loops(void **state)
{
    (void)state;
    static double factor[ROWS * COLUMNS];
    static const double parts[] = {1.0, 0.3, 2.0, 30.0};
    for (uint64_t k = 0; k < 4; k++) {
        double most = 0.0;
        make(1.25, parts[k], k);
        find(1.25);
        for (int v = 0; v < VIEWS; v++) {
            factors_of(factor, frame + v * HEIGHT * WIDTH, neighbour + v * HEIGHT * WIDTH, 1.25);
            for (int i = 0; i < HEIGHT * WIDTH; i++) {
                const double twin = between(factor, i / WIDTH, i % WIDTH);
                most = fmax(most, fabs((double)found[v * HEIGHT * WIDTH + i] / twin - 1.0));
            }
        }
        print_message("%g times: off by %.2g\n", parts[k], most);
        assert_true(most < 10.0 * test_rounding(16 + 4 * 3));
    }
}

/* ---- statistics ---- */

/* Of a scene that stands still chi^2 is above 3 in 8 of 100 squares, and what is beyond it little:
 * least squares scatter by the noise over the light, 0.5 of 60 in a square, of 18 squares. */
static void noise_moves_little(void **state)
{
    (void)state;
    double squares = 0.0;
    make(1.0, 1.0, 9);
    find(1.0);
    for (int64_t i = 0; i < SAMPLES; i++) {
        squares += pow((double)found[i] - 1.0, 2.0) / SAMPLES;
    }
    const double scatter = noise / SIDE * sqrt(2.0) / 65.0 / sqrt(18.0);
    print_message("%.3g of %.3g\n", sqrt(squares), scatter);
    assert_true(sqrt(squares) < 0.4 * scatter);
}

/* Half of the frame flashes: it is found, but within ten pixels of where it begins. */
static void what_flashes_is_found(void **state)
{
    (void)state;
    make(1.0, 2.0, 5);
    find(1.0);
    for (int64_t i = 0; i < SAMPLES; i++) {
        const int64_t y = i / WIDTH % HEIGHT;
        if (y < 20 || y >= 40) {
            assert_true(fabs((double)found[i] - (y < 30 ? 1.0 : 2.0)) < 0.06);
        }
    }
}

/* Without light there is nothing to be brighter; below 0 there is none either. */
static void the_dark_has_the_factor_of_all(void **state)
{
    (void)state;
    for (int64_t i = 0; i < SAMPLES; i++) {
        frame[i] =
            (float)(noise * v2v_random_normal(3, 1, (uint64_t)i)) - (i < SAMPLES / 2 ? 0 : 50);
        neighbour[i] =
            (float)(noise * v2v_random_normal(3, 2, (uint64_t)i)) - (i < SAMPLES / 2 ? 0 : 20);
        photons[i] = 0.0f;
    }
    find(1.5);
    double squares = 0.0;
    for (int64_t i = 0; i < SAMPLES; i++) {
        assert_true(i < SAMPLES / 2 || found[i] == 1.5f);
        squares += pow((double)found[i] - 1.5, 2.0) / SAMPLES;
    }
    /* noise alone passes 3 in 8 of 100 squares, and moves a factor by what is expected at most */
    print_message("%.3g\n", sqrt(squares));
    assert_true(sqrt(squares) < sqrt(0.08) * 1.5);
}

/* Where photons are all the noise there is, squares without one have none, and say nothing of
 * others. */
static void squares_without_a_photon_leave_others_alone(void **state)
{
    (void)state;
    for (int64_t i = 0; i < SAMPLES; i++) {
        const int64_t y = i / WIDTH % HEIGHT, x = i % WIDTH;
        const double light = x < 40 ? 0.0 : 100.0;
        neighbour[i] = (float)(x < 40 && i % 50 == 0 ? 1.0 : light);
        photons[i] = frame[i] = (float)(y < 30 ? light : 2.0 * light);
    }
    find_with(1.0, 1.0, 0.0);
    for (int64_t i = 0; i < SAMPLES; i++) {
        const int64_t y = i / WIDTH % HEIGHT, x = i % WIDTH;
        assert_true(isfinite(found[i]));
        if (x >= 50 && (y < 20 || y >= 40)) {
            assert_true(fabs((double)found[i] - (y < 30 ? 1.0 : 2.0)) < 0.06);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(factors_match_plain_loops),
        cmocka_unit_test(noise_moves_little),
        cmocka_unit_test(what_flashes_is_found),
        cmocka_unit_test(the_dark_has_the_factor_of_all),
        cmocka_unit_test(squares_without_a_photon_leave_others_alone),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
