/* The coarse structure of views that are a known projection, plus what a volume does not have. */
#include "support.h"

#include "v2v3d/base/random.h"
#include "v2v3d/eval/structure.h"

#include <math.h>
#include <string.h>

enum { HEIGHT = 96, WIDTH = 112, PIXELS = HEIGHT * WIDTH };

static float recorded[PIXELS], projected[PIXELS];

/* Waves of many pixels, `part` of them of another direction in the view; and white noise. */
static void make(double part, double gain, double noise)
{
    for (int i = 0; i < PIXELS; i++) {
        const double y = i / WIDTH, x = i % WIDTH;
        const double volume = sin(x / 7.0) + cos(y / 9.0), other = 2.0 * sin((x + 2.0 * y) / 16.0);
        projected[i] = (float)(2.0 + volume);
        recorded[i] = (float)(5.0 + gain * ((1.0 - part) * volume + part * other) +
                              noise * v2v_random_normal(7, 0, (uint64_t)i));
    }
}

static struct v2v_structure structure(double part, double gain, double noise)
{
    make(part, gain, noise);
    return v2v_structure_of(recorded, projected, HEIGHT, WIDTH);
}

static void noise_alone_is_nothing_missed(void **state)
{
    (void)state;
    static const double noises[] = {0.0, 0.01, 0.1, 1.0, 3.0};
    for (size_t i = 0; i < sizeof noises / sizeof *noises; i++) {
        const struct v2v_structure found = structure(0.0, 3.0, noises[i]);
        assert_true(v2v_structure_missed(&found) < 1e-6);
    }
}

/* 100 squares of which noise has 1 each, all of them give or take the root of 200: of what is not
 * eight times that above their sum, 113, nothing is known. */
static void what_noise_may_make_is_nothing_missed(void **state)
{
    (void)state;
    struct v2v_structure found = {.yy = 180.0, .dyy = 256.0, .differences = 1.0, .squares = 100.0};
    assert_true(isnan(v2v_structure_missed(&found)));
    found.yy = 220.0;
    assert_true(v2v_structure_missed(&found) == 1.0); /* of views alone */
    found = (struct v2v_structure){.yy = 1100.0,
                                   .yp = sqrt(920.0),
                                   .pp = 1.0,
                                   .dyy = 256.0,
                                   .differences = 1.0,
                                   .squares = 100.0};
    assert_true(v2v_structure_missed(&found) == 0.0);
    found.yp = sqrt(880.0); /* 1100 - 880 - 100 of 1100 - 100 */
    assert_true(fabs(v2v_structure_missed(&found) - sqrt(0.12)) < 1e-4);
}

/* A tenth of another structure, however much noise lies over it. */
static void what_the_volume_lacks_is_seen_through_noise(void **state)
{
    (void)state;
    const struct v2v_structure clean = structure(0.1, 3.0, 0.0), noisy = structure(0.1, 3.0, 0.5);
    const double missed = v2v_structure_missed(&clean);
    assert_true(missed > 0.05 && missed < 0.2);
    /* 48 squares miss 0.3 * 2 sin, 0.42 each, beside noise of 0.5 / 8: the sum of squares is known
     * to 2 * 0.0625 / (0.42 sqrt(48)) = 4 %, its root to 2 % */
    assert_true(fabs(v2v_structure_missed(&noisy) - missed) < 0.05 * missed);
}

static void views_without_structure_miss_nothing_that_is_known(void **state)
{
    (void)state;
    struct v2v_structure found = structure(0.0, 0.0, 0.0);
    assert_true(isnan(v2v_structure_missed(&found)));
    found = structure(0.0, 0.0, 1.0);
    assert_true(isnan(v2v_structure_missed(&found)));
    found = v2v_structure_of(recorded, projected, 15, WIDTH); /* no two squares high inside */
    assert_true(found.squares > 0.0);
    found = v2v_structure_of(recorded, projected, 15, 24);
    assert_true(found.squares == 0.0 && isnan(v2v_structure_missed(&found)));
    projected[PIXELS / 2 + WIDTH / 2] = NAN;
    found = v2v_structure_of(recorded, projected, HEIGHT, WIDTH);
    assert_true(isnan(v2v_structure_missed(&found)));
    assert_true(v2v_structure_brightness(&found, &found) == 1.0);
}

/* Two or three views, of which the last shows `part` of what the others do, with noise. */
static int lacks_view(int64_t count, double part, double noise)
{
    static float views[3 * PIXELS];
    for (int64_t v = 0; v < count; v++) {
        make(0.0, v + 1 < count ? 1.0 : part, noise);
        memcpy(views + v * PIXELS, recorded, sizeof recorded);
    }
    return v2v_structure_lacks_view(views, count, HEIGHT, WIDTH);
}

static void a_dark_view_is_lacking_beside_plain_ones(void **state)
{
    (void)state;
    static const double noises[] = {0.0, 0.1, 1.0};
    for (size_t i = 0; i < sizeof noises / sizeof *noises; i++) {
        for (int64_t count = 2; count <= 3; count++) {
            assert_true(lacks_view(count, 0.0, noises[i]));
            assert_false(lacks_view(count, 0.3, noises[i]));
        }
    }
    assert_false(lacks_view(1, 0.0, 0.1));
    assert_false(lacks_view(3, 0.0, 100.0)); /* nothing is plain */
    assert_true(v2v_structure_can_be_seen(16, 16) && !v2v_structure_can_be_seen(16, 15));
}

static void another_brightness_is_told_beyond_the_noise(void **state)
{
    (void)state;
    static const struct {
        double part, gain, noise, times; /* times: what is told */
    } cases[] = {{0.0, 3.0, 0.5, 1.0},
                 {0.0, 3.6, 0.0, 1.2},
                 {0.0, 3.6, 0.5, 1.2},
                 {0.0, 3.1, 0.1, 1.0},
                 {0.0, 0.0, 0.5, 0.0},
                 {0.0, 3.6, 20.0, 1.0},
                 {0.5, 3.0, 0.1, 1.0 /* which no gain explains */}};
    const struct v2v_structure others = structure(0.0, 3.0, 0.5);
    /* 48 squares of 0.95 and noise of 0.5 / 8 tell a gain of 3 to 0.0095, as that of the others:
     * their ratio, 1.2 or less, to 0.005; 0.02 is four times that */
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const struct v2v_structure here = structure(cases[i].part, cases[i].gain, cases[i].noise);
        const double times = v2v_structure_brightness(&here, &others);
        assert_true(fabs(times - cases[i].times) < (cases[i].times == 1.0 ? 1e-12 : 0.02));
    }
    const struct v2v_structure here = structure(0.0, 3.6, 0.0), none = {0};
    assert_true(v2v_structure_brightness(&here, &none) == 1.0);
    const struct v2v_structure noise = structure(0.0, 0.3, 5.0);
    assert_true(noise.yp > 0.0 && v2v_structure_brightness(&here, &noise) == 1.0);
    assert_true(v2v_structure_brightness(&none, &none) == 1.0);
}

static void draw_at_border(void)
{
    for (int i = 0; i < PIXELS; i++) {
        const double y = (double)(i / WIDTH) - 5.0, x = (double)(i % WIDTH) - 5.0;
        projected[i] = (float)(100.0 * exp(-(y * y + x * x) / 200.0));
        recorded[i] = projected[i] * (y > 20.0 || x > 20.0 ? 0.5f : 1.0f);
    }
}

/* A bright spot at the border, of which tails alone are inside: nothing is known of them. */
static void tails_of_what_lies_at_the_border_tell_nothing(void **state)
{
    (void)state;
    double shift[2];
    draw_at_border();
    const struct v2v_structure found = v2v_structure_of(recorded, projected, HEIGHT, WIDTH);
    const struct v2v_structure others = structure(0.0, 3.0, 0.5);
    assert_true(found.squares == 0.0 && isnan(v2v_structure_missed(&found)));
    assert_true(v2v_structure_brightness(&found, &others) == 1.0);
    draw_at_border();
    assert_ok(v2v_structure_shifts(shift, recorded, projected, 1, HEIGHT, WIDTH));
    assert_true(isnan(shift[0]) && isnan(shift[1]));
}

/* Ten views of few photons, in one bright spot that most of them lie in: none is odd. */
static void noise_of_photons_makes_no_view_odd(void **state)
{
    (void)state;
    enum { VIEWS = 10, SEEDS = 20 };
    struct v2v_structure of[VIEWS];
    for (int seed = 0; seed < SEEDS; seed++) {
        struct v2v_structure all = {0};
        for (int v = 0; v < VIEWS; v++) {
            for (int i = 0; i < PIXELS; i++) {
                const double y = (double)(i / WIDTH) - HEIGHT / 2.0;
                const double x = (double)(i % WIDTH) - WIDTH / 2.0;
                const double light = 0.002 + 1.5 * exp(-(y * y + x * x) / 18.0);
                projected[i] = (float)light;
                recorded[i] =
                    (float)v2v_random_poisson((uint64_t)seed, (uint64_t)v, (uint64_t)i, light);
            }
            of[v] = v2v_structure_of(recorded, projected, HEIGHT, WIDTH);
            v2v_structure_add(&all, &of[v]);
        }
        for (int v = 0; v < VIEWS; v++) {
            assert_true(v2v_structure_brightness(&of[v], &all) == 1.0);
        }
    }
}

static void a_view_that_moved_is_found_where_it_is(void **state)
{
    (void)state;
    static float two[2][PIXELS], moved[2][PIXELS];
    double shift[4];
    make(0.0, 1.0, 2.0);
    for (int i = 0; i < PIXELS; i++) {
        const int y = i / WIDTH, x = i % WIDTH;
        two[0][i] = two[1][i] = recorded[i];
        moved[0][i] = recorded[i];
        moved[1][i] = y >= 2 && x < WIDTH - 3 ? recorded[(y - 2) * WIDTH + x + 3] : 5.0f;
    }
    assert_ok(v2v_structure_shifts(shift, moved[0], two[0], 2, HEIGHT, WIDTH));
    assert_true(fabs(shift[0]) < 1e-3 && fabs(shift[1]) < 1e-3);
    /* the window, which does not move, has a part in it */
    assert_true(fabs(shift[2] - 2.0) < 0.1 && fabs(shift[3] + 3.0) < 0.1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(noise_alone_is_nothing_missed),
        cmocka_unit_test(what_noise_may_make_is_nothing_missed),
        cmocka_unit_test(what_the_volume_lacks_is_seen_through_noise),
        cmocka_unit_test(views_without_structure_miss_nothing_that_is_known),
        cmocka_unit_test(a_dark_view_is_lacking_beside_plain_ones),
        cmocka_unit_test(another_brightness_is_told_beyond_the_noise),
        cmocka_unit_test(tails_of_what_lies_at_the_border_tell_nothing),
        cmocka_unit_test(noise_of_photons_makes_no_view_odd),
        cmocka_unit_test(a_view_that_moved_is_found_where_it_is),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
