/* Resolution and shifts of images whose spectra are known. */
#include "support.h"

#include "eval/fourier.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"

#include <math.h>
#include <string.h>

enum { SLICES = 12, HEIGHT = 96, WIDTH = 128, PIXELS = HEIGHT * WIDTH, WAVES = 60 };

/* Waves of random directions and phases, of slice z: added. Frequencies lie between `least` and
 * `most` cycles a pixel, as many a ring's area, and as strong whatever the limits. */
static void add_waves(float *image, uint64_t stream, int z, double least, double most)
{
    const double strength = sqrt(most * most - least * least);
    for (int w = 0; w < WAVES; w++) {
        const uint64_t n = (uint64_t)(3 * (z * WAVES + w));
        const double pi = acos(-1.0), turn = 2 * pi * v2v_random_uniform(7, stream, n);
        const double phase = 2 * pi * v2v_random_uniform(7, stream, n + 1);
        const double u = v2v_random_uniform(7, stream, n + 2);
        const double f = sqrt(least * least + u * (most * most - least * least));
        for (int i = 0; i < PIXELS; i++) {
            const double along = cos(turn) * (double)(i % WIDTH) + sin(turn) * (double)(i / WIDTH);
            image[i] += (float)(strength * cos(2 * pi * f * along + phase));
        }
    }
}

/* Two volumes with the same waves below `limit` and each its own above. */
static double resolution_of(double limit, double own_from)
{
    static float a[PIXELS], b[PIXELS];
    struct v2v_ring rings[HEIGHT / 2] = {{0}};
    struct v2v_fourier *fourier = NULL;
    assert_ok(v2v_fourier_create(&fourier, HEIGHT, WIDTH));
    assert_int_equal(v2v_fourier_rings(fourier), HEIGHT / 2);
    for (int z = 0; z < SLICES; z++) {
        for (int i = 0; i < PIXELS; i++) {
            a[i] = b[i] = 0.0f;
        }
        if (limit > 0.0) {
            add_waves(a, 0, z, 0.0, limit);
            add_waves(b, 0, z, 0.0, limit);
        }
        add_waves(a, 1, z, own_from, 0.5);
        add_waves(b, 2, z, own_from, 0.5);
        v2v_fourier_correlate(fourier, rings, a, b);
    }
    v2v_fourier_destroy(&fourier);
    return v2v_fourier_resolution(rings, HEIGHT / 2);
}

/* A wave along y has both its frequencies in half a spectrum, one along x one of them: squares of
 * the same number, each rounded by a transform in single precision, some 1e-7 of the largest. */
static void waves_along_either_axis_count_alike(void **state)
{
    (void)state;
    enum { SIDE = 48, RINGS = SIDE / 2 };
    static float along_y[SIDE * SIDE], along_x[SIDE * SIDE];
    struct v2v_ring of_y[RINGS] = {{0}}, of_x[RINGS] = {{0}};
    struct v2v_fourier *fourier = NULL;
    double most = 0.0;
    for (int i = 0; i < SIDE * SIDE; i++) {
        along_y[i] = (float)cos(0.9 * (i / SIDE));
        along_x[i] = (float)cos(0.9 * (i % SIDE));
    }
    assert_ok(v2v_fourier_create(&fourier, SIDE, SIDE));
    v2v_fourier_correlate(fourier, of_y, along_y, along_y);
    v2v_fourier_correlate(fourier, of_x, along_x, along_x);
    v2v_fourier_destroy(&fourier);
    for (int r = 0; r < RINGS; r++) {
        most = fmax(most, of_y[r].first);
    }
    for (int r = 0; r < RINGS; r++) {
        assert_true(fabs(of_y[r].first - of_x[r].first) < 1e-6 * most);
    }
}

/* The window widens a line by about a ring (1 / 96 of a cycle a pixel) to either side, so that what
 * is shared and what is not mix in two of them: the limit is met to that. */
static void shared_frequencies_end_where_the_correlation_does(void **state)
{
    (void)state;
    const double limits[] = {0.125, 0.2, 0.3};
    for (int i = 0; i < 3; i++) {
        const double found = 1.0 / resolution_of(limits[i], limits[i]);
        if (!(fabs(found - limits[i]) <= 2.0 / HEIGHT)) {
            fail_msg("limit %g, found %g", limits[i], found);
        }
    }
}

/* Strips of images whose shared waves are strong: what their edges leave in the spectrum beyond the
 * limit is shared as well. As above, of 24 pixels. */
static void narrow_images_share_no_more_than_wide_ones(void **state)
{
    (void)state;
    enum { NARROW = 24 };
    static float a[PIXELS], b[PIXELS], strip_a[HEIGHT * NARROW], strip_b[HEIGHT * NARROW];
    const double limit = 0.1;
    struct v2v_ring rings[NARROW / 2] = {{0}};
    struct v2v_fourier *fourier = NULL;
    assert_ok(v2v_fourier_create(&fourier, HEIGHT, NARROW));
    assert_int_equal(v2v_fourier_rings(fourier), NARROW / 2);
    for (int z = 0; z < SLICES; z++) {
        memset(a, 0, sizeof a);
        add_waves(a, 0, z, 0.0, limit);
        for (int i = 0; i < PIXELS; i++) {
            a[i] = b[i] = 5.0f * a[i];
        }
        add_waves(a, 1, z, limit, 0.5);
        add_waves(b, 2, z, limit, 0.5);
        for (int i = 0; i < HEIGHT * NARROW; i++) {
            strip_a[i] = a[i / NARROW * WIDTH + i % NARROW];
            strip_b[i] = b[i / NARROW * WIDTH + i % NARROW];
        }
        v2v_fourier_correlate(fourier, rings, strip_a, strip_b);
    }
    v2v_fourier_destroy(&fourier);
    const double found = 1.0 / v2v_fourier_resolution(rings, NARROW / 2);
    if (!(fabs(found - limit) <= 2.0 / NARROW)) {
        fail_msg("limit %g, found %g", limit, found);
    }
}

/* Slices count by their light: what dim ones have in common, or not, is of no matter. */
static void dim_slices_count_less(void **state)
{
    (void)state;
    static float a[PIXELS], b[PIXELS];
    const double limit = 0.3;
    struct v2v_ring rings[HEIGHT / 2] = {{0}};
    struct v2v_fourier *fourier = NULL;
    assert_ok(v2v_fourier_create(&fourier, HEIGHT, WIDTH));
    for (int z = 0; z < 10; z++) {
        const float brightness = z == 0 ? 1.0f : 1e-3f;
        memset(a, 0, sizeof a);
        memset(b, 0, sizeof b);
        if (z == 0) {
            add_waves(a, 0, z, 0.0, limit);
            add_waves(b, 0, z, 0.0, limit);
        }
        add_waves(a, 1, z, z == 0 ? limit : 0.0, 0.5);
        add_waves(b, 2, z, z == 0 ? limit : 0.0, 0.5);
        for (int i = 0; i < PIXELS; i++) {
            a[i] *= brightness;
            b[i] *= brightness;
        }
        v2v_fourier_correlate(fourier, rings, a, b);
    }
    const double found = 1.0 / v2v_fourier_resolution(rings, HEIGHT / 2);
    if (!(fabs(found - limit) <= 2.0 / HEIGHT)) {
        fail_msg("limit %g, found %g", limit, found);
    }
    v2v_fourier_destroy(&fourier);
}

static void equal_volumes_resolve_to_the_nyquist_frequency(void **state)
{
    (void)state;
    static float image[PIXELS];
    struct v2v_ring rings[HEIGHT / 2] = {{0}};
    struct v2v_fourier *fourier = NULL;
    add_waves(image, 0, 0, 0.0, 0.5);
    assert_ok(v2v_fourier_create(&fourier, HEIGHT, WIDTH));
    v2v_fourier_correlate(fourier, rings, image, image);
    assert_true(v2v_fourier_resolution(rings, HEIGHT / 2) == 2.0);
    v2v_fourier_destroy(&fourier);
}

static void nothing_shared_resolves_nothing(void **state)
{
    (void)state;
    const struct v2v_ring dark[4] = {{0}};
    const struct v2v_ring never[3] = {{1, 1, 1}, {0.1, 1, 1}, {0, 1, 1}};
    const struct v2v_ring known[3] = {{1, 1, 1}, {1, 1, 1}, {-1, 1, 1}};
    assert_true(isnan(v2v_fourier_resolution(dark, 4)));
    assert_true(isnan(v2v_fourier_resolution(never, 3)));
    /* from 1 at ring 1.5 down to -1 at 2.5: 1/7 at 1.5 + 3/7, of 2 * 3 rings a cycle a pixel */
    assert_true(fabs(v2v_fourier_resolution(known, 3) - 6.0 / (1.5 + 3.0 / 7.0)) < 1e-12);
}

static void check_shift(int dy, int dx, float brightness)
{
    static float image[PIXELS], moved[PIXELS];
    struct v2v_fourier *fourier = NULL;
    double shift[2];
    for (int i = 0; i < PIXELS; i++) {
        image[i] = 0.0f;
    }
    add_waves(image, 0, 0, 0.0, 0.2);
    for (int i = 0; i < PIXELS; i++) {
        const int y = (i / WIDTH + dy + HEIGHT) % HEIGHT, x = (i % WIDTH + dx + WIDTH) % WIDTH;
        moved[y * WIDTH + x] = brightness * image[i];
    }
    for (int i = 0; i < PIXELS; i++) {
        image[i] *= brightness;
    }
    assert_ok(v2v_fourier_create(&fourier, HEIGHT, WIDTH));
    v2v_fourier_shift(fourier, shift, moved, image);
    v2v_fourier_destroy(&fourier);
    /* Under the windows w overlap as the correlation of w with itself, which falls by 2 d / n of a
     * side n over a shift of d in a fading eighth at most: of the curvature of the correlation
     * peak, waves of 0.14 cycles a pixel in the mean, (2 pi 0.14)^2 / 2 = 0.4 a square pixel, that
     * moves the top by 8 / n / 0.8 = 0.1. The parabola adds less. */
    if (!(fabs(shift[0] - dy) < 0.15 && fabs(shift[1] - dx) < 0.15)) {
        fail_msg("%d, %d at %g: found %g, %g", dy, dx, (double)brightness, shift[0], shift[1]);
    }
}

static void an_image_is_found_where_it_was_moved(void **state)
{
    (void)state;
    check_shift(0, 0, 1.0f);
    check_shift(2, 0, 1.0f);
    check_shift(-3, 5, 1.0f);
    check_shift(1, -7, 1.0f);
    check_shift(-3, 5, 1e30f);
    check_shift(-3, 5, 1e-30f);
}

static void a_flat_image_lies_nowhere(void **state)
{
    (void)state;
    static float flat[PIXELS], image[PIXELS];
    struct v2v_fourier *fourier = NULL;
    double shift[2] = {0.0, 0.0};
    image[PIXELS / 2] = 1.0f;
    assert_ok(v2v_fourier_create(&fourier, HEIGHT, WIDTH));
    v2v_fourier_shift(fourier, shift, flat, image);
    assert_true(isnan(shift[0]) && isnan(shift[1]));
    v2v_fourier_destroy(&fourier);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(waves_along_either_axis_count_alike),
        cmocka_unit_test(shared_frequencies_end_where_the_correlation_does),
        cmocka_unit_test(narrow_images_share_no_more_than_wide_ones),
        cmocka_unit_test(dim_slices_count_less),
        cmocka_unit_test(equal_volumes_resolve_to_the_nyquist_frequency),
        cmocka_unit_test(nothing_shared_resolves_nothing),
        cmocka_unit_test(an_image_is_found_where_it_was_moved),
        cmocka_unit_test(a_flat_image_lies_nowhere),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
