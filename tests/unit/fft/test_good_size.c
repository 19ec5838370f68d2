#include "support.h"
#include "v2v3d/fft/fft2.h"

static int is_good(int64_t n)
{
    if (n % 2 != 0) {
        return 0;
    }
    for (int64_t factor = 2; factor <= 7; factor++) {
        while (n % factor == 0) {
            n /= factor;
        }
    }
    return n == 1;
}

static void good_size_is_the_smallest_even_product_of_2_3_5_7(void **state)
{
    (void)state;
    for (int64_t n = 0; n <= 5000; n++) {
        const int64_t good = v2v_fft_good_size(n);
        assert_true(good >= n && is_good(good));
        for (int64_t smaller = n < 1 ? 1 : n; smaller < good; smaller++) {
            assert_false(is_good(smaller));
        }
    }
}

static void good_size_of_frame_sizes_is_as_tabled(void **state)
{
    static const int64_t cases[][2] = {{1, 2},     {2, 2},     {11, 12},   {192, 192},
                                       {353, 360}, {576, 576}, {577, 588}, {2049, 2058}};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        assert_int_equal(v2v_fft_good_size(cases[i][0]), cases[i][1]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(good_size_is_the_smallest_even_product_of_2_3_5_7),
        cmocka_unit_test(good_size_of_frame_sizes_is_as_tabled),
    };
    return cmocka_run_group_tests_name("fft.good_size", tests, NULL, NULL);
}
