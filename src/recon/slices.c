#include "recon/slices.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/par/transfer.h"

#include <string.h>

struct v2v_slices {
    const struct v2v_comm *comm;
    int64_t count, height, width;
    int64_t *first, *rows; /* [ranks] */
    struct v2v_transfers *transfers;
    float *received; /* [rank][own,rows of the rank,width] */
    float *whole;    /* [own,height,width] */
};

struct v2v_part v2v_slices_own(const struct v2v_slices *self)
{
    return v2v_par_part(self->count, v2v_comm_size(self->comm), v2v_comm_rank(self->comm));
}

int64_t v2v_slices_floats(int64_t count, int64_t height, int64_t width, const struct v2v_comm *comm)
{
    int64_t own = v2v_par_part(count, v2v_comm_size(comm), v2v_comm_rank(comm)).count;
    return v2v_comm_size(comm) > 1 ? v2v_mem_product(own, height, width) : 0;
}

enum v2v_status v2v_slices_create(struct v2v_slices **slices, int64_t count, int64_t height,
                                  int64_t width, struct v2v_part rows, float *const scratch[2],
                                  const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_slices *self = NULL;
    int64_t ranks = v2v_comm_size(comm);
    V2V_TRY(V2V_ALLOC(self, "recon.slices", 1));
    *self = (struct v2v_slices){.comm = comm, .count = count, .height = height, .width = width};
    V2V_TRY(V2V_ALLOC(self->first, "recon.slices", ranks));
    V2V_TRY(V2V_ALLOC(self->rows, "recon.slices", ranks));
    self->first[v2v_comm_rank(comm)] = rows.first;
    self->rows[v2v_comm_rank(comm)] = rows.count;
    if (ranks > 1) {
        V2V_TRY(v2v_transfers_create(&self->transfers, comm, 2 * ranks));
        self->received = scratch[0];
        self->whole = scratch[1];
    }
done:
    if (rc != V2V_OK) {
        v2v_slices_destroy(&self);
    }
    *slices = self;
    return rc;
}

void v2v_slices_destroy(struct v2v_slices **slices)
{
    struct v2v_slices *self = *slices;
    if (self == NULL) {
        return;
    }
    v2v_transfers_destroy(&self->transfers);
    v2v_mem_free(self->first);
    v2v_mem_free(self->rows);
    v2v_mem_free(self);
    *slices = NULL;
}

/* Every rank's rows; a call for every volume costs nothing, and creation stays local. */
static void share_rows(struct v2v_slices *self)
{
    int ranks = v2v_comm_size(self->comm), rank = v2v_comm_rank(self->comm);
    for (int r = 0; r < ranks; r++) {
        if (r != rank) {
            self->first[r] = self->rows[r] = 0;
        }
    }
    v2v_par_sum_i64(self->comm, self->first, ranks);
    v2v_par_sum_i64(self->comm, self->rows, ranks);
}

/* Slices of one rank lie together in every rank's rows. */
static void exchange(struct v2v_slices *self, const float *rows)
{
    int ranks = v2v_comm_size(self->comm), rank = v2v_comm_rank(self->comm);
    int64_t own = v2v_slices_own(self).count, size = self->rows[rank] * self->width;
    float *received = self->received;
    for (int r = 0; r < ranks; r++) {
        v2v_transfers_receive(self->transfers, received, own * self->rows[r] * self->width, r);
        received += own * self->rows[r] * self->width;
    }
    for (int r = 0; r < ranks; r++) {
        struct v2v_part part = v2v_par_part(self->count, ranks, r);
        v2v_transfers_send(self->transfers, rows + part.first * size, part.count * size, r);
    }
    v2v_transfers_wait(self->transfers);
}

const float *v2v_slices_make(struct v2v_slices *self, const float *rows)
{
    int ranks = v2v_comm_size(self->comm);
    int64_t own = v2v_slices_own(self).count;
    if (ranks == 1) {
        return rows;
    }
    share_rows(self);
    exchange(self, rows);
    const float *from = self->received;
    for (int r = 0; r < ranks; r++) {
        int64_t size = self->rows[r] * self->width;
        for (int64_t z = 0; z < own; z++) {
            memcpy(self->whole + (z * self->height + self->first[r]) * self->width, from,
                   (size_t)size * sizeof *from);
            from += size;
        }
    }
    return self->whole;
}
