/** One test for every gradient: of operators, losses and whole networks, without anything to
 *  compare with but the function itself.
 *
 *  Along a direction d, in steps h that are halved, for a cotangent c and g = J^T c:
 *  - central differences: <c, F(x + h d) - F(x - h d)> = 2 h <g, d> + O(h^3);
 *  - the Taylor remainder of second order: <c, F(x + h d) - F(x)> - h <g, d> falls as h^2.
 *  Directions are all arguments together, each by itself, and single elements of each, as long as
 *  makes a step of h change F by about h of its norm. The cotangent is J d itself, along which
 *  nothing cancels, and where F is smooth a drawn one, too.
 *
 *  What central differences err by is read off F: by what they change when h is halved, and by the
 *  bend, the second difference. A kink at a distance s < h from x (leaky ReLU, maximum, modulus)
 *  leaves parts of the same (h - s) in the bend and in the difference. Of a convex F the slope lies
 *  between the differences to either side, so the bend is a bound; in a network, kinks of both
 *  signs leave sums of the same variance in either. Their remainder falls as no power of h: central
 *  differences judge alone.
 */
#ifndef V2V_TEST_GRADIENT_H
#define V2V_TEST_GRADIENT_H

#include <stdint.h>

/** What may lie within the steps: no kink, those of a convex function, any. */
enum test_kinks { TEST_SMOOTH, TEST_CONVEX, TEST_KINKS };

struct test_argument {
    const char *name;
    float *x;              /**< [count], moved by the tester and put back */
    const float *gradient; /**< [count] where backward leaves it */
    int64_t count;
};

struct test_function {
    const char *name;
    const struct test_argument *argument;
    int64_t arguments, outs;
    void *self;
    /** out [outs] = F(x) of the arguments as they are. */
    void (*forward)(void *self, double *out);
    /** Set the gradients to J(x)^T dout, with whatever forward pass that takes. */
    void (*backward)(void *self, const double *dout);
    double step;     /**< the first and largest h */
    double rounding; /**< norm of forward's error in parts of the result's, see test_rounding */
    double backward_rounding; /**< likewise of the gradient's */
    int64_t elements;         /**< tried of each argument */
    double sees;              /**< least error of a slope that the test is to see, in parts of it */
    int kinks;                /**< enum test_kinks */
};

/** What is wrong, NULL: nothing. The text lives until the next call. */
const char *test_gradient_fault(const struct test_function *function);

/** Fail when the gradient is wrong, or when the test could not see that it is. */
void test_gradient(const struct test_function *function);

#endif
