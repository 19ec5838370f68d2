/* Slices over ranks must give what one rank gives: uneven splits, more ranks than slices, a rank
 * that can't. */
#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/projector.h"

enum { VIEWS = 3, KERNEL = 6, HEIGHT = 14, WIDTH = 11, FRAME = HEIGHT * WIDTH };

/* 1 and 2: more ranks than slices; 5 and 7: uneven. */
static const int64_t slice_counts[] = {1, 2, 5, 7};
enum { CASES = sizeof slice_counts / sizeof slice_counts[0] };

struct fixture {
    struct v2v_psf_file psf;
    struct v2v_projector *serial, *parallel;
    float *volume, *volume2, *views, *views2;
    struct v2v_part mine;
};

static void make_psf(struct v2v_psf_file *psf, int64_t slices)
{
    *psf =
        (struct v2v_psf_file){.views = VIEWS, .slices = slices, .height = KERNEL, .width = KERNEL};
    assert_ok(V2V_ALLOC(psf->data, "test", VIEWS * slices * KERNEL * KERNEL));
    for (int64_t i = 0; i < VIEWS * slices * KERNEL * KERNEL; i++) {
        psf->data[i] = (float)v2v_random_uniform(5, 0, (uint64_t)i);
    }
}

static void setup(struct fixture *f, int64_t slices)
{
    make_psf(&f->psf, slices);
    assert_ok(V2V_ALLOC(f->volume, "test", slices * FRAME));
    assert_ok(V2V_ALLOC(f->volume2, "test", slices * FRAME));
    assert_ok(V2V_ALLOC(f->views, "test", VIEWS * FRAME));
    assert_ok(V2V_ALLOC(f->views2, "test", VIEWS * FRAME));
    for (int64_t i = 0; i < slices * FRAME; i++) {
        f->volume[i] = (float)v2v_random_normal(5, 1, (uint64_t)i);
    }
    assert_ok(v2v_projector_create(&f->serial, &f->psf, HEIGHT, WIDTH, NULL));
    assert_ok(v2v_projector_create(&f->parallel, &f->psf, HEIGHT, WIDTH, test_world()));
    f->mine = v2v_projector_slices(f->parallel);
}

static void teardown(struct fixture *f)
{
    v2v_projector_destroy(&f->parallel);
    v2v_projector_destroy(&f->serial);
    v2v_mem_free(f->views2);
    v2v_mem_free(f->views);
    v2v_mem_free(f->volume2);
    v2v_mem_free(f->volume);
    v2v_mem_free(f->psf.data);
}

static void slices_of_all_ranks_cover_the_volume_once(void **state)
{
    (void)state;
    for (int i = 0; i < CASES; i++) {
        struct fixture f;
        setup(&f, slice_counts[i]);
        int64_t covered = f.mine.count, ends = f.mine.first + f.mine.count;
        v2v_par_sum_i64(test_world(), &covered, 1);
        v2v_par_max_i64(test_world(), &ends, 1);
        assert_int_equal(covered, slice_counts[i]);
        assert_int_equal(ends, slice_counts[i]);
        assert_int_equal(v2v_projector_slices(f.serial).count, slice_counts[i]);
        teardown(&f);
    }
}

/* The same products summed in another order: each view is a sum of at most 7 slices and 4 ranks,
 * whose roundings are 11 * 6e-8 of its size at most: below 1e-6. */
static void forward_over_ranks_matches_one_rank(void **state)
{
    static const int32_t list[] = {2, 0};
    (void)state;
    for (int i = 0; i < CASES; i++) {
        struct fixture f;
        setup(&f, slice_counts[i]);
        const float *mine = f.volume + f.mine.first * FRAME;
        v2v_projector_forward(f.serial, f.views, f.volume, NULL, VIEWS);
        v2v_projector_forward(f.parallel, f.views2, mine, NULL, VIEWS);
        assert_true(test_relative_l2(f.views2, f.views, VIEWS * FRAME) <= 1e-6);
        v2v_projector_forward(f.serial, f.views, f.volume, list, 2);
        v2v_projector_forward(f.parallel, f.views2, mine, list, 2);
        assert_true(test_relative_l2(f.views2, f.views, 2 * FRAME) <= 1e-6);
        teardown(&f);
    }
}

static void adjoint_over_ranks_is_the_same_bits_as_one_rank(void **state)
{
    (void)state;
    for (int i = 0; i < CASES; i++) {
        struct fixture f;
        setup(&f, slice_counts[i]);
        v2v_projector_forward(f.serial, f.views, f.volume, NULL, VIEWS);
        v2v_projector_adjoint(f.serial, f.volume, f.views, NULL, VIEWS);
        v2v_projector_adjoint(f.parallel, f.volume2, f.views, NULL, VIEWS);
        assert_memory_equal(f.volume2, f.volume + f.mine.first * FRAME,
                            (size_t)(f.mine.count * FRAME) * sizeof(float));
        teardown(&f);
    }
}

static void one_rank_short_of_memory_fails_creation_on_all(void **state)
{
    struct v2v_psf_file psf;
    struct v2v_projector *projector = NULL;
    const int last = v2v_comm_size(test_world()) - 1;
    (void)state;
    make_psf(&psf, 5);
    if (v2v_comm_rank(test_world()) == last) {
        v2v_mem_set_limit(v2v_mem_held() + 1000);
    }
    const size_t held = v2v_mem_held();
    assert_int_equal(v2v_projector_create(&projector, &psf, HEIGHT, WIDTH, test_world()),
                     V2V_E_MEMORY);
    v2v_mem_set_limit(0);
    assert_null(projector);
    assert_int_equal(v2v_mem_held(), held);
    v2v_mem_free(psf.data);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slices_of_all_ranks_cover_the_volume_once),
        cmocka_unit_test(forward_over_ranks_matches_one_rank),
        cmocka_unit_test(adjoint_over_ranks_is_the_same_bits_as_one_rank),
        cmocka_unit_test(one_rank_short_of_memory_fails_creation_on_all),
    };
    return test_mpi_main(tests, argc, argv);
}
