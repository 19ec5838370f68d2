/* Every instruction set that this processor has, not only the one that convolutions would take. */
#include "op/direct_kernel.h"
#include "op/isa.h"
#include "support.h"
#include "twin_conv.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include <math.h>
#include <string.h>

enum { IN = 3, OUT = 6, FILLED = 8, HEIGHT = 9, WIDTH = 150, PITCH = 176, LANES = 16 };

static float uniform(uint64_t stream, int64_t index)
{
    return (float)(2.0 * v2v_random_uniform(13, stream, (uint64_t)index) - 1.0);
}

struct fixture {
    struct v2v_conv_spec spec;
    float in[IN * HEIGHT * WIDTH], dout[OUT * HEIGHT * WIDTH];
    float weight[OUT * IN * 9], bias[FILLED], packed[FILLED * IN * 9];
    float strip[IN * (HEIGHT + 2) * PITCH], right[FILLED * HEIGHT * PITCH];
    float out[OUT * HEIGHT * WIDTH], sums[FILLED * IN * 9 * LANES];
    double value[OUT * HEIGHT * WIDTH], moduli[OUT * HEIGHT * WIDTH];
};

static struct fixture *fixture_create(int kernel)
{
    struct fixture *f = v2v_mem_alloc("test", 1, sizeof *f);
    assert_non_null(f);
    f->spec = (struct v2v_conv_spec){1, IN, OUT, HEIGHT, WIDTH, kernel, 1, 0.5f, 1, 0, {0}, 0, 0};
    int pad = (kernel - 1) / 2, taps = kernel * kernel;
    for (int64_t i = 0; i < IN * HEIGHT * WIDTH; i++) {
        int64_t c = i / (HEIGHT * WIDTH), y = i / WIDTH % HEIGHT, x = i % WIDTH;
        f->in[i] = uniform(1, i);
        f->strip[(c * (HEIGHT + 2 * pad) + y + pad) * PITCH + x + pad] = f->in[i];
    }
    for (int64_t i = 0; i < OUT * HEIGHT * WIDTH; i++) {
        f->dout[i] = uniform(2, i);
        f->right[i / WIDTH * PITCH + i % WIDTH] = f->dout[i];
    }
    for (int64_t i = 0; i < OUT * IN * taps; i++) {
        int64_t o = i / (IN * taps), rest = i % (IN * taps);
        f->weight[i] = uniform(3, i);
        f->packed[(o / 4 * IN * taps + rest) * 4 + o % 4] = f->weight[i];
    }
    for (int64_t o = 0; o < OUT; o++) {
        f->bias[o] = uniform(4, o);
    }
    return f;
}

static void check_convolve(const struct direct_kernel *kernel, struct fixture *f)
{
    int pad = (f->spec.kernel - 1) / 2;
    struct direct_strip strip = {f->strip, IN, HEIGHT + 2 * pad, PITCH, 0};
    struct direct_target target = {f->out, OUT, HEIGHT * WIDTH, HEIGHT, WIDTH, WIDTH, HEIGHT, 0};
    kernel->convolve(&target, &strip, f->packed, f->bias, f->spec.kernel, f->spec.slope);
    twin_conv_forward((struct twin){f->value, f->moduli}, &f->spec, f->in, f->weight, f->bias);
    for (int64_t i = 0; i < OUT * HEIGHT * WIDTH; i++) {
        double twin = f->value[i] > 0.0 ? f->value[i] : 0.5 * f->value[i];
        /* 27 products and the bias (test_conv.c: the bound of any float32 sum). */
        assert_true(fabs((double)f->out[i] - twin) <= 30 * ldexp(1.0, -24) * f->moduli[i]);
    }
}

static void check_correlate(const struct direct_kernel *kernel, struct fixture *f)
{
    int k = f->spec.kernel, pad = (k - 1) / 2;
    struct direct_strip strip = {f->strip, IN, HEIGHT + 2 * pad, PITCH, 0};
    struct direct_strip right = {f->right, OUT, HEIGHT, PITCH, 0};
    memset(f->sums, 0, sizeof f->sums);
    kernel->correlate(f->sums, &strip, &right, WIDTH, k);
    twin_conv_backward_weights((struct twin){f->value, f->moduli}, &f->spec, f->in, f->dout);
    for (int64_t i = 0; i < OUT * IN * k * k; i++) {
        int64_t o = i / (IN * k * k), c = i / (k * k) % IN, row = i / k % k, column = i % k;
        int64_t place = (((o / 4 * IN + c) * k + row) * 4 + o % 4) * k + column;
        double sum = 0.0;
        for (int64_t lane = 0; lane < kernel->lanes; lane++) {
            sum += (double)f->sums[place * kernel->lanes + lane];
        }
        assert_true(fabs(sum - f->value[i]) <= HEIGHT * WIDTH * ldexp(1.0, -24) * f->moduli[i]);
    }
}

static void check(const struct direct_kernel *kernel)
{
    for (int size = 1; size <= 3; size += 2) {
        struct fixture *f = fixture_create(size);
        check_convolve(kernel, f);
        check_correlate(kernel, f);
        v2v_mem_free(f);
    }
}

static void check_set(int set)
{
    static const struct direct_kernel *const sets[] = V2V_KERNEL_SETS(v2v_direct);
    if (set > v2v_kernel_set()) {
        test_skip("this build or processor has it not");
    }
    check(sets[set]);
}

static void plain_vectors_match_plain_loops(void **unused)
{
    (void)unused;
    check_set(V2V_SET_ANY);
}

static void avx2_matches_plain_loops(void **unused)
{
    (void)unused;
    check_set(V2V_SET_AVX2);
}

static void avx512_matches_plain_loops(void **unused)
{
    (void)unused;
    check_set(V2V_SET_AVX512);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(plain_vectors_match_plain_loops),
        cmocka_unit_test(avx2_matches_plain_loops),
        cmocka_unit_test(avx512_matches_plain_loops),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
