/* Means over squares. */
#include "support.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/random.h"
#include "v2v3d/tensor/smooth.h"

#include <math.h>
#include <string.h>

enum { HEIGHT = 9, WIDTH = 7, PIXELS = HEIGHT * WIDTH };

static double mean_around(const float *image, int64_t y, int64_t x, int radius)
{
    double sum = 0.0;
    for (int64_t i = y - radius; i <= y + radius; i++) {
        for (int64_t k = x - radius; k <= x + radius; k++) {
            sum +=
                (double)image[v2v_within(i, 0, HEIGHT - 1) * WIDTH + v2v_within(k, 0, WIDTH - 1)];
        }
    }
    return sum / pow(2 * radius + 1, 2);
}

/* Radii beyond the sides, too. Two roundings to float32 of numbers up to 1. */
static void means_are_those_of_squares_also_in_place(void **state)
{
    (void)state;
    float image[PIXELS], to[PIXELS], scratch[PIXELS];
    for (int i = 0; i < PIXELS; i++) {
        image[i] = (float)v2v_random_uniform(5, 0, (uint64_t)i);
    }
    for (int radius = 0; radius <= 12; radius += 3) {
        float same[PIXELS];
        memcpy(same, image, sizeof same);
        v2v_smooth_image(to, scratch, image, HEIGHT, WIDTH, radius);
        v2v_smooth_image(same, scratch, same, HEIGHT, WIDTH, radius);
        for (int i = 0; i < PIXELS; i++) {
            const double mean = mean_around(image, i / WIDTH, i % WIDTH, radius);
            assert_true(fabs((double)to[i] - mean) < 2 * 0x1p-24);
        }
        assert_memory_equal(to, same, sizeof to);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(means_are_those_of_squares_also_in_place),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
