/* Projection by slices, by slabs and by slabs through FFTW3-MPI, measured in turn and predicted,
 * with their errors against plain sums in double precision.
 *   mpirun -n RANKS bench_projector PSF [SIDE [TURNS]] */
#include "twin_projector.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/cost.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/optics/psf.h"
#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>

enum { SPLITS = 3, KINDS = 4, MOST_TURNS = 101, SAMPLES = 64 };
static const enum v2v_split splits[SPLITS] = {V2V_SPLIT_SLICES, V2V_SPLIT_SLABS,
                                              V2V_SPLIT_SLABS_FFTW3_MPI};
static const char *const split_names[SPLITS] = {"slices", "slabs", "FFTW3-MPI"};
static const char *const kind_names[KINDS] = {"forward, all views", "adjoint, all views",
                                              "forward, one view", "adjoint, one view"};

struct bench {
    const struct v2v_comm *comm;
    struct v2v_psf_file psf;
    int64_t side;
    float *volume, *views; /* whole: what is projected, and back-projected */
};

struct side {
    struct v2v_projector *projector;
    struct v2v_projector_share share;
    float *volume, *volume_out, *rows, *rows_out; /* of this rank */
    double seconds[KINDS][MOST_TURNS];
    double create_s, error[2];
};

static void cut_volume(const struct bench *bench, struct side *side)
{
    float *to = side->volume;
    for (int64_t z = 0; z < side->share.slices.count; z++) {
        for (int64_t i = 0; i < side->share.rows.count * bench->side; i++) {
            *to++ = bench->volume[((side->share.slices.first + z) * bench->side +
                                   side->share.rows.first) *
                                      bench->side +
                                  i];
        }
    }
}

static enum v2v_status prepare(const struct bench *bench, struct side *side, enum v2v_split split)
{
    enum v2v_status rc = V2V_OK;
    double start = v2v_clock_now();
    V2V_TRY(v2v_projector_create(&side->projector, &bench->psf, bench->side, bench->side, split,
                                 bench->comm));
    side->create_s = v2v_clock_now() - start;
    side->share = v2v_projector_share(side->projector);
    int64_t voxels = side->share.slices.count * side->share.rows.count * bench->side;
    int64_t pixels = bench->psf.views * side->share.view_rows.count * bench->side;
    V2V_TRY(V2V_ALLOC(side->volume, "bench", voxels));
    V2V_TRY(V2V_ALLOC(side->volume_out, "bench", voxels));
    V2V_TRY(V2V_ALLOC(side->rows, "bench", pixels));
    V2V_TRY(V2V_ALLOC(side->rows_out, "bench", pixels));
    cut_volume(bench, side);
    v2v_projector_cut_views(side->projector, side->rows, bench->views, bench->psf.views);
done:
    return rc;
}

static void run(const struct bench *bench, struct side *side, int kind)
{
    const int64_t count = kind < 2 ? bench->psf.views : 1;
    if (kind % 2 == 0) {
        v2v_projector_forward(side->projector, side->rows_out, side->volume, NULL, count, 1.0f);
    } else {
        v2v_projector_adjoint(side->projector, side->volume_out, side->rows, NULL, count, 1.0f);
    }
}

static void measure(const struct bench *bench, struct side *side, int turn)
{
    for (int kind = 0; kind < KINDS; kind++) {
        v2v_par_barrier(bench->comm);
        double start = v2v_clock_now();
        run(bench, side, kind);
        double taken = v2v_clock_now() - start;
        v2v_par_max_f64(bench->comm, &taken, 1);
        side->seconds[kind][turn] = taken;
    }
}

/* Relative L2 error over sampled pixels of this rank's rows and voxels of its share. */
static void judge(const struct bench *bench, struct side *side)
{
    const struct v2v_psf_file *psf = &bench->psf;
    const struct twin_shape shape = {psf->slices, psf->height, psf->width, bench->side,
                                     bench->side};
    const int64_t taps = psf->slices * psf->height * psf->width, frame = bench->side * bench->side;
    double sums[4] = {0};
    run(bench, side, 0);
    run(bench, side, 1);
    for (uint64_t k = 0; k < SAMPLES && side->share.view_rows.count > 0; k++) {
        int64_t v = (int64_t)v2v_random_below(1, 0, k, (uint64_t)psf->views);
        int64_t y = (int64_t)v2v_random_below(1, 1, k, (uint64_t)side->share.view_rows.count);
        int64_t x = (int64_t)v2v_random_below(1, 2, k, (uint64_t)bench->side);
        double exact = twin_pixel(bench->volume, psf->data + v * taps, &shape,
                                  side->share.view_rows.first + y, x);
        double d = side->rows_out[(v * side->share.view_rows.count + y) * bench->side + x] - exact;
        sums[0] += d * d;
        sums[1] += exact * exact;
    }
    int64_t voxels = side->share.slices.count * side->share.rows.count * bench->side;
    for (uint64_t k = 0; k < SAMPLES && voxels > 0; k++) {
        int64_t i = (int64_t)v2v_random_below(2, 0, k, (uint64_t)voxels);
        int64_t z = i / (side->share.rows.count * bench->side), x = i % bench->side;
        int64_t y = i / bench->side % side->share.rows.count + side->share.rows.first;
        double exact = 0;
        for (int64_t v = 0; v < psf->views; v++) {
            exact += twin_voxel(bench->views + v * frame, psf->data + v * taps, &shape,
                                side->share.slices.first + z, y, x);
        }
        double d = side->volume_out[i] - exact;
        sums[2] += d * d;
        sums[3] += exact * exact;
    }
    v2v_par_sum_f64(bench->comm, sums, 4);
    side->error[0] = sqrt(sums[0] / sums[1]);
    side->error[1] = sqrt(sums[2] / sums[3]);
}

static int by_size(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void report(const struct bench *bench, struct side *sides, int turns,
                   const struct v2v_projector_cost *cost)
{
    const int ranks = v2v_comm_size(bench->comm);
    printf("%d ranks x %d threads, %lld x %lld, %lld slices, %lld views; ms, median (least) of %d "
           "turns\n",
           ranks, omp_get_max_threads(), (long long)bench->side, (long long)bench->side,
           (long long)bench->psf.slices, (long long)bench->psf.views, turns);
    printf("transform %.3g ms a frame of 512, product %.3g ns, waiting %.3g us, message %.3g us, "
           "exchange %.3g GB/s a rank\n",
           1e3 * cost->transform_s * 576 * 576 * log2(576 * 576), 1e9 * cost->product_s,
           1e6 * cost->wait_s, 1e6 * cost->network.message_s, 1e-9 / cost->network.byte_s);
    for (int kind = 0; kind < KINDS; kind++) {
        printf("%-20s", kind_names[kind]);
        for (int k = 0; k < SPLITS; k++) {
            struct v2v_projector_times times =
                v2v_projector_predict(cost, &bench->psf, bench->side, bench->side,
                                      kind < 2 ? bench->psf.views : 1, splits[k], ranks);
            double *seconds = sides[k].seconds[kind];
            qsort(seconds, (size_t)turns, sizeof *seconds, by_size);
            printf("  %s %7.1f (%7.1f), predicted %7.1f", split_names[k], 1e3 * seconds[turns / 2],
                   1e3 * seconds[0], 1e3 * (kind % 2 == 0 ? times.forward_s : times.adjoint_s));
        }
        printf("\n");
    }
    for (int k = 0; k < SPLITS; k++) {
        printf("%s: created in %.2f s, error forward %.2g, adjoint %.2g\n", split_names[k],
               sides[k].create_s, sides[k].error[0], sides[k].error[1]);
    }
}

static enum v2v_status bench_run(struct bench *bench, const char *path, int turns)
{
    enum v2v_status rc = V2V_OK;
    static struct side sides[SPLITS];
    struct v2v_projector_cost cost;
    V2V_TRY(v2v_psf_read(&bench->psf, path, "", V2V_NORMALIZE_VIEW, bench->comm));
    int64_t frame = bench->side * bench->side;
    V2V_TRY(V2V_ALLOC(bench->volume, "bench", bench->psf.slices * frame));
    V2V_TRY(V2V_ALLOC(bench->views, "bench", bench->psf.views * frame));
    for (int64_t i = 0; i < bench->psf.slices * frame; i++) {
        bench->volume[i] = (float)v2v_random_uniform(1, 3, (uint64_t)i);
    }
    for (int64_t i = 0; i < bench->psf.views * frame; i++) {
        bench->views[i] = (float)v2v_random_uniform(1, 4, (uint64_t)i);
    }
    V2V_TRY(v2v_projector_cost_measure(&cost, bench->comm));
    for (int k = 0; k < SPLITS; k++) {
        V2V_TRY(prepare(bench, &sides[k], splits[k]));
        judge(bench, &sides[k]);
    }
    for (int turn = 0; turn < turns; turn++) {
        for (int k = 0; k < SPLITS; k++) {
            measure(bench, &sides[k], turn);
        }
    }
    if (v2v_comm_rank(bench->comm) == 0) {
        report(bench, sides, turns, &cost);
    }
done:
    for (int k = 0; k < SPLITS; k++) {
        v2v_mem_free(sides[k].rows_out);
        v2v_mem_free(sides[k].rows);
        v2v_mem_free(sides[k].volume_out);
        v2v_mem_free(sides[k].volume);
        v2v_projector_destroy(&sides[k].projector);
    }
    v2v_mem_free(bench->views);
    v2v_mem_free(bench->volume);
    v2v_psf_file_fini(&bench->psf);
    return rc;
}

int main(int argc, char **argv)
{
    struct v2v_comm *world = NULL;
    if (v2v_par_init(&world, &argc, &argv) != V2V_OK || argc < 2) {
        fprintf(stderr, "%s\n",
                argc < 2 ? "usage: bench_projector PSF [SIDE [TURNS]]" : v2v_status_message());
        return 1;
    }
    long side = argc > 2 ? strtol(argv[2], NULL, 10) : 512;
    long turns = argc > 3 ? strtol(argv[3], NULL, 10) : 11;
    struct bench bench = {.comm = world, .side = side >= 1 && side <= 8192 ? side : 512};
    enum v2v_status rc =
        bench_run(&bench, argv[1], turns >= 1 && turns <= MOST_TURNS ? (int)turns : 11);
    if (rc != V2V_OK) {
        fprintf(stderr, "%s\n", v2v_status_message());
    }
    v2v_par_finalize(&world);
    return rc != V2V_OK;
}
