/* The example of data_step.h: the step is the minimum that it says, by direct sums over a torus in
 * double precision. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/data_step.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

enum { VIEWS = 5, SLICES = 4, KERNEL_HEIGHT = 6, KERNEL_WIDTH = 5, HEIGHT = 15, WIDTH = 22 };
enum { MOST = 40 * 40, SAMPLES = VIEWS * HEIGHT * WIDTH };

static struct v2v_psf_file psf;
static float views[SAMPLES];
static struct v2v_torus torus;
static int64_t pixels; /* of the torus */
static double y[VIEWS * MOST];

static int setup(void **state)
{
    (void)state;
    const int64_t taps = VIEWS * SLICES * KERNEL_HEIGHT * KERNEL_WIDTH;
    psf = (struct v2v_psf_file){
        .views = VIEWS, .slices = SLICES, .height = KERNEL_HEIGHT, .width = KERNEL_WIDTH};
    assert_ok(V2V_ALLOC(psf.data, "test", taps));
    for (int64_t i = 0; i < taps; i++) {
        psf.data[i] = (float)v2v_random_uniform(31, 0, (uint64_t)i);
    }
    v2v_psf_normalize_views(&psf);
    for (int64_t i = 0; i < SAMPLES; i++) {
        views[i] = (float)v2v_random_uniform(31, 1, (uint64_t)i) - 0.3f;
    }
    torus = v2v_data_step_torus_of(&psf, HEIGHT, WIDTH);
    pixels = torus.height * torus.width;
    assert_true(pixels <= MOST);
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    v2v_psf_file_fini(&psf);
    return v2v_mem_held() != 0;
}

/* image += A_vz slice, or its adjoint. */
static void convolve(double *to, const double *from, int64_t v, int64_t z, int is_adjoint)
{
    const float *kernel = psf.data + (v * SLICES + z) * KERNEL_HEIGHT * KERNEL_WIDTH;
    for (int64_t i = 0; i < pixels; i++) {
        for (int64_t k = 0; k < KERNEL_HEIGHT * KERNEL_WIDTH; k++) {
            /* the centre of K pixels is ceil(K/2)-1 */
            const int64_t dy = k / KERNEL_WIDTH - 2, dx = k % KERNEL_WIDTH - 2;
            const int64_t row = (i / torus.width + dy + torus.height) % torus.height;
            const int64_t column = (i % torus.width + dx + torus.width) % torus.width;
            const int64_t there = row * torus.width + column;
            to[is_adjoint ? i : there] += (double)kernel[k] * from[is_adjoint ? there : i];
        }
    }
}

static void project(double *image, const double *volume)
{
    memset(image, 0, (size_t)(VIEWS * pixels) * sizeof *image);
    for (int64_t v = 0; v < VIEWS; v++) {
        for (int64_t z = 0; z < SLICES; z++) {
            convolve(image + v * pixels, volume + z * pixels, v, z, 0);
        }
    }
}

static double at_torus(const double *plane, int64_t row, int64_t column)
{
    return plane[(row + torus.height) % torus.height * torus.width +
                 (column + torus.width) % torus.width];
}

/* (1 2 1; 2 -12 2; 1 2 1) / 4. */
static void bend(double *to, const double *plane)
{
    for (int64_t i = 0; i < pixels; i++) {
        double sum = -16.0 * plane[i];
        for (int64_t k = 0; k < 9; k++) {
            const int64_t dy = k / 3 - 1, dx = k % 3 - 1;
            sum += (double)((2 - dy * dy) * (2 - dx * dx)) *
                   at_torus(plane, i / torus.width + dy, i % torus.width + dx);
        }
        to[i] = sum / 4.0;
    }
}

/* to += P volume, of slice z. */
static void penalize(double *to, const double *volume, int64_t z, const struct v2v_penalty *penalty)
{
    const double *plane = volume + z * pixels;
    static double once[MOST], twice[MOST];
    bend(once, plane);
    bend(twice, once);
    for (int64_t i = 0; i < pixels; i++) {
        const int64_t row = i / torus.width, column = i % torus.width;
        const double around = at_torus(plane, row - 1, column) + at_torus(plane, row + 1, column) +
                              at_torus(plane, row, column - 1) + at_torus(plane, row, column + 1);
        to[i] += penalty->constant * plane[i] + penalty->differences * (4.0 * plane[i] - around) +
                 penalty->curvature * twice[i];
        to[i] += z > 0 ? penalty->depth * (plane[i] - plane[i - pixels]) : 0.0;
        to[i] += z + 1 < SLICES ? penalty->depth * (plane[i] - plane[i + pixels]) : 0.0;
    }
}

/* Its largest number of a frequency. */
static double largest_of(const struct v2v_penalty *penalty)
{
    return penalty->constant + 8.0 * penalty->differences + 4.0 * penalty->depth +
           16.0 * penalty->curvature;
}

/* |A^T (A x - y) + P (x - v) + g| over the lengths of its terms, |A| <= 1: 0 at the minimum, in
 * float32 the round-off of transforms and products. @param g NULL: 0 */
static double gradient_with(const float *x, const float *v, const float *g,
                            const struct v2v_penalty *penalty)
{
    static double volume[SLICES * MOST], image[VIEWS * MOST], gradient[SLICES * MOST],
        from_views[SLICES * MOST], moved[SLICES * MOST];
    double squares = 0.0, whole = 0.0, size = 0.0, start = 0.0, pull = 0.0;
    memset(gradient, 0, sizeof gradient);
    memset(from_views, 0, sizeof from_views);
    for (int64_t i = 0; i < SLICES * pixels; i++) {
        volume[i] = (double)x[i];
        moved[i] = (double)x[i] - (double)v[i];
    }
    project(image, volume);
    for (int64_t i = 0; i < VIEWS * pixels; i++) {
        image[i] -= y[i];
    }
    for (int64_t z = 0; z < SLICES; z++) {
        for (int64_t w = 0; w < VIEWS; w++) {
            convolve(gradient + z * pixels, image + w * pixels, w, z, 1);
            convolve(from_views + z * pixels, y + w * pixels, w, z, 1);
        }
        penalize(gradient + z * pixels, moved, z, penalty);
    }
    for (int64_t i = 0; i < SLICES * pixels; i++) {
        const double of_g = g != NULL ? (double)g[i] : 0.0, sum = gradient[i] + of_g;
        squares += sum * sum;
        pull += of_g * of_g;
        whole += from_views[i] * from_views[i];
        size += (double)x[i] * (double)x[i];
        start += (double)v[i] * (double)v[i];
    }
    return sqrt(squares) / (sqrt(whole) + sqrt(size) + sqrt(pull) +
                            (sqrt(size) + sqrt(start)) * largest_of(penalty));
}

static double gradient_of(const float *x, const float *v, double tau)
{
    return gradient_with(x, v, NULL, &(struct v2v_penalty){.constant = 1.0 / tau});
}

/* y as begin makes it: from the last pixel to the first of the opposite edge in a straight line. */
static void bridge_views(double scale)
{
    for (int64_t i = 0; i < VIEWS * pixels; i++) {
        const int64_t v = i / pixels, row = i % pixels / torus.width, column = i % torus.width;
        const double py =
            fmax(0.0, (double)(row - HEIGHT + 1)) / (double)(torus.height - HEIGHT + 1);
        const double px =
            fmax(0.0, (double)(column - WIDTH + 1)) / (double)(torus.width - WIDTH + 1);
        const int64_t r = row < HEIGHT ? row : HEIGHT - 1, c = column < WIDTH ? column : WIDTH - 1;
        const float *view = views + v * HEIGHT * WIDTH;
        const double left = (1 - py) * (double)view[r * WIDTH + c] + py * (double)view[c];
        const double right = (1 - py) * (double)view[r * WIDTH] + py * (double)view[0];
        y[i] = scale * ((1 - px) * left + px * right);
    }
}

static struct v2v_data_step *make(double tau, double scale)
{
    struct v2v_data_step *step = NULL;
    assert_ok(v2v_data_step_create(&step, &psf, HEIGHT, WIDTH, &torus, V2V_SPLIT_SLABS, NULL));
    v2v_data_step_factor(step, &(struct v2v_penalty){.constant = 1.0 / tau});
    v2v_data_step_begin(step, views, scale);
    bridge_views(scale);
    return step;
}

static void random_volume(float *v)
{
    for (int64_t i = 0; i < SLICES * pixels; i++) {
        v[i] = (float)v2v_random_uniform(31, 2, (uint64_t)i) * 4.0f;
    }
}

/* Of the transforms and products; and of the inverses, rounded to single precision: of the
 * condition of A A^H + 1 / tau, whose largest eigenvalue, at frequency 0 where each view's light is
 * even over the slices, is V / Z. */
static double bound_of(double tau)
{
    return 2e-6 + 0x1p-24 * tau * VIEWS / SLICES;
}

static void the_step_is_the_minimum(void **state)
{
    (void)state;
    static const double taus[] = {0.1, 1.0, 30.0, 1000.0};
    static float v[SLICES * MOST], x[SLICES * MOST];
    for (size_t i = 0; i < sizeof taus / sizeof *taus; i++) {
        for (double scale = 1.0; scale < 1e3; scale *= 50.0) {
            struct v2v_data_step *step = make(taus[i], scale);
            random_volume(v);
            memcpy(x, v, sizeof v);
            v2v_data_step_run(step, x);
            const double gradient = gradient_of(x, v, taus[i]);
            if (!(gradient < bound_of(taus[i]))) {
                fail_msg("tau %g, scale %g: gradient %g", taus[i], scale, gradient);
            }
            v2v_data_step_destroy(&step);
        }
    }
}

static const struct v2v_penalty penalties[] = {
    {0.02, 0.0, 0.0, 0.0},   {0.01, 0.05, 0.0, 0.0},  {0.02, 0.0, 0.0, 0.03},
    {0.02, 0.05, 0.0, 0.03}, {0.02, 0.05, 0.01, 0.0}, {0.003, 0.04, 0.05, 0.02},
    {0.003, 0.04, 0.0, 0.02}}; /* neighbours differ in one, too */
enum { PENALTIES = sizeof penalties / sizeof *penalties };

static void frequencies_have_penalties_of_their_own(void **state)
{
    (void)state;
    static float v[SLICES * MOST], x[SLICES * MOST];
    struct v2v_data_step *step = make(1.0, 1.0);
    random_volume(v);
    for (int i = 0; i < PENALTIES; i++) {
        v2v_data_step_factor(step, &penalties[i]);
        memcpy(x, v, sizeof v);
        v2v_data_step_run(step, x);
        const double gradient = gradient_with(x, v, NULL, &penalties[i]);
        if (!(gradient < bound_of(1.0 / penalties[i].constant))) {
            fail_msg("penalty %d: gradient %g", i, gradient);
        }
    }
    v2v_data_step_destroy(&step);
}

/* |a - b|^2 of volumes. */
static double distance_of(const float *a, const float *b)
{
    double squares = 0.0;
    for (int64_t i = 0; i < SLICES * pixels; i++) {
        squares += ((double)a[i] - (double)b[i]) * ((double)a[i] - (double)b[i]);
    }
    return squares;
}

/* Three steps from 0, whose volumes are followed here. */
static void steps_advance_to_the_minimum_and_beyond(void **state)
{
    (void)state;
    enum { STEPS = 3 };
    static float g[SLICES * MOST], out[SLICES * MOST], next[SLICES * MOST], x[SLICES * MOST];
    const float relax = 1.7f;
    struct v2v_data_step *step = make(1.0, 1.0);
    for (int i = 0; i < PENALTIES; i++) {
        v2v_data_step_factor(step, &penalties[i]);
        v2v_data_step_clear(step);
        memset(x, 0, sizeof x);
        for (int k = 0; k < STEPS; k++) {
            for (int64_t j = 0; j < SLICES * pixels; j++) {
                g[j] = 0.01f * (float)v2v_random_normal(31, (uint64_t)(4 + k), (uint64_t)j);
            }
            memcpy(out, g, sizeof g);
            v2v_data_step_advance(step, out, relax);
            for (int64_t j = 0; j < SLICES * pixels; j++) {
                next[j] = 0.5f * (out[j] + x[j]);
            }
            assert_true(gradient_with(next, x, g, &penalties[i]) <
                        bound_of(1.0 / penalties[i].constant));
            const double moved =
                sqrt(distance_of(next, x) / v2v_sum_of_squares(next, SLICES * pixels));
            assert_true(fabs(v2v_data_step_change(step) / moved - 1.0) < 1e-4);
            double light = 0.0;
            for (int64_t j = 0; j < SLICES * pixels; j++) {
                x[j] += relax * (next[j] - x[j]);
                light += (double)x[j];
            }
            const double filled = light * light / v2v_sum_of_squares(next, SLICES * pixels) /
                                  (double)(SLICES * pixels);
            assert_true(fabs(v2v_data_step_filled(step) / filled - 1.0) < 1e-4);
            v2v_data_step_volume(step, out);
            assert_true(distance_of(x, out) < 1e-10 * v2v_sum_of_squares(x, SLICES * pixels));
        }
    }
    v2v_data_step_clear(step);
    v2v_data_step_volume(step, out);
    for (int64_t j = 0; j < SLICES * pixels; j++) {
        assert_true(out[j] == 0.0f);
    }
    v2v_data_step_destroy(&step);
}

static int is_within(int64_t i, const struct v2v_part *rows, const struct v2v_part *columns)
{
    const int64_t row = i % pixels / torus.width, column = i % torus.width;
    return row >= rows->first && row < rows->first + rows->count && column >= columns->first &&
           column < columns->first + columns->count;
}

static const struct v2v_part frame_rows = {0, HEIGHT}, frame_columns = {0, WIDTH};

static int is_in_frame(int64_t i)
{
    return is_within(i, &frame_rows, &frame_columns);
}

/* As v2v_data_step_coarse, of what is left [v,torus]. */
static double coarse_of(const double *left, const struct v2v_part *rows,
                        const struct v2v_part *columns)
{
    enum { SIDE = V2V_DATA_STEP_SQUARE };
    double squares = 0.0, count = 0.0;
    for (int64_t v = 0; v < VIEWS; v++) {
        for (int64_t i = 0; i < rows->count / SIDE; i++) {
            for (int64_t j = 0; j < columns->count / SIDE; j++) {
                double sum = 0.0;
                for (int64_t k = 0; k < SIDE * SIDE; k++) {
                    sum += left[v * pixels + (rows->first + i * SIDE + k / SIDE) * torus.width +
                                columns->first + j * SIDE + k % SIDE];
                }
                squares += sum * sum / (SIDE * SIDE);
                count += 1.0;
            }
        }
    }
    assert_true(count > 0.0);
    return sqrt(squares / count);
}

/* The step is the minimum before and after views, known in these rows and columns, are extended. */
static void assert_extended(struct v2v_data_step *step, const float *v, double tau,
                            const struct v2v_part *rows, const struct v2v_part *columns)
{
    static float x[SLICES * MOST];
    static double volume[SLICES * MOST], image[VIEWS * MOST], left[VIEWS * MOST];
    double squares = 0.0;
    memcpy(x, v, sizeof x);
    v2v_data_step_run(step, x);
    assert_true(gradient_of(x, v, tau) < bound_of(tau));
    for (int64_t i = 0; i < SLICES * pixels; i++) {
        volume[i] = (double)x[i];
    }
    project(image, volume);
    for (int64_t i = 0; i < VIEWS * pixels; i++) {
        const int is_known = is_within(i, rows, columns);
        squares += is_known ? (image[i] - y[i]) * (image[i] - y[i]) : 0.0;
        left[i] = y[i] - image[i];
        y[i] = is_known ? y[i] : image[i];
    }
    assert_true(fabs(v2v_data_step_extend(step) / squares - 1.0) < 1e-4);
    assert_true(fabs(v2v_data_step_coarse(step) / coarse_of(left, rows, columns) - 1.0) < 1e-4);
    memcpy(x, v, sizeof x);
    v2v_data_step_run(step, x);
    assert_true(gradient_of(x, v, tau) < bound_of(tau));
}

static void the_border_follows_the_volume(void **state)
{
    (void)state;
    static float v[SLICES * MOST];
    const double tau = 20.0;
    struct v2v_data_step *step = make(tau, 1.0);
    random_volume(v);
    assert_extended(step, v, tau, &frame_rows, &frame_columns);
    v2v_data_step_destroy(&step);
}

/* `around` [v,torus] of seen views less those of a part's light, which y is without. */
static void surround(struct v2v_data_step *step, double *around)
{
    static float light[SLICES * MOST], seen[VIEWS * MOST];
    static double volume[SLICES * MOST];
    random_volume(light);
    for (int64_t i = 0; i < SLICES * pixels; i++) {
        volume[i] = (double)light[i];
    }
    project(around, volume);
    for (int64_t i = 0; i < VIEWS * pixels; i++) {
        seen[i] = 3.0f * (float)v2v_random_uniform(31, 3, (uint64_t)i);
        around[i] = (double)seen[i] - around[i];
        y[i] -= around[i];
    }
    float not_saturated[VIEWS];
    for (int v = 0; v < VIEWS; v++) {
        not_saturated[v] = INFINITY;
    }
    v2v_data_step_surround(step, light, seen, NULL, not_saturated);
}

/* Rounds of a run from v, and extended views; returns what the views missed. */
static double run_and_extend(struct v2v_data_step *step, float *x, const float *v, int rounds)
{
    double squares = 0.0;
    for (int round = 0; round < rounds; round++) {
        memcpy(x, v, (size_t)(SLICES * MOST) * sizeof *x);
        v2v_data_step_run(step, x);
        squares = v2v_data_step_extend(step);
    }
    return squares;
}

/* What begin takes anew has no weights and surroundings any more. @param gain 0: nor shall it have
 * new weights */
static void assert_as_new(struct v2v_data_step *step, const float *v, double tau, double gain,
                          double floor)
{
    static float x[SLICES * MOST], expected[SLICES * MOST];
    struct v2v_data_step *fresh = make(tau, 1.0);
    v2v_data_step_begin(step, views, 1.0);
    if (gain > 0.0) {
        assert_ok(v2v_data_step_take_weights(fresh));
        v2v_data_step_weigh(fresh, gain, floor);
        v2v_data_step_weigh(step, gain, floor);
    }
    (void)run_and_extend(step, x, v, 1);
    memcpy(x, v, sizeof x);
    v2v_data_step_run(step, x);
    (void)run_and_extend(fresh, expected, v, 1);
    memcpy(expected, v, sizeof expected);
    v2v_data_step_run(fresh, expected);
    for (int64_t i = 0; i < SLICES * pixels; i++) {
        assert_true(x[i] == expected[i]);
    }
    v2v_data_step_destroy(&fresh);
}

/* Of a part of a plane: what light around gives is taken off, what is known is told. */
static void a_part_of_a_plane_is_surrounded(void **state)
{
    (void)state;
    static const float dark[SLICES * MOST];
    static double around[VIEWS * MOST];
    static const struct v2v_part rows = {4, 9}, columns = {3, 11};
    const double tau = 20.0;
    struct v2v_data_step *step = make(tau, 1.0);
    surround(step, around);
    v2v_data_step_know(step, &rows, &columns);
    assert_extended(step, dark, tau, &rows, &columns);
    assert_as_new(step, dark, tau, 0.0, 0.0);
    v2v_data_step_destroy(&step);
}

/* Runs from one v and extends in turn end where A^T W (A x - y) + (x - v) / tau = 0, W the weights
 * by the volume itself, with the light around if there is some, and 0 beyond the frame: that is
 * gradient_of for y' = A x + W (y - A x). */
static void assert_weighted(int is_surrounded)
{
    enum { ROUNDS = 300 };
    static float v[SLICES * MOST], x[SLICES * MOST];
    static double volume[SLICES * MOST], image[VIEWS * MOST], recorded[VIEWS * MOST];
    static double around[VIEWS * MOST], left[VIEWS * MOST];
    const double tau = 5.0, gain = 2.0, floor = 0.05; /* weights of 0.2 to 20 */
    double squares = 0.0, even = 0.0;
    struct v2v_data_step *step = make(tau, 1.0);
    assert_ok(v2v_data_step_take_weights(step));
    memset(around, 0, sizeof around);
    if (is_surrounded) {
        surround(step, around);
    }
    v2v_data_step_weigh(step, gain, floor);
    random_volume(v);
    squares = run_and_extend(step, x, v, ROUNDS);
    memcpy(recorded, y, sizeof y);
    for (int64_t i = 0; i < SLICES * pixels; i++) {
        volume[i] = (double)x[i];
    }
    project(image, volume);
    for (int64_t i = 0; i < VIEWS * pixels; i++) {
        const double d = recorded[i] - image[i];
        const double light = fmax(image[i] + around[i], 0.0);
        const double weight = is_in_frame(i) ? 1.0 / (gain * light + floor) : 0.0;
        left[i] = recorded[i] - (light - around[i]);
        squares -= is_in_frame(i) ? d * d : 0.0;
        even += is_in_frame(i) ? d * d : 0.0;
        y[i] = image[i] + weight * d;
    }
    assert_true(fabs(squares) < 1e-4 * even);
    const double coarse = coarse_of(left, &frame_rows, &frame_columns);
    assert_true(fabs(v2v_data_step_coarse(step) / coarse - 1.0) < 1e-4);
    const double gradient = gradient_of(x, v, tau);
    /* round-off as without weights, times the largest of them */
    if (!(gradient < bound_of(tau) / floor)) {
        fail_msg("gradient %g", gradient);
    }
    assert_as_new(step, v, tau, 0.0, floor);
    assert_as_new(step, v, tau, gain, floor);
    v2v_data_step_destroy(&step);
}

static void weights_give_the_minimum_of_weighted_squares(void **state)
{
    (void)state;
    assert_weighted(0);
    assert_weighted(1);
}

/* Two views alike, and a view of a slice that gives no light: A A^H has no inverse, its sum with
 * 1 / tau has. */
static void views_alike_and_dark_slices_are_no_matter(void **state)
{
    (void)state;
    static float v[SLICES * MOST], x[SLICES * MOST];
    const int64_t taps = KERNEL_HEIGHT * KERNEL_WIDTH, view = SLICES * taps;
    const double tau = 1e4;
    memcpy(psf.data + view, psf.data, (size_t)view * sizeof(float));
    memset(psf.data + 2 * view + taps, 0, (size_t)taps * sizeof(float));
    struct v2v_data_step *step = make(tau, 1.0);
    random_volume(v);
    memcpy(x, v, sizeof v);
    v2v_data_step_run(step, x);
    assert_true(gradient_of(x, v, tau) < 1e-4);
    v2v_data_step_destroy(&step);
}

/* Views that end at HIGHEST: two fifths of their samples have it. */
#define HIGHEST 0.3f

static void saturate(void)
{
    for (int64_t i = 0; i < SAMPLES; i++) {
        views[i] = fminf(views[i], HIGHEST);
    }
}

static int is_saturated(int64_t i)
{
    const int64_t v = i / pixels, row = i % pixels / torus.width, column = i % torus.width;
    return is_in_frame(i) && views[(v * HEIGHT + row) * WIDTH + column] == HIGHEST;
}

static void a_saturated_sample_bounds_the_volume_from_below(void **state)
{
    (void)state;
    static float v[SLICES * MOST], x[SLICES * MOST];
    static double image[VIEWS * MOST], volume[SLICES * MOST];
    const double tau = 1.0, scale = 50.0;
    double squares = 0.0;
    int64_t known = 0, above = 0, below = 0;
    saturate();
    struct v2v_data_step *step = make(tau, scale);
    random_volume(v);
    for (int64_t i = 0; i < SLICES * pixels; i++) {
        v[i] *= (float)scale / 4.0f;
    }
    memcpy(x, v, sizeof v);
    v2v_data_step_run(step, x);
    for (int64_t i = 0; i < SLICES * pixels; i++) {
        volume[i] = (double)x[i];
    }
    project(image, volume);
    const double found = v2v_data_step_extend(step);
    for (int64_t i = 0; i < VIEWS * pixels; i++) {
        if (is_saturated(i)) {
            above += image[i] > y[i];
            below += image[i] < y[i];
            y[i] = fmax(y[i], image[i]);
        } else if (is_in_frame(i)) {
            squares += (image[i] - y[i]) * (image[i] - y[i]);
            known++;
        } else {
            y[i] = image[i];
        }
    }
    print_message("%lld above, %lld below\n", (long long)above, (long long)below);
    assert_true(above > 50 && below > 50);
    assert_int_equal(v2v_data_step_known(step), known);
    /* what is left is as long as y, and known to 2e-6 of that (bound_of), its square to 4e-6 */
    assert_true(fabs(found / squares - 1.0) < 1e-4);
    memcpy(x, v, sizeof v);
    v2v_data_step_run(step, x);
    assert_true(gradient_of(x, v, tau) < bound_of(tau));
    v2v_data_step_destroy(&step);
}

/* @param x [slices,torus] out: where runs and extends end @param is_weighed by weights of 1
 * @return the squares that are missed there */
static double run_saturated(float *x, int is_weighed)
{
    enum { TIMES = 300 };
    double squares = 0.0;
    struct v2v_data_step *step = make(3.0, 1.0);
    if (is_weighed) {
        assert_ok(v2v_data_step_take_weights(step));
        v2v_data_step_begin(step, views, 1.0);
        v2v_data_step_weigh(step, 0.0, 1.0);
    }
    for (int i = 0; i < TIMES; i++) {
        random_volume(x);
        v2v_data_step_run(step, x);
        squares = v2v_data_step_extend(step);
    }
    v2v_data_step_destroy(&step);
    return squares;
}

static void weights_of_one_end_where_none_do(void **state)
{
    (void)state;
    static float with[SLICES * MOST], without[SLICES * MOST], as_light[SLICES * MOST];
    saturate();
    const double missed = run_saturated(without, 0);
    assert_true(fabs(run_saturated(with, 1) - missed) < 1e-4 * missed); /* of none but light */
    views[0] = HIGHEST + 1e-6f; /* the highest, alone: now HIGHEST is light */
    for (int64_t v = 1; v < VIEWS; v++) {
        views[v * HEIGHT * WIDTH] = HIGHEST + 1e-6f;
    }
    (void)run_saturated(as_light, 0);
    const double size = v2v_sum_of_squares(without, SLICES * pixels);
    print_message("%g apart; %g with samples that are no bounds\n",
                  sqrt(distance_of(with, without) / size),
                  sqrt(distance_of(as_light, without) / size));
    /* 300 times converged: round-off is left, 1e-7 of the length; bounds or light, 7e-2 */
    assert_true(distance_of(with, without) < 1e-8 * size);
    assert_true(distance_of(as_light, without) > 1e-4 * size);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(the_step_is_the_minimum, setup, teardown),
        cmocka_unit_test_setup_teardown(frequencies_have_penalties_of_their_own, setup, teardown),
        cmocka_unit_test_setup_teardown(steps_advance_to_the_minimum_and_beyond, setup, teardown),
        cmocka_unit_test_setup_teardown(the_border_follows_the_volume, setup, teardown),
        cmocka_unit_test_setup_teardown(a_part_of_a_plane_is_surrounded, setup, teardown),
        cmocka_unit_test_setup_teardown(weights_give_the_minimum_of_weighted_squares, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(views_alike_and_dark_slices_are_no_matter, setup, teardown),
        cmocka_unit_test_setup_teardown(a_saturated_sample_bounds_the_volume_from_below, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(weights_of_one_end_where_none_do, setup, teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
