/* Numbers of views against the minimum that they are of, over numbers and volume together, by
 * conjugate gradients and direct sums over the torus in double precision. */
#include "method/least_squares.h"
#include "support.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/pi.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/data_step.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/tensor/blind.h"

#include <math.h>
#include <string.h>

enum { VIEWS = 4, SLICES = 3, KERNEL = 3, HEIGHT = 12, WIDTH = 14, FRAME = HEIGHT * WIDTH };
enum { TERMS = V2V_LEAST_SQUARES_TERMS, NUMBERS = TERMS * VIEWS };
enum { MOST = 24 * 24, UNKNOWNS = NUMBERS + SLICES * MOST, BLIND = 2 * FRAME + 5 * WIDTH + 6 };

static const struct v2v_part rows = {2, 9}, columns = {1, 12};
static const struct v2v_volume_errors known = {.noise = 0.2, .square = 0.5};

static struct v2v_psf_file psf;
static struct v2v_torus torus;
static int64_t pixels; /* of the torus */
static float missed[VIEWS * FRAME], images[NUMBERS * FRAME];
/* both, through the window, on the torus */
static double seen[VIEWS * MOST], shown[NUMBERS * MOST];
static const struct v2v_least_squares_terms gains = {
    .count = 1, .images = images, .is_relative = 1};
static const struct v2v_least_squares_terms both = {.count = TERMS, .images = images};

static double window_of(int64_t i, struct v2v_part part)
{
    const int64_t in = v2v_smaller(i - part.first, part.first + part.count - 1 - i);
    const double rise = (double)(part.count / 8 + 1);
    const double s = sin(0.5 * V2V_PI * fmin(1.0, ((double)in + 0.5) / rise));
    return in < 0 ? 0.0 : s * s;
}

/* PSFs, images of `least` to `least` + 1, and what views are missed by. */
static void draw(float least)
{
    const int64_t taps = VIEWS * SLICES * KERNEL * KERNEL;
    psf =
        (struct v2v_psf_file){.views = VIEWS, .slices = SLICES, .height = KERNEL, .width = KERNEL};
    assert_ok(V2V_ALLOC(psf.data, "test", taps));
    for (int64_t i = 0; i < taps; i++) {
        psf.data[i] = (float)v2v_random_uniform(7, 0, (uint64_t)i);
    }
    v2v_psf_normalize_views(&psf);
    torus = v2v_data_step_torus_of(&psf, HEIGHT, WIDTH);
    pixels = torus.height * torus.width;
    assert_true(pixels <= MOST);
    memset(seen, 0, sizeof seen);
    memset(shown, 0, sizeof shown);
    for (int64_t i = 0; i < NUMBERS * FRAME; i++) {
        const int64_t t = i / FRAME, y = i % FRAME / WIDTH, x = i % WIDTH;
        const int64_t of_view = i % (VIEWS * FRAME), v = t % VIEWS;
        const double part = of_view == BLIND ? 0.0 : window_of(y, rows) * window_of(x, columns);
        const int64_t at = (t * torus.height + y) * torus.width + x;
        images[i] = least + (float)v2v_random_uniform(7, 1, (uint64_t)i);
        shown[at] = part * images[i];
        if (t < VIEWS) {
            missed[i] = (0.1f * (float)v - 0.2f) * images[i] +
                        0.2f * (float)v2v_random_normal(7, 2, (uint64_t)i);
            seen[at] = part * missed[i];
            missed[i] = i == BLIND ? V2V_BLIND : missed[i];
        }
    }
}

/* to += A from, or its adjoint. */
static void project(double *to, const double *from, int is_adjoint)
{
    for (int64_t i = 0; i < VIEWS * SLICES * KERNEL * KERNEL; i++) {
        const int64_t v = i / (SLICES * KERNEL * KERNEL), z = i / (KERNEL * KERNEL) % SLICES;
        const int64_t dy = i / KERNEL % KERNEL - 1, dx = i % KERNEL - 1;
        for (int64_t p = 0; p < pixels; p++) {
            const int64_t row = (p / torus.width + dy + torus.height) % torus.height;
            const int64_t column = (p % torus.width + dx + torus.width) % torus.width;
            const int64_t there = row * torus.width + column;
            if (is_adjoint) {
                to[z * pixels + p] += (double)psf.data[i] * from[v * pixels + there];
            } else {
                to[v * pixels + there] += (double)psf.data[i] * from[z * pixels + p];
            }
        }
    }
}

static double mean_of_modes(void)
{
    double sum = 0.0;
    for (int64_t z = 0; z < SLICES; z++) {
        for (int64_t p = 0; p < pixels; p++) {
            const double a = sin(V2V_PI * (double)z / (2.0 * SLICES));
            const double b = sin(V2V_PI * (double)(p / torus.width) / (double)torus.height);
            const double c = sin(V2V_PI * (double)(p % torus.width) / (double)torus.width);
            sum += 1.0 / (4e-4 + 4.0 * (a * a + b * b + c * c));
        }
    }
    return sum / (double)(SLICES * pixels);
}

/* to += P x */
static void penalize(double *to, const double *x)
{
    const double unit = known.noise * known.noise * mean_of_modes() / known.square;
    for (int64_t z = 0; z < SLICES; z++) {
        for (int64_t p = 0; p < pixels; p++) {
            const int64_t row = p / torus.width * torus.width, i = z * pixels + p;
            const double beside = x[z * pixels + (p + torus.width) % pixels] +
                                  x[z * pixels + (p - torus.width + pixels) % pixels] +
                                  x[z * pixels + row + (p - row + 1) % torus.width] +
                                  x[z * pixels + row + (p - row - 1 + torus.width) % torus.width];
            const double above = z > 0 ? x[i] - x[i - pixels] : 0.0;
            const double below = z + 1 < SLICES ? x[i] - x[i + pixels] : 0.0;
            to[i] += unit * (4e-4 * x[i] + 4.0 * x[i] - beside + above + below);
        }
    }
}

static double squares_of(int64_t number)
{
    double sum = 0.0;
    for (int64_t i = number * pixels; i < (number + 1) * pixels; i++) {
        sum += shown[i] * shown[i];
    }
    return sum;
}

/* to = the derivatives of 1/2 |views|^2 by volume and by numbers; of gains, times the squares of
 * `shown`, the sum is 0. */
static void go_back(double *to, const double *views, const struct v2v_least_squares_terms *terms)
{
    double along = 0.0, squares = 0.0;
    memset(to, 0, UNKNOWNS * sizeof *to);
    for (int64_t i = 0; i < terms->count * VIEWS; i++) {
        for (int64_t p = 0; p < pixels; p++) {
            to[i] += shown[i * pixels + p] * views[i % VIEWS * pixels + p];
        }
        along += to[i] * squares_of(i);
        squares += squares_of(i) * squares_of(i);
    }
    for (int64_t i = 0; i < (terms->is_relative ? VIEWS : 0); i++) {
        to[i] -= along / squares * squares_of(i);
    }
    project(to + NUMBERS, views, 1);
}

static double dot(const double *a, const double *b)
{
    double sum = 0.0;
    for (int64_t i = 0; i < UNKNOWNS; i++) {
        sum += a[i] * b[i];
    }
    return sum;
}

/* found = the minimum of 1/2 |seen - numbers shown - A x|^2 + 1/2 x^T P x */
static void find(double *found, const struct v2v_least_squares_terms *terms)
{
    static double rest[UNKNOWNS], way[UNKNOWNS], product[UNKNOWNS], views[VIEWS * MOST];
    memset(found, 0, UNKNOWNS * sizeof *found);
    go_back(rest, seen, terms);
    memcpy(way, rest, sizeof way);
    double squares = dot(rest, rest);
    const double first = squares;
    for (int k = 0; k < 5000 && squares > 1e-22 * first; k++) {
        memset(views, 0, sizeof views);
        for (int64_t i = 0; i < terms->count * VIEWS * pixels; i++) {
            views[i % (VIEWS * pixels)] += way[i / pixels] * shown[i];
        }
        project(views, way + NUMBERS, 0);
        go_back(product, views, terms);
        penalize(product + NUMBERS, way + NUMBERS);
        const double step = squares / dot(way, product), before = squares;
        for (int64_t i = 0; i < UNKNOWNS; i++) {
            found[i] += step * way[i];
            rest[i] -= step * product[i];
        }
        squares = dot(rest, rest);
        for (int64_t i = 0; i < UNKNOWNS; i++) {
            way[i] = rest[i] + squares / before * way[i];
        }
    }
    assert_true(squares <= 1e-22 * first);
}

static struct v2v_least_squares *create(void)
{
    struct v2v_least_squares *least_squares;
    assert_ok(v2v_least_squares_create(&least_squares, &psf, HEIGHT, WIDTH, rows, columns,
                                       V2V_SPLIT_SLABS, NULL));
    return least_squares;
}

static void check(const struct v2v_least_squares_terms *terms, float least, double bar)
{
    static double found[UNKNOWNS];
    double numbers[NUMBERS];
    draw(least);
    find(found, terms);
    assert_true(fabs(found[1]) > 0.04);
    struct v2v_least_squares *least_squares = create();
    v2v_least_squares_solve(least_squares, numbers, missed, terms, &known);
    for (int i = 0; i < terms->count * VIEWS; i++) {
        assert_true(fabs(numbers[i] - found[i]) < bar);
    }
    v2v_least_squares_destroy(&least_squares);
    v2v_psf_file_fini(&psf);
    assert_int_equal(v2v_mem_held(), 0);
}

static void numbers_are_those_of_the_minimum(void **state)
{
    (void)state;
    check(&gains, 1.0f, 1e-5);
    check(&both, -0.5f, 1e-4); /* worse conditioned: 3e-5 */
}

/* Gains in proportion to projections are theirs, whatever the noise: one view shows nothing. */
static void a_view_that_shows_nothing_has_none(void **state)
{
    (void)state;
    double gain[VIEWS];
    draw(1.0f);
    const double expected[VIEWS] = {-0.1, 0.0, 0.1 * squares_of(0) / squares_of(2), 0.0};
    for (int64_t i = 0; i < VIEWS * FRAME; i++) {
        images[i] = i / FRAME == 3 ? 0.0f : images[i];
        missed[i] = i == BLIND ? V2V_BLIND : (float)(expected[i / FRAME] * images[i]);
    }
    struct v2v_least_squares *least_squares = create();
    v2v_least_squares_solve(least_squares, gain, missed, &gains, &known);
    for (int v = 0; v < VIEWS; v++) {
        assert_true(fabs(gain[v] - expected[v]) < 1e-5);
    }
    assert_true(gain[3] == 0.0);
    memset(images, 0, sizeof images);
    v2v_least_squares_solve(least_squares, gain, missed, &gains, &known);
    for (int v = 0; v < VIEWS; v++) {
        assert_true(gain[v] == 0.0);
    }
    v2v_least_squares_destroy(&least_squares);
    v2v_psf_file_fini(&psf);
    assert_int_equal(v2v_mem_held(), 0);
}

/* Views of brightness 1 to 9 of a volume that is too dim by a fifth: gains are a twentieth of that
 * at most. Were their sum 0, the dimmest view's would be a third of it. */
static void a_volume_too_dim_is_no_gain(void **state)
{
    (void)state;
    static const float brightness[VIEWS] = {1.0f, 3.0f, 9.0f, 5.0f};
    static double volume[SLICES * MOST], views[VIEWS * MOST];
    double gain[VIEWS];
    draw(1.0f);
    for (int64_t i = 0; i < VIEWS * SLICES * KERNEL * KERNEL; i++) {
        psf.data[i] *= brightness[i / (SLICES * KERNEL * KERNEL)];
    }
    for (int64_t i = 0; i < SLICES * pixels; i++) {
        volume[i] = v2v_random_uniform(7, 3, (uint64_t)i);
    }
    memset(views, 0, sizeof views);
    project(views, volume, 0);
    for (int64_t i = 0; i < VIEWS * FRAME; i++) {
        const int64_t v = i / FRAME, y = i % FRAME / WIDTH, x = i % WIDTH;
        images[i] = (float)views[(v * torus.height + y) * torus.width + x];
        missed[i] = 0.2f * images[i];
    }
    struct v2v_least_squares *least_squares = create();
    v2v_least_squares_solve(least_squares, gain, missed, &gains, &known);
    for (int v = 0; v < VIEWS; v++) {
        assert_true(fabs(gain[v]) < 0.01);
    }
    v2v_least_squares_destroy(&least_squares);
    v2v_psf_file_fini(&psf);
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(numbers_are_those_of_the_minimum),
        cmocka_unit_test(a_view_that_shows_nothing_has_none),
        cmocka_unit_test(a_volume_too_dim_is_no_gain),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
