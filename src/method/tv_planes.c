#include "method/tv_planes.h"

#include "v2v3d/base/clones.h"
#include "v2v3d/base/memory.h"

#include <math.h>
#include <omp.h>
#include <string.h>

enum { AXES = 3 };

int64_t v2v_tv_planes_floats(int64_t slices, int64_t rows, int64_t width)
{
    enum { OF_ROWS = 6, GHOSTS = 2 + 3 + 2 * V2V_TV_SIDES };
    return v2v_mem_product(slices, OF_ROWS * rows + GHOSTS, width);
}

enum v2v_status v2v_tv_planes_init(struct v2v_tv_planes *planes, int64_t slices, int64_t rows,
                                   int64_t width, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const int64_t beside = v2v_mem_product(V2V_TV_SIDES, slices, width);
    *planes = (struct v2v_tv_planes){.comm = comm,
                                     .threads = omp_get_max_threads(),
                                     .slices = slices,
                                     .rows = rows,
                                     .width = width};
    V2V_TRY(V2V_ALLOC(planes->volume, "tv.volume", v2v_mem_product(slices, rows + 2, width)));
    V2V_TRY(V2V_ALLOC(planes->next, "tv.volume", v2v_mem_product(slices, rows, width)));
    V2V_TRY(V2V_ALLOC(planes->beside, "tv.beside", beside));
    V2V_TRY(V2V_ALLOC(planes->edges, "tv.beside", beside));
    for (int i = 0; i < AXES; i++) {
        V2V_TRY(V2V_ALLOC(planes->dual[i], "tv.dual", v2v_mem_product(slices, rows + 1, width)));
    }
    V2V_TRY(V2V_ALLOC(planes->positive, "tv.dual", v2v_mem_product(slices, rows, width)));
    V2V_TRY(V2V_ALLOC(planes->scratch, "tv.lines", v2v_mem_product(planes->threads, width + 1, 1)));
    V2V_TRY(V2V_ALLOC(planes->of_row, "tv.change", 2 * rows));
    V2V_TRY(v2v_transfers_create(&planes->transfers, comm, 2 * V2V_TV_SIDES));
done:
    return rc;
}

void v2v_tv_planes_fini(struct v2v_tv_planes *planes)
{
    for (int i = 0; i < AXES; i++) {
        v2v_mem_free(planes->dual[i]);
    }
    v2v_mem_free(planes->volume);
    v2v_mem_free(planes->next);
    v2v_mem_free(planes->beside);
    v2v_mem_free(planes->edges);
    v2v_mem_free(planes->positive);
    v2v_mem_free(planes->scratch);
    v2v_mem_free(planes->of_row);
    v2v_transfers_destroy(&planes->transfers);
}

/* A slice a thread: the first time it is the kernel that clears, page by page. */
void v2v_tv_planes_clear(struct v2v_tv_planes *planes)
{
    const int64_t rows = planes->rows, width = planes->width;
#pragma omp parallel for schedule(static) num_threads(planes->threads)
    for (int64_t z = 0; z < planes->slices; z++) {
        const int64_t of_volume = (rows + 2) * width, inside = rows * width;
        const int64_t of_dual = (rows + 1) * width;
        memset(planes->volume + z * of_volume, 0, (size_t)of_volume * sizeof(float));
        memset(planes->next + z * inside, 0, (size_t)inside * sizeof(float));
        memset(planes->positive + z * inside, 0, (size_t)inside * sizeof(float));
        for (int i = 0; i < AXES; i++) {
            memset(planes->dual[i] + z * of_dual, 0, (size_t)of_dual * sizeof(float));
        }
    }
}

/* Rows -1 .. rows of one slice. */
static float *volume_row(const struct v2v_tv_planes *planes, int64_t z, int64_t y)
{
    return planes->volume + (z * (planes->rows + 2) + y + 1) * planes->width;
}

static float *next_row(const struct v2v_tv_planes *planes, int64_t z, int64_t y)
{
    if (y >= 0 && y < planes->rows) {
        return planes->next + (z * planes->rows + y) * planes->width;
    }
    const int side = y < 0 ? V2V_TV_ABOVE : V2V_TV_BELOW;
    return planes->beside + (side * planes->slices + z) * planes->width;
}

/* Rows -1 .. rows-1. */
static float *dual_row(const struct v2v_tv_planes *planes, int axis, int64_t z, int64_t y)
{
    return planes->dual[axis] + (z * (planes->rows + 1) + y + 1) * planes->width;
}

/* Rows of `next` from the neighbours, of a ring of ranks. A rank's first row is what the one before
 * it has below, its last row what the one behind it has above. Collective(comm). */
static void exchange(struct v2v_tv_planes *planes)
{
    const int rank = v2v_comm_rank(planes->comm), size = v2v_comm_size(planes->comm);
    const int64_t side = planes->slices * planes->width;
    float *mine = size > 1 ? planes->edges : planes->beside;
    for (int64_t z = 0; z < planes->slices; z++) {
        const size_t bytes = (size_t)planes->width * sizeof(float);
        memcpy(mine + V2V_TV_BELOW * side + z * planes->width, next_row(planes, z, 0), bytes);
        memcpy(mine + V2V_TV_ABOVE * side + z * planes->width,
               next_row(planes, z, planes->rows - 1), bytes);
    }
    if (size > 1) {
        const int before = (rank + size - 1) % size, behind = (rank + 1) % size;
        v2v_transfers_receive(planes->transfers, planes->beside + V2V_TV_BELOW * side, side,
                              behind);
        v2v_transfers_receive(planes->transfers, planes->beside + V2V_TV_ABOVE * side, side,
                              before);
        v2v_transfers_send(planes->transfers, mine + V2V_TV_BELOW * side, side, before);
        v2v_transfers_send(planes->transfers, mine + V2V_TV_ABOVE * side, side, behind);
        v2v_transfers_wait(planes->transfers);
    }
}

/* line[width+1] = 2 * next - volume of a row, and its first pixel again. */
V2V_SIMD_CLONES
static void extrapolate(float *restrict line, const float *next, const float *volume, int64_t width)
{
#pragma omp simd
    for (int64_t x = 0; x < width; x++) {
        line[x] = 2.0f * next[x] - volume[x];
    }
    line[width] = line[0];
}

/* A row of the volume and what it becomes. */
struct pair {
    const float *volume, *next;
};

static struct pair pair_of(const struct v2v_tv_planes *planes, int64_t z, int64_t y)
{
    return (struct pair){volume_row(planes, z, y), next_row(planes, z, y)};
}

/* Duals of a row, from the extrapolated volume here, and what a row below and a slice further (here
 * again: in the last slice, and of no weight) will be extrapolated from. */
V2V_SIMD_CLONES
static void move_duals(float *restrict ux, float *restrict uy, float *restrict uz,
                       const float *here, struct pair below, struct pair behind, float depth,
                       const struct v2v_tv_steps *steps, int64_t width)
{
    const float sigma = steps->sigma, lambda = steps->lambda;
    const float relax = steps->relax, shrink = steps->shrink;
#pragma omp simd
    for (int64_t x = 0; x < width; x++) {
        const float dy = 2.0f * below.next[x] - below.volume[x] - here[x];
        const float dz = 2.0f * behind.next[x] - behind.volume[x] - here[x];
        const float px = shrink * (ux[x] + sigma * (here[x + 1] - here[x]));
        const float py = shrink * (uy[x] + sigma * dy);
        const float pz = shrink * (uz[x] + sigma * depth * dz);
        const float norm = sqrtf(px * px + py * py + pz * pz);
        const float factor = norm > lambda ? lambda / norm : 1.0f;
        ux[x] += relax * (px * factor - ux[x]);
        uy[x] += relax * (py * factor - uy[x]);
        uz[x] += relax * (pz * factor - uz[x]);
    }
}

V2V_SIMD_CLONES
static void move_positive(float *restrict w, const float *here, float sigma, float relax,
                          int64_t width)
{
#pragma omp simd
    for (int64_t x = 0; x < width; x++) {
        const float moved = w[x] + sigma * here[x];
        w[x] += relax * ((moved < 0.0f ? moved : 0.0f) - w[x]);
    }
}

static float *positive_row(const struct v2v_tv_planes *planes, int64_t z, int64_t y)
{
    return planes->positive + (z * planes->rows + y) * planes->width;
}

static inline void ask_for(const float *row, int64_t width)
{
    enum { LINE = 16 };
    for (int64_t x = 0; x < width; x += LINE) {
        __builtin_prefetch(row + x);
    }
}

/* What dual_row_step reads first of all: rows of all slices in turn are more places than the
 * processor looks ahead in. */
static void ask_for_rows(const struct v2v_tv_planes *planes, int64_t z, int64_t y)
{
    const int64_t width = planes->width;
    for (int axis = 0; axis < AXES; axis++) {
        ask_for(dual_row(planes, axis, z, y), width);
    }
    if (y >= 0) {
        ask_for(positive_row(planes, z, y), width);
    }
    ask_for(volume_row(planes, z, y + 1), width);
    ask_for(next_row(planes, z, y + 1), width);
}

static void dual_row_step(struct v2v_tv_planes *planes, const struct v2v_tv_steps *steps, int64_t z,
                          int64_t y)
{
    const int64_t width = planes->width;
    const int is_last = z + 1 == planes->slices;
    float *here = planes->scratch + omp_get_thread_num() * (width + 1);
    if (!is_last) {
        ask_for_rows(planes, z + 1, y);
    }
    extrapolate(here, next_row(planes, z, y), volume_row(planes, z, y), width);
    move_duals(dual_row(planes, 0, z, y), dual_row(planes, 1, z, y), dual_row(planes, 2, z, y),
               here, pair_of(planes, z, y + 1), pair_of(planes, is_last ? z : z + 1, y),
               is_last ? 0.0f : steps->depth, steps, width);
    if (y >= 0) {
        move_positive(positive_row(planes, z, y), here, steps->sigma, steps->relax, width);
    }
}

/* x <- x + relax * (next - x), as move_row has it to the bit. */
V2V_SIMD_CLONES
static void relax_row(float *restrict volume, const float *next, float relax, int64_t width)
{
#pragma omp simd
    for (int64_t x = 0; x < width; x++) {
        const float d = next[x] - volume[x];
        volume[x] += relax * d;
    }
}

/* The duals that a row of v reads; before: NULL in the first slice. */
struct duals {
    const float *x, *y, *above, *z, *before, *positive;
};

/* relax_row, and next <- x - tau * (K^T u + w). @param squares += those of next - x and of next */
V2V_SIMD_CLONES
static void move_row(double squares[2], float *restrict volume, float *restrict next,
                     const struct duals *u, const struct v2v_tv_steps *steps, int64_t width)
{
    const float relax = steps->relax, tau = steps->tau, depth = steps->depth;
    const float *ux = u->x, *uy = u->y, *above = u->above, *uz = u->z, *w = u->positive;
    const float *before = u->before != NULL ? u->before : u->z;
    const float before_weight = u->before != NULL ? depth : 0.0f;
    double change = 0.0, whole = 0.0;
#pragma omp simd reduction(+ : change, whole)
    for (int64_t x = 0; x < width; x++) {
        const float n = next[x], d = n - volume[x];
        change += (double)d * (double)d;
        whole += (double)n * (double)n;
        volume[x] += relax * d;
        next[x] = volume[x] - tau * ((above[x] - uy[x]) +
                                     (before_weight * before[x] - depth * uz[x]) + (w[x] - ux[x]));
    }
    next[0] -= tau * ux[width - 1];
#pragma omp simd
    for (int64_t x = 1; x < width; x++) {
        next[x] -= tau * ux[x - 1];
    }
    squares[0] += change;
    squares[1] += whole;
}

static void primal_row_step(struct v2v_tv_planes *planes, const struct v2v_tv_steps *steps,
                            int64_t z, int64_t y)
{
    if (y < 0 || y >= planes->rows) {
        relax_row(volume_row(planes, z, y), next_row(planes, z, y), steps->relax, planes->width);
        return;
    }
    const struct duals duals = {.x = dual_row(planes, 0, z, y),
                                .y = dual_row(planes, 1, z, y),
                                .above = dual_row(planes, 1, z, y - 1),
                                .z = dual_row(planes, 2, z, y),
                                .before = z > 0 ? dual_row(planes, 2, z - 1, y) : NULL,
                                .positive = positive_row(planes, z, y)};
    move_row(planes->of_row + 2 * y, volume_row(planes, z, y), next_row(planes, z, y), &duals,
             steps, planes->width);
}

/* A row of all slices after the other, as long as it is in the cache: its duals, then its volume,
 * which no later row reads. The row above does, so that a thread's first row waits for the thread
 * before it. */
void v2v_tv_planes_step(struct v2v_tv_planes *planes, const struct v2v_tv_steps *steps)
{
    exchange(planes);
    memset(planes->of_row, 0, (size_t)(2 * planes->rows) * sizeof *planes->of_row);
#pragma omp parallel num_threads(planes->threads)
    {
        const struct v2v_part part =
            v2v_par_part(planes->rows + 1, omp_get_num_threads(), omp_get_thread_num());
        const int64_t first = part.first - 1, end = first + part.count;
        for (int64_t y = first; y < end; y++) {
            for (int64_t z = 0; z < planes->slices; z++) {
                dual_row_step(planes, steps, z, y);
                if (y > first) {
                    primal_row_step(planes, steps, z, y);
                }
            }
        }
#pragma omp barrier
        for (int64_t z = 0; z < planes->slices && part.count > 0; z++) {
            primal_row_step(planes, steps, z, first);
            if (end == planes->rows) {
                primal_row_step(planes, steps, z, end);
            }
        }
    }
}
