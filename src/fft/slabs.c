#include "v2v3d/fft/slabs.h"
#include "fft/lanes.h"
#include "fft/transposition.h"
#include "par/comm_mpi.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include <limits.h>
#include <omp.h>
#include <string.h>

/* What a rank sends in one exchange, at most, bytes, unless a frame has more: enough that latency
 * doesn't count, little enough that both sides of two exchanges stay in a second-level cache. */
enum { EXCHANGE = 1 << 20 };

/* Where everything lies; one place, so that v2v_fft_slabs_bytes can't drift. Numbers are complex.
 */
struct layout {
    int64_t half;          /* nx/2+1 */
    int64_t plane;         /* floats of a real or imaginary part of rows or columns in lanes */
    int64_t batch;         /* frames of one exchange, at most */
    int64_t rows, columns; /* of the fullest rank */
    int64_t side;          /* numbers of a route's buffer */
};

/* One exchange: equal pieces from and to each rank r, as large as the fullest ranks'. On the rows'
 * side [r, frame, kx of r, y of this rank], on the columns' side [r, frame, kx of this rank, y of
 * r], or as FFTW3-MPI leaves it: [frame, kx of this rank, r, y of r]. The own exchange finds a
 * rank's piece for itself on the other side already. One rank has one side. */
struct route {
    struct v2v_complex *rows_side, *columns_side;
    MPI_Request *received, *sent; /* [rank]: of the own exchange; all null with FFTW3-MPI */
};

/* Real and imaginary parts, and as many again (fft/lanes.h), and what lies between them, lest they
 * be whole pages apart. */
enum { PLANES = 4, BETWEEN = 4 };

/* Exchanges on their way at once: a rank may be that many ahead of another before it waits. */
enum { ROUTES = 2 };

struct v2v_fft_slabs {
    struct v2v_fft_shape shape;
    struct layout layout;
    const struct v2v_comm *comm;   /* borrowed */
    struct v2v_part rows, columns; /* of this rank */
    int threads;
    struct route route[ROUTES]; /* on one rank: the first one's rows_side, a frame a thread */
    struct v2v_transposition *transposition; /* of the first route; NULL: the own exchange */
    float *planes;                           /* [thread,PLANES,plane] */
    struct v2v_fft_lanes *row, *column;      /* of nx/2 and of ny numbers */
};

static int is_transposed(const struct v2v_fft_shape *shape, int ranks)
{
    return shape->uses_fftw3_mpi && ranks > 1;
}

static int routes_of(const struct v2v_fft_shape *shape, int ranks)
{
    return is_transposed(shape, ranks) ? 1 : ROUTES;
}

/* 0 when the numbers of a frame leave the int that MPI counts in. */
static int layout_plan(struct layout *layout, const struct v2v_fft_shape *shape, int ranks)
{
    const int64_t half = shape->nx / 2 + 1, frame = v2v_mem_product(shape->ny, half, 1);
    if (frame < 0 || frame > INT_MAX) {
        return 0;
    }
    const int64_t rows = v2v_par_part(shape->height, ranks, 0).count;
    const int64_t columns = v2v_par_part(half, ranks, 0).count;
    const int64_t sent = rows * half * (int64_t)sizeof(struct v2v_complex);
    layout->half = half;
    layout->plane = (v2v_larger(half, shape->ny) + BETWEEN) * V2V_LANES;
    layout->batch = v2v_within(EXCHANGE / sent, 1, v2v_smaller(shape->frames, INT_MAX / frame));
    if (ranks == 1) {
        layout->batch = 1;
    }
    layout->rows = rows;
    layout->columns = columns;
    layout->side = layout->batch * rows * columns * ranks;
    return 1;
}

int64_t v2v_fft_slabs_bytes(const struct v2v_fft_shape *shape, int ranks)
{
    struct layout layout;
    if (!layout_plan(&layout, shape, ranks)) {
        return -1;
    }
    const int64_t threads = omp_get_max_threads();
    const int routes = routes_of(shape, ranks);
    const int64_t buffers = ranks == 1 ? threads : 2 * routes;
    const int64_t requests = ranks == 1 ? 0 : 2 * routes * (int64_t)ranks;
    return buffers * layout.side * (int64_t)sizeof(struct v2v_complex) +
           threads * PLANES * layout.plane * (int64_t)sizeof(float) +
           v2v_fft_lanes_bytes(shape->nx / 2) + v2v_fft_lanes_bytes(shape->ny) +
           requests * (int64_t)sizeof(MPI_Request) + (int64_t)sizeof(struct v2v_fft_slabs);
}

int64_t v2v_fft_slabs_batch(const struct v2v_fft_shape *shape, int ranks)
{
    struct layout layout;
    return layout_plan(&layout, shape, ranks) ? layout.batch : 1;
}

static enum v2v_status take_routes(struct v2v_fft_slabs *fft, int size)
{
    enum v2v_status rc = V2V_OK;
    for (int i = 0; i < routes_of(&fft->shape, size) && size > 1; i++) {
        struct route *route = &fft->route[i];
        V2V_TRY(V2V_ALLOC(route->rows_side, "fft.exchange", fft->layout.side));
        V2V_TRY(V2V_ALLOC(route->columns_side, "fft.exchange", fft->layout.side));
        V2V_TRY(V2V_ALLOC(route->received, "fft.exchange", size));
        V2V_TRY(V2V_ALLOC(route->sent, "fft.exchange", size));
        for (int r = 0; r < size; r++) {
            route->received[r] = route->sent[r] = MPI_REQUEST_NULL;
        }
    }
    if (size == 1) {
        V2V_TRY(V2V_ALLOC(fft->route[0].rows_side, "fft.exchange",
                          v2v_mem_product(fft->threads, fft->layout.side, 1)));
    }
done:
    return rc;
}

static enum v2v_status create_local(struct v2v_fft_slabs *fft, const struct v2v_fft_shape *shape,
                                    int size)
{
    enum v2v_status rc = V2V_OK;
    struct layout *layout = &fft->layout;
    const int64_t threads = fft->threads = omp_get_max_threads();
    if (!layout_plan(layout, shape, size)) {
        V2V_TRY(V2V_FAIL(V2V_E_MEMORY, "transforms of %lld x %lld pixels are too large",
                         (long long)shape->ny, (long long)shape->nx));
    }
    V2V_TRY(take_routes(fft, size));
    V2V_TRY(V2V_ALLOC(fft->planes, "fft.lanes", v2v_mem_product(threads, PLANES, layout->plane)));
    V2V_TRY(v2v_fft_lanes_create(&fft->row, shape->nx / 2));
    V2V_TRY(v2v_fft_lanes_create(&fft->column, shape->ny));
done:
    return rc;
}

enum v2v_status v2v_fft_slabs_create(struct v2v_fft_slabs **fft, const struct v2v_fft_shape *shape,
                                     const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const int size = v2v_comm_size(comm), rank = v2v_comm_rank(comm);

    V2V_ASSERT(shape->height >= 1 && shape->width >= 1 && shape->height <= shape->ny &&
               shape->width <= shape->nx && shape->frames >= 1 &&
               shape->ny == v2v_fft_good_size(shape->ny) &&
               shape->nx == v2v_fft_good_size(shape->nx));
    rc = V2V_ALLOC(*fft, "fft.slabs", 1);
    if (rc == V2V_OK) {
        (*fft)->shape = *shape;
        (*fft)->comm = comm;
        (*fft)->rows = v2v_par_part(shape->height, size, rank);
        (*fft)->columns = v2v_par_part(shape->nx / 2 + 1, size, rank);
        rc = create_local(*fft, shape, size);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    if (is_transposed(shape, size)) {
        const struct layout *layout = &(*fft)->layout;
        const struct route *route = &(*fft)->route[0];
        V2V_TRY(v2v_transposition_create(&(*fft)->transposition, route->rows_side,
                                         route->columns_side, layout->rows, layout->columns,
                                         layout->batch, comm));
    }
done:
    if (rc != V2V_OK) {
        v2v_fft_slabs_destroy(fft);
    }
    return rc;
}

void v2v_fft_slabs_destroy(struct v2v_fft_slabs **fft)
{
    struct v2v_fft_slabs *old = *fft;
    if (old == NULL) {
        return;
    }
    v2v_fft_lanes_destroy(&old->row);
    v2v_fft_lanes_destroy(&old->column);
    v2v_transposition_destroy(&old->transposition);
    for (int i = 0; i < ROUTES; i++) {
        v2v_mem_free(old->route[i].rows_side);
        v2v_mem_free(old->route[i].columns_side);
        v2v_mem_free(old->route[i].received);
        v2v_mem_free(old->route[i].sent);
    }
    v2v_mem_free(old->planes);
    v2v_mem_free(old);
    *fft = NULL;
}

struct v2v_part v2v_fft_slabs_rows(const struct v2v_fft_slabs *fft)
{
    return fft->rows;
}

struct v2v_part v2v_fft_slabs_columns(const struct v2v_fft_slabs *fft)
{
    return fft->columns;
}

static struct v2v_lanes thread_lanes(const struct v2v_fft_slabs *fft)
{
    const int64_t plane = fft->layout.plane;
    float *first = fft->planes + omp_get_thread_num() * PLANES * plane;
    return (struct v2v_lanes){first, first + plane, first + 2 * plane, first + 3 * plane};
}

/* Numbers first .. end of all lanes become zero. */
static void clear(const struct v2v_lanes *lanes, int64_t first, int64_t end)
{
    const size_t bytes = (size_t)((end - first) * V2V_LANES) * sizeof *lanes->re;
    memset(lanes->re + first * V2V_LANES, 0, bytes);
    memset(lanes->im + first * V2V_LANES, 0, bytes);
}

/* lanes = spectra of `count` rows of `length` pixels, zeros behind them. */
static void transform_rows(const struct v2v_fft_slabs *fft, struct v2v_lanes *lanes,
                           const float *rows, int64_t length, int64_t count)
{
    const int64_t pairs = length / 2, odd = length % 2;
    v2v_lanes_take(lanes->re, lanes->im, rows, length, pairs, count);
    clear(lanes, pairs, fft->shape.nx / 2);
    for (int64_t j = 0; j < count && odd; j++) {
        lanes->re[pairs * V2V_LANES + j] = rows[j * length + length - 1];
    }
    v2v_fft_lanes_real_forward(fft->row, lanes);
}

/* The way back, times `factor`. */
static void restore_rows(const struct v2v_fft_slabs *fft, struct v2v_lanes *lanes, float *rows,
                         float factor, int64_t length, int64_t count)
{
    const int64_t pairs = length / 2, odd = length % 2;
    v2v_fft_lanes_real_inverse(fft->row, lanes);
    v2v_lanes_give(rows, length, lanes->re, lanes->im, factor, pairs, count);
    for (int64_t j = 0; j < count && odd; j++) {
        rows[j * length + length - 1] = factor * lanes->re[pairs * V2V_LANES + j];
    }
}

/* Where frame i of n begins among the numbers for rank r on the rows' side. */
static int64_t rows_place(const struct v2v_fft_slabs *fft, int r, int64_t n, int64_t i)
{
    return (r * n + i) * fft->layout.columns * fft->layout.rows;
}

/* Where the rows of rank r begin, of column k of frame i of n on the columns' side. */
static int64_t column_place(const struct v2v_fft_slabs *fft, int r, int64_t n, int64_t i, int64_t k)
{
    const int64_t column = i * fft->layout.columns + k;
    const int64_t place = fft->transposition != NULL ? column * v2v_comm_size(fft->comm) + r
                                                     : r * n * fft->layout.columns + column;
    return place * fft->layout.rows;
}

/* Floats from a column to the next one there. */
static int64_t column_stride(const struct v2v_fft_slabs *fft, int64_t n)
{
    return 2 * (column_place(fft, 0, n, 0, 1) - column_place(fft, 0, n, 0, 0));
}

/* Where rank r's piece is written: on this side of the exchange, but for the own one. */
static struct v2v_complex *piece_side(const struct v2v_fft_slabs *fft, int r,
                                      struct v2v_complex *this_side, struct v2v_complex *other_side)
{
    const int is_own = r == v2v_comm_rank(fft->comm) && fft->transposition == NULL;
    return is_own ? other_side : this_side;
}

/* Rows from y on, as many as there are lanes, of frame i of n into the rows' side. */
static void send_rows(const struct v2v_fft_slabs *fft, const struct route *route,
                      const float *frames, int64_t n, int64_t i, int64_t y)
{
    const int size = v2v_comm_size(fft->comm);
    const int64_t mine = fft->rows.count, width = fft->shape.width;
    const int64_t count = v2v_smaller(V2V_LANES, mine - y);
    struct v2v_lanes lanes = thread_lanes(fft);
    transform_rows(fft, &lanes, frames + (i * mine + y) * width, width, count);
    for (int r = 0; r < size; r++) {
        const struct v2v_part part = v2v_par_part(fft->layout.half, size, r);
        const int64_t first = part.first * V2V_LANES;
        v2v_lanes_give_beside(piece_side(fft, r, route->rows_side, route->columns_side) +
                                  rows_place(fft, r, n, i) + y,
                              fft->layout.rows, lanes.re + first, lanes.im + first, part.count,
                              count);
    }
}

static int64_t columns_from(const struct v2v_fft_slabs *fft, int64_t k)
{
    return v2v_smaller(V2V_LANES, fft->columns.count - k);
}

/* Columns from k on, as many as there are lanes, of frame i of n from the columns' side. */
static void take_columns(const struct v2v_fft_slabs *fft, struct v2v_complex *spectrum,
                         const struct v2v_complex *side, int64_t n, int64_t i, int64_t k)
{
    const int size = v2v_comm_size(fft->comm);
    const int64_t ny = fft->shape.ny, count = columns_from(fft, k);
    struct v2v_lanes lanes = thread_lanes(fft);
    for (int r = 0; r < size; r++) {
        const struct v2v_part part = v2v_par_part(fft->shape.height, size, r);
        const int64_t first = part.first * V2V_LANES;
        v2v_lanes_take(lanes.re + first, lanes.im + first, &side[column_place(fft, r, n, i, k)].re,
                       column_stride(fft, n), part.count, count);
    }
    clear(&lanes, fft->shape.height, ny);
    v2v_fft_lanes_forward(fft->column, &lanes);
    v2v_lanes_give(&spectrum[k * ny].re, 2 * ny, lanes.re, lanes.im, 1.0f, ny, count);
}

/* Columns from k on of frame i of n into the columns' side. */
static void send_columns(const struct v2v_fft_slabs *fft, const struct route *route,
                         const struct v2v_complex *spectrum, int64_t n, int64_t i, int64_t k)
{
    const int size = v2v_comm_size(fft->comm);
    const int64_t ny = fft->shape.ny, count = columns_from(fft, k);
    struct v2v_lanes lanes = thread_lanes(fft);
    v2v_lanes_take(lanes.re, lanes.im, &spectrum[k * ny].re, 2 * ny, ny, count);
    v2v_fft_lanes_inverse(fft->column, &lanes);
    for (int r = 0; r < size; r++) {
        const struct v2v_part part = v2v_par_part(fft->shape.height, size, r);
        const int64_t first = part.first * V2V_LANES;
        struct v2v_complex *to = piece_side(fft, r, route->columns_side, route->rows_side) +
                                 column_place(fft, r, n, i, k);
        v2v_lanes_give(&to->re, column_stride(fft, n), lanes.re + first, lanes.im + first, 1.0f,
                       part.count, count);
    }
}

/* Rows from y on of frame i of n from the rows' side. */
static void take_rows(const struct v2v_fft_slabs *fft, float *frames, float factor,
                      const struct v2v_complex *side, int64_t n, int64_t i, int64_t y)
{
    const int size = v2v_comm_size(fft->comm);
    const int64_t mine = fft->rows.count, width = fft->shape.width;
    const int64_t count = v2v_smaller(V2V_LANES, mine - y);
    struct v2v_lanes lanes = thread_lanes(fft);
    for (int r = 0; r < size; r++) {
        const struct v2v_part part = v2v_par_part(fft->layout.half, size, r);
        const int64_t first = part.first * V2V_LANES;
        v2v_lanes_take_beside(lanes.re + first, lanes.im + first,
                              side + rows_place(fft, r, n, i) + y, fft->layout.rows, part.count,
                              count);
    }
    restore_rows(fft, &lanes, frames + (i * mine + y) * width, factor, width, count);
}

static void start(const struct v2v_fft_slabs *fft, struct route *route, int64_t n, int forward)
{
    const int64_t count = n * fft->layout.rows * fft->layout.columns;
    const int size = v2v_comm_size(fft->comm), rank = v2v_comm_rank(fft->comm);
    const MPI_Comm mpi = v2v_comm_mpi(fft->comm);
    struct v2v_complex *to = forward ? route->columns_side : route->rows_side;
    const struct v2v_complex *from = forward ? route->rows_side : route->columns_side;
    if (fft->transposition != NULL) {
        const double began = v2v_clock_now();
        v2v_transposition_run(fft->transposition, n, forward);
        v2v_par_spent(V2V_PAR_EXCHANGE, began);
        return;
    }
    /* In step s everybody sends s ranks up, so that nobody is sent to by two at once. */
    for (int s = 1; s < size; s++) {
        const int above = (rank + s) % size, below = (rank - s + size) % size;
        MPI_Irecv(to + below * count, (int)count, MPI_C_FLOAT_COMPLEX, below, V2V_TAG_PARTS, mpi,
                  &route->received[below]);
        MPI_Isend(from + above * count, (int)count, MPI_C_FLOAT_COMPLEX, above, V2V_TAG_PARTS, mpi,
                  &route->sent[above]);
    }
}

static void wait_for(const struct v2v_fft_slabs *fft, MPI_Request *requests)
{
    const double began = v2v_clock_now();
    MPI_Waitall(v2v_comm_size(fft->comm), requests, MPI_STATUSES_IGNORE);
    v2v_par_spent(V2V_PAR_EXCHANGE, began);
}

/* The frames of n that follow a batch; FFTW3-MPI takes a power of two. */
static struct v2v_part batch_after(const struct v2v_fft_slabs *fft, struct v2v_part batch,
                                   int64_t n)
{
    const int64_t first = batch.first + batch.count;
    int64_t count = v2v_smaller(fft->layout.batch, n - first);
    while (fft->transposition != NULL && (count & (count - 1)) != 0) {
        count &= count - 1;
    }
    return (struct v2v_part){first, count};
}

/* The arrays of one call. */
struct job {
    const float *frames; /* forward: read */
    float *restored;     /* inverse: written */
    float factor;
    struct v2v_complex *spectra;    /* forward: written */
    const struct v2v_complex *kept; /* inverse: read */
    int64_t stride;
};

static void rows_to_route(const struct v2v_fft_slabs *fft, const struct job *job,
                          const struct route *route, struct v2v_part batch)
{
    const float *frames = job->frames + batch.first * fft->rows.count * fft->shape.width;
#pragma omp parallel for collapse(2) schedule(static) num_threads(fft->threads)
    for (int64_t i = 0; i < batch.count; i++) {
        for (int64_t y = 0; y < fft->rows.count; y += V2V_LANES) {
            send_rows(fft, route, frames, batch.count, i, y);
        }
    }
}

static void columns_from_route(const struct v2v_fft_slabs *fft, const struct job *job,
                               const struct route *route, struct v2v_part batch)
{
#pragma omp parallel for collapse(2) schedule(static) num_threads(fft->threads)
    for (int64_t i = 0; i < batch.count; i++) {
        for (int64_t k = 0; k < fft->columns.count; k += V2V_LANES) {
            take_columns(fft, job->spectra + (batch.first + i) * job->stride, route->columns_side,
                         batch.count, i, k);
        }
    }
}

static void columns_to_route(const struct v2v_fft_slabs *fft, const struct job *job,
                             const struct route *route, struct v2v_part batch)
{
#pragma omp parallel for collapse(2) schedule(static) num_threads(fft->threads)
    for (int64_t i = 0; i < batch.count; i++) {
        for (int64_t k = 0; k < fft->columns.count; k += V2V_LANES) {
            send_columns(fft, route, job->kept + (batch.first + i) * job->stride, batch.count, i,
                         k);
        }
    }
}

static void rows_from_route(const struct v2v_fft_slabs *fft, const struct job *job,
                            const struct route *route, struct v2v_part batch)
{
    float *frames = job->restored + batch.first * fft->rows.count * fft->shape.width;
#pragma omp parallel for collapse(2) schedule(static) num_threads(fft->threads)
    for (int64_t i = 0; i < batch.count; i++) {
        for (int64_t y = 0; y < fft->rows.count; y += V2V_LANES) {
            take_rows(fft, frames, job->factor, route->rows_side, batch.count, i, y);
        }
    }
}

/* Batches are begun in turn, and each is finished when ROUTES - 1 more have been. FFTW3-MPI returns
 * when a batch has arrived. */
static void share(struct v2v_fft_slabs *fft, const struct job *job, int64_t n, int forward)
{
    const int routes = routes_of(&fft->shape, v2v_comm_size(fft->comm));
    struct v2v_part batches[ROUTES] = {{0, 0}};
    struct v2v_part batch = {0, 0};
    int64_t begun = 0, finished = 0;
    do {
        batch = batch_after(fft, batch, n);
        if (batch.count > 0) {
            struct route *route = &fft->route[begun % routes];
            wait_for(fft, route->sent);
            (forward ? rows_to_route : columns_to_route)(fft, job, route, batch);
            start(fft, route, batch.count, forward);
            batches[begun++ % routes] = batch;
        }
        if (begun - finished == routes || (batch.count == 0 && finished < begun)) {
            struct route *route = &fft->route[finished % routes];
            wait_for(fft, route->received);
            (forward ? columns_from_route : rows_from_route)(fft, job, route,
                                                             batches[finished++ % routes]);
        }
    } while (batch.count > 0 || finished < begun);
    for (int i = 0; i < routes; i++) {
        wait_for(fft, fft->route[i].sent);
    }
}

static void forward_alone(const struct v2v_fft_slabs *fft, const struct route *route,
                          struct v2v_complex *spectrum, const float *frame)
{
    for (int64_t y = 0; y < fft->rows.count; y += V2V_LANES) {
        send_rows(fft, route, frame, 1, 0, y);
    }
    for (int64_t k = 0; k < fft->columns.count; k += V2V_LANES) {
        take_columns(fft, spectrum, route->columns_side, 1, 0, k);
    }
}

static void inverse_alone(const struct v2v_fft_slabs *fft, const struct route *route, float *frame,
                          float factor, const struct v2v_complex *spectrum)
{
    for (int64_t k = 0; k < fft->columns.count; k += V2V_LANES) {
        send_columns(fft, route, spectrum, 1, 0, k);
    }
    for (int64_t y = 0; y < fft->rows.count; y += V2V_LANES) {
        take_rows(fft, frame, factor, route->rows_side, 1, 0, y);
    }
}

/* On one rank a thread's frame lies here between its rows and its columns. */
static struct route thread_route(const struct v2v_fft_slabs *fft)
{
    struct v2v_complex *side = fft->route[0].rows_side + omp_get_thread_num() * fft->layout.side;
    return (struct route){.rows_side = side, .columns_side = side};
}

void v2v_fft_slabs_forward(struct v2v_fft_slabs *fft, struct v2v_complex *spectra, int64_t stride,
                           const float *frames, int64_t n)
{
    const int64_t pixels = fft->rows.count * fft->shape.width;
    const struct job job = {.frames = frames, .spectra = spectra, .stride = stride};
    if (v2v_comm_size(fft->comm) > 1) {
        share(fft, &job, n, 1);
        return;
    }
#pragma omp parallel for schedule(dynamic) num_threads(fft->threads)
    for (int64_t i = 0; i < n; i++) {
        const struct route route = thread_route(fft);
        forward_alone(fft, &route, spectra + i * stride, frames + i * pixels);
    }
}

void v2v_fft_slabs_inverse(struct v2v_fft_slabs *fft, float *frames, float factor,
                           const struct v2v_complex *spectra, int64_t stride, int64_t n)
{
    const int64_t pixels = fft->rows.count * fft->shape.width;
    const struct job job = {
        .restored = frames, .factor = factor, .kept = spectra, .stride = stride};
    if (v2v_comm_size(fft->comm) > 1) {
        share(fft, &job, n, 0);
        return;
    }
#pragma omp parallel for schedule(dynamic) num_threads(fft->threads)
    for (int64_t i = 0; i < n; i++) {
        const struct route route = thread_route(fft);
        inverse_alone(fft, &route, frames + i * pixels, factor, spectra + i * stride);
    }
}

/* Spectra of rows go straight to their places in the columns, which are then transformed. */
void v2v_fft_slabs_local(const struct v2v_fft_slabs *fft, struct v2v_complex *spectrum,
                         const float *rows, int64_t first, int64_t count)
{
    const int64_t ny = fft->shape.ny, nx = fft->shape.nx, columns = fft->columns.count;
    struct v2v_lanes lanes = thread_lanes(fft);
    memset(spectrum, 0, (size_t)(columns * ny) * sizeof *spectrum);
    for (int64_t i = 0, some = 0; i < count; i += some) {
        const int64_t y = ((first + i) % ny + ny) % ny, mine = fft->columns.first * V2V_LANES;
        some = v2v_smaller(v2v_smaller(V2V_LANES, count - i), ny - y);
        transform_rows(fft, &lanes, rows + i * nx, nx, some);
        v2v_lanes_give_beside(spectrum + y, ny, lanes.re + mine, lanes.im + mine, columns, some);
    }
    for (int64_t k = 0; k < columns; k += V2V_LANES) {
        float *from = &spectrum[k * ny].re;
        v2v_lanes_take(lanes.re, lanes.im, from, 2 * ny, ny, columns_from(fft, k));
        v2v_fft_lanes_forward(fft->column, &lanes);
        v2v_lanes_give(from, 2 * ny, lanes.re, lanes.im, 1.0f, ny, columns_from(fft, k));
    }
}
