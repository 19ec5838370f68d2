#include "par/comm_mpi.h"
#include "v2v3d/base/bounds.h"

#include <string.h>

/* Elements are summed piece by piece; of a piece every rank sums one part. */
static int64_t piece_length(const struct v2v_comm *comm)
{
    int64_t size = v2v_comm_size(comm);
    V2V_ASSERT(size <= V2V_PAR_SCRATCH);
    return V2V_PAR_SCRATCH / size * size;
}

static void add(float *sum, const float *x, int64_t count)
{
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < count; i++) {
        sum[i] += x[i];
    }
}

/* Every rank's values of this rank's part come side by side; their sum in order replaces them. */
static void add_piece(const struct v2v_comm *comm, float *x, int64_t count, float *scratch)
{
    int size = v2v_comm_size(comm);
    int *counts = v2v_comm_scratch(comm), *offsets = counts + size;
    int *taken = offsets + size, *places = taken + size;
    struct v2v_part mine = v2v_par_part(count, size, v2v_comm_rank(comm));
    v2v_par_list_parts(counts, offsets, count, size);
    for (int r = 0; r < size; r++) {
        taken[r] = (int)mine.count;
        places[r] = (int)(r * mine.count);
    }
    MPI_Alltoallv(x, counts, offsets, MPI_FLOAT, scratch, taken, places, MPI_FLOAT,
                  v2v_comm_mpi(comm));
    memset(x + mine.first, 0, (size_t)mine.count * sizeof *x);
    for (int r = 0; r < size; r++) {
        add(x + mine.first, scratch + places[r], mine.count);
    }
}

void v2v_par_sum_ordered_f32(const struct v2v_comm *comm, float *x, int64_t count, float *scratch)
{
    int size = v2v_comm_size(comm);
    V2V_ASSERT(count >= 0);
    if (size == 1) {
        return;
    }
    double began = v2v_clock_now();
    int64_t length = piece_length(comm);
    for (int64_t i = 0; i < count; i += length) {
        add_piece(comm, x + i, v2v_smaller(count - i, length), scratch);
    }
    v2v_par_spent(V2V_PAR_SUM, began);
    began = v2v_clock_now();
    int *counts = v2v_comm_scratch(comm), *offsets = counts + size;
    for (int64_t i = 0; i < count; i += length) {
        v2v_par_list_parts(counts, offsets, v2v_smaller(count - i, length), size);
        MPI_Allgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, x + i, counts, offsets, MPI_FLOAT,
                       v2v_comm_mpi(comm));
    }
    v2v_par_spent(V2V_PAR_SPREAD, began);
}
