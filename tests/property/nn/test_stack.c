/* Stacks of images, flat and deep, repeated, and pooled at given places: adjoints; and the maximum
 * that a pool finds. */
#include "adjoint.h"
#include "nn/stack.h"
#include "support.h"

#include "v2v3d/base/random.h"

#include <math.h>
#include <string.h>

enum { DEPTH = 2, CHANNELS = 3, HEIGHT = 4, WIDTH = 5, JOINED = 5, FIRST = 2 };
enum { MOST = 4 * DEPTH * JOINED * 4 * HEIGHT * WIDTH };

/* A stack with ends among its memory, and one of half its sides, and of half its depth if deep. */
struct pair {
    struct v2v_stack large, small;
    uint8_t which[MOST];
    float memory[2][MOST], scratch[MOST];
};

static void make(struct pair *p, int is_deep)
{
    const int64_t depth = is_deep ? 2 * DEPTH : DEPTH;
    memset(p, 0, sizeof *p);
    p->large = (struct v2v_stack){p->memory[0], JOINED, depth, 2 * HEIGHT, 2 * WIDTH, is_deep};
    p->small = (struct v2v_stack){p->memory[1], CHANNELS, DEPTH, HEIGHT, WIDTH, is_deep};
    for (int64_t i = 0; i < MOST; i++) {
        p->which[i] = (uint8_t)v2v_random_below(3, 1, (uint64_t)i, is_deep ? 8 : 4);
    }
}

static int64_t floats(const struct v2v_stack *stack)
{
    return stack->depth * stack->channels * v2v_stack_pixels(stack);
}

/* Without ends. */
static void load(const struct v2v_stack *stack, const float *from)
{
    memcpy(v2v_stack_at(stack, 0, 0), from, (size_t)floats(stack) * sizeof *from);
}

static void store(float *to, const struct v2v_stack *stack)
{
    memcpy(to, v2v_stack_at(stack, 0, 0), (size_t)floats(stack) * sizeof *to);
}

static void repeat(void *self, float *out, const float *in)
{
    struct pair *p = self;
    memset(p->memory, 0, sizeof p->memory);
    load(&p->small, in);
    v2v_stack_repeat(&p->large, FIRST, &p->small);
    store(out, &p->large);
}

static void repeat_backward(void *self, float *in, const float *out)
{
    struct pair *p = self;
    load(&p->large, out);
    v2v_stack_repeat_backward(&p->small, &p->large, FIRST, p->scratch);
    store(in, &p->small);
}

/* The place in a window's stack of a float of the small one. */
static float *place_in(const struct pair *p, int64_t i)
{
    const int64_t x = i % WIDTH, y = i / WIDTH % HEIGHT, c = i / WIDTH / HEIGHT % CHANNELS;
    const int64_t d = i / WIDTH / HEIGHT / CHANNELS * (p->large.depth / DEPTH) + p->which[i] / 4;
    return v2v_stack_at(&p->large, d, c) + (2 * y + p->which[i] / 2 % 2) * 2 * WIDTH + 2 * x +
           p->which[i] % 2;
}

static void pick(void *self, float *out, const float *in)
{
    struct pair *p = self;
    load(&p->large, in);
    for (int64_t i = 0; i < floats(&p->small); i++) {
        out[i] = *place_in(p, i);
    }
}

static void pick_backward(void *self, float *in, const float *out)
{
    struct pair *p = self;
    memset(p->memory, 0, sizeof p->memory);
    load(&p->small, out);
    v2v_stack_pool_backward(&p->large, &p->small, p->which);
    store(in, &p->large);
}

/* Sums of at most eight numbers. */
static void repeats_and_pools_have_their_adjoints(void **state)
{
    (void)state;
    static struct pair p;
    for (int is_deep = 0; is_deep < 2; is_deep++) {
        make(&p, is_deep);
        test_adjoint(&(struct test_linear){.name = "repeat",
                                           .ins = floats(&p.small),
                                           .outs = floats(&p.large),
                                           .self = &p,
                                           .forward = repeat,
                                           .adjoint = repeat_backward,
                                           .rounding = test_rounding(8)});
        test_adjoint(&(struct test_linear){.name = "pool",
                                           .ins = floats(&p.large),
                                           .outs = floats(&p.small),
                                           .self = &p,
                                           .forward = pick,
                                           .adjoint = pick_backward,
                                           .rounding = 0x1p-24});
    }
}

/* Every window has one number above all others, at a place drawn, one in seven a NaN. */
static void a_pool_finds_the_maximum_and_a_nan(void **state)
{
    (void)state;
    static struct pair p;
    static uint8_t which[MOST];
    for (int is_deep = 0; is_deep < 2; is_deep++) {
        make(&p, is_deep);
        for (int64_t i = 0; i < MOST; i++) {
            p.memory[0][i] = (float)(v2v_random_uniform(5, 1, (uint64_t)i) - 1.0);
        }
        for (int64_t i = 0; i < floats(&p.small); i++) {
            *place_in(&p, i) = i % 7 == 0 ? NAN : (float)(i + 1);
        }
        v2v_stack_pool(&p.small, which, &p.large);
        for (int64_t i = 0; i < floats(&p.small); i++) {
            const float found = v2v_stack_at(&p.small, 0, 0)[i];
            assert_int_equal(which[i], p.which[i]);
            assert_true(i % 7 == 0 ? isnan(found) : found == (float)(i + 1));
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(repeats_and_pools_have_their_adjoints),
        cmocka_unit_test(a_pool_finds_the_maximum_and_a_nan),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
