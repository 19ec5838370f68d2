/* The fast projector against plain loops and against its own adjoint, on shapes that are odd, even,
 * oblong, smaller than the kernel, and just fit the transform. */
#include "adjoint.h"
#include "support.h"
#include "twin_projector.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/projector.h"
#include <float.h>
#include <math.h>
#include <omp.h>
#include <string.h>

struct shape {
    int64_t views, slices, kernel_height, kernel_width, height, width;
};

/* 8 + 4 and 10 + 2 are transform sizes themselves: there the least wrap-around would show. */
static const struct shape shapes[] = {
    {1, 1, 1, 1, 1, 1},    {2, 3, 5, 5, 10, 10},  {2, 3, 8, 8, 8, 8},   {3, 2, 8, 5, 8, 10},
    {3, 4, 7, 6, 13, 9},   {2, 2, 31, 30, 6, 11}, {2, 2, 4, 31, 17, 5}, {4, 5, 12, 12, 24, 21},
    {1, 2, 15, 2, 20, 33}, {5, 1, 2, 2, 3, 19},   {13, 3, 9, 9, 16, 8}, {2, 40, 3, 3, 16, 15},
};
enum { SHAPES = sizeof shapes / sizeof shapes[0] };

/* Three transforms follow each other (OTF, frame, inverse); in each, log2(n) stages round by at
 * most FLT_EPSILON in norm; the product and the sum over z or v add a few more. */
static double bound(const struct shape *s)
{
    const double pixels = (double)((s->height + s->kernel_height) * (s->width + s->kernel_width));
    return (3 * log2(4 * pixels) + 4) * FLT_EPSILON;
}

struct fixture {
    struct shape s;
    struct twin_shape twin;
    struct v2v_psf_file psf;
    struct v2v_projector *projector;
    float *volume, *views, *volume2, *views2;
    double *volume_exact, *views_exact;
    int64_t volume_count, frame_count;
};

static void setup(struct fixture *f, const struct shape *s)
{
    *f = (struct fixture){
        .s = *s,
        .twin = {s->slices, s->kernel_height, s->kernel_width, s->height, s->width},
        .psf = {.views = s->views,
                .slices = s->slices,
                .height = s->kernel_height,
                .width = s->kernel_width},
        .volume_count = s->slices * s->height * s->width,
        .frame_count = s->height * s->width};
    const int64_t taps = s->views * s->slices * s->kernel_height * s->kernel_width;
    const int64_t pixels = s->views * f->frame_count;
    assert_ok(V2V_ALLOC(f->psf.data, "test", taps));
    assert_ok(V2V_ALLOC(f->volume, "test", f->volume_count));
    assert_ok(V2V_ALLOC(f->volume2, "test", f->volume_count));
    assert_ok(V2V_ALLOC(f->volume_exact, "test", f->volume_count));
    assert_ok(V2V_ALLOC(f->views, "test", pixels));
    assert_ok(V2V_ALLOC(f->views2, "test", pixels));
    assert_ok(V2V_ALLOC(f->views_exact, "test", pixels));
    for (int64_t i = 0; i < taps; i++) {
        f->psf.data[i] = (float)v2v_random_uniform(3, 0, (uint64_t)i);
    }
    for (int64_t i = 0; i < f->volume_count; i++) {
        f->volume[i] = (float)v2v_random_normal(3, 1, (uint64_t)i);
        f->volume_exact[i] = f->volume[i];
    }
    for (int64_t i = 0; i < pixels; i++) {
        f->views[i] = (float)v2v_random_normal(3, 2, (uint64_t)i);
        f->views_exact[i] = f->views[i];
    }
    assert_ok(
        v2v_projector_create(&f->projector, &f->psf, s->height, s->width, V2V_SPLIT_SLICES, NULL));
}

static void teardown(struct fixture *f)
{
    v2v_projector_destroy(&f->projector);
    assert_null(f->projector);
    v2v_mem_free(f->views_exact);
    v2v_mem_free(f->views2);
    v2v_mem_free(f->views);
    v2v_mem_free(f->volume_exact);
    v2v_mem_free(f->volume2);
    v2v_mem_free(f->volume);
    v2v_mem_free(f->psf.data);
}

static const float *kernel_of(const struct fixture *f, int64_t v)
{
    return f->psf.data + v * f->s.slices * f->s.kernel_height * f->s.kernel_width;
}

static void forward_matches_the_plain_loops(void **state)
{
    (void)state;
    for (int i = 0; i < SHAPES; i++) {
        struct fixture f;
        setup(&f, &shapes[i]);
        for (int64_t v = 0; v < f.s.views; v++) {
            twin_project(f.views_exact + v * f.frame_count, f.volume_exact, kernel_of(&f, v),
                         &f.twin);
        }
        v2v_projector_forward(f.projector, f.views, f.volume, NULL, f.s.views, 1.0f);
        const double error =
            test_relative_l2_to_double(f.views, f.views_exact, f.s.views * f.frame_count);
        print_message("forward %d: error %.2g, bound %.2g\n", i, error, bound(&f.s));
        assert_true(error <= bound(&f.s));
        teardown(&f);
    }
}

static void adjoint_matches_the_plain_loops(void **state)
{
    (void)state;
    for (int i = 0; i < SHAPES; i++) {
        struct fixture f;
        setup(&f, &shapes[i]);
        memset(f.volume_exact, 0, (size_t)f.volume_count * sizeof *f.volume_exact);
        for (int64_t v = 0; v < f.s.views; v++) {
            twin_project_adjoint(f.volume_exact, f.views_exact + v * f.frame_count,
                                 kernel_of(&f, v), &f.twin);
        }
        v2v_projector_adjoint(f.projector, f.volume, f.views, NULL, f.s.views, 1.0f);
        const double error = test_relative_l2_to_double(f.volume, f.volume_exact, f.volume_count);
        print_message("adjoint %d: error %.2g, bound %.2g\n", i, error, bound(&f.s));
        assert_true(error <= bound(&f.s));
        teardown(&f);
    }
}

struct listed {
    struct v2v_projector *projector;
    const int32_t *list;
    int64_t count;
    float scale;
};

static void project(void *self, float *views, const float *volume)
{
    const struct listed *l = self;
    v2v_projector_forward(l->projector, views, volume, l->list, l->count, l->scale);
}

static void project_back(void *self, float *volume, const float *views)
{
    const struct listed *l = self;
    v2v_projector_adjoint(l->projector, volume, views, l->list, l->count, l->scale);
}

static void assert_adjoint(const struct fixture *f, const int32_t *list, int64_t count, float scale)
{
    struct listed listed = {f->projector, list, count, scale};
    test_adjoint(&(struct test_linear){.name = "projection",
                                       .ins = f->volume_count,
                                       .outs = count * f->frame_count,
                                       .self = &listed,
                                       .forward = project,
                                       .adjoint = project_back,
                                       .rounding = bound(&f->s)});
}

static void adjoint_matches_inner_product(void **state)
{
    static const int32_t lists[][3] = {{2, 0, 1}, {1, 3, 0}, {3, 1, 2}};
    (void)state;
    for (int i = 0; i < SHAPES; i++) {
        struct fixture f;
        setup(&f, &shapes[i]);
        assert_adjoint(&f, NULL, f.s.views, 1.0f);
        assert_adjoint(&f, NULL, f.s.views, 0.25f);
        for (int64_t k = 0; k < 12 && i == 7; k++) {
            assert_adjoint(&f, lists[k / 4], k % 4, 1.0f);
        }
        teardown(&f);
    }
}

static void listed_views_are_the_same_bits_as_all_views(void **state)
{
    static const int32_t list[] = {3, 1};
    struct fixture f;
    (void)state;
    setup(&f, &shapes[7]);
    v2v_projector_forward(f.projector, f.views, f.volume, NULL, f.s.views, 1.0f);
    v2v_projector_forward(f.projector, f.views2, f.volume, list, 2, 1.0f);
    for (int i = 0; i < 2; i++) {
        assert_memory_equal(f.views2 + i * f.frame_count, f.views + list[i] * f.frame_count,
                            (size_t)f.frame_count * sizeof(float));
    }
    teardown(&f);
}

static void first_views_are_taken_without_a_list(void **state)
{
    static const int32_t list[] = {0, 1};
    struct fixture f;
    (void)state;
    setup(&f, &shapes[7]);
    v2v_projector_adjoint(f.projector, f.volume, f.views, NULL, 2, 1.0f);
    v2v_projector_adjoint(f.projector, f.volume2, f.views, list, 2, 1.0f);
    assert_memory_equal(f.volume, f.volume2, (size_t)f.volume_count * sizeof(float));
    teardown(&f);
}

static void scale_multiplies_projection_and_adjoint(void **state)
{
    struct fixture f;
    (void)state;
    setup(&f, &shapes[4]);
    v2v_projector_forward(f.projector, f.views2, f.volume, NULL, f.s.views, 1.0f);
    v2v_projector_adjoint(f.projector, f.volume2, f.views2, NULL, f.s.views, 1.0f);
    /* A power of two scales without rounding. */
    v2v_projector_forward(f.projector, f.views, f.volume, NULL, f.s.views, 0.5f);
    v2v_projector_adjoint(f.projector, f.volume, f.views, NULL, f.s.views, 0.5f);
    for (int64_t k = 0; k < f.s.views * f.frame_count; k++) {
        assert_true(f.views[k] == 0.5f * f.views2[k]);
    }
    for (int64_t k = 0; k < f.volume_count; k++) {
        assert_true(f.volume[k] == 0.25f * f.volume2[k]);
    }
    teardown(&f);
}

static void thread_count_does_not_change_bits(void **state)
{
    const int before = omp_get_max_threads();
    struct fixture one, many;
    (void)state;
    omp_set_num_threads(1);
    setup(&one, &shapes[7]);
    omp_set_num_threads(5);
    setup(&many, &shapes[7]);
    omp_set_num_threads(before);
    v2v_projector_forward(one.projector, one.views2, one.volume, NULL, one.s.views, 1.0f);
    v2v_projector_forward(many.projector, many.views2, many.volume, NULL, many.s.views, 1.0f);
    assert_memory_equal(one.views2, many.views2,
                        (size_t)(one.s.views * one.frame_count) * sizeof(float));
    v2v_projector_adjoint(one.projector, one.volume2, one.views, NULL, one.s.views, 1.0f);
    v2v_projector_adjoint(many.projector, many.volume2, many.views, NULL, many.s.views, 1.0f);
    assert_memory_equal(one.volume2, many.volume2, (size_t)one.volume_count * sizeof(float));
    teardown(&many);
    teardown(&one);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(forward_matches_the_plain_loops),
        cmocka_unit_test(adjoint_matches_the_plain_loops),
        cmocka_unit_test(adjoint_matches_inner_product),
        cmocka_unit_test(listed_views_are_the_same_bits_as_all_views),
        cmocka_unit_test(first_views_are_taken_without_a_list),
        cmocka_unit_test(scale_multiplies_projection_and_adjoint),
        cmocka_unit_test(thread_count_does_not_change_bits),
    };
    return cmocka_run_group_tests_name("optics.projector", tests, NULL, NULL);
}
