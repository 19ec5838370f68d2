#include "support.h"

#include "base/philox.h"
#include "v2v3d/base/random.h"

#include <math.h>

static void philox_gives_the_published_answers(void **state)
{
    (void)state;
    /* Known answers of Random123 for philox4x32 with 10 rounds; the third is the digits of pi. */
    static const struct {
        uint32_t counter[4], key[2], answer[4];
    } cases[] = {
        {{0, 0, 0, 0}, {0, 0}, {0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}},
        {{0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff},
         {0xffffffff, 0xffffffff},
         {0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}},
        {{0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344},
         {0xa4093822, 0x299f31d0},
         {0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        uint32_t counter[4];
        for (int w = 0; w < 4; w++) {
            counter[w] = cases[i].counter[w];
        }
        v2v_philox(counter, cases[i].key);
        assert_memory_equal(counter, cases[i].answer, sizeof counter);
    }
}

static void bits_are_philox_of_index_and_stream_under_the_seed(void **state)
{
    (void)state;
    uint64_t seed = 0x299f31d0a4093822, stream = 0x0370734413198a2e, index = 0x85a308d3243f6a88;
    assert_true(v2v_random_bits(seed, stream, index) == 0x94fdccebd16cfe09);
    assert_true(v2v_random_bits(0, 0, 0) == 0xe169c58d6627e8d5);
}

static void splitmix_and_fnv_give_the_published_answers(void **state)
{
    (void)state;
    /* First numbers of splitmix64 from states 0 and 1234567; FNV-1a 64 of "", "a" and "foobar". */
    assert_true(v2v_random_splitmix64(0) == 0xE220A8397B1DCDAF);
    assert_true(v2v_random_splitmix64(1234567) == 6457827717110365317u);
    assert_true(v2v_random_fnv1a64("") == 0xCBF29CE484222325);
    assert_true(v2v_random_fnv1a64("a") == 0xAF63DC4C8601EC8C);
    assert_true(v2v_random_fnv1a64("foobar") == 0x85944171F73967E8);
}

static void rule_gives_the_golden_input(void **state)
{
    (void)state;
    const char *path = test_shared("golden/network.h5");
    int64_t count = 0, wrong = 0;
    if (path == NULL) {
        skip();
    }
    uint64_t seed = (uint64_t)test_h5_attribute(path, "/", "seed");
    double *lfi = test_h5_read(path, "lfi", &count);
    for (int64_t i = 0; i < count; i++) {
        wrong += (float)(0.2 + 0.2 * v2v_random_rule("lfi", seed, (uint64_t)i)) != (float)lfi[i];
    }
    test_release(lfi);
    assert_int_equal(count, 13 * 64 * 64);
    assert_int_equal(wrong, 0);
}

static void rule_lies_in_minus_one_to_one(void **state)
{
    (void)state;
    for (uint64_t i = 0; i < 10000; i++) {
        double u = v2v_random_rule("unet1.init_conv.0.weight", 3, i);
        assert_true(u >= -1.0 && u < 1.0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(philox_gives_the_published_answers),
        cmocka_unit_test(bits_are_philox_of_index_and_stream_under_the_seed),
        cmocka_unit_test(splitmix_and_fnv_give_the_published_answers),
        cmocka_unit_test(rule_gives_the_golden_input),
        cmocka_unit_test(rule_lies_in_minus_one_to_one),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
