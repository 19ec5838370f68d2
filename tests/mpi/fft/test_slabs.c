/* Transforms cut over ranks, by either exchange, against those of one rank, bit for bit, and
 * against the plain plan: uneven cuts, more ranks than rows or columns, more frames than one
 * exchange takes. */
#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/fft/slabs.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* FFTW3-MPI: uneven cuts; 4 + 1 frames; more ranks than columns and rows; frames one by one. */
static const struct v2v_fft_shape shapes[] = {
    {1, 1, 2, 2, 1, 0},         {3, 5, 4, 6, 2, 0},     {17, 12, 20, 16, 3, 0},
    {20, 7, 20, 8, 40, 0},      {9, 40, 10, 42, 1, 0},  {300, 290, 300, 320, 5, 0},
    {40, 37, 42, 40, 2, 0},     {17, 12, 20, 16, 4, 1}, {1, 1, 2, 2, 1, 1},
    {300, 290, 300, 320, 5, 1},
};
enum { SHAPES = sizeof shapes / sizeof shapes[0], FRAMES = 5 };

struct fixture {
    struct v2v_fft_shape s;
    struct v2v_fft_slabs *alone, *together;
    struct v2v_part rows, columns;
    int64_t stride, my_stride;       /* of whole spectra, and of this rank's */
    float *frames, *mine, *restored; /* [n,y,x], [n,rows,x] */
    struct v2v_complex *spectra, *my_spectra;
};

static int64_t even(int64_t n)
{
    return n + n % 2;
}

static void setup(struct fixture *f, const struct v2v_fft_shape *shape)
{
    *f = (struct fixture){.s = *shape};
    assert_ok(v2v_fft_slabs_create(&f->alone, shape, NULL));
    assert_ok(v2v_fft_slabs_create(&f->together, shape, test_world()));
    f->rows = v2v_fft_slabs_rows(f->together);
    f->columns = v2v_fft_slabs_columns(f->together);
    f->stride = even(shape->ny * (shape->nx / 2 + 1)) + 2;
    f->my_stride = even(shape->ny * f->columns.count) + 4;
    assert_ok(V2V_ALLOC(f->frames, "test", FRAMES * shape->height * shape->width));
    assert_ok(V2V_ALLOC(f->mine, "test", FRAMES * f->rows.count * shape->width));
    assert_ok(V2V_ALLOC(f->restored, "test", FRAMES * shape->height * shape->width));
    assert_ok(V2V_ALLOC(f->spectra, "test", FRAMES * f->stride));
    assert_ok(V2V_ALLOC(f->my_spectra, "test", FRAMES * f->my_stride));
    for (int64_t i = 0; i < FRAMES * shape->height * shape->width; i++) {
        f->frames[i] = (float)v2v_random_normal(9, 0, (uint64_t)i);
    }
    for (int64_t i = 0; i < FRAMES * f->rows.count; i++) {
        const int64_t y = f->rows.first + i % f->rows.count, frame = i / f->rows.count;
        memcpy(f->mine + i * shape->width, f->frames + (frame * shape->height + y) * shape->width,
               (size_t)shape->width * sizeof *f->mine);
    }
}

static void teardown(struct fixture *f)
{
    v2v_mem_free(f->my_spectra);
    v2v_mem_free(f->spectra);
    v2v_mem_free(f->restored);
    v2v_mem_free(f->mine);
    v2v_mem_free(f->frames);
    v2v_fft_slabs_destroy(&f->together);
    v2v_fft_slabs_destroy(&f->alone);
    assert_null(f->together);
}

static void rows_and_columns_of_all_ranks_cover_the_frame_once(void **state)
{
    (void)state;
    for (int k = 0; k < SHAPES; k++) {
        struct fixture f;
        setup(&f, &shapes[k]);
        int64_t covered[2] = {f.rows.count, f.columns.count};
        int64_t ends[2] = {f.rows.first + f.rows.count, f.columns.first + f.columns.count};
        v2v_par_sum_i64(test_world(), covered, 2);
        v2v_par_max_i64(test_world(), ends, 2);
        assert_true(covered[0] == f.s.height && ends[0] == f.s.height);
        assert_true(covered[1] == f.s.nx / 2 + 1 && ends[1] == f.s.nx / 2 + 1);
        teardown(&f);
    }
}

/* Of each of two transforms of n numbers, log2(n) stages round a few times (4 covers the radices in
 * use). */
static void one_ranks_spectra_match_the_plain_transform(void **state)
{
    (void)state;
    for (int k = 0; k < SHAPES; k++) {
        struct fixture f;
        struct v2v_fft2 *fft = NULL;
        float *padded = NULL;
        struct v2v_complex *plain = NULL;
        double difference = 0, size = 0;
        setup(&f, &shapes[k]);
        const int64_t half = f.s.nx / 2 + 1;
        assert_ok(v2v_fft2_create(&fft, f.s.ny, f.s.nx));
        assert_ok(V2V_ALLOC(padded, "test", f.s.ny * f.s.nx));
        assert_ok(V2V_ALLOC(plain, "test", f.s.ny * half));
        for (int64_t y = 0; y < f.s.height; y++) {
            memcpy(padded + y * f.s.nx, f.frames + y * f.s.width,
                   (size_t)f.s.width * sizeof *padded);
        }
        v2v_fft2_forward(fft, plain, padded);
        v2v_fft_slabs_forward(f.alone, f.spectra, f.stride, f.frames, 1);
        for (int64_t i = 0; i < f.s.ny * half; i++) {
            const struct v2v_complex a = plain[i], b = f.spectra[i % half * f.s.ny + i / half];
            const double re = (double)a.re - b.re, im = (double)a.im - b.im;
            difference += re * re + im * im;
            size += (double)a.re * a.re + (double)a.im * a.im;
        }
        const double stages = log2((double)(f.s.ny * f.s.nx)) + 2;
        assert_true(sqrt(difference) <= 2 * 4 * stages * FLT_EPSILON * sqrt(size));
        v2v_mem_free(plain);
        v2v_mem_free(padded);
        v2v_fft2_destroy(&fft);
        teardown(&f);
    }
}

static void any_number_of_ranks_gives_the_same_bits(void **state)
{
    (void)state;
    for (int k = 0; k < SHAPES; k++) {
        struct fixture f;
        setup(&f, &shapes[k]);
        const size_t held = v2v_mem_held(), peak = v2v_mem_peak();
        v2v_fft_slabs_forward(f.alone, f.spectra, f.stride, f.frames, FRAMES);
        v2v_fft_slabs_forward(f.together, f.my_spectra, f.my_stride, f.mine, FRAMES);
        for (int64_t i = 0; i < FRAMES; i++) {
            assert_memory_equal(f.my_spectra + i * f.my_stride,
                                f.spectra + i * f.stride + f.columns.first * f.s.ny,
                                (size_t)(f.columns.count * f.s.ny) * sizeof *f.spectra);
        }
        v2v_fft_slabs_inverse(f.alone, f.restored, 0.25f, f.spectra, f.stride, FRAMES);
        v2v_fft_slabs_inverse(f.together, f.mine, 0.25f, f.my_spectra, f.my_stride, FRAMES);
        const int64_t width = f.s.width, rows = f.rows.count;
        for (int64_t i = 0; i < FRAMES && rows > 0; i++) {
            assert_memory_equal(f.mine + i * rows * width,
                                f.restored + (i * f.s.height + f.rows.first) * width,
                                (size_t)(rows * width) * sizeof *f.mine);
        }
        assert_true(v2v_mem_held() == held && v2v_mem_peak() == peak);
        teardown(&f);
    }
}

static void inverse_returns_the_frames_and_keeps_the_spectra(void **state)
{
    (void)state;
    for (int k = 0; k < SHAPES; k++) {
        struct fixture f;
        struct v2v_complex *kept = NULL;
        setup(&f, &shapes[k]);
        const int64_t count = FRAMES * f.rows.count * f.s.width, numbers = FRAMES * f.my_stride;
        assert_ok(V2V_ALLOC(kept, "test", numbers));
        v2v_fft_slabs_forward(f.together, f.my_spectra, f.my_stride, f.mine, FRAMES);
        memcpy(kept, f.my_spectra, (size_t)numbers * sizeof *kept);
        v2v_fft_slabs_inverse(f.together, f.restored, (float)(1.0 / (double)(f.s.ny * f.s.nx)),
                              f.my_spectra, f.my_stride, FRAMES);
        assert_memory_equal(kept, f.my_spectra, (size_t)numbers * sizeof *kept);
        const double stages = log2((double)(f.s.ny * f.s.nx)) + 2;
        assert_true(test_relative_l2(f.restored, f.mine, count) <= 2 * 4 * stages * FLT_EPSILON);
        v2v_mem_free(kept);
        teardown(&f);
    }
}

/* The rows of a frame as an image of its own: once in place, once with the rows around row 0. */
static void an_image_that_all_ranks_have_gets_the_same_bits(void **state)
{
    (void)state;
    for (int k = 0; k < SHAPES; k++) {
        struct fixture f;
        float *image = NULL;
        setup(&f, &shapes[k]);
        assert_ok(V2V_ALLOC(image, "test", f.s.height * f.s.nx));
        for (int64_t y = 0; y < f.s.height; y++) {
            memcpy(image + y * f.s.nx, f.frames + y * f.s.width, (size_t)f.s.width * sizeof *image);
        }
        v2v_fft_slabs_forward(f.alone, f.spectra, f.stride, f.frames, 1);
        const struct v2v_complex *expected = f.spectra + f.columns.first * f.s.ny;
        const int64_t numbers = f.columns.count * f.s.ny;
        v2v_fft_slabs_local(f.together, f.my_spectra, image, 0, f.s.height);
        assert_memory_equal(f.my_spectra, expected, (size_t)numbers * sizeof *expected);
        v2v_fft_slabs_local(f.together, f.my_spectra, image, -f.s.ny, f.s.height);
        assert_memory_equal(f.my_spectra, expected, (size_t)numbers * sizeof *expected);
        /* One row down turns frequency ky by -2 pi ky / ny. */
        v2v_fft_slabs_local(f.together, f.my_spectra, image, 1, f.s.height);
        double difference = 0, size = 0;
        for (int64_t i = 0; i < numbers; i++) {
            const double angle = -2 * acos(-1) * (double)(i % f.s.ny) / (double)f.s.ny;
            const double re = expected[i].re * cos(angle) - expected[i].im * sin(angle);
            const double im = expected[i].re * sin(angle) + expected[i].im * cos(angle);
            difference += pow(re - f.my_spectra[i].re, 2) + pow(im - f.my_spectra[i].im, 2);
            size += re * re + im * im;
        }
        const double stages = log2((double)(f.s.ny * f.s.nx)) + 2;
        assert_true(sqrt(difference) <= 2 * 4 * stages * FLT_EPSILON * sqrt(size));
        v2v_mem_free(image);
        teardown(&f);
    }
}

static void one_rank_short_of_memory_fails_creation_on_all(void **state)
{
    struct v2v_fft_slabs *fft = NULL;
    (void)state;
    if (v2v_comm_rank(test_world()) == v2v_comm_size(test_world()) - 1) {
        v2v_mem_set_limit(v2v_mem_held() + 1000);
    }
    const size_t held = v2v_mem_held();
    assert_int_equal(v2v_fft_slabs_create(&fft, &shapes[2], test_world()), V2V_E_MEMORY);
    v2v_mem_set_limit(0);
    assert_null(fft);
    assert_int_equal(v2v_mem_held(), held);
}

static void the_bytes_of_the_fullest_rank_are_foretold(void **state)
{
    (void)state;
    for (int k = 0; k < SHAPES; k++) {
        struct v2v_fft_slabs *fft = NULL;
        const int size = v2v_comm_size(test_world());
        const size_t before = v2v_mem_held();
        assert_ok(v2v_fft_slabs_create(&fft, &shapes[k], test_world()));
        int64_t held = (int64_t)(v2v_mem_held() - before);
        v2v_fft_slabs_destroy(&fft);
        v2v_par_max_i64(test_world(), &held, 1);
        /* Beside what FFTW3-MPI's transposition holds for itself. */
        const int64_t beside = shapes[k].uses_fftw3_mpi && size > 1 ? 1024 : 0;
        assert_true(llabs(held - v2v_fft_slabs_bytes(&shapes[k], size)) <= beside);
    }
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rows_and_columns_of_all_ranks_cover_the_frame_once),
        cmocka_unit_test(one_ranks_spectra_match_the_plain_transform),
        cmocka_unit_test(any_number_of_ranks_gives_the_same_bits),
        cmocka_unit_test(inverse_returns_the_frames_and_keeps_the_spectra),
        cmocka_unit_test(an_image_that_all_ranks_have_gets_the_same_bits),
        cmocka_unit_test(one_rank_short_of_memory_fails_creation_on_all),
        cmocka_unit_test(the_bytes_of_the_fullest_rank_are_foretold),
    };
    return test_mpi_main(tests, argc, argv);
}
