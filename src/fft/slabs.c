#include "v2v3d/fft/slabs.h"
#include "fft/transposition.h"
#include "par/comm_mpi.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include <fftw3.h>
#include <limits.h>
#include <omp.h>
#include <string.h>

/* Rows that change places with columns together: eight complex numbers are a cache line. */
enum { ROWS = 8 };

/* What a rank sends in one exchange, at most, bytes, unless a frame has more: enough that latency
 * doesn't count, little enough that both sides of two exchanges stay in a second-level cache. */
enum { EXCHANGE = 1 << 20 };

/* Where everything lies; one place, so that v2v_fft_slabs_bytes can't drift. Numbers are complex.
 */
struct layout {
    int64_t half;          /* nx/2+1 */
    int64_t row_floats;    /* a row of pixels */
    int64_t row_stride;    /* from spectrum to spectrum of rows, numbers */
    int64_t column_stride; /* a column, numbers */
    int64_t batch;         /* frames of one exchange, at most */
    int64_t rows, columns; /* of the fullest rank */
    int64_t side;          /* numbers of a lane's buffer */
};

/* One exchange: equal pieces from and to each rank r, as large as the fullest ranks'. On the rows'
 * side [r, frame, kx of r, y of this rank], on the columns' side [r, frame, kx of this rank, y of
 * r], or as FFTW3-MPI leaves it: [frame, kx of this rank, r, y of r]. The own exchange finds a
 * rank's piece for itself on the other side already. One rank has one side. */
struct lane {
    struct v2v_complex *rows_side, *columns_side;
    MPI_Request *received, *sent; /* [rank]: of the own exchange; all null with FFTW3-MPI */
};

/* Exchanges on their way at once: a rank may be that many ahead of another before it waits. */
enum { LANES = 2 };

struct v2v_fft_slabs {
    struct v2v_fft_shape shape;
    struct layout layout;
    const struct v2v_comm *comm;   /* borrowed */
    struct v2v_part rows, columns; /* of this rank */
    int threads;
    struct lane lane[LANES]; /* on one rank: the first one's rows_side, a frame a thread */
    struct v2v_transposition *transposition; /* of the first lane; NULL: the own exchange */
    float *pixels;               /* [thread,row_floats]: zeros behind `width` for ever */
    float *restored;             /* [thread,row_floats] */
    struct v2v_complex *numbers; /* [thread,ROWS,row_stride] */
    struct v2v_complex *column;  /* [thread,column_stride]: zeros behind `height` for ever */
    struct v2v_complex *changed; /* [thread,column_stride] */
    fftwf_plan row_forward, row_inverse, column_forward, column_inverse;
};

static int64_t aligned(int64_t n)
{
    return (n + 15) / 16 * 16; /* whole cache lines of floats, and of complex numbers */
}

static int is_transposed(const struct v2v_fft_shape *shape, int ranks)
{
    return shape->uses_fftw3_mpi && ranks > 1;
}

static int lanes_of(const struct v2v_fft_shape *shape, int ranks)
{
    return is_transposed(shape, ranks) ? 1 : LANES;
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
    layout->row_floats = aligned(shape->nx);
    layout->row_stride = aligned(half);
    layout->column_stride = aligned(shape->ny);
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
    const int lanes = lanes_of(shape, ranks);
    const int64_t buffers = ranks == 1 ? threads : 2 * lanes;
    const int64_t requests = ranks == 1 ? 0 : 2 * lanes * (int64_t)ranks;
    return (buffers * layout.side +
            threads * (ROWS * layout.row_stride + 2 * layout.column_stride)) *
               (int64_t)sizeof(struct v2v_complex) +
           threads * 2 * layout.row_floats * (int64_t)sizeof(float) +
           requests * (int64_t)sizeof(MPI_Request) + (int64_t)sizeof(struct v2v_fft_slabs);
}

int64_t v2v_fft_slabs_batch(const struct v2v_fft_shape *shape, int ranks)
{
    struct layout layout;
    return layout_plan(&layout, shape, ranks) ? layout.batch : 1;
}

static enum v2v_status plan(struct v2v_fft_slabs *fft)
{
    const int ny = (int)fft->shape.ny, nx = (int)fft->shape.nx;
    fftwf_complex *row = (fftwf_complex *)(void *)fft->numbers;
    fftwf_complex *column = (fftwf_complex *)(void *)fft->column;
    fftwf_complex *changed = (fftwf_complex *)(void *)fft->changed;
    const unsigned kept = FFTW_ESTIMATE | FFTW_PRESERVE_INPUT;
    fft->row_forward = fftwf_plan_dft_r2c_1d(nx, fft->pixels, row, kept);
    fft->row_inverse = fftwf_plan_dft_c2r_1d(nx, row, fft->restored, FFTW_ESTIMATE);
    fft->column_forward = fftwf_plan_dft_1d(ny, column, changed, FFTW_FORWARD, kept);
    fft->column_inverse = fftwf_plan_dft_1d(ny, column, changed, FFTW_BACKWARD, kept);
    if (fft->row_forward == NULL || fft->row_inverse == NULL || fft->column_forward == NULL ||
        fft->column_inverse == NULL) {
        return V2V_FAIL(V2V_E_MEMORY, "no room to plan transforms of %d x %d pixels", ny, nx);
    }
    return V2V_OK;
}

static enum v2v_status take_lanes(struct v2v_fft_slabs *fft, int size)
{
    enum v2v_status rc = V2V_OK;
    for (int i = 0; i < lanes_of(&fft->shape, size) && size > 1; i++) {
        struct lane *lane = &fft->lane[i];
        V2V_TRY(V2V_ALLOC(lane->rows_side, "fft.exchange", fft->layout.side));
        V2V_TRY(V2V_ALLOC(lane->columns_side, "fft.exchange", fft->layout.side));
        V2V_TRY(V2V_ALLOC(lane->received, "fft.exchange", size));
        V2V_TRY(V2V_ALLOC(lane->sent, "fft.exchange", size));
        for (int r = 0; r < size; r++) {
            lane->received[r] = lane->sent[r] = MPI_REQUEST_NULL;
        }
    }
    if (size == 1) {
        V2V_TRY(V2V_ALLOC(fft->lane[0].rows_side, "fft.exchange",
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
    V2V_TRY(take_lanes(fft, size));
    V2V_TRY(V2V_ALLOC(fft->pixels, "fft.row", threads * layout->row_floats));
    V2V_TRY(V2V_ALLOC(fft->restored, "fft.row", threads * layout->row_floats));
    V2V_TRY(V2V_ALLOC(fft->numbers, "fft.row", threads * ROWS * layout->row_stride));
    V2V_TRY(V2V_ALLOC(fft->column, "fft.column", threads * layout->column_stride));
    V2V_TRY(V2V_ALLOC(fft->changed, "fft.column", threads * layout->column_stride));
    V2V_TRY(plan(fft));
done:
    return rc;
}

enum v2v_status v2v_fft_slabs_create(struct v2v_fft_slabs **fft, const struct v2v_fft_shape *shape,
                                     const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const int size = v2v_comm_size(comm), rank = v2v_comm_rank(comm);

    V2V_ASSERT(shape->height >= 1 && shape->width >= 1 && shape->height <= shape->ny &&
               shape->width <= shape->nx && shape->frames >= 1 && shape->ny % 2 == 0 &&
               shape->nx % 2 == 0);
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
        const struct lane *lane = &(*fft)->lane[0];
        V2V_TRY(v2v_transposition_create(&(*fft)->transposition, lane->rows_side,
                                         lane->columns_side, layout->rows, layout->columns,
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
    fftwf_plan plans[] = {old->row_forward, old->row_inverse, old->column_forward,
                          old->column_inverse};
    for (size_t i = 0; i < sizeof plans / sizeof *plans; i++) {
        if (plans[i] != NULL) {
            fftwf_destroy_plan(plans[i]);
        }
    }
    v2v_transposition_destroy(&old->transposition);
    for (int i = 0; i < LANES; i++) {
        v2v_mem_free(old->lane[i].rows_side);
        v2v_mem_free(old->lane[i].columns_side);
        v2v_mem_free(old->lane[i].received);
        v2v_mem_free(old->lane[i].sent);
    }
    v2v_mem_free(old->pixels);
    v2v_mem_free(old->restored);
    v2v_mem_free(old->numbers);
    v2v_mem_free(old->column);
    v2v_mem_free(old->changed);
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

static float *thread_pixels(const struct v2v_fft_slabs *fft)
{
    return fft->pixels + omp_get_thread_num() * fft->layout.row_floats;
}

static float *thread_restored(const struct v2v_fft_slabs *fft)
{
    return fft->restored + omp_get_thread_num() * fft->layout.row_floats;
}

static struct v2v_complex *thread_column(const struct v2v_fft_slabs *fft)
{
    return fft->column + omp_get_thread_num() * fft->layout.column_stride;
}

static struct v2v_complex *thread_changed(const struct v2v_fft_slabs *fft)
{
    return fft->changed + omp_get_thread_num() * fft->layout.column_stride;
}

static struct v2v_complex *thread_numbers(const struct v2v_fft_slabs *fft)
{
    return fft->numbers + omp_get_thread_num() * ROWS * fft->layout.row_stride;
}

/* numbers[kx] = transform of a row of `length` pixels, which are copied to `pixels`. */
static void transform_row(const struct v2v_fft_slabs *fft, struct v2v_complex *numbers,
                          float *pixels, const float *row, int64_t length)
{
    memcpy(pixels, row, (size_t)length * sizeof *pixels);
    fftwf_execute_dft_r2c(fft->row_forward, pixels, (fftwf_complex *)(void *)numbers);
}

/* to[i,j] = from[j,i]. Inlined with rows = ROWS, a line at a time. */
static inline void turn(struct v2v_complex *restrict to, int64_t to_stride,
                        const struct v2v_complex *restrict from, int64_t from_stride,
                        int64_t columns, int64_t rows)
{
    for (int64_t i = 0; i < columns; i++) {
        for (int64_t j = 0; j < rows; j++) {
            to[i * to_stride + j] = from[j * from_stride + i];
        }
    }
}

static inline void turn_back(struct v2v_complex *restrict to, int64_t to_stride,
                             const struct v2v_complex *restrict from, int64_t from_stride,
                             int64_t columns, int64_t rows)
{
    for (int64_t i = 0; i < columns; i++) {
        for (int64_t j = 0; j < rows; j++) {
            to[j * to_stride + i] = from[i * from_stride + j];
        }
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

/* Where rank r's piece is written: on this side of the exchange, but for the own one. */
static struct v2v_complex *piece_side(const struct v2v_fft_slabs *fft, int r,
                                      struct v2v_complex *this_side, struct v2v_complex *other_side)
{
    const int is_own = r == v2v_comm_rank(fft->comm) && fft->transposition == NULL;
    return is_own ? other_side : this_side;
}

/* Rows y .. y+ROWS-1 of frame i of n into the rows' side. */
static void send_rows(const struct v2v_fft_slabs *fft, const struct lane *lane, const float *frames,
                      int64_t n, int64_t i, int64_t y)
{
    const int size = v2v_comm_size(fft->comm);
    const int64_t mine = fft->rows.count, width = fft->shape.width;
    const int64_t count = v2v_smaller(ROWS, mine - y), stride = fft->layout.row_stride;
    const int64_t step = fft->layout.rows;
    struct v2v_complex *numbers = thread_numbers(fft);
    for (int64_t j = 0; j < count; j++) {
        transform_row(fft, numbers + j * stride, thread_pixels(fft),
                      frames + (i * mine + y + j) * width, width);
    }
    for (int r = 0; r < size; r++) {
        const struct v2v_part part = v2v_par_part(fft->layout.half, size, r);
        struct v2v_complex *to =
            piece_side(fft, r, lane->rows_side, lane->columns_side) + rows_place(fft, r, n, i) + y;
        if (count == ROWS) {
            turn(to, step, numbers + part.first, stride, part.count, ROWS);
        } else {
            turn(to, step, numbers + part.first, stride, part.count, count);
        }
    }
}

/* Column k of frame i of n from the columns' side. */
static void take_column(const struct v2v_fft_slabs *fft, struct v2v_complex *spectrum,
                        const struct v2v_complex *side, int64_t n, int64_t i, int64_t k)
{
    const int size = v2v_comm_size(fft->comm);
    struct v2v_complex *column = thread_column(fft);
    for (int r = 0; r < size; r++) {
        const struct v2v_part part = v2v_par_part(fft->shape.height, size, r);
        memcpy(column + part.first, side + column_place(fft, r, n, i, k),
               (size_t)part.count * sizeof *column);
    }
    fftwf_execute_dft(fft->column_forward, (fftwf_complex *)(void *)column,
                      (fftwf_complex *)(void *)(spectrum + k * fft->shape.ny));
}

/* Column k of frame i of n into the columns' side. */
static void send_column(const struct v2v_fft_slabs *fft, const struct lane *lane,
                        const struct v2v_complex *spectrum, int64_t n, int64_t i, int64_t k)
{
    const int size = v2v_comm_size(fft->comm);
    struct v2v_complex *changed = thread_changed(fft);
    /* The plan keeps its input; FFTW's types don't say so. */
    fftwf_complex *from = (fftwf_complex *)(uintptr_t)(spectrum + k * fft->shape.ny);
    fftwf_execute_dft(fft->column_inverse, from, (fftwf_complex *)(void *)changed);
    for (int r = 0; r < size; r++) {
        const struct v2v_part part = v2v_par_part(fft->shape.height, size, r);
        memcpy(piece_side(fft, r, lane->columns_side, lane->rows_side) +
                   column_place(fft, r, n, i, k),
               changed + part.first, (size_t)part.count * sizeof *changed);
    }
}

/* Rows y .. y+ROWS-1 of frame i of n from the rows' side. */
static void take_rows(const struct v2v_fft_slabs *fft, float *frames, float factor,
                      const struct v2v_complex *side, int64_t n, int64_t i, int64_t y)
{
    const int size = v2v_comm_size(fft->comm);
    const int64_t mine = fft->rows.count, width = fft->shape.width;
    const int64_t count = v2v_smaller(ROWS, mine - y), stride = fft->layout.row_stride;
    const int64_t step = fft->layout.rows;
    struct v2v_complex *numbers = thread_numbers(fft);
    float *restored = thread_restored(fft);
    for (int r = 0; r < size; r++) {
        const struct v2v_part part = v2v_par_part(fft->layout.half, size, r);
        const struct v2v_complex *from = side + rows_place(fft, r, n, i) + y;
        if (count == ROWS) {
            turn_back(numbers + part.first, stride, from, step, part.count, ROWS);
        } else {
            turn_back(numbers + part.first, stride, from, step, part.count, count);
        }
    }
    for (int64_t j = 0; j < count; j++) {
        float *row = frames + (i * mine + y + j) * width;
        fftwf_execute_dft_c2r(fft->row_inverse, (fftwf_complex *)(void *)(numbers + j * stride),
                              restored);
        for (int64_t x = 0; x < width; x++) {
            row[x] = factor * restored[x];
        }
    }
}

static void start(const struct v2v_fft_slabs *fft, struct lane *lane, int64_t n, int forward)
{
    const int64_t count = n * fft->layout.rows * fft->layout.columns;
    const int size = v2v_comm_size(fft->comm), rank = v2v_comm_rank(fft->comm);
    const MPI_Comm mpi = v2v_comm_mpi(fft->comm);
    struct v2v_complex *to = forward ? lane->columns_side : lane->rows_side;
    const struct v2v_complex *from = forward ? lane->rows_side : lane->columns_side;
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
                  &lane->received[below]);
        MPI_Isend(from + above * count, (int)count, MPI_C_FLOAT_COMPLEX, above, V2V_TAG_PARTS, mpi,
                  &lane->sent[above]);
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

static void rows_to_lane(const struct v2v_fft_slabs *fft, const struct job *job,
                         const struct lane *lane, struct v2v_part batch)
{
    const float *frames = job->frames + batch.first * fft->rows.count * fft->shape.width;
#pragma omp parallel for collapse(2) schedule(static) num_threads(fft->threads)
    for (int64_t i = 0; i < batch.count; i++) {
        for (int64_t y = 0; y < fft->rows.count; y += ROWS) {
            send_rows(fft, lane, frames, batch.count, i, y);
        }
    }
}

static void columns_from_lane(const struct v2v_fft_slabs *fft, const struct job *job,
                              const struct lane *lane, struct v2v_part batch)
{
#pragma omp parallel for collapse(2) schedule(static) num_threads(fft->threads)
    for (int64_t i = 0; i < batch.count; i++) {
        for (int64_t k = 0; k < fft->columns.count; k++) {
            take_column(fft, job->spectra + (batch.first + i) * job->stride, lane->columns_side,
                        batch.count, i, k);
        }
    }
}

static void columns_to_lane(const struct v2v_fft_slabs *fft, const struct job *job,
                            const struct lane *lane, struct v2v_part batch)
{
#pragma omp parallel for collapse(2) schedule(static) num_threads(fft->threads)
    for (int64_t i = 0; i < batch.count; i++) {
        for (int64_t k = 0; k < fft->columns.count; k++) {
            send_column(fft, lane, job->kept + (batch.first + i) * job->stride, batch.count, i, k);
        }
    }
}

static void rows_from_lane(const struct v2v_fft_slabs *fft, const struct job *job,
                           const struct lane *lane, struct v2v_part batch)
{
    float *frames = job->restored + batch.first * fft->rows.count * fft->shape.width;
#pragma omp parallel for collapse(2) schedule(static) num_threads(fft->threads)
    for (int64_t i = 0; i < batch.count; i++) {
        for (int64_t y = 0; y < fft->rows.count; y += ROWS) {
            take_rows(fft, frames, job->factor, lane->rows_side, batch.count, i, y);
        }
    }
}

/* Batches are begun in turn, and each is finished when LANES - 1 more have been. FFTW3-MPI returns
 * when a batch has arrived. */
static void share(struct v2v_fft_slabs *fft, const struct job *job, int64_t n, int forward)
{
    const int lanes = lanes_of(&fft->shape, v2v_comm_size(fft->comm));
    struct v2v_part batches[LANES] = {{0, 0}};
    struct v2v_part batch = {0, 0};
    int64_t begun = 0, finished = 0;
    do {
        batch = batch_after(fft, batch, n);
        if (batch.count > 0) {
            struct lane *lane = &fft->lane[begun % lanes];
            wait_for(fft, lane->sent);
            (forward ? rows_to_lane : columns_to_lane)(fft, job, lane, batch);
            start(fft, lane, batch.count, forward);
            batches[begun++ % lanes] = batch;
        }
        if (begun - finished == lanes || (batch.count == 0 && finished < begun)) {
            struct lane *lane = &fft->lane[finished % lanes];
            wait_for(fft, lane->received);
            (forward ? columns_from_lane : rows_from_lane)(fft, job, lane,
                                                           batches[finished++ % lanes]);
        }
    } while (batch.count > 0 || finished < begun);
    for (int i = 0; i < lanes; i++) {
        wait_for(fft, fft->lane[i].sent);
    }
}

static void forward_alone(const struct v2v_fft_slabs *fft, const struct lane *lane,
                          struct v2v_complex *spectrum, const float *frame)
{
    for (int64_t y = 0; y < fft->rows.count; y += ROWS) {
        send_rows(fft, lane, frame, 1, 0, y);
    }
    for (int64_t k = 0; k < fft->columns.count; k++) {
        take_column(fft, spectrum, lane->columns_side, 1, 0, k);
    }
}

static void inverse_alone(const struct v2v_fft_slabs *fft, const struct lane *lane, float *frame,
                          float factor, const struct v2v_complex *spectrum)
{
    for (int64_t k = 0; k < fft->columns.count; k++) {
        send_column(fft, lane, spectrum, 1, 0, k);
    }
    for (int64_t y = 0; y < fft->rows.count; y += ROWS) {
        take_rows(fft, frame, factor, lane->rows_side, 1, 0, y);
    }
}

/* On one rank a thread's frame lies here between its rows and its columns. */
static struct lane thread_lane(const struct v2v_fft_slabs *fft)
{
    struct v2v_complex *side = fft->lane[0].rows_side + omp_get_thread_num() * fft->layout.side;
    return (struct lane){.rows_side = side, .columns_side = side};
}

void v2v_fft_slabs_forward(struct v2v_fft_slabs *fft, struct v2v_complex *spectra, int64_t stride,
                           const float *frames, int64_t n)
{
    const int64_t pixels = fft->rows.count * fft->shape.width;
    const struct job job = {.frames = frames, .spectra = spectra, .stride = stride};
    V2V_ASSERT(stride % 2 == 0);
    if (v2v_comm_size(fft->comm) > 1) {
        share(fft, &job, n, 1);
        return;
    }
#pragma omp parallel for schedule(dynamic) num_threads(fft->threads)
    for (int64_t i = 0; i < n; i++) {
        const struct lane lane = thread_lane(fft);
        forward_alone(fft, &lane, spectra + i * stride, frames + i * pixels);
    }
}

void v2v_fft_slabs_inverse(struct v2v_fft_slabs *fft, float *frames, float factor,
                           const struct v2v_complex *spectra, int64_t stride, int64_t n)
{
    const int64_t pixels = fft->rows.count * fft->shape.width;
    const struct job job = {
        .restored = frames, .factor = factor, .kept = spectra, .stride = stride};
    V2V_ASSERT(stride % 2 == 0);
    if (v2v_comm_size(fft->comm) > 1) {
        share(fft, &job, n, 0);
        return;
    }
#pragma omp parallel for schedule(dynamic) num_threads(fft->threads)
    for (int64_t i = 0; i < n; i++) {
        const struct lane lane = thread_lane(fft);
        inverse_alone(fft, &lane, frames + i * pixels, factor, spectra + i * stride);
    }
}

/* Row spectra go straight to their places in the columns, which are then transformed in turn. */
void v2v_fft_slabs_local(const struct v2v_fft_slabs *fft, struct v2v_complex *spectrum,
                         const float *rows, int64_t first, int64_t count)
{
    const int64_t ny = fft->shape.ny, nx = fft->shape.nx, columns = fft->columns.count;
    struct v2v_complex *changed = thread_changed(fft), *numbers = thread_numbers(fft);
    memset(spectrum, 0, (size_t)(columns * ny) * sizeof *spectrum);
    for (int64_t i = 0; i < count; i++) {
        const int64_t y = ((first + i) % ny + ny) % ny;
        /* Not through thread_pixels, whose end stays zero. */
        transform_row(fft, numbers, thread_restored(fft), rows + i * nx, nx);
        turn(spectrum + y, ny, numbers + fft->columns.first, 0, columns, 1);
    }
    for (int64_t k = 0; k < columns; k++) {
        fftwf_execute_dft(fft->column_forward, (fftwf_complex *)(void *)(spectrum + k * ny),
                          (fftwf_complex *)(void *)changed);
        memcpy(spectrum + k * ny, changed, (size_t)ny * sizeof *changed);
    }
}
