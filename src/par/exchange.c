#include "v2v3d/par/exchange.h"

#include "par/comm_mpi.h"
#include "v2v3d/base/bounds.h"

#include <string.h>

/* Words of one message: below INT_MAX, where MPI's counts end. */
enum { PIECE = 1 << 26 };

static MPI_Datatype type_of(size_t word)
{
    V2V_ASSERT(word == 4 || word == 8 || word == 16);
    return word == 4 ? MPI_FLOAT : word == 8 ? MPI_DOUBLE : MPI_C_DOUBLE_COMPLEX;
}

static int piece_of(struct v2v_part part, int64_t done)
{
    return (int)v2v_smaller(part.count - done, PIECE);
}

/** Send one part to `to` and receive one from `from`, in pieces that both sides count alike. */
static void trade(const struct v2v_comm *comm, char *received, struct v2v_part from_part, int from,
                  const char *sent, struct v2v_part to_part, int to, size_t word)
{
    double began = v2v_clock_now();
    for (int64_t done = 0; done < from_part.count || done < to_part.count; done += PIECE) {
        MPI_Request request[2] = {MPI_REQUEST_NULL, MPI_REQUEST_NULL};
        if (done < from_part.count) {
            MPI_Irecv(received + (size_t)(from_part.first + done) * word, piece_of(from_part, done),
                      type_of(word), from, V2V_TAG_PARTS, v2v_comm_mpi(comm), &request[0]);
        }
        if (done < to_part.count) {
            MPI_Isend(sent + (size_t)(to_part.first + done) * word, piece_of(to_part, done),
                      type_of(word), to, V2V_TAG_PARTS, v2v_comm_mpi(comm), &request[1]);
        }
        MPI_Waitall(2, request, MPI_STATUSES_IGNORE);
    }
    v2v_par_spent(V2V_PAR_EXCHANGE, began);
}

void v2v_par_alltoall(const struct v2v_comm *comm, void *received, const struct v2v_part *from_part,
                      const void *sent, const struct v2v_part *to_part, size_t word)
{
    int rank = v2v_comm_rank(comm), size = v2v_comm_size(comm);
    V2V_ASSERT(from_part[rank].count == to_part[rank].count);
    if (to_part[rank].count > 0) {
        memmove((char *)received + (size_t)from_part[rank].first * word,
                (const char *)sent + (size_t)to_part[rank].first * word,
                (size_t)to_part[rank].count * word);
    }
    /* In step s everybody sends s ranks up, so that nobody is sent to by two at once. */
    for (int s = 1; s < size; s++) {
        int to = (rank + s) % size, from = (rank - s + size) % size;
        trade(comm, received, from_part[from], from, sent, to_part[to], to, word);
    }
}
