/* Transforms cut over ranks by the own exchange, by FFTW3-MPI's transposition, and by FFTW3-MPI
 * alone, in turn: frames of SIDE x SIDE in zeros, there and back. FFTW3-MPI alone transforms and
 * sends the zeros too: planned by estimate (MEASURE gives other bits from run to run), transposed
 * spectra, a frame after the other.
 *   mpirun -n RANKS bench_slabs [SIDE [FRAMES [TURNS]]] */
#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/fft/slabs.h"
#include <fftw3-mpi.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { KINDS = 6, MOST_TURNS = 101 };
static const char *const names[KINDS] = {"own, forward",        "own, inverse",
                                         "fftw3-mpi, forward",  "fftw3-mpi, inverse",
                                         "FFTW alone, forward", "FFTW alone, inverse"};

struct bench {
    struct v2v_comm *world;
    struct v2v_fft_shape shape;
    struct v2v_fft_slabs *slabs[2]; /* own, fftw3-mpi */
    double planned_s[2];
    int64_t stride;
    float *frames;
    struct v2v_complex *spectra;
    ptrdiff_t first, rows, room; /* of FFTW3-MPI's share: rows, and numbers of a spectrum */
    float *padded, *their_frames;
    fftwf_complex *their_spectra;
    fftwf_plan forward, inverse;
};

static int64_t filled(const struct bench *b)
{
    int64_t left = b->shape.height - b->first;
    return left < 0 ? 0 : left < b->rows ? left : b->rows;
}

static enum v2v_status prepare(struct bench *b)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_fft_shape *s = &b->shape;
    ptrdiff_t columns, first_column;
    for (int i = 0; i < 2; i++) {
        struct v2v_fft_shape shape = *s;
        const double start = v2v_clock_now();
        shape.uses_fftw3_mpi = i;
        V2V_TRY(v2v_fft_slabs_create(&b->slabs[i], &shape, b->world));
        b->planned_s[i] = v2v_clock_now() - start;
    }
    b->stride = v2v_fft_slabs_columns(b->slabs[0]).count * s->ny;
    int64_t pixels = v2v_fft_slabs_rows(b->slabs[0]).count * s->width;
    V2V_TRY(V2V_ALLOC(b->frames, "bench", s->frames * pixels));
    V2V_TRY(V2V_ALLOC(b->spectra, "bench", s->frames * b->stride));
    fftwf_mpi_init();
    b->room = fftwf_mpi_local_size_2d_transposed(s->ny, s->nx / 2 + 1, MPI_COMM_WORLD, &b->rows,
                                                 &b->first, &columns, &first_column);
    V2V_TRY(V2V_ALLOC(b->padded, "bench", 2 * b->room));
    V2V_TRY(V2V_ALLOC(b->their_frames, "bench", s->frames * filled(b) * s->width));
    V2V_TRY(V2V_ALLOC(b->their_spectra, "bench", s->frames * b->room));
    b->forward = fftwf_mpi_plan_dft_r2c_2d(s->ny, s->nx, b->padded, b->their_spectra,
                                           MPI_COMM_WORLD, FFTW_ESTIMATE | FFTW_MPI_TRANSPOSED_OUT);
    b->inverse = fftwf_mpi_plan_dft_c2r_2d(s->ny, s->nx, b->their_spectra, b->padded,
                                           MPI_COMM_WORLD, FFTW_ESTIMATE | FFTW_MPI_TRANSPOSED_IN);
    if (b->forward == NULL || b->inverse == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_MEMORY, "FFTW3-MPI has no plan"));
    }
done:
    return rc;
}

static void their_forward(const struct bench *b)
{
    const int64_t stride = 2 * (b->shape.nx / 2 + 1), width = b->shape.width, rows = filled(b);
    for (int64_t i = 0; i < b->shape.frames; i++) {
        memset(b->padded, 0, (size_t)(b->rows * stride) * sizeof *b->padded);
        for (int64_t y = 0; y < rows; y++) {
            memcpy(b->padded + y * stride, b->their_frames + (i * rows + y) * width,
                   (size_t)width * sizeof *b->padded);
        }
        fftwf_mpi_execute_dft_r2c(b->forward, b->padded, b->their_spectra + i * b->room);
    }
}

static void their_inverse(const struct bench *b, float factor)
{
    const int64_t stride = 2 * (b->shape.nx / 2 + 1), width = b->shape.width, rows = filled(b);
    for (int64_t i = 0; i < b->shape.frames; i++) {
        fftwf_mpi_execute_dft_c2r(b->inverse, b->their_spectra + i * b->room, b->padded);
        for (int64_t k = 0; k < rows * width; k++) {
            b->their_frames[i * rows * width + k] =
                factor * b->padded[k / width * stride + k % width];
        }
    }
}

static double measure(const struct bench *b, int kind)
{
    const struct v2v_fft_shape *s = &b->shape;
    const float factor = 1.0f / (float)(s->ny * s->nx);
    v2v_par_barrier(b->world);
    double start = v2v_clock_now();
    if (kind == 4) {
        their_forward(b);
    } else if (kind == 5) {
        their_inverse(b, factor);
    } else if (kind % 2 == 0) {
        v2v_fft_slabs_forward(b->slabs[kind / 2], b->spectra, b->stride, b->frames, s->frames);
    } else {
        v2v_fft_slabs_inverse(b->slabs[kind / 2], b->frames, factor, b->spectra, b->stride,
                              s->frames);
    }
    double taken = v2v_clock_now() - start;
    v2v_par_max_f64(b->world, &taken, 1);
    return taken;
}

static int by_size(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static long number(int argc, char **argv, int i, long otherwise, long most)
{
    long given = argc > i ? strtol(argv[i], NULL, 10) : otherwise;
    return given >= 1 && given <= most ? given : otherwise;
}

int main(int argc, char **argv)
{
    static double seconds[KINDS][MOST_TURNS];
    struct bench b = {0};
    if (v2v_par_init(&b.world, &argc, &argv) != V2V_OK) {
        fprintf(stderr, "%s\n", v2v_status_message());
        return 1;
    }
    const long side = number(argc, argv, 1, 512, 8192), frames = number(argc, argv, 2, 39, 1000);
    const long turns = number(argc, argv, 3, 11, MOST_TURNS);
    const int64_t size = v2v_fft_good_size(side + side / 8);
    b.shape = (struct v2v_fft_shape){side, side, size, size, frames, 0};
    if (prepare(&b) != V2V_OK) {
        fprintf(stderr, "%s\n", v2v_status_message());
        v2v_par_abort(1);
    }
    for (long turn = 0; turn < turns; turn++) {
        for (int kind = 0; kind < KINDS; kind++) {
            seconds[kind][turn] = measure(&b, kind);
        }
    }
    for (int kind = 0; kind < KINDS && v2v_comm_rank(b.world) == 0; kind++) {
        qsort(seconds[kind], (size_t)turns, sizeof(double), by_size);
        printf("%d ranks, %ld frames of %ld in %lld: %-19s %7.1f ms, least %7.1f\n",
               v2v_comm_size(b.world), frames, side, (long long)size, names[kind],
               1e3 * seconds[kind][turns / 2], 1e3 * seconds[kind][0]);
    }
    if (v2v_comm_rank(b.world) == 0) {
        printf("planned in %.3f s (own), %.3f s (fftw3-mpi)\n", b.planned_s[0], b.planned_s[1]);
    }
    fftwf_destroy_plan(b.forward);
    fftwf_destroy_plan(b.inverse);
    void *memory[] = {b.frames, b.spectra, b.padded, b.their_frames, b.their_spectra};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
    v2v_fft_slabs_destroy(&b.slabs[0]);
    v2v_fft_slabs_destroy(&b.slabs[1]);
    v2v_par_finalize(&b.world);
    return 0;
}
