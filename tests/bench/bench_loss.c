/* The loss of a training step, whole on every rank against shared by all, measured in turn.
 *   mpirun -n RANKS bench_loss PSF [SIDE [TURNS]] */
#include "held_out.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include <stdio.h>
#include <stdlib.h>

enum { WAYS = 2, OUTPUTS = 2, MOST_TURNS = 101 };
static const char *const way_names[WAYS] = {"whole", "shared"};

struct way {
    struct v2v_projector *projector;
    struct v2v_loss *loss;
    float *volume[OUTPUTS], *dvolume[OUTPUTS];
    double seconds[MOST_TURNS], terms[V2V_LOSS_TERMS];
    size_t bytes; /* of projector, loss and volumes */
};

static enum v2v_status prepare(struct way *way, const struct v2v_psf_file *psf, int64_t side,
                               const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_config config;
    const size_t held = v2v_mem_held();
    v2v_config_defaults(&config);
    V2V_TRY(v2v_projector_create(&way->projector, psf, side, side, V2V_SPLIT_SLABS, comm));
    const struct v2v_part rows = v2v_projector_share(way->projector).rows;
    struct v2v_loss_setup setup = {.settings = &config.loss,
                                   .psf = psf,
                                   .height = side,
                                   .width = side,
                                   .window = {16, side - 16, 16, side - 16},
                                   .projector = way->projector,
                                   .comm = comm};
    test_hold_out_halves(&setup, psf->views);
    V2V_TRY(v2v_loss_create(&way->loss, &setup));
    for (int o = 0; o < OUTPUTS; o++) {
        const int64_t voxels = psf->slices * rows.count * side;
        V2V_TRY(V2V_ALLOC(way->volume[o], "bench", voxels));
        V2V_TRY(V2V_ALLOC(way->dvolume[o], "bench", voxels));
        for (int64_t i = 0; i < voxels; i++) {
            const int64_t z = i / (rows.count * side), at = i % (rows.count * side);
            const int64_t voxel = (z * side + rows.first) * side + at;
            way->volume[o][i] = (float)v2v_random_uniform(3, (uint64_t)o, (uint64_t)voxel) - 0.1f;
        }
    }
    way->bytes = v2v_mem_held() - held;
done:
    return rc;
}

static double run(struct way *way, const float *views, const struct v2v_comm *world)
{
    const float *const volume[OUTPUTS] = {way->volume[0], way->volume[1]};
    v2v_par_barrier(world);
    const double start = v2v_clock_now();
    v2v_loss_evaluate(way->loss, way->terms, 3, way->dvolume, volume, views);
    double taken = v2v_clock_now() - start;
    v2v_par_max_f64(world, &taken, 1);
    return taken;
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static enum v2v_status bench(const char *path, int64_t side, int turns, struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    static struct way way[WAYS];
    struct v2v_psf_file psf = {0};
    float *views = NULL;
    V2V_TRY(v2v_psf_read(&psf, path, "", V2V_NORMALIZE_VIEW, world));
    V2V_TRY(V2V_ALLOC(views, "bench", psf.views * side * side));
    for (int64_t i = 0; i < psf.views * side * side; i++) {
        views[i] = (float)v2v_random_uniform(3, 9, (uint64_t)i);
    }
    V2V_TRY(prepare(&way[0], &psf, side, NULL));
    V2V_TRY(prepare(&way[1], &psf, side, world));
    for (int turn = 0; turn < turns; turn++) {
        for (int w = 0; w < WAYS; w++) {
            way[w].seconds[turn] = run(&way[w], views, world);
        }
    }
    for (int w = 0; w < WAYS && v2v_comm_rank(world) == 0; w++) {
        qsort(way[w].seconds, (size_t)turns, sizeof(double), compare);
        printf("%d ranks, %-6s  median %7.2f ms, least %7.2f ms  %6.1f MB a rank  loss %.17g\n",
               v2v_comm_size(world), way_names[w], 1e3 * way[w].seconds[turns / 2],
               1e3 * way[w].seconds[0], 1e-6 * (double)way[w].bytes, way[w].terms[V2V_LOSS_TOTAL]);
    }
done:
    for (int w = 0; w < WAYS; w++) {
        for (int o = 0; o < OUTPUTS; o++) {
            v2v_mem_free(way[w].volume[o]);
            v2v_mem_free(way[w].dvolume[o]);
        }
        v2v_loss_destroy(&way[w].loss);
        v2v_projector_destroy(&way[w].projector);
    }
    v2v_mem_free(views);
    v2v_psf_file_fini(&psf);
    return rc;
}

int main(int argc, char **argv)
{
    struct v2v_comm *world = NULL;
    enum v2v_status rc = v2v_par_init(&world, &argc, &argv);
    const int64_t side = argc > 2 ? strtoll(argv[2], NULL, 10) : 128;
    const int turns = argc > 3 ? (int)strtol(argv[3], NULL, 10) : 21;
    if (rc == V2V_OK && (argc < 2 || side < 33 || turns < 1 || turns > MOST_TURNS)) {
        rc = V2V_FAIL(V2V_E_USAGE, "bench_loss PSF [SIDE [TURNS]]");
    }
    if (rc == V2V_OK) {
        rc = bench(argv[1], side, turns, world);
    }
    if (rc != V2V_OK && v2v_comm_rank(world) == 0) {
        fprintf(stderr, "bench_loss: %s\n", v2v_status_message());
    }
    v2v_par_finalize(&world);
    return rc == V2V_OK ? 0 : 1;
}
