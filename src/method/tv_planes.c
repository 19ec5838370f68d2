#include "method/tv_planes.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/clones.h"
#include "v2v3d/base/memory.h"

#include <math.h>
#include <omp.h>
#include <string.h>

enum { SIDES = V2V_TV_SIDES, BEYOND = V2V_TV_BEYOND, DUALS = V2V_TV_DUALS };

/* Lines of a thread, each with a pixel more at either end: three rows of the volume in turn, and
 * three rows of a dual summed up. */
enum { IN_TURN = 3, SUMS = IN_TURN, LINES, ENDS = 2 };

struct v2v_penalty v2v_tv_planes_penalty(const struct v2v_tv_steps *steps)
{
    const double plain = (double)steps->plain, bend = (double)steps->bend;
    const double depth = (double)steps->depth, sigma = (double)steps->sigma;
    return (struct v2v_penalty){.constant = sigma * plain * plain,
                                .differences = sigma,
                                .depth = sigma * depth * depth,
                                .curvature = sigma * bend * bend};
}

void v2v_tv_planes_rescale(struct v2v_tv_planes *planes, float factor)
{
    const int64_t inside = planes->rows * planes->width;
#pragma omp parallel for schedule(static) num_threads(planes->threads)
    for (int64_t z = 0; z < planes->slices; z++) {
        for (int64_t i = z * inside; i < (z + 1) * inside; i++) {
            planes->positive[i] *= factor;
        }
    }
}

int64_t v2v_tv_planes_floats(int64_t slices, int64_t rows, int64_t width)
{
    enum {
        OF_ROWS = DUALS + 2, /* duals, w, volume */
        MORE = 2 * DUALS + 2 * SIDES * BEYOND
    };
    return v2v_mem_product(slices, OF_ROWS * rows + MORE, width);
}

static int64_t dual_floats(const struct v2v_tv_planes *planes)
{
    return (planes->rows + 2) * planes->width;
}

enum v2v_status v2v_tv_planes_init(struct v2v_tv_planes *planes, int64_t slices, int64_t rows,
                                   int64_t width, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const int64_t beside = v2v_mem_product(SIDES * slices, BEYOND, width);
    *planes = (struct v2v_tv_planes){.comm = comm,
                                     .threads = omp_get_max_threads(),
                                     .slices = slices,
                                     .rows = rows,
                                     .width = width};
    V2V_TRY(V2V_ALLOC(planes->volume, "tv.volume", v2v_mem_product(slices, rows, width)));
    V2V_TRY(V2V_ALLOC(planes->beside, "tv.beside", beside));
    V2V_TRY(V2V_ALLOC(planes->edges, "tv.beside", beside));
    for (int i = 0; i < DUALS; i++) {
        V2V_TRY(
            V2V_ALLOC(planes->dual[i], "tv.dual", v2v_mem_product(slices, dual_floats(planes), 1)));
    }
    V2V_TRY(V2V_ALLOC(planes->positive, "tv.dual", v2v_mem_product(slices, rows, width)));
    V2V_TRY(V2V_ALLOC(planes->scratch, "tv.lines",
                      v2v_mem_product(planes->threads, LINES, width + ENDS)));
    V2V_TRY(v2v_transfers_create(&planes->transfers, comm, 2 * SIDES));
done:
    return rc;
}

void v2v_tv_planes_fini(struct v2v_tv_planes *planes)
{
    for (int i = 0; i < DUALS; i++) {
        v2v_mem_free(planes->dual[i]);
    }
    v2v_mem_free(planes->volume);
    v2v_mem_free(planes->beside);
    v2v_mem_free(planes->edges);
    v2v_mem_free(planes->positive);
    v2v_mem_free(planes->scratch);
    v2v_transfers_destroy(&planes->transfers);
}

/* A slice a thread: the first time it is the kernel that clears, page by page. */
void v2v_tv_planes_clear(struct v2v_tv_planes *planes)
{
    const int64_t inside = planes->rows * planes->width;
#pragma omp parallel for schedule(static) num_threads(planes->threads)
    for (int64_t z = 0; z < planes->slices; z++) {
        const int64_t of_dual = dual_floats(planes);
        memset(planes->volume + z * inside, 0, (size_t)inside * sizeof(float));
        memset(planes->positive + z * inside, 0, (size_t)inside * sizeof(float));
        for (int i = 0; i < DUALS; i++) {
            memset(planes->dual[i] + z * of_dual, 0, (size_t)of_dual * sizeof(float));
        }
    }
}

/* Row `i` of those beyond this rank's, or of those that others have there. */
static float *beside_row(const struct v2v_tv_planes *planes, float *beside, int side, int64_t z,
                         int64_t i)
{
    return beside + ((side * planes->slices + z) * BEYOND + i) * planes->width;
}

/* Rows -2 .. rows+1. */
static float *row_of(const struct v2v_tv_planes *planes, int64_t z, int64_t y)
{
    if (y < 0) {
        return beside_row(planes, planes->beside, V2V_TV_ABOVE, z, y + BEYOND);
    }
    if (y >= planes->rows) {
        return beside_row(planes, planes->beside, V2V_TV_BELOW, z, y - planes->rows);
    }
    return planes->volume + (z * planes->rows + y) * planes->width;
}

/* Rows -1 .. rows. */
static float *dual_row(const struct v2v_tv_planes *planes, int dual, int64_t z, int64_t y)
{
    return planes->dual[dual] + z * dual_floats(planes) + (y + 1) * planes->width;
}

static float *positive_row(const struct v2v_tv_planes *planes, int64_t z, int64_t y)
{
    return planes->positive + (z * planes->rows + y) * planes->width;
}

static int is_inside(const struct v2v_tv_planes *planes, int64_t y)
{
    return y >= 0 && y < planes->rows;
}

/* Rows of the volume from the neighbours, of a ring of ranks. A rank's first rows are what the one
 * before it has below, its last rows what the one behind it has above. Collective(comm). */
static void exchange(struct v2v_tv_planes *planes)
{
    const int rank = v2v_comm_rank(planes->comm), size = v2v_comm_size(planes->comm);
    const int64_t side = planes->slices * BEYOND * planes->width;
    const size_t bytes = (size_t)planes->width * sizeof(float);
    float *mine = size > 1 ? planes->edges : planes->beside;
    for (int64_t z = 0; z < planes->slices; z++) {
        for (int64_t i = 0; i < BEYOND; i++) { /* alone it may have one row */
            const int64_t first = i % planes->rows, last = planes->rows - 1 - first;
            memcpy(beside_row(planes, mine, V2V_TV_BELOW, z, i), row_of(planes, z, first), bytes);
            memcpy(beside_row(planes, mine, V2V_TV_ABOVE, z, BEYOND - 1 - i),
                   row_of(planes, z, last), bytes);
        }
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

/* A row is periodic: line[-1], line[width]. */
static void close_ring(float *line, int64_t width)
{
    line[-1] = line[width - 1];
    line[width] = line[0];
}

/* sums[-1..width] = above + 2 * here + below. */
V2V_SIMD_CLONES
static void sum_rows(float *restrict sums, const float *above, const float *here,
                     const float *below, int64_t width)
{
#pragma omp simd
    for (int64_t x = 0; x < width; x++) {
        sums[x] = above[x] + 2.0f * here[x] + below[x];
    }
    close_ring(sums, width);
}

/* (1 2 1; 2 -12 2; 1 2 1) / 4 at x, of what is here and sums of the rows above, here and below. */
static inline float curvature(float left, float middle, float right, float here)
{
    return 0.25f * (left + 2.0f * middle + right) - 4.0f * here;
}

/* Of one row: what moves its duals. */
struct moving {
    const float *above, *here, *below; /* [-1..width] of the volume */
    const float *behind;               /* the row a slice further, here in the last slice .. */
    float depth;                       /* .. and of no weight */
    float *x, *y, *z, *bent;
};

V2V_SIMD_CLONES
static void move_duals(const struct moving *row, const struct v2v_tv_steps *steps, int64_t width)
{
    const float sigma = steps->sigma, lambda = steps->lambda, relax = steps->relax;
    const float shrink = steps->shrink, depth = sigma * row->depth, bend = sigma * steps->bend;
    const float bound = steps->bound, shrink_bent = steps->shrink_bent;
    const float *above = row->above, *here = row->here, *below = row->below;
    const float *behind = row->behind;
    float *restrict ux = row->x, *restrict uy = row->y, *restrict uz = row->z;
    float *restrict bent = row->bent;
#pragma omp simd
    for (int64_t x = 0; x < width; x++) {
        const float e = here[x], right = here[x + 1];
        const float px = shrink * (ux[x] + sigma * (right - e));
        const float py = shrink * (uy[x] + sigma * (below[x] - e));
        const float pz = shrink * (uz[x] + depth * (behind[x] - e));
        const float norm = sqrtf(px * px + py * py + pz * pz);
        const float factor = norm > lambda ? lambda / norm : 1.0f;
        ux[x] += relax * (px * factor - ux[x]);
        uy[x] += relax * (py * factor - uy[x]);
        uz[x] += relax * (pz * factor - uz[x]);
        const float c = curvature(above[x - 1] + 2.0f * here[x - 1] + below[x - 1],
                                  above[x] + 2.0f * e + below[x],
                                  above[x + 1] + 2.0f * right + below[x + 1], e);
        const float moved = shrink_bent * (bent[x] + bend * c);
        const float low = moved > -bound ? moved : -bound;
        bent[x] += relax * ((low < bound ? low : bound) - bent[x]);
    }
}

V2V_SIMD_CLONES
static void move_positive(float *restrict w, const float *here, float sigma, float sparse,
                          float relax, int64_t width)
{
#pragma omp simd
    for (int64_t x = 0; x < width; x++) {
        const float moved = w[x] + sigma * here[x];
        w[x] += relax * ((moved < sparse ? moved : sparse) - w[x]);
    }
}

/* A line of this thread, from its first pixel on. */
static float *line_of(const struct v2v_tv_planes *planes, int64_t i)
{
    return planes->scratch + (omp_get_thread_num() * LINES + i) * (planes->width + ENDS) + 1;
}

/* Row y >= -BEYOND of the slice at hand. */
static float *line_of_row(const struct v2v_tv_planes *planes, int64_t y)
{
    return line_of(planes, (y + BEYOND) % IN_TURN);
}

static void take_line(const struct v2v_tv_planes *planes, int64_t z, int64_t y)
{
    float *line = line_of_row(planes, y);
    memcpy(line, row_of(planes, z, y), (size_t)planes->width * sizeof *line);
    close_ring(line, planes->width);
}

/* After take_line of y-1, y and y+1. */
static void dual_row_step(struct v2v_tv_planes *planes, const struct v2v_tv_steps *steps, int64_t z,
                          int64_t y)
{
    const int is_last = z + 1 == planes->slices;
    const struct moving row = {.above = line_of_row(planes, y - 1),
                               .here = line_of_row(planes, y),
                               .below = line_of_row(planes, y + 1),
                               .behind = row_of(planes, is_last ? z : z + 1, y),
                               .depth = is_last ? 0.0f : steps->depth,
                               .x = dual_row(planes, V2V_TV_DX, z, y),
                               .y = dual_row(planes, V2V_TV_DY, z, y),
                               .z = dual_row(planes, V2V_TV_DZ, z, y),
                               .bent = dual_row(planes, V2V_TV_CURVATURE, z, y)};
    move_duals(&row, steps, planes->width);
    if (is_inside(planes, y)) {
        move_positive(positive_row(planes, z, y), row.here, steps->sigma * steps->plain,
                      steps->sparse, steps->relax, planes->width);
    }
}

/* The duals that a row of K^T u reads; before: NULL in the first slice; sums: of those of
 * curvature. */
struct duals {
    const float *x, *y, *above, *z, *before, *positive, *bent, *sums;
};

/* gradient = K^T u. */
V2V_SIMD_CLONES
static void sum_duals(float *restrict gradient, const struct duals *u,
                      const struct v2v_tv_steps *steps, int64_t width)
{
    const float depth = steps->depth, bend = steps->bend, plain = steps->plain;
    const float *ux = u->x, *uy = u->y, *above = u->above, *uz = u->z, *w = u->positive;
    const float *sums = u->sums, *bent = u->bent;
    const float *before = u->before != NULL ? u->before : u->z;
    const float before_weight = u->before != NULL ? depth : 0.0f;
#pragma omp simd
    for (int64_t x = 0; x < width; x++) {
        gradient[x] = (above[x] - uy[x]) + (before_weight * before[x] - depth * uz[x]) +
                      (plain * w[x] - ux[x]) +
                      bend * curvature(sums[x - 1], sums[x], sums[x + 1], bent[x]);
    }
    gradient[0] += ux[width - 1];
#pragma omp simd
    for (int64_t x = 1; x < width; x++) {
        gradient[x] += ux[x - 1];
    }
}

static void gradient_row(struct v2v_tv_planes *planes, const struct v2v_tv_steps *steps, int64_t z,
                         int64_t y)
{
    float *sums = line_of(planes, SUMS);
    const struct duals duals = {.x = dual_row(planes, V2V_TV_DX, z, y),
                                .y = dual_row(planes, V2V_TV_DY, z, y),
                                .above = dual_row(planes, V2V_TV_DY, z, y - 1),
                                .z = dual_row(planes, V2V_TV_DZ, z, y),
                                .before = z > 0 ? dual_row(planes, V2V_TV_DZ, z - 1, y) : NULL,
                                .positive = positive_row(planes, z, y),
                                .bent = dual_row(planes, V2V_TV_CURVATURE, z, y),
                                .sums = sums};
    sum_rows(sums, dual_row(planes, V2V_TV_CURVATURE, z, y - 1), duals.bent,
             dual_row(planes, V2V_TV_CURVATURE, z, y + 1), planes->width);
    sum_duals(row_of(planes, z, y), &duals, steps, planes->width);
}

/* A slice after the other, and of it row by row, as long as they are in the cache: its duals, then
 * the volume's row before, which no later row reads. A thread's first and last row, which those of
 * other threads read, wait for all. */
void v2v_tv_planes_step(struct v2v_tv_planes *planes, const struct v2v_tv_steps *steps)
{
    const int64_t rows = planes->rows, slices = planes->slices;
    exchange(planes);
#pragma omp parallel num_threads(planes->threads)
    {
        const struct v2v_part part =
            v2v_par_part(rows + 2, omp_get_num_threads(), omp_get_thread_num());
        const int64_t first = part.first - 1, end = first + part.count;
        for (int64_t z = 0; z < slices && part.count > 0; z++) {
            take_line(planes, z, first - 1);
            take_line(planes, z, first);
            for (int64_t y = first; y < end; y++) {
                take_line(planes, z, y + 1);
                dual_row_step(planes, steps, z, y);
                if (y > first + 1) {
                    gradient_row(planes, steps, z, y - 1);
                }
            }
        }
#pragma omp barrier
        const int64_t from = v2v_larger(first, 0), to = v2v_smaller(end, rows);
        for (int64_t z = 0; z < slices && part.count > 0; z++) {
            for (int64_t y = from; y < to; y++) {
                if (y <= first || y >= end - 1) {
                    gradient_row(planes, steps, z, y);
                }
            }
        }
    }
}

void v2v_tv_planes_gradient(struct v2v_tv_planes *planes, const struct v2v_tv_steps *steps)
{
#pragma omp parallel for collapse(2) schedule(static) num_threads(planes->threads)
    for (int64_t z = 0; z < planes->slices; z++) {
        for (int64_t y = 0; y < planes->rows; y++) {
            gradient_row(planes, steps, z, y);
        }
    }
}
