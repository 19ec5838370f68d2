#include "method/implicit_field.h"

#include "op/panel_kernel.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/clones.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"

#include <math.h>
#include <omp.h>
#include <string.h>

/* The products of a panel of 32 voxels with W2 are those of op/panel_kernel.h; PART voxels at a
 * time share what is read of the sums of W2's gradient. */
enum { PANEL = PANEL_COLUMNS, TILE = PANEL_ROWS, PART = 128 };

/* A row's sums of a neuron, three of the first layer and one of the second, and the lanes that each
 * is taken in. */
enum { SUMS = 4, LANES = 16 };

/* Streams of random numbers. */
enum { STREAM_TABLE = 0x44494e, STREAM_WEIGHTS };

/* Of fresh coordinates, as the paper has it. */
static const double start_range = 1e-4;

/* What a row's sums are: of d h1' over its voxels, [width,width], of d, where a neuron of the
 * second layer is above 0 [width], of all [1]; and dW1, of a coordinate [2,width], db1 [width]. */
struct sums {
    float *product, *lit, *all, *w1, *b1;
};

static struct sums sums_at(const struct v2v_implicit_field *field, float *row)
{
    const int64_t width = field->width;
    float *lit = row + width * width, *w1 = lit + width;
    return (struct sums){row, lit, w1 + 3 * width, w1, w1 + 2 * width};
}

/* Of a thread: the first layer of 32 voxels [width][32], and of PART by panels of neurons
 * [width/32][part][32]; d where the second layer is lit, of 32 voxels [width][32] and of PART by
 * tiles of neurons [width/8][part][8]; a product; lanes of sums [width][4][16]; d of a row. */
struct scratch {
    float *first, *turned, *masked, *tiles, *product, *lanes, *d;
};

static struct scratch scratch_of(const struct v2v_implicit_field *field)
{
    const int64_t panel = field->width * PANEL, part = field->width * PART;
    float *own = field->scratch + omp_get_thread_num() * field->a_scratch;
    float *turned = own + 2 * panel, *product = turned + 2 * part;
    float *lanes = product + TILE * PANEL;
    return (struct scratch){.first = own,
                            .turned = turned,
                            .masked = own + panel,
                            .tiles = turned + part,
                            .product = product,
                            .lanes = lanes,
                            .d = lanes + SUMS * LANES * field->width};
}

static int64_t scratch_floats(int64_t width, int64_t run)
{
    return v2v_mem_product(2 * (PANEL + PART) + SUMS * LANES, width, 1) + TILE * PANEL + run;
}

static struct v2v_implicit_layout layout_of(int64_t width)
{
    struct v2v_implicit_layout at = {.b1 = V2V_IMPLICIT_COORDINATES * width};
    at.w2 = at.b1 + width;
    at.b2 = at.w2 + width * width;
    at.w3 = at.b2 + width;
    at.b3 = at.w3 + width;
    at.count = at.b3 + 1;
    return at;
}

static int64_t run_of(int64_t slices, int64_t columns)
{
    return v2v_round_up(v2v_mem_product(slices, columns, 1), PANEL);
}

static int64_t row_sums_of(int64_t width)
{
    return width * width + 4 * width + 1;
}

enum v2v_status v2v_implicit_field_init(struct v2v_implicit_field *field, int64_t width,
                                        int64_t slices, int64_t height, int64_t columns,
                                        const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const int ranks = v2v_comm_size(comm);
    V2V_ASSERT(width > 0 && width % V2V_IMPLICIT_WIDTHS == 0);
    *field = (struct v2v_implicit_field){.comm = comm,
                                         .slices = slices,
                                         .height = height,
                                         .columns = columns,
                                         .rows = v2v_par_part(height, ranks, v2v_comm_rank(comm)),
                                         .width = width,
                                         .at = layout_of(width),
                                         .run = run_of(slices, columns),
                                         .row_sums = row_sums_of(width)};
    field->a_scratch = scratch_floats(width, field->run);
    const int64_t voxels = v2v_mem_product(field->rows.count, field->run, 1);
    const int64_t numbers = v2v_mem_product(V2V_IMPLICIT_COORDINATES, voxels, 1);
    V2V_TRY(V2V_ALLOC(field->table, "field.table", numbers));
    V2V_TRY(V2V_ALLOC(field->dtable, "field.table", numbers));
    V2V_TRY(V2V_ALLOC(field->raised, "field.layers", voxels));
    V2V_TRY(V2V_ALLOC(field->lit, "field.layers", v2v_mem_product(width / TILE, voxels, 1)));
    V2V_TRY(V2V_ALLOC(field->weights, "field.weights", field->at.count));
    V2V_TRY(V2V_ALLOC(field->dweights, "field.weights", field->at.count));
    V2V_TRY(V2V_ALLOC(field->packed, "field.weights", 2 * width * width));
    V2V_TRY(V2V_ALLOC(field->sums, "field.sums", v2v_mem_product(height, field->row_sums, 1)));
    V2V_TRY(V2V_ALLOC(field->spread, "field.sums", 2 * ranks));
    V2V_TRY(V2V_ALLOC(field->scratch, "field.layers",
                      v2v_mem_product(omp_get_max_threads(), field->a_scratch, 1)));
    for (int r = 0; r < ranks; r++) {
        const struct v2v_part rows = v2v_par_part(height, ranks, r);
        field->spread[r] = rows.count * field->row_sums;
        field->spread[ranks + r] = rows.first * field->row_sums;
    }
done:
    return rc;
}

void v2v_implicit_field_fini(struct v2v_implicit_field *field)
{
    v2v_mem_free(field->table);
    v2v_mem_free(field->dtable);
    v2v_mem_free(field->raised);
    v2v_mem_free(field->lit);
    v2v_mem_free(field->weights);
    v2v_mem_free(field->dweights);
    v2v_mem_free(field->packed);
    v2v_mem_free(field->sums);
    v2v_mem_free(field->spread);
    v2v_mem_free(field->scratch);
}

int64_t v2v_implicit_field_bytes(int64_t width, int64_t slices, int64_t height, int64_t columns)
{
    const int64_t floats = 2 * V2V_IMPLICIT_COORDINATES + 1; /* of a voxel; and its bits */
    const int64_t of_voxels =
        v2v_mem_product(4 * floats + width / TILE, height, run_of(slices, columns));
    return v2v_mem_bytes(v2v_mem_product(height, row_sums_of(width), 1), of_voxels);
}

static float uniform(double range, uint64_t seed, uint64_t stream, int64_t index)
{
    return (float)(range * (2.0 * v2v_random_uniform(seed, stream, (uint64_t)index) - 1.0));
}

/* Weights and biases of a layer, within 1 / sqrt(its inputs). */
static void draw_layer(const struct v2v_implicit_field *field, int64_t first, int64_t count,
                       int64_t inputs, uint64_t seed)
{
    for (int64_t i = first; i < first + count; i++) {
        field->weights[i] = uniform(1.0 / sqrt((double)inputs), seed, STREAM_WEIGHTS, i);
    }
}

void v2v_implicit_field_draw(const struct v2v_implicit_field *field, uint64_t seed)
{
    const int64_t width = field->width, voxels = field->slices * field->columns;
    memset(field->table, 0,
           (size_t)(field->rows.count * V2V_IMPLICIT_COORDINATES * field->run) * sizeof(float));
#pragma omp parallel for schedule(static)
    for (int64_t y = 0; y < field->rows.count; y++) {
        const int64_t first = (field->rows.first + y) * voxels * V2V_IMPLICIT_COORDINATES;
        for (int64_t i = 0; i < V2V_IMPLICIT_COORDINATES * voxels; i++) {
            const int64_t at =
                (y * V2V_IMPLICIT_COORDINATES + i / voxels) * field->run + i % voxels;
            field->table[at] = uniform(start_range, seed, STREAM_TABLE, first + i);
        }
    }
    draw_layer(field, field->at.w1, (V2V_IMPLICIT_COORDINATES + 1) * width,
               V2V_IMPLICIT_COORDINATES, seed);
    draw_layer(field, field->at.w2, (width + 1) * width, width, seed);
    draw_layer(field, field->at.w3, width + 1, width, seed);
}

/* ---- forward ---- */

/* first[width][32] = relu(W1 t + b1) of 32 voxels. */
V2V_SIMD_CLONES
static void first_layer(float *restrict first, const float *restrict t0, const float *restrict t1,
                        const float *restrict w1, const float *restrict b1, int64_t width)
{
    for (int64_t k = 0; k < width; k++) {
        const float w = w1[2 * k], u = w1[2 * k + 1], b = b1[k];
#pragma omp simd
        for (int i = 0; i < PANEL; i++) {
            const float h = w * t0[i] + u * t1[i] + b;
            first[k * PANEL + i] = h > 0.0f ? h : 0.0f;
        }
    }
}

/* Of 8 neurons and 32 voxels, whose sums `product` becomes their values: bits, and what they add to
 * the output. One condition a loop: of two, a branch is made. */
V2V_SIMD_CLONES
static void second_layer(float *restrict raised, uint8_t *restrict lit, float *restrict product,
                         const float *restrict b2, const float *restrict w3)
{
    int32_t bits[PANEL] = {0};
    for (int j = 0; j < TILE; j++) {
        float *of = product + j * PANEL;
#pragma omp simd
        for (int i = 0; i < PANEL; i++) {
            const float h = of[i] + b2[j];
            of[i] = h > 0.0f ? h : 0.0f;
        }
#pragma omp simd
        for (int i = 0; i < PANEL; i++) {
            raised[i] += w3[j] * of[i];
        }
#pragma omp simd
        for (int i = 0; i < PANEL; i++) {
            bits[i] |= (of[i] > 0.0f) << j;
        }
    }
#pragma omp simd
    for (int i = 0; i < PANEL; i++) {
        lit[i] = (uint8_t)bits[i];
    }
}

static void forward_row(struct v2v_implicit_field *field, const struct panel_kernel *kernel,
                        int64_t y)
{
    const struct scratch s = scratch_of(field);
    const struct v2v_implicit_layout *at = &field->at;
    const float *w = field->weights;
    const float *t = field->table + y * V2V_IMPLICIT_COORDINATES * field->run;
    for (int64_t i = 0; i < field->run; i += PANEL) {
        float *raised = field->raised + y * field->run + i;
        first_layer(s.first, t + i, t + field->run + i, w + at->w1, w + at->b1, field->width);
        for (int p = 0; p < PANEL; p++) {
            raised[p] = 1.0f + w[at->b3];
        }
        for (int64_t j = 0; j < field->width; j += TILE) {
            kernel->product(s.product, field->packed + j * field->width, s.first, field->width, 0);
            second_layer(raised, field->lit + (y * field->width / TILE + j / TILE) * field->run + i,
                         s.product, w + at->b2 + j, w + at->w3 + j);
        }
    }
}

/* [width/8][width][8]: for the forward pass W2 by tiles of its outputs, for the backward pass w3 W2
 * by tiles of its inputs. */
static void pack(struct v2v_implicit_field *field)
{
    const int64_t width = field->width;
    const float *w2 = field->weights + field->at.w2, *w3 = field->weights + field->at.w3;
    float *forward = field->packed, *backward = forward + width * width;
    for (int64_t j = 0; j < width; j++) {
        for (int64_t k = 0; k < width; k++) {
            const float w = w2[j * width + k];
            forward[(j / TILE * width + k) * TILE + j % TILE] = w;
            backward[(k / TILE * width + j) * TILE + k % TILE] = w3[j] * w;
        }
    }
}

/* A row [z,x] of the volume [z,y,x]. */
static void put_row(const struct v2v_implicit_field *field, float *volume, int64_t y)
{
    const int64_t columns = field->columns;
    for (int64_t z = 0; z < field->slices; z++) {
        const float *from = field->raised + y * field->run + z * columns;
        float *to = volume + (z * field->rows.count + y) * columns;
        for (int64_t x = 0; x < columns; x++) {
            to[x] = fabsf(from[x]);
        }
    }
}

void v2v_implicit_field_forward(struct v2v_implicit_field *field, float *volume)
{
    const struct panel_kernel *kernel = v2v_panel_choose();
    pack(field);
#pragma omp parallel for schedule(dynamic)
    for (int64_t y = 0; y < field->rows.count; y++) {
        forward_row(field, kernel, y);
        put_row(field, volume, y);
    }
}

/* ---- backward ---- */

/* By panels of neurons: turned[width/32][count][32], `part` voxels apart. */
V2V_SIMD_CLONES
static void first_layer_turned(float *restrict turned, const float *restrict t0,
                               const float *restrict t1, const float *restrict w1,
                               const float *restrict b1, int64_t width, int64_t count)
{
    float w[PANEL], u[PANEL];
    for (int64_t k = 0; k < width; k += PANEL) {
        for (int j = 0; j < PANEL; j++) {
            w[j] = w1[2 * (k + j)];
            u[j] = w1[2 * (k + j) + 1];
        }
        float *to = turned + k * PART;
        for (int64_t i = 0; i < count; i++) {
#pragma omp simd
            for (int j = 0; j < PANEL; j++) {
                const float h = w[j] * t0[i] + u[j] * t1[i] + b1[k + j];
                to[i * PANEL + j] = h > 0.0f ? h : 0.0f;
            }
        }
    }
}

/* d where the 8 neurons are lit, as [8][32]; and its sums, the last of the lanes [8][4][16]. */
V2V_SIMD_CLONES
static void mask(float *restrict masked, float *restrict lanes, const float *restrict d,
                 const uint8_t *restrict lit)
{
    for (int j = 0; j < TILE; j++) {
        float *of = masked + j * PANEL, *sum = lanes + (j * SUMS + SUMS - 1) * LANES;
#pragma omp simd
        for (int i = 0; i < PANEL; i++) {
            of[i] = lit[i] >> j & 1 ? d[i] : 0.0f;
        }
        for (int i = 0; i < PANEL; i += LANES) {
#pragma omp simd
            for (int l = 0; l < LANES; l++) {
                sum[l] += of[i + l];
            }
        }
    }
}

/* Through the first layer, of 8 neurons and 32 voxels whose gradient is `product`.
 * @param lanes [8][4][16]: of sums of g t0, g t1 and g over voxels */
V2V_SIMD_CLONES
static void first_backward(float *restrict d0, float *restrict d1, float *restrict lanes,
                           const float *restrict product, const float *restrict first,
                           const float *restrict t0, const float *restrict t1,
                           const float *restrict w1)
{
    for (int k = 0; k < TILE; k++) {
        float *a = lanes + k * SUMS * LANES, *b = a + LANES, *c = b + LANES;
        for (int i = 0; i < PANEL; i += LANES) {
            const float *g = product + k * PANEL + i, *h = first + k * PANEL + i;
#pragma omp simd
            for (int l = 0; l < LANES; l++) {
                const float lit = h[l] > 0.0f ? g[l] : 0.0f;
                d0[i + l] += w1[2 * k] * lit;
                d1[i + l] += w1[2 * k + 1] * lit;
                a[l] += lit * t0[i + l];
                b[l] += lit * t1[i + l];
                c[l] += lit;
            }
        }
    }
}

/* The sums of a row, of its lanes. */
static void add_lanes(const struct sums *sums, const float *lanes, int64_t width)
{
    float *const to[SUMS] = {sums->w1, sums->w1 + width, sums->b1, sums->lit};
    for (int64_t i = 0; i < SUMS * width; i++) {
        float sum = 0.0f;
        for (int l = 0; l < LANES; l++) {
            sum += lanes[i * LANES + l];
        }
        to[i % SUMS][i / SUMS] = sum;
    }
}

/* PART voxels or fewer of a row, from `i` on. */
static void backward_part(struct v2v_implicit_field *field, const struct panel_kernel *kernel,
                          const struct sums *sums, int64_t y, int64_t i, int64_t count)
{
    const struct scratch s = scratch_of(field);
    const int64_t width = field->width, run = field->run;
    const float *w1 = field->weights + field->at.w1, *b1 = field->weights + field->at.b1;
    const float *t0 = field->table + y * V2V_IMPLICIT_COORDINATES * run + i, *t1 = t0 + run;
    float *d0 = field->dtable + y * V2V_IMPLICIT_COORDINATES * run + i, *d1 = d0 + run;
    const float *backward = field->packed + width * width;
    for (int64_t p = 0; p < count; p += PANEL) {
        first_layer(s.first, t0 + p, t1 + p, w1, b1, width);
        for (int64_t j = 0; j < width; j += TILE) {
            mask(s.masked + j * PANEL, s.lanes + j * SUMS * LANES, s.d + i + p,
                 field->lit + (y * width / TILE + j / TILE) * run + i + p);
            for (int64_t q = 0; q < PANEL; q += TILE) {
                kernel->turn(s.tiles + j * PART + (p + q) * TILE, TILE, s.masked + j * PANEL + q,
                             PANEL);
            }
        }
        memset(d0 + p, 0, PANEL * sizeof *d0);
        memset(d1 + p, 0, PANEL * sizeof *d1);
        for (int64_t k = 0; k < width; k += TILE) {
            kernel->product(s.product, backward + k * width, s.masked, width, 0);
            first_backward(d0 + p, d1 + p, s.lanes + k * SUMS * LANES, s.product,
                           s.first + k * PANEL, t0 + p, t1 + p, w1 + 2 * k);
        }
    }
    first_layer_turned(s.turned, t0, t1, w1, b1, width, count);
    for (int64_t k = 0; k < width; k += PANEL) {
        for (int64_t j = 0; j < width; j += TILE) { /* tiles [width/32][width][32] */
            kernel->product(sums->product + k * width + j * PANEL, s.tiles + j * PART,
                            s.turned + k * PART, count, 1);
        }
    }
}

/* d[run] = the gradient by the network's output; what fills the row up has none. */
static void take_row(const struct v2v_implicit_field *field, float *d, const float *dvolume,
                     int64_t y)
{
    const int64_t columns = field->columns, voxels = field->slices * columns;
    for (int64_t z = 0; z < field->slices; z++) {
        const float *raised = field->raised + y * field->run + z * columns;
        const float *from = dvolume + (z * field->rows.count + y) * columns;
        for (int64_t x = 0; x < columns; x++) {
            d[z * columns + x] = raised[x] < 0.0f ? -from[x] : from[x];
        }
    }
    memset(d + voxels, 0, (size_t)(field->run - voxels) * sizeof *d);
}

static void backward_row(struct v2v_implicit_field *field, const struct panel_kernel *kernel,
                         const float *dvolume, int64_t y)
{
    float *row = field->sums + (field->rows.first + y) * field->row_sums;
    const struct scratch s = scratch_of(field);
    const struct sums sums = sums_at(field, row);
    memset(row, 0, (size_t)field->row_sums * sizeof *row);
    memset(s.lanes, 0, (size_t)(SUMS * LANES * field->width) * sizeof *s.lanes);
    take_row(field, s.d, dvolume, y);
    for (int64_t i = 0; i < field->run; i++) {
        *sums.all += s.d[i];
    }
    for (int64_t i = 0; i < field->run; i += PART) {
        backward_part(field, kernel, &sums, y, i, v2v_smaller(PART, field->run - i));
    }
    add_lanes(&sums, s.lanes, field->width);
}

/* The network's gradient of the sums over all voxels. */
static void finish(struct v2v_implicit_field *field)
{
    const int64_t width = field->width;
    const struct v2v_implicit_layout *at = &field->at;
    const struct sums sums = sums_at(field, field->sums);
    const float *w = field->weights;
    float *dw = field->dweights;
    for (int64_t j = 0; j < width; j++) {
        double of_w3 = (double)w[at->b2 + j] * (double)sums.lit[j];
        for (int64_t k = 0; k < width; k++) {
            const int64_t panel = k / PANEL * PANEL;
            const float sum = sums.product[panel * width + j * PANEL + k % PANEL];
            of_w3 += (double)w[at->w2 + j * width + k] * (double)sum;
            dw[at->w2 + j * width + k] = w[at->w3 + j] * sum;
        }
        dw[at->w3 + j] = (float)of_w3;
        dw[at->b2 + j] = w[at->w3 + j] * sums.lit[j];
        dw[at->w1 + 2 * j] = sums.w1[j];
        dw[at->w1 + 2 * j + 1] = sums.w1[width + j];
        dw[at->b1 + j] = sums.b1[j];
    }
    dw[at->b3] = *sums.all;
}

void v2v_implicit_field_backward(struct v2v_implicit_field *field, const float *dvolume)
{
    const struct panel_kernel *kernel = v2v_panel_choose();
    const int ranks = v2v_comm_size(field->comm);
#pragma omp parallel for schedule(dynamic)
    for (int64_t y = 0; y < field->rows.count; y++) {
        backward_row(field, kernel, dvolume, y);
    }
    v2v_par_allgather_f32(field->comm, field->sums,
                          field->sums + field->rows.first * field->row_sums, field->spread,
                          field->spread + ranks);
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < field->row_sums; i++) { /* in one order for any number of ranks */
        double sum = 0.0;
        for (int64_t y = 0; y < field->height; y++) {
            sum += (double)field->sums[y * field->row_sums + i];
        }
        field->sums[i] = (float)sum;
    }
    finish(field);
}
