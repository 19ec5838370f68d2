/* How far structures moved between two frames, of spots whose way is known. */
#include "support.h"

#include "method/motion.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"

#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

enum { VIEWS = 4, HEIGHT = 90, WIDTH = 107, PIXELS = HEIGHT * WIDTH, SAMPLES = VIEWS * PIXELS };
static const double noise = 3.0;

static float frame[SAMPLES], neighbour[SAMPLES], clean[SAMPLES], aligned[SAMPLES], again[SAMPLES];

/* Of what a frame shows: pixels that it lies further. */
struct way {
    double y, x;
};

/* Spots of two pixels' standard deviation, elsewhere in every view, one in 200 pixels. Left and
 * right halves go their own way, and views by so many times their share of it further, as of
 * something that moves along z. */
enum { SPOTS = 48, REACH = 8 };
static const struct way parallax[VIEWS] = {{1.0, 0.0}, {0.0, 1.0}, {-1.0, 0.0}, {0.0, -1.0}};

static void add_spot(double *light, double at_y, double at_x)
{
    for (int y = (int)at_y - REACH; y <= (int)at_y + REACH; y++) {
        for (int x = (int)at_x - REACH; x <= (int)at_x + REACH; x++) {
            if (y >= 0 && y < HEIGHT && x >= 0 && x < WIDTH) {
                const double across = y - at_y, along = x - at_x;
                light[y * WIDTH + x] +=
                    20.0 * noise * exp(-(across * across + along * along) / 8.0);
            }
        }
    }
}

static void make_deep(float *to, uint64_t stream, double sigma, struct way left, struct way right,
                      double depth)
{
    static double light[SAMPLES];
    for (int i = 0; i < SAMPLES; i++) {
        light[i] = 20.0;
    }
    for (uint64_t k = 0; k < (uint64_t)SPOTS * VIEWS; k++) {
        const double y = HEIGHT * v2v_random_uniform(8, 0, k);
        const double x = WIDTH * v2v_random_uniform(8, 1, k);
        const struct way way = x < WIDTH / 2 ? left : right;
        const struct way of_view = parallax[k / SPOTS];
        add_spot(light + k / SPOTS * PIXELS, y + way.y + depth * of_view.y,
                 x + way.x + depth * of_view.x);
    }
    for (int i = 0; i < SAMPLES; i++) {
        to[i] = (float)(light[i] + sigma * v2v_random_normal(7, stream, (uint64_t)i));
    }
}

static void make(float *to, uint64_t stream, double sigma, struct way left, struct way right)
{
    make_deep(to, stream, sigma, left, right, 0.0);
}

static void align(float *to, const float *from, double factor, double sigma)
{
    struct v2v_motion *motion = NULL;
    const size_t held = v2v_mem_held();
    assert_ok(v2v_motion_create(&motion, VIEWS, HEIGHT, WIDTH));
    const int64_t taken = (int64_t)(v2v_mem_held() - held);
    const int64_t planned = 4 * v2v_motion_floats(VIEWS, HEIGHT, WIDTH);
    assert_true(taken >= planned && taken < planned + 4096); /* and the object itself */
    v2v_motion_begin(motion, frame, sigma);
    v2v_motion_find(motion, from, factor);
    v2v_motion_undo(motion, to, from);
    v2v_motion_destroy(&motion);
    assert_null(motion);
}

/* Away from edges, where light comes in, and from where halves part: squares missed of the frame
 * without noise, of two frames with it. */
enum { EDGE = 16 };

static double missed_by(const float *moved, double sigma)
{
    double squares = 0.0, count = 0.0;
    for (int i = 0; i < SAMPLES; i++) {
        const int y = i / WIDTH % HEIGHT, x = i % WIDTH;
        const int is_inside = y >= EDGE && y < HEIGHT - EDGE && x >= EDGE && x < WIDTH - EDGE;
        if (is_inside && abs(x - WIDTH / 2) > EDGE / 2) {
            squares += pow((double)moved[i] - (double)clean[i], 2.0) / (sigma * sigma);
            count += 1.0;
        }
    }
    return squares / count;
}

static const struct way here = {0.0, 0.0};

/* What a frame that is aligned misses is its noise, which cubic convolution takes from, and what is
 * left of the way: 0.06 of the noise's square for a tenth of a pixel along both axes, since a spot
 * has pi / 2 (20 noise)^2 of squared gradient along either, and 48 lie on 90 x 107 pixels. */
static void structures_come_back(void **state)
{
    (void)state;
    static const struct {
        struct way left, right;
        double depth;
    } ways[] = {{{0.7, -0.4}, {0.7, -0.4}, 0.0}, {{-2.3, 3.1}, {-2.3, 3.1}, 0.0},
                {{6.0, 5.0}, {6.0, 5.0}, 0.0},   {{1.5, 0.5}, {-1.0, -1.5}, 0.0},
                {{0.0, 0.0}, {0.0, 0.0}, 1.5},   {{1.0, -2.0}, {1.0, -2.0}, -2.5}};
    make(frame, 0, noise, here, here);
    make(clean, 0, 0.0, here, here);
    for (size_t k = 0; k < sizeof ways / sizeof *ways; k++) {
        make_deep(neighbour, 1, noise, ways[k].left, ways[k].right, ways[k].depth);
        align(aligned, neighbour, 1.0, noise);
        const double before = missed_by(neighbour, noise), after = missed_by(aligned, noise);
        if (!(before > 1.5 && after < 1.1)) {
            fail_msg("ways %zu: %g of the noise missed, %g aligned", k, before, after);
        }
    }
}

/* Twice as bright, in any unit; of half of the noise a tenth of a pixel is 0.25 of the square. */
static void brightness_and_units_do_not_matter(void **state)
{
    (void)state;
    static const double units[] = {1.0, 1e-20, 1e15};
    const struct way far = {-2.3, 3.1};
    make(clean, 0, 0.0, here, here);
    for (size_t k = 0; k < sizeof units / sizeof *units; k++) {
        make(frame, 0, noise, here, here);
        make(neighbour, 1, 0.5 * noise, far, far);
        for (int i = 0; i < SAMPLES; i++) {
            frame[i] = (float)((double)frame[i] * units[k]);
            neighbour[i] = (float)(2.0 * (double)neighbour[i] * units[k]);
        }
        align(aligned, neighbour, 0.5, noise * units[k]);
        for (int i = 0; i < SAMPLES; i++) {
            aligned[i] = (float)(0.5 * (double)aligned[i] / units[k]);
        }
        assert_true(missed_by(aligned, 0.5 * noise) < 1.3);
    }
}

/* Nothing moved: noise seldom makes a tenth of a pixel where structure says otherwise. */
static void what_stands_still_keeps_its_samples(void **state)
{
    (void)state;
    int kept = 0;
    make(frame, 0, noise, here, here);
    make(neighbour, 1, noise, here, here);
    align(aligned, neighbour, 1.0, noise);
    for (int i = 0; i < SAMPLES; i++) {
        kept += aligned[i] == neighbour[i];
    }
    if (kept < 0.8 * SAMPLES) {
        fail_msg("%d of %d samples kept", kept, SAMPLES);
    }
}

/* Nothing but noise: by half a pixel both ways 0.41 of its variance would be left, by a tenth
 * 0.96. */
static void noise_alone_hardly_moves(void **state)
{
    (void)state;
    double squares = 0.0;
    for (int i = 0; i < SAMPLES; i++) {
        frame[i] = (float)(noise * v2v_random_normal(7, 2, (uint64_t)i));
        neighbour[i] = (float)(noise * v2v_random_normal(7, 3, (uint64_t)i));
    }
    align(aligned, neighbour, 1.0, noise);
    for (int i = 0; i < SAMPLES; i++) {
        squares += pow((double)aligned[i] / noise, 2.0) / SAMPLES;
    }
    if (squares < 0.9) {
        fail_msg("%g of the variance is left", squares);
    }
}

static void bits_do_not_depend_on_threads(void **state)
{
    (void)state;
    const int threads = omp_get_max_threads();
    const struct way left = {1.5, 0.5}, right = {-1.0, -1.5};
    make(frame, 0, noise, here, here);
    make(neighbour, 1, noise, left, right);
    align(aligned, neighbour, 1.0, noise);
    for (int count = 1; count <= 3; count++) {
        omp_set_num_threads(count);
        align(again, neighbour, 1.0, noise);
        assert_memory_equal(again, aligned, sizeof again);
    }
    omp_set_num_threads(threads);
}

/* What is not finite spoils what is about it in its own view; a pixel, too bright to be squared, at
 * most all of it, and in neither case is anything read beyond a frame. */
static void what_is_not_finite_stays_where_it_is(void **state)
{
    (void)state;
    static const float bad[] = {NAN, INFINITY, -INFINITY, 3e38f};
    const struct way far = {-2.3, 3.1};
    make(frame, 0, noise, here, here);
    make(clean, 0, 0.0, here, here);
    for (size_t k = 0; k < sizeof bad / sizeof *bad; k++) {
        make(neighbour, 1, noise, far, far);
        neighbour[HEIGHT / 2 * WIDTH + 4] = bad[k];
        align(aligned, neighbour, 1.0, noise);
        int finite = 0;
        for (int i = 0; i < SAMPLES; i++) {
            finite += isfinite(aligned[i]) != 0;
        }
        assert_true(finite >= SAMPLES - 36);
        if (k < 3) {
            assert_true(missed_by(aligned, noise) < 1.1);
        }
    }
}

static void frames_of_a_few_pixels_are_frames(void **state)
{
    (void)state;
    static const int64_t sizes[][2] = {{1, 1}, {1, 3}, {3, 1},   {2, 9},   {17, 2},
                                       {5, 5}, {6, 7}, {17, 25}, {19, 25}, {24, 24}};
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) {
        struct v2v_motion *motion = NULL;
        const int64_t samples = 2 * sizes[k][0] * sizes[k][1];
        make(frame, 0, noise, here, here);
        make(neighbour, 1, noise, here, here);
        memset(aligned, 0, sizeof aligned);
        assert_ok(v2v_motion_create(&motion, 2, sizes[k][0], sizes[k][1]));
        v2v_motion_begin(motion, frame, noise);
        v2v_motion_find(motion, neighbour, 1.0);
        v2v_motion_undo(motion, aligned, neighbour);
        v2v_motion_destroy(&motion);
        for (int64_t i = 0; i < samples; i++) {
            assert_true(isfinite(aligned[i]) && aligned[i] != 0.0f);
        }
        assert_true(aligned[samples] == 0.0f);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(structures_come_back),
        cmocka_unit_test(brightness_and_units_do_not_matter),
        cmocka_unit_test(what_stands_still_keeps_its_samples),
        cmocka_unit_test(noise_alone_hardly_moves),
        cmocka_unit_test(bits_do_not_depend_on_threads),
        cmocka_unit_test(what_is_not_finite_stays_where_it_is),
        cmocka_unit_test(frames_of_a_few_pixels_are_frames),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
