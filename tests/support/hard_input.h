/** Images that strain floating point: what a wrong unit, a camera or a broken pixel brings. */
#ifndef V2V_TEST_HARD_INPUT_H
#define V2V_TEST_HARD_INPUT_H

#include <stdint.h>

enum test_hard {
    TEST_HARD_1E_6, /**< waves with noise around 1, times 1e-6 */
    TEST_HARD_1E_3,
    TEST_HARD_1,
    TEST_HARD_1E3,
    TEST_HARD_1E6,
    TEST_HARD_ZERO,
    TEST_HARD_CONSTANT,  /**< 100 everywhere */
    TEST_HARD_HOT,       /**< one pixel of 1e4 times the mean */
    TEST_HARD_SATURATED, /**< a third of the pixels at 65535 */
    TEST_HARD_SUBNORMAL, /**< times 1e-40: below FLT_MIN */
    TEST_HARD_INPUTS
};

const char *test_hard_name(enum test_hard which);

/** Sample i of an image or a stack of images with rows of `width`; the hot one is sample `hot`. */
float test_hard_sample(enum test_hard which, int64_t i, int64_t width, int64_t hot);

#endif
