#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/sim/planes.h"

#include <math.h>
#include <string.h>

enum { SIDE = 96, PIXELS = SIDE * SIDE };

static void draw(float *view, const struct v2v_planes *planes, int64_t v)
{
    v2v_planes_draw(view, planes, v);
    for (int64_t i = 0; i < planes->height * planes->width; i++) {
        assert_true(view[i] >= 0 && view[i] < 3);
    }
}

static void a_seed_repeats_its_views_and_another_gives_others(void **state)
{
    (void)state;
    double at[2][2] = {{0, -1}, {0, 1}};
    const struct v2v_cameras cameras = {2, at};
    struct v2v_planes planes = {&cameras, 8, 1, SIDE, SIDE, 3};
    static float one[PIXELS], again[PIXELS], other[PIXELS];
    draw(one, &planes, 0);
    draw(again, &planes, 0);
    assert_memory_equal(one, again, sizeof one);
    draw(other, &planes, 1);
    assert_memory_not_equal(one, other, sizeof one);
    planes.seed = 4;
    draw(other, &planes, 0);
    assert_memory_not_equal(one, other, sizeof one);
}

/* A camera that is moved by p sees a point of disparity d moved by - d p. Light is below 3, and
 * coordinates are computed in double precision: a rounding of float32 or two are left. */
static void views_of_one_disparity_are_each_other_moved(void **state)
{
    (void)state;
    double at[3][2] = {{0, 0}, {2, 0}, {-2, 4}};
    const struct v2v_cameras cameras = {3, at};
    const struct v2v_planes planes = {&cameras, 2.5, 2.5, SIDE, SIDE + 16, 5};
    const int64_t width = SIDE + 16;
    static float first[SIDE * (SIDE + 16)], moved[SIDE * (SIDE + 16)];
    draw(first, &planes, 0);
    for (int64_t v = 1; v < 3; v++) {
        const int64_t off_y = (int64_t)(2.5 * at[v][0]), off_x = (int64_t)(2.5 * at[v][1]);
        draw(moved, &planes, v);
        for (int64_t y = 0; y < SIDE; y++) {
            for (int64_t x = 0; x < width; x++) {
                const int64_t from_y = y + off_y, from_x = x + off_x;
                if (from_y >= 0 && from_y < SIDE && from_x >= 0 && from_x < width) {
                    assert_true(fabsf(moved[y * width + x] - first[from_y * width + from_x]) <=
                                3 * 0x1p-23f);
                }
            }
        }
    }
}

/* The whole disparity by which a patch of the second view fits the first one best. */
static int64_t disparity_of(const float *first, const float *second, int64_t y, int64_t x)
{
    enum { REACH = 4, LEAST = -2, MOST = 11 };
    double fewest = INFINITY;
    int64_t best = 0;
    for (int64_t d = LEAST; d <= MOST; d++) {
        double squares = 0;
        for (int64_t i = -REACH; i <= REACH; i++) {
            for (int64_t k = -REACH; k <= REACH; k++) {
                const int64_t at = (y + i) * SIDE + x + k;
                squares += pow((double)(second[at] - first[at + d]), 2);
            }
        }
        if (squares < fewest) {
            fewest = squares;
            best = d;
        }
    }
    return best;
}

/* Cameras a unit apart; patches at a rim may fit anything. Of planes in wrong order the background,
 * which is everywhere, would hide the others. */
static void disparities_are_between_the_farthest_and_the_nearest(void **state)
{
    (void)state;
    double at[2][2] = {{0, 0}, {0, 1}};
    const struct v2v_cameras cameras = {2, at};
    const struct v2v_planes planes = {&cameras, 8, 1, SIDE, SIDE, 2};
    static float first[PIXELS], second[PIXELS];
    int64_t count = 0, within = 0, near = 0, far = 0;
    draw(first, &planes, 0);
    draw(second, &planes, 1);
    for (int64_t y = 6; y < SIDE - 6; y += 3) {
        for (int64_t x = 6; x < SIDE - 16; x += 3) {
            const int64_t d = disparity_of(first, second, y, x);
            count++;
            within += d >= 1 && d <= 8;
            near += d >= 6 && d <= 8;
            far += d >= 1 && d <= 3;
        }
    }
    assert_true(within * 10 > count * 9);
    assert_true(near * 20 > count && far * 20 > count);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_seed_repeats_its_views_and_another_gives_others),
        cmocka_unit_test(views_of_one_disparity_are_each_other_moved),
        cmocka_unit_test(disparities_are_between_the_farthest_and_the_nearest),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
