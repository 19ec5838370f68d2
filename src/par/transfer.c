#include "v2v3d/par/transfer.h"

#include "par/comm_mpi.h"
#include "v2v3d/base/memory.h"

#include <limits.h>

struct v2v_transfers {
    const struct v2v_comm *comm;
    MPI_Request *request; /* [most] */
    int most, pending;
};

enum v2v_status v2v_transfers_create(struct v2v_transfers **transfers, const struct v2v_comm *comm,
                                     int64_t most)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_transfers *self = NULL;
    V2V_ASSERT(most >= 0 && most <= INT_MAX);
    V2V_TRY(V2V_ALLOC(self, "par.transfers", 1));
    V2V_TRY(V2V_ALLOC(self->request, "par.transfers", most));
    self->comm = comm;
    self->most = (int)most;
done:
    if (rc != V2V_OK) {
        v2v_transfers_destroy(&self);
    }
    *transfers = self;
    return rc;
}

void v2v_transfers_destroy(struct v2v_transfers **transfers)
{
    if (*transfers == NULL) {
        return;
    }
    V2V_ASSERT((*transfers)->pending == 0);
    v2v_mem_free((*transfers)->request);
    v2v_mem_free(*transfers);
    *transfers = NULL;
}

/* One message is one MPI call: its count is an int. */
static MPI_Request *next_request(struct v2v_transfers *self, int64_t count)
{
    V2V_ASSERT(count > 0 && count <= INT_MAX && self->pending < self->most);
    return &self->request[self->pending++];
}

void v2v_transfers_send(struct v2v_transfers *self, const float *x, int64_t count, int to)
{
    if (count != 0) {
        MPI_Isend(x, (int)count, MPI_FLOAT, to, V2V_TAG_TRANSFER, v2v_comm_mpi(self->comm),
                  next_request(self, count));
    }
}

void v2v_transfers_receive(struct v2v_transfers *self, float *x, int64_t count, int from)
{
    if (count != 0) {
        MPI_Irecv(x, (int)count, MPI_FLOAT, from, V2V_TAG_TRANSFER, v2v_comm_mpi(self->comm),
                  next_request(self, count));
    }
}

void v2v_transfers_wait(struct v2v_transfers *self)
{
    if (self->pending > 0) { /* without MPI there is nothing to wait for */
        double began = v2v_clock_now();
        MPI_Waitall(self->pending, self->request, MPI_STATUSES_IGNORE);
        v2v_par_spent(V2V_PAR_EXCHANGE, began);
    }
    self->pending = 0;
}
