/* An iteration of total variation beside its floor: the transforms of its slices, and one reading
 * of the OTFs and of the inverses from memory; both with the threads of the iteration. The
 * transforms are those of the iteration, and for a second floor FFTW's, planned by measuring.
 *   bench_tv PSF [SIDE [TURNS]] */
#include "method/tv_planes.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/clones.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/fft/slabs.h"
#include "v2v3d/optics/data_step.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/tensor/statistics.h"
#include <fftw3.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>

enum {
    DATA_STEP,
    EXTEND,
    PLANES,
    TRANSFORMS,
    FFTW,
    READING,
    PARTS,
    MOST_TURNS = 101,
    EXTEND_EVERY = 2,
    SUMS = 128
};
static const char *const names[PARTS] = {"data step",  "views beyond the frame", "differences",
                                         "transforms", "transforms by FFTW",     "one reading"};

struct bench {
    struct v2v_psf_file psf;
    struct v2v_torus torus;
    struct v2v_data_step *step;
    struct v2v_tv_planes planes;
    struct v2v_fft_slabs *fft;
    fftwf_plan forward, inverse; /* of a slice */
    struct v2v_complex *spectra;
    float *views, *factors;
    int64_t stride, factor_floats;
    float seconds[PARTS][MOST_TURNS]; /* by turn */
    double factor_s;
    float sink;
};

static const struct v2v_tv_steps steps = {.lambda = 0.05f,
                                          .depth = 0.25f,
                                          .plain = 0.5f,
                                          .bend = 0.5f,
                                          .bound = 0.05f,
                                          .sigma = 0.01f,
                                          .shrink = 1.0f,
                                          .shrink_bent = 1.0f,
                                          .relax = 1.8f};

static enum v2v_status prepare(struct bench *bench, int64_t side)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_psf_file *psf = &bench->psf;
    V2V_TRY(V2V_ALLOC(bench->views, "bench", psf->views * side * side));
    for (int64_t i = 0; i < psf->views * side * side; i++) {
        bench->views[i] = (float)(i % 17);
    }
    bench->torus = v2v_data_step_torus_of(psf, side, side);
    V2V_TRY(
        v2v_data_step_create(&bench->step, psf, side, side, &bench->torus, V2V_SPLIT_SLABS, NULL));
    const struct v2v_penalty penalty = v2v_tv_planes_penalty(&steps);
    const double began = v2v_clock_now();
    v2v_data_step_factor(bench->step, &penalty);
    bench->factor_s = v2v_clock_now() - began;
    v2v_data_step_begin(bench->step, bench->views, 1.0);
    v2v_data_step_clear(bench->step);
    const int64_t height = bench->torus.height, width = bench->torus.width;
    V2V_TRY(v2v_tv_planes_init(&bench->planes, psf->slices, height, width, NULL));
    v2v_tv_planes_clear(&bench->planes);
    const struct v2v_fft_shape shape = {height, width, height, width, psf->slices, 0};
    V2V_TRY(v2v_fft_slabs_create(&bench->fft, &shape, NULL));
    bench->stride = (height * (width / 2 + 1) + 7) / 8 * 8;
    V2V_TRY(V2V_ALLOC(bench->spectra, "bench", psf->slices * bench->stride));
    fftwf_complex *spectrum = (void *)bench->spectra;
    bench->forward = fftwf_plan_dft_r2c_2d((int)height, (int)width, bench->planes.volume, spectrum,
                                           FFTW_MEASURE);
    bench->inverse = fftwf_plan_dft_c2r_2d((int)height, (int)width, spectrum, bench->planes.volume,
                                           FFTW_MEASURE);
    if (bench->forward == NULL || bench->inverse == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_MEMORY, "no room to plan FFTW's transforms"));
    }
    const int64_t pairs = psf->views * (psf->views + 1) / 2;
    bench->factor_floats = 2 * bench->stride * (psf->views * psf->slices + pairs);
    V2V_TRY(V2V_ALLOC(bench->factors, "bench", bench->factor_floats));
    for (int64_t i = 0; i < bench->factor_floats; i++) {
        bench->factors[i] = 1.0f; /* pages of its own */
    }
done:
    return rc;
}

/* Enough sums side by side that memory alone decides. */
V2V_SIMD_CLONES
static float sum_of(const float *x, int64_t count)
{
    float sums[SUMS] = {0}, sum = 0.0f;
    for (int64_t i = 0; i + SUMS <= count; i += SUMS) {
#pragma omp simd
        for (int k = 0; k < SUMS; k++) {
            sums[k] += x[i + k];
        }
    }
    for (int k = 0; k < SUMS; k++) {
        sum += sums[k];
    }
    return sum;
}

static void read_factors(struct bench *bench)
{
    float sum = 0.0f;
#pragma omp parallel reduction(+ : sum)
    {
        const struct v2v_part part =
            v2v_par_part(bench->factor_floats, omp_get_num_threads(), omp_get_thread_num());
        sum += sum_of(bench->factors + part.first, part.count);
    }
    bench->sink += sum;
}

/* A slice a thread. A torus has even sides: slices are aligned to 16 bytes, as planned. */
static void transform_by_fftw(struct bench *bench)
{
    const int64_t pixels = bench->torus.height * bench->torus.width;
#pragma omp parallel for schedule(dynamic)
    for (int64_t z = 0; z < bench->psf.slices; z++) {
        fftwf_complex *spectrum = (void *)(bench->spectra + z * bench->stride);
        fftwf_execute_dft_r2c(bench->forward, bench->planes.volume + z * pixels, spectrum);
    }
#pragma omp parallel for schedule(dynamic)
    for (int64_t z = 0; z < bench->psf.slices; z++) {
        fftwf_complex *spectrum = (void *)(bench->spectra + z * bench->stride);
        fftwf_execute_dft_c2r(bench->inverse, spectrum, bench->planes.volume + z * pixels);
    }
}

static void run(struct bench *bench, int part)
{
    switch (part) {
    case DATA_STEP:
        v2v_data_step_advance(bench->step, bench->planes.volume, steps.relax);
        break;
    case EXTEND:
        (void)v2v_data_step_extend(bench->step);
        break;
    case PLANES:
        v2v_tv_planes_step(&bench->planes, &steps);
        break;
    case TRANSFORMS:
        v2v_fft_slabs_forward(bench->fft, bench->spectra, bench->stride, bench->planes.volume,
                              bench->psf.slices);
        v2v_fft_slabs_inverse(bench->fft, bench->planes.volume, 1e-6f, bench->spectra,
                              bench->stride, bench->psf.slices);
        break;
    case FFTW:
        transform_by_fftw(bench);
        break;
    default:
        read_factors(bench);
        break;
    }
}

static enum v2v_status report(struct bench *bench, int64_t side, int turns)
{
    enum v2v_status rc = V2V_OK;
    double of[PARTS];
    printf("%d threads, frames of %lld x %lld on a torus of %lld x %lld, %lld slices, %lld views; "
           "ms, median of %d turns\n",
           omp_get_max_threads(), (long long)side, (long long)side, (long long)bench->torus.height,
           (long long)bench->torus.width, (long long)bench->psf.slices, (long long)bench->psf.views,
           turns);
    for (int part = 0; part < PARTS; part++) {
        V2V_TRY(v2v_percentile(&of[part], bench->seconds[part], turns, 50.0));
        printf("%-24s %8.1f\n", names[part], 1e3 * of[part]);
    }
    const double iteration = of[DATA_STEP] + of[PLANES] + of[EXTEND] / EXTEND_EVERY;
    const double floor_s = of[TRANSFORMS] + of[READING], fftw_s = of[FFTW] + of[READING];
    printf("an iteration %.1f, its floor %.1f: %.2f; by FFTW's transforms %.1f: %.2f; inverses, "
           "once: %.1f\n",
           1e3 * iteration, 1e3 * floor_s, iteration / floor_s, 1e3 * fftw_s, iteration / fftw_s,
           1e3 * bench->factor_s);
done:
    return rc;
}

static enum v2v_status bench_run(struct bench *bench, const char *path, int64_t side, int turns)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_psf_read(&bench->psf, path, "", V2V_NORMALIZE_VIEW, NULL));
    V2V_TRY(prepare(bench, side));
    for (int turn = -1; turn < turns; turn++) { /* the first one warms up */
        for (int part = 0; part < PARTS; part++) {
            const double began = v2v_clock_now();
            run(bench, part);
            bench->seconds[part][turn < 0 ? 0 : turn] = (float)(v2v_clock_now() - began);
        }
    }
    V2V_TRY(report(bench, side, turns));
done:
    v2v_data_step_destroy(&bench->step);
    v2v_tv_planes_fini(&bench->planes);
    v2v_fft_slabs_destroy(&bench->fft);
    if (bench->forward != NULL) {
        fftwf_destroy_plan(bench->forward);
    }
    if (bench->inverse != NULL) {
        fftwf_destroy_plan(bench->inverse);
    }
    v2v_mem_free(bench->spectra);
    v2v_mem_free(bench->factors);
    v2v_mem_free(bench->views);
    v2v_psf_file_fini(&bench->psf);
    return rc;
}

int main(int argc, char **argv)
{
    static struct bench bench;
    struct v2v_comm *world = NULL;
    if (v2v_par_init(&world, &argc, &argv) != V2V_OK || argc < 2) {
        fprintf(stderr, "%s\n",
                argc < 2 ? "usage: bench_tv PSF [SIDE [TURNS]]" : v2v_status_message());
        return 1;
    }
    const long side = argc > 2 ? strtol(argv[2], NULL, 10) : 512;
    const long turns = argc > 3 ? strtol(argv[3], NULL, 10) : 11;
    const enum v2v_status rc = bench_run(&bench, argv[1], side >= 1 && side <= 8192 ? side : 512,
                                         turns >= 1 && turns <= MOST_TURNS ? (int)turns : 11);
    if (rc != V2V_OK) {
        fprintf(stderr, "%s\n", v2v_status_message());
    }
    v2v_par_finalize(&world);
    return rc != V2V_OK;
}
