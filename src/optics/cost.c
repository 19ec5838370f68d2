#include "v2v3d/optics/cost.h"
#include "optics/projector_plan.h"
#include "optics/spectrum_block.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include <math.h>
#include <omp.h>

/* What is measured: the frames and the set that the program is made for, but of the OTFs only as
 * many blocks as no second-level cache holds. */
enum { SIDE = 512, SIZE = 576, VIEWS = 13, SLICES = 39, BLOCKS = 256 };

/* One turn takes some 10 ms on an idle core: longer than a process is let run where there are more
 * of them than cores, so that it tells how fast they are together. */
enum { FRAMES = 4, REPEATS = 8 };

struct trial {
    struct v2v_fft_slabs *alone, *together;
    int64_t frames;  /* FRAMES for each thread */
    int64_t shared;  /* as many for each rank */
    int64_t columns; /* of this rank, of their spectra */
    float *frame;
    struct v2v_complex *spectrum;
    float *otf;     /* [block,v,z] */
    float *scratch; /* [thread]: a sum and a block of slices */
    int threads;
};

static const int64_t stride = SIZE * (SIZE / 2 + 1);
static const float factor = 1.0f / (SIZE * SIZE);
static const int64_t scratch_floats = (SLICES + 2) * V2V_BLOCK_FLOATS;

static const struct v2v_fft_shape measured = {SIDE, SIDE, SIZE, SIZE, FRAMES, 0};

/* Room for a rank's part of the shared frames, too. @param threads of the rank that has most */
static enum v2v_status take(struct trial *trial, int64_t threads, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const int64_t ranks = v2v_comm_size(comm);
    const int64_t rows = ranks * v2v_par_part(SIDE, ranks, 0).count;
    const int64_t columns = ranks * v2v_par_part(SIZE / 2 + 1, ranks, 0).count;
    trial->threads = omp_get_max_threads();
    trial->frames = FRAMES * (int64_t)trial->threads;
    trial->shared = FRAMES * threads * ranks;
    trial->columns = v2v_par_part(SIZE / 2 + 1, ranks, v2v_comm_rank(comm)).count;
    V2V_TRY(v2v_fft_slabs_create(&trial->alone, &measured, NULL));
    V2V_TRY(V2V_ALLOC(trial->frame, "optics.cost", FRAMES * threads * rows * SIDE));
    V2V_TRY(V2V_ALLOC(trial->spectrum, "optics.cost", FRAMES * threads * columns * SIZE));
    V2V_TRY(
        V2V_ALLOC(trial->otf, "optics.cost", (int64_t)BLOCKS * VIEWS * SLICES * V2V_BLOCK_FLOATS));
    V2V_TRY(V2V_ALLOC(trial->scratch, "optics.cost", trial->threads * scratch_floats));
done:
    return rc;
}

static void give_back(struct trial *trial)
{
    v2v_mem_free(trial->scratch);
    v2v_mem_free(trial->otf);
    v2v_mem_free(trial->spectrum);
    v2v_mem_free(trial->frame);
    v2v_fft_slabs_destroy(&trial->alone);
    v2v_fft_slabs_destroy(&trial->together);
}

/* There and back, as a projection and its adjoint go. */
static void transform(const void *context)
{
    const struct trial *trial = context;
    v2v_fft_slabs_forward(trial->alone, trial->spectrum, stride, trial->frame, trial->frames);
    v2v_fft_slabs_inverse(trial->alone, trial->frame, factor, trial->spectrum, stride,
                          trial->frames);
}

/* The same share of more frames, of which all ranks have a part: one frame after the other in the
 * same place. */
static void transform_together(const void *context)
{
    const struct trial *trial = context;
    for (int64_t i = 0; i < trial->shared; i++) {
        v2v_fft_slabs_forward(trial->together, trial->spectrum, stride, trial->frame, 1);
        v2v_fft_slabs_inverse(trial->together, trial->frame, factor, trial->spectrum, stride, 1);
    }
}

/* All of them in one call, as projections do, so that one frame's exchange may hide another's
 * work. */
static void transform_at_once(const void *context)
{
    const struct trial *trial = context;
    v2v_fft_slabs_forward(trial->together, trial->spectrum, trial->columns * SIZE, trial->frame,
                          trial->shared);
    v2v_fft_slabs_inverse(trial->together, trial->frame, factor, trial->spectrum,
                          trial->columns * SIZE, trial->shared);
}

static void multiply(const void *context)
{
    const struct trial *trial = context;
#pragma omp parallel for schedule(static) num_threads(trial->threads)
    for (int64_t i = 0; i < (int64_t)REPEATS * BLOCKS; i++) {
        const int64_t b = i % BLOCKS;
        float *scratch = trial->scratch + omp_get_thread_num() * scratch_floats;
        for (int64_t v = 0; v < VIEWS; v++) {
            v2v_block_project((double *)(void *)scratch,
                              trial->otf + (b * VIEWS + v) * SLICES * V2V_BLOCK_FLOATS,
                              scratch + 2 * V2V_BLOCK_FLOATS, SLICES);
        }
    }
}

static double operations(int64_t ny, int64_t nx)
{
    const double n = (double)ny * (double)nx;
    return n * log2(n);
}

/* One case of a prediction. */
struct work {
    const struct v2v_projector_cost *cost;
    struct v2v_projector_layout layout; /* of the first rank, which has most */
    int ranks;
    double frame_s; /* of one frame, on one rank */
    double largest; /* share of the rows and columns that the first rank has */
    double ratio;   /* of frames transformed together, to the own exchange's */
};

/* Frames that each rank transforms by itself, a thread a frame. */
static double alone_s(const struct work *work, int64_t frames)
{
    const int64_t threads = work->cost->threads;
    return (double)((frames + threads - 1) / threads * threads) * work->frame_s;
}

/* Exchanges between pieces of work, in which a rank sends `bytes` in all. */
static double turns_s(const struct work *work, double bytes, double turns)
{
    return turns * work->cost->wait_s +
           v2v_comm_exchange_s(&work->cost->network, work->ranks, bytes, turns);
}

/* Frames that all ranks transform together. */
static double together_s(const struct work *work, int64_t frames)
{
    const struct v2v_fft_shape *shape = &work->layout.shape;
    const double bytes = work->largest * (double)(frames * shape->height * work->layout.half) *
                         sizeof(struct v2v_complex) * (work->ranks - 1) / work->ranks;
    const double batches = ceil((double)frames / (double)v2v_fft_slabs_batch(shape, work->ranks));
    return work->ratio *
           ((double)frames * work->largest * work->frame_s + turns_s(work, bytes, batches));
}

/* Numbers of `size` bytes of all frequencies of `count` views from or to the ranks that own them.
 */
static double owners_s(const struct work *work, int64_t count, size_t size)
{
    const double numbers = (double)(count * work->layout.slice_numbers);
    const double fit = count > 0 ? floor((double)work->layout.views / (double)count) : 1;
    return turns_s(work, numbers * (double)size * (work->ranks - 1) / work->ranks,
                   ceil((double)work->layout.rounds / fit));
}

/* What waiting for one another costs: the ranks' frames transformed together, less the same without
 * the waiting. */
static double waiting(const struct v2v_projector_cost *cost, const struct trial *trial,
                      const struct v2v_comm *comm)
{
    const int ranks = v2v_comm_size(comm);
    struct work work = {.cost = cost, .ranks = ranks, .largest = 1.0 / ranks, .ratio = 1.0};
    work.layout.shape = measured;
    work.layout.half = SIZE / 2 + 1;
    work.frame_s = cost->transform_s * operations(SIZE, SIZE);
    const double taken = v2v_comm_median_s(transform_together, trial, comm);
    return fmax(taken / (2.0 * (double)trial->shared) - together_s(&work, 1), 0.0);
}

/* Waiting by the own exchange, and both exchanges, one after the other. */
static enum v2v_status measure_together(struct v2v_projector_cost *cost, struct trial *trial,
                                        const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_fft_shape shape = measured;
    const double shared = (double)trial->shared;
    V2V_TRY(v2v_fft_slabs_create(&trial->together, &shape, comm));
    cost->wait_s = waiting(cost, trial, comm);
    cost->own_s = v2v_comm_median_s(transform_at_once, trial, comm) / shared;
    v2v_fft_slabs_destroy(&trial->together);
    shape.uses_fftw3_mpi = 1;
    V2V_TRY(v2v_fft_slabs_create(&trial->together, &shape, comm));
    cost->fftw3_mpi_s = v2v_comm_median_s(transform_at_once, trial, comm) / shared;
done:
    return rc;
}

enum v2v_status v2v_projector_cost_measure(struct v2v_projector_cost *cost,
                                           const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct trial trial = {0};
    int64_t threads = omp_get_max_threads();
    v2v_par_max_i64(comm, &threads, 1);
    *cost = (struct v2v_projector_cost){.threads = (int)threads};
    V2V_TRY(v2v_par_agree(comm, take(&trial, threads, comm)));
    cost->transform_s = v2v_comm_median_s(transform, &trial, comm) /
                        (2.0 * (double)trial.frames * operations(SIZE, SIZE));
    cost->product_s = v2v_comm_median_s(multiply, &trial, comm) /
                      ((double)REPEATS * BLOCKS * VIEWS * SLICES * V2V_BLOCK);
    v2v_par_max_f64(comm, &cost->transform_s, 1); /* of the rank with the fewest threads */
    V2V_TRY(v2v_comm_cost_measure(&cost->network, comm));
    if (v2v_comm_size(comm) > 1) {
        V2V_TRY(measure_together(cost, &trial, comm));
    }
done:
    give_back(&trial);
    return rc;
}

/* What the fullest rank transforms of `count` rows or columns. */
static double part_of(int64_t count, int ranks)
{
    const int64_t mine = v2v_par_part(count, ranks, 0).count;
    return (double)v2v_round_up(mine, V2V_FFT_SIDE_BY_SIDE) /
           (double)v2v_round_up(count, V2V_FFT_SIDE_BY_SIDE);
}

struct v2v_projector_times v2v_projector_predict(const struct v2v_projector_cost *cost,
                                                 const struct v2v_psf_file *psf, int64_t height,
                                                 int64_t width, int64_t count, enum v2v_split split,
                                                 int ranks)
{
    struct work work = {.cost = cost, .ranks = ranks, .ratio = 1.0};
    struct v2v_projector_layout *layout = &work.layout;
    if (!v2v_projector_plan(layout, psf, height, width, V2V_BEYOND_ZERO, split, ranks, 0)) {
        return (struct v2v_projector_times){INFINITY, INFINITY};
    }
    const struct v2v_fft_shape *shape = &layout->shape;
    work.frame_s = cost->transform_s * operations(shape->ny, shape->nx);
    work.largest = 0.5 * (part_of(height, ranks) + part_of(layout->half, ranks));
    if (split == V2V_SPLIT_SLABS_FFTW3_MPI && ranks > 1 && cost->own_s > 0) {
        work.ratio = cost->fftw3_mpi_s / cost->own_s;
    }
    const double products =
        cost->product_s * (double)(layout->slices * count) * (double)layout->slice_numbers;
    struct v2v_projector_times times = {products, products};
    if (split != V2V_SPLIT_SLICES || ranks == 1) {
        times.forward_s += together_s(&work, layout->slices + count);
        times.adjoint_s += together_s(&work, layout->slices + count);
    } else {
        /* Summing up reads as many numbers as the products of one slice. */
        const double summing = cost->product_s * (double)(count * layout->slice_numbers);
        const double frames = alone_s(&work, layout->slices) + together_s(&work, count);
        times.forward_s += frames + summing + owners_s(&work, count, sizeof(struct v2v_partial));
        times.adjoint_s += frames + owners_s(&work, count, sizeof(struct v2v_complex));
    }
    return times;
}

static const enum v2v_split splits[V2V_SPLITS] = {V2V_SPLIT_SLICES, V2V_SPLIT_SLABS,
                                                  V2V_SPLIT_SLABS_FFTW3_MPI};

const char *v2v_split_text(enum v2v_split split)
{
    static const char *const texts[] = {"auto", "slices", "slabs", "slabs through FFTW3-MPI"};
    return texts[split];
}

/* Do parallel.split and parallel.transform leave this choice? */
static int is_allowed(const struct v2v_config *config, enum v2v_split split)
{
    const int wanted = config->parallel.split, transform = config->parallel.transform;
    if (split == V2V_SPLIT_SLICES) {
        return wanted == V2V_SPLIT_AUTO || wanted == V2V_SPLIT_SLICES;
    }
    return wanted != V2V_SPLIT_SLICES &&
           (transform == V2V_TRANSFORM_AUTO ||
            (transform == V2V_TRANSFORM_OWN) == (split == V2V_SPLIT_SLABS));
}

enum v2v_split v2v_projector_faster(double seconds[V2V_SPLITS],
                                    const struct v2v_projector_cost *cost,
                                    const struct v2v_config *config, const struct v2v_psf_file *psf,
                                    int64_t height, int64_t width, int64_t count, int ranks)
{
    int best = -1;
    for (int i = 0; i < V2V_SPLITS; i++) {
        const struct v2v_projector_times times =
            v2v_projector_predict(cost, psf, height, width, count, splits[i], ranks);
        seconds[i] = times.forward_s + times.adjoint_s;
        if (is_allowed(config, splits[i]) && (best < 0 || seconds[i] < seconds[best])) {
            best = i;
        }
    }
    return splits[best];
}

enum v2v_status v2v_projector_choose_split(enum v2v_split *split, const struct v2v_config *config,
                                           const struct v2v_psf_file *psf, int64_t height,
                                           int64_t width, int64_t count,
                                           const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_projector_cost cost;
    double seconds[V2V_SPLITS];
    const int ranks = v2v_comm_size(comm);
    int choices = 0;
    for (int i = V2V_SPLITS - 1; i >= 0; i--) {
        if (is_allowed(config, splits[i])) {
            *split = splits[i];
            choices++;
        }
    }
    if (config->parallel.reproducible && ranks > 1) {
        if (config->parallel.split == V2V_SPLIT_SLICES) {
            return V2V_FAIL(V2V_E_CONFIG,
                            "parallel.reproducible with parallel.split: slices, whose "
                            "sums over ranks may round otherwise: take slabs");
        }
        *split = v2v_split_of_slabs(config);
        return V2V_OK;
    }
    if (ranks == 1 || choices == 1) {
        return V2V_OK;
    }
    rc = v2v_projector_cost_measure(&cost, comm);
    if (rc == V2V_E_MEMORY) { /* the projection itself may well fit */
        v2v_log(V2V_LOG_INFO, "no memory to measure projections: shared by %s",
                v2v_split_text(*split));
        return V2V_OK;
    }
    V2V_TRY(rc);
    *split = v2v_projector_faster(seconds, &cost, config, psf, height, width, count, ranks);
    v2v_par_broadcast(comm, split, (int64_t)sizeof *split, 0); /* processors may round otherwise */
    v2v_log(V2V_LOG_INFO,
            "projection over %d ranks by %s: %.3g ms there and back predicted by slices, %.3g ms "
            "by slabs, %.3g ms by slabs through FFTW3-MPI",
            ranks, v2v_split_text(*split), 1e3 * seconds[0], 1e3 * seconds[1], 1e3 * seconds[2]);
done:
    return rc;
}

enum v2v_split v2v_split_of_slabs(const struct v2v_config *config)
{
    return config->parallel.transform == V2V_TRANSFORM_FFTW3_MPI ? V2V_SPLIT_SLABS_FFTW3_MPI
                                                                 : V2V_SPLIT_SLABS;
}
