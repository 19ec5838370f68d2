/* A volume shared by ranks, by slices or by slabs, must give what one rank gives: uneven splits,
 * more ranks than slices or rows, a rank that can't. */
#include "adjoint.h"
#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/projector.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { VIEWS = 3, KERNEL = 6 };

/* Slices: 1 and 2: more ranks than slices; 5 and 7: uneven. Rows: 3: more ranks than rows. The last
 * one's sums over ranks take several rounds of exchanges: 3 * 602 * 351 numbers of 16 bytes. */
static const struct {
    int64_t slices, height, width;
} cases[] = {{1, 14, 11}, {2, 14, 11}, {5, 14, 11}, {7, 14, 11}, {5, 3, 11}, {2, 600, 700}};
enum { CASES = sizeof cases / sizeof cases[0] - 1, LARGE = CASES };

static const enum v2v_split splits[] = {V2V_SPLIT_SLICES, V2V_SPLIT_SLABS,
                                        V2V_SPLIT_SLABS_FFTW3_MPI};
enum { SPLITS = sizeof splits / sizeof splits[0] };

struct fixture {
    int64_t slices, height, width, frame;
    struct v2v_psf_file psf;
    struct v2v_projector *serial, *parallel;
    float *volume, *volume2; /* whole; volume2 for what the ranks make together */
    float *views, *views2;
    float *share, *slices_share, *rows; /* of this rank */
    struct v2v_projector_share mine;
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

static void setup(struct fixture *f, int which, enum v2v_split split)
{
    *f = (struct fixture){.slices = cases[which].slices,
                          .height = cases[which].height,
                          .width = cases[which].width,
                          .frame = cases[which].height * cases[which].width};
    make_psf(&f->psf, f->slices);
    assert_ok(v2v_projector_create(&f->serial, &f->psf, f->height, f->width, split, NULL));
    assert_ok(
        v2v_projector_create(&f->parallel, &f->psf, f->height, f->width, split, test_world()));
    f->mine = v2v_projector_share(f->parallel);
    assert_ok(V2V_ALLOC(f->volume, "test", f->slices * f->frame));
    assert_ok(V2V_ALLOC(f->volume2, "test", f->slices * f->frame));
    assert_ok(V2V_ALLOC(f->views, "test", VIEWS * f->frame));
    assert_ok(V2V_ALLOC(f->views2, "test", VIEWS * f->frame));
    assert_ok(V2V_ALLOC(f->share, "test", f->mine.slices.count * f->mine.rows.count * f->width));
    assert_ok(
        V2V_ALLOC(f->slices_share, "test", v2v_projector_slices(f->parallel).count * f->frame));
    assert_ok(V2V_ALLOC(f->rows, "test", VIEWS * f->mine.view_rows.count * f->width));
    for (int64_t i = 0; i < f->slices * f->frame; i++) {
        f->volume[i] = (float)(v2v_random_uniform(5, 1, (uint64_t)i) - 0.5);
    }
    for (int64_t i = 0; i < VIEWS * f->frame; i++) {
        f->views[i] = (float)(v2v_random_uniform(5, 2, (uint64_t)i) - 0.5);
    }
}

static void teardown(struct fixture *f)
{
    v2v_projector_destroy(&f->parallel);
    v2v_projector_destroy(&f->serial);
    v2v_mem_free(f->rows);
    v2v_mem_free(f->slices_share);
    v2v_mem_free(f->share);
    v2v_mem_free(f->views2);
    v2v_mem_free(f->views);
    v2v_mem_free(f->volume2);
    v2v_mem_free(f->volume);
    v2v_mem_free(f->psf.data);
}

/* The part of `volume` that this rank holds, cut out by plain loops. */
static void cut(const struct fixture *f, float *share, const float *volume)
{
    for (int64_t z = 0; z < f->mine.slices.count; z++) {
        for (int64_t y = 0; y < f->mine.rows.count; y++) {
            for (int64_t x = 0; x < f->width; x++) {
                *share++ = volume[(f->mine.slices.first + z) * f->frame +
                                  (f->mine.rows.first + y) * f->width + x];
            }
        }
    }
}

/* volume2 = the whole volume of which every rank holds a share. */
static void join(struct fixture *f)
{
    const struct v2v_part slices = v2v_projector_slices(f->parallel);
    v2v_projector_to_slices(f->parallel, f->slices_share, f->share);
    memset(f->volume2, 0, (size_t)(f->slices * f->frame) * sizeof(float));
    memcpy(f->volume2 + slices.first * f->frame, f->slices_share,
           (size_t)(slices.count * f->frame) * sizeof(float));
    v2v_par_sum_f32(test_world(), f->volume2, f->slices * f->frame);
}

static void for_all_cases(void (*check)(struct fixture *))
{
    for (int i = 0; i < CASES; i++) {
        for (int k = 0; k < SPLITS; k++) {
            struct fixture f;
            setup(&f, i, splits[k]);
            check(&f);
            teardown(&f);
        }
    }
}

static void check_cover(struct fixture *f)
{
    int64_t sums[2] = {f->mine.slices.count * f->mine.rows.count, f->mine.view_rows.count};
    v2v_par_sum_i64(test_world(), sums, 2);
    assert_int_equal(sums[0], f->slices * f->height);
    assert_int_equal(sums[1], f->height);
    const struct v2v_projector_share all = v2v_projector_share(f->serial);
    assert_true(all.slices.count == f->slices && all.rows.count == f->height &&
                all.view_rows.count == f->height);
}

static void shares_of_all_ranks_cover_volume_and_views_once(void **state)
{
    (void)state;
    for_all_cases(check_cover);
}

static void check_moves(struct fixture *f)
{
    const struct v2v_part slices = v2v_projector_slices(f->parallel);
    float *expected = NULL;
    const int64_t count = f->mine.slices.count * f->mine.rows.count * f->width;
    assert_ok(V2V_ALLOC(expected, "test", count));
    cut(f, expected, f->volume);
    memcpy(f->slices_share, f->volume + slices.first * f->frame,
           (size_t)(slices.count * f->frame) * sizeof(float));
    v2v_projector_from_slices(f->parallel, f->share, f->slices_share);
    assert_memory_equal(f->share, expected, (size_t)count * sizeof(float));
    join(f);
    assert_memory_equal(f->volume2, f->volume, (size_t)(f->slices * f->frame) * sizeof(float));
    v2v_projector_cut_views(f->parallel, f->rows, f->views, VIEWS);
    v2v_projector_gather_views(f->parallel, f->views2, f->rows, VIEWS);
    assert_memory_equal(f->views2, f->views, (size_t)(VIEWS * f->frame) * sizeof(float));
    v2v_mem_free(expected);
}

static void volumes_and_views_move_between_files_and_shares_unchanged(void **state)
{
    (void)state;
    for_all_cases(check_moves);
}

/* Slabs: the same bits. Slices: sums in double precision, rounded once like one rank's, round
 * another way for about one number in 2^53 / 2^24, which moves a pixel by no more than its own
 * rounding, 6e-8. */
static void compare_views(struct fixture *f, const int32_t *list, int64_t count)
{
    const int64_t pixels = count * f->frame;
    cut(f, f->share, f->volume);
    v2v_projector_forward(f->serial, f->views, f->volume, list, count, 1.0f);
    v2v_projector_forward(f->parallel, f->rows, f->share, list, count, 1.0f);
    v2v_projector_gather_views(f->parallel, f->views2, f->rows, count);
    if (f->mine.rows.count < f->height) {
        assert_memory_equal(f->views2, f->views, (size_t)pixels * sizeof(float));
    } else {
        assert_true(test_relative_l2(f->views2, f->views, pixels) <= 6e-8);
    }
}

static void check_forward(struct fixture *f)
{
    static const int32_t list[] = {2, 0}, one[] = {1};
    compare_views(f, NULL, VIEWS);
    compare_views(f, list, 2);
    compare_views(f, one, 1);
    compare_views(f, one, 0);
}

static void forward_over_ranks_matches_one_rank(void **state)
{
    (void)state;
    for_all_cases(check_forward);
}

static void check_adjoint(struct fixture *f)
{
    static const int32_t list[] = {2, 0};
    for (int64_t count = VIEWS; count >= 2; count--) {
        const int32_t *some = count == VIEWS ? NULL : list;
        v2v_projector_cut_views(f->parallel, f->rows, f->views, count);
        v2v_projector_adjoint(f->serial, f->volume, f->views, some, count, 1.0f);
        v2v_projector_adjoint(f->parallel, f->share, f->rows, some, count, 1.0f);
        join(f);
        assert_memory_equal(f->volume2, f->volume, (size_t)(f->slices * f->frame) * sizeof(float));
    }
}

static void adjoint_over_ranks_is_the_same_bits_as_one_rank(void **state)
{
    (void)state;
    for_all_cases(check_adjoint);
}

static void sums_in_several_rounds_match_one_rank(void **state)
{
    struct fixture f;
    (void)state;
    setup(&f, LARGE, V2V_SPLIT_SLICES);
    check_forward(&f);
    check_adjoint(&f);
    teardown(&f);
}

static void project(void *self, float *rows, const float *share)
{
    v2v_projector_forward(self, rows, share, NULL, VIEWS, 1.0f);
}

static void project_back(void *self, float *share, const float *rows)
{
    v2v_projector_adjoint(self, share, rows, NULL, VIEWS, 1.0f);
}

/* Three transforms of at most 2^18 numbers follow each other, each of whose stages rounds by eps in
 * norm, and a few sums. */
static void check_inner_products(struct fixture *f)
{
    test_adjoint(&(struct test_linear){.name = "projection over ranks",
                                       .ins = f->mine.slices.count * f->mine.rows.count * f->width,
                                       .outs = VIEWS * f->mine.view_rows.count * f->width,
                                       .self = f->parallel,
                                       .forward = project,
                                       .adjoint = project_back,
                                       .rounding = (3 * 18 + 4) * (double)FLT_EPSILON,
                                       .comm = test_world()});
}

static void adjoint_over_ranks_matches_inner_product(void **state)
{
    (void)state;
    for_all_cases(check_inner_products);
}

static void all_splits_agree(void **state)
{
    (void)state;
    for (int i = 0; i < CASES; i++) {
        struct fixture f[SPLITS];
        for (int k = 0; k < SPLITS; k++) {
            setup(&f[k], i, splits[k]);
            cut(&f[k], f[k].share, f[k].volume);
            v2v_projector_forward(f[k].parallel, f[k].rows, f[k].share, NULL, VIEWS, 1.0f);
            v2v_projector_gather_views(f[k].parallel, f[k].views2, f[k].rows, VIEWS);
        }
        /* as compare_views */
        for (int k = 1; k < SPLITS; k++) {
            assert_true(test_relative_l2(f[0].views2, f[k].views2, VIEWS * f[0].frame) <= 6e-8);
        }
        for (int k = 0; k < SPLITS; k++) {
            teardown(&f[k]);
        }
    }
}

static void neither_projection_allocates(void **state)
{
    (void)state;
    for (int k = 0; k < SPLITS; k++) {
        struct fixture f;
        setup(&f, 2, splits[k]);
        const size_t held = v2v_mem_held(), peak = v2v_mem_peak();
        v2v_projector_forward(f.parallel, f.rows, f.share, NULL, VIEWS, 1.0f);
        v2v_projector_adjoint(f.parallel, f.share, f.rows, NULL, VIEWS, 1.0f);
        v2v_projector_to_slices(f.parallel, f.slices_share, f.share);
        assert_true(v2v_mem_held() == held && v2v_mem_peak() == peak);
        teardown(&f);
    }
}

static void the_bytes_of_the_fullest_rank_are_foretold(void **state)
{
    const int size = v2v_comm_size(test_world());
    (void)state;
    for (int i = 0; i < CASES; i++) {
        for (int k = 0; k < SPLITS; k++) {
            struct v2v_psf_file psf;
            struct v2v_projector *projector = NULL;
            make_psf(&psf, cases[i].slices);
            const size_t before = v2v_mem_held();
            assert_ok(v2v_projector_create(&projector, &psf, cases[i].height, cases[i].width,
                                           splits[k], test_world()));
            int64_t held = (int64_t)(v2v_mem_held() - before);
            v2v_projector_destroy(&projector);
            v2v_par_max_i64(test_world(), &held, 1);
            /* Beside a header of each of some 40 allocations and MPI's counts. */
            const int64_t beside = 40 * 128 + 2 * 4 * size * 4;
            assert_true(llabs(held - v2v_projector_bytes(&psf, cases[i].height, cases[i].width,
                                                         splits[k], size)) <= beside);
            v2v_mem_free(psf.data);
        }
    }
}

static void one_rank_short_of_memory_fails_creation_on_all(void **state)
{
    const int last = v2v_comm_size(test_world()) - 1;
    (void)state;
    for (int k = 0; k < SPLITS; k++) {
        /* Once the projector's own memory is short, once that of its transforms. */
        for (int64_t allowed = 1000; allowed <= 40000; allowed *= 2) {
            struct v2v_psf_file psf;
            struct v2v_projector *projector = NULL;
            make_psf(&psf, 5);
            const size_t held = v2v_mem_held();
            if (v2v_comm_rank(test_world()) == last) {
                v2v_mem_set_limit(held + (size_t)allowed);
            }
            enum v2v_status rc =
                v2v_projector_create(&projector, &psf, 14, 11, splits[k], test_world());
            v2v_mem_set_limit(0);
            assert_true(rc == V2V_E_MEMORY || rc == V2V_OK);
            assert_true(rc == V2V_E_MEMORY || allowed > 1000);
            assert_true((rc == V2V_OK) == (projector != NULL));
            v2v_projector_destroy(&projector);
            assert_int_equal(v2v_mem_held(), held);
            v2v_mem_free(psf.data);
        }
    }
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shares_of_all_ranks_cover_volume_and_views_once),
        cmocka_unit_test(volumes_and_views_move_between_files_and_shares_unchanged),
        cmocka_unit_test(forward_over_ranks_matches_one_rank),
        cmocka_unit_test(adjoint_over_ranks_is_the_same_bits_as_one_rank),
        cmocka_unit_test(sums_in_several_rounds_match_one_rank),
        cmocka_unit_test(adjoint_over_ranks_matches_inner_product),
        cmocka_unit_test(all_splits_agree),
        cmocka_unit_test(neither_projection_allocates),
        cmocka_unit_test(the_bytes_of_the_fullest_rank_are_foretold),
        cmocka_unit_test(one_rank_short_of_memory_fails_creation_on_all),
    };
    return test_mpi_main(tests, argc, argv);
}
