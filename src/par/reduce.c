#include "par/comm_mpi.h"

#include <limits.h>
#include <string.h>

/* Elements of one MPI call: far below INT_MAX, where counts end, and small enough that the
 * library's own copies stay small; large enough that a call's latency doesn't count. */
enum { PIECE = 1 << 24 };

static int piece_count(int64_t left)
{
    return left < PIECE ? (int)left : PIECE;
}

/** Reduce `count` elements of `size` bytes in place. */
static void reduce(const struct v2v_comm *comm, void *x, int64_t count, size_t size,
                   MPI_Datatype type, MPI_Op operation)
{
    V2V_ASSERT(count >= 0);
    if (v2v_comm_size(comm) == 1) {
        return;
    }
    double began = v2v_clock_now();
    for (int64_t i = 0; i < count; i += PIECE) {
        MPI_Allreduce(MPI_IN_PLACE, (char *)x + (size_t)i * size, piece_count(count - i), type,
                      operation, v2v_comm_mpi(comm));
    }
    v2v_par_spent(V2V_PAR_SUM, began);
}

void v2v_par_sum_f32(const struct v2v_comm *comm, float *x, int64_t count)
{
    reduce(comm, x, count, sizeof *x, MPI_FLOAT, MPI_SUM);
}

void v2v_par_sum_f64(const struct v2v_comm *comm, double *x, int64_t count)
{
    reduce(comm, x, count, sizeof *x, MPI_DOUBLE, MPI_SUM);
}

void v2v_par_sum_i64(const struct v2v_comm *comm, int64_t *x, int64_t count)
{
    reduce(comm, x, count, sizeof *x, MPI_INT64_T, MPI_SUM);
}

void v2v_par_max_i64(const struct v2v_comm *comm, int64_t *x, int64_t count)
{
    reduce(comm, x, count, sizeof *x, MPI_INT64_T, MPI_MAX);
}

void v2v_par_max_f64(const struct v2v_comm *comm, double *x, int64_t count)
{
    reduce(comm, x, count, sizeof *x, MPI_DOUBLE, MPI_MAX);
}

void v2v_par_broadcast(const struct v2v_comm *comm, void *data, int64_t bytes, int root)
{
    V2V_ASSERT(bytes >= 0);
    if (v2v_comm_size(comm) == 1) {
        return;
    }
    double began = v2v_clock_now();
    for (int64_t i = 0; i < bytes; i += PIECE) {
        MPI_Bcast((char *)data + i, piece_count(bytes - i), MPI_BYTE, root, v2v_comm_mpi(comm));
    }
    v2v_par_spent(V2V_PAR_SPREAD, began);
}

/** Does every contribution end below what an int can count? The same answer on all ranks. */
static int fits_int(const int64_t *count, const int64_t *offset, int size)
{
    for (int r = 0; r < size; r++) {
        if (count[r] > INT_MAX || offset[r] > INT_MAX) {
            return 0;
        }
    }
    return 1;
}

void v2v_par_allgather_f32(const struct v2v_comm *comm, float *out, const float *mine,
                           const int64_t *count, const int64_t *offset)
{
    int rank = v2v_comm_rank(comm), size = v2v_comm_size(comm);
    float *place = out + offset[rank];
    if (mine != place && count[rank] > 0) {
        memmove(place, mine, (size_t)count[rank] * sizeof *out);
    }
    if (size == 1) {
        return;
    }
    if (!fits_int(count, offset, size)) {
        for (int r = 0; r < size; r++) {
            v2v_par_broadcast(comm, out + offset[r], count[r] * (int64_t)sizeof *out, r);
        }
        return;
    }
    int *counts = v2v_comm_scratch(comm);
    int *offsets = counts + size;
    for (int r = 0; r < size; r++) {
        counts[r] = (int)count[r];
        offsets[r] = (int)offset[r];
    }
    double began = v2v_clock_now();
    MPI_Allgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, out, counts, offsets, MPI_FLOAT,
                   v2v_comm_mpi(comm));
    v2v_par_spent(V2V_PAR_SPREAD, began);
}

void v2v_par_exchange_f32(const struct v2v_comm *comm, float *received, const float *sent,
                          int64_t count, int other)
{
    V2V_ASSERT(count >= 0 && other >= 0 && other < v2v_comm_size(comm));
    if (other == v2v_comm_rank(comm)) {
        if (count > 0) {
            memmove(received, sent, (size_t)count * sizeof *sent);
        }
        return;
    }
    double began = v2v_clock_now();
    for (int64_t i = 0; i < count; i += PIECE) {
        int piece = piece_count(count - i);
        MPI_Sendrecv(sent + i, piece, MPI_FLOAT, other, V2V_TAG_PAIR, received + i, piece,
                     MPI_FLOAT, other, V2V_TAG_PAIR, v2v_comm_mpi(comm), MPI_STATUS_IGNORE);
    }
    v2v_par_spent(V2V_PAR_EXCHANGE, began);
}

void v2v_par_barrier(const struct v2v_comm *comm)
{
    if (v2v_comm_size(comm) > 1) {
        double began = v2v_clock_now();
        MPI_Barrier(v2v_comm_mpi(comm));
        v2v_par_spent(V2V_PAR_AGREE, began);
    }
}

struct v2v_part v2v_par_part(int64_t n, int64_t parts, int64_t index)
{
    V2V_ASSERT(n >= 0 && parts >= 1 && index >= 0 && index < parts);
    int64_t least = n / parts, longer = n % parts;
    return (struct v2v_part){
        .first = index * least + (index < longer ? index : longer),
        .count = least + (index < longer),
    };
}

void v2v_par_list_parts(int *counts, int *offsets, int64_t count, int size)
{
    for (int r = 0; r < size; r++) {
        const struct v2v_part part = v2v_par_part(count, size, r);
        counts[r] = (int)part.count;
        offsets[r] = (int)part.first;
    }
}
