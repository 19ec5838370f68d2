/** Draws against their distributions. Seeds are fixed: a passing test passes for ever. A statistic
 *  of standard error s is allowed 5 s: a right generator leaves that once in 1.7e6 seeds. */
#include "support.h"

#include "v2v3d/base/random.h"

#include <math.h>

enum { DRAWS = 200000 };

static void check_near(double value, double expected, double standard_error, const char *what)
{
    if (!(fabs(value - expected) <= 5.0 * standard_error)) {
        fail_msg("%s: %.9g instead of %.9g +- %.3g", what, value, expected, 5.0 * standard_error);
    }
}

static void uniform_has_its_mean_variance_and_range(void **state)
{
    (void)state;
    double sum = 0.0, squares = 0.0;
    for (uint64_t i = 0; i < DRAWS; i++) {
        double u = v2v_random_uniform(1, 2, i);
        assert_true(u >= 0.0 && u < 1.0);
        sum += u - 0.5;
        squares += (u - 0.5) * (u - 0.5);
    }
    /* Variance 1/12; fourth central moment 1/80, so that (u - 1/2)^2 has variance 1/180. */
    check_near(sum / DRAWS, 0.0, sqrt(1.0 / 12.0 / DRAWS), "mean");
    check_near(squares / DRAWS, 1.0 / 12.0, sqrt(1.0 / 180.0 / DRAWS), "variance");
}

static void normal_has_its_first_four_moments(void **state)
{
    (void)state;
    double m1 = 0.0, m2 = 0.0, m3 = 0.0, m4 = 0.0;
    for (uint64_t i = 0; i < DRAWS; i++) {
        double x = v2v_random_normal(3, 4, i);
        m1 += x;
        m2 += x * x;
        m3 += x * x * x;
        m4 += x * x * x * x;
    }
    /* Var x^k = E x^2k - (E x^k)^2, with E x^2, x^4, x^6, x^8 = 1, 3, 15, 105. */
    check_near(m1 / DRAWS, 0.0, sqrt(1.0 / DRAWS), "mean");
    check_near(m2 / DRAWS, 1.0, sqrt(2.0 / DRAWS), "second moment");
    check_near(m3 / DRAWS, 0.0, sqrt(15.0 / DRAWS), "third moment");
    check_near(m4 / DRAWS, 3.0, sqrt(96.0 / DRAWS), "fourth moment");
}

static void neighbours_streams_and_seeds_do_not_correlate(void **state)
{
    (void)state;
    double next = 0.0, stream = 0.0, seed = 0.0;
    for (uint64_t i = 0; i < DRAWS; i++) {
        double x = v2v_random_normal(5, 6, i);
        next += x * v2v_random_normal(5, 6, i + 1);
        stream += x * v2v_random_normal(5, 7, i);
        seed += x * v2v_random_normal(6, 6, i);
    }
    /* A product of two independent standard normals has variance 1. */
    check_near(next / DRAWS, 0.0, sqrt(1.0 / DRAWS), "next index");
    check_near(stream / DRAWS, 0.0, sqrt(1.0 / DRAWS), "next stream");
    check_near(seed / DRAWS, 0.0, sqrt(1.0 / DRAWS), "next seed");
}

static void below_is_even_over_its_range(void **state)
{
    (void)state;
    enum { N = 7 };
    int64_t seen[N] = {0};
    double chi2 = 0.0;
    for (uint64_t i = 0; i < DRAWS; i++) {
        int64_t k = v2v_random_below(8, 9, i, N);
        assert_true(k >= 0 && k < N);
        seen[k]++;
    }
    for (int k = 0; k < N; k++) {
        double d = (double)seen[k] - (double)DRAWS / N;
        chi2 += d * d / ((double)DRAWS / N);
    }
    /* chi2 of N - 1 degrees has variance 2 (N - 1). */
    check_near(chi2, N - 1, sqrt(2.0 * (N - 1)), "chi2");
    assert_int_equal(v2v_random_below(8, 9, 0, 1), 0);
    for (uint64_t i = 0; i < 1000; i++) {
        /* Three quarters of 2^63: without rejection the lower half would be favoured. */
        int64_t k = v2v_random_below(8, 10, i, (int64_t)3 << 61);
        assert_true(k >= 0 && k < (int64_t)3 << 61);
    }
}

static void poisson_has_its_mean_and_variance(void **state)
{
    (void)state;
    /* Both sides of the change of method at 30. */
    static const double means[] = {0.01, 1.0, 5.5, 29.9, 30.0, 30.1, 100.0, 12345.6, 1e9};
    for (size_t m = 0; m < sizeof means / sizeof means[0]; m++) {
        double mean = means[m], sum = 0.0, squares = 0.0;
        for (uint64_t i = 0; i < DRAWS; i++) {
            int64_t k = v2v_random_poisson(10 + m, 11, i, mean);
            assert_true(k >= 0);
            double d = (double)k - mean;
            sum += d;
            squares += d * d;
        }
        /* Fourth central moment mean + 3 mean^2, so that d^2 has variance mean + 2 mean^2. */
        check_near(sum / DRAWS, 0.0, sqrt(mean / DRAWS), "mean");
        check_near(squares / DRAWS, mean, sqrt((mean + 2.0 * mean * mean) / DRAWS), "variance");
    }
    assert_int_equal(v2v_random_poisson(1, 2, 3, 0.0), 0);
}

static void poisson_has_its_probabilities(void **state)
{
    (void)state;
    static const double means[] = {4.0, 29.0, 31.0, 60.0};
    enum { MOST = 200 };
    for (size_t m = 0; m < sizeof means / sizeof means[0]; m++) {
        int64_t seen[MOST] = {0};
        double chi2 = 0.0;
        int cells = 0;
        for (uint64_t i = 0; i < DRAWS; i++) {
            int64_t k = v2v_random_poisson(20 + m, 21, i, means[m]);
            assert_true(k < MOST);
            seen[k]++;
        }
        for (int k = 0; k < MOST; k++) {
            double expected = DRAWS * exp(k * log(means[m]) - means[m] - lgamma((double)k + 1.0));
            if (expected >= 20.0) {
                double d = (double)seen[k] - expected;
                chi2 += d * d / expected;
                cells++;
            }
        }
        /* The cells left out hold less than a thousandth: cells degrees of freedom, to that. */
        check_near(chi2, cells, sqrt(2.0 * cells), "chi2");
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(uniform_has_its_mean_variance_and_range),
        cmocka_unit_test(normal_has_its_first_four_moments),
        cmocka_unit_test(neighbours_streams_and_seeds_do_not_correlate),
        cmocka_unit_test(below_is_even_over_its_range),
        cmocka_unit_test(poisson_has_its_mean_and_variance),
        cmocka_unit_test(poisson_has_its_probabilities),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
