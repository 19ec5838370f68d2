#include "v2v3d/par/slicing.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/par/exchange.h"

#include <string.h>

struct v2v_slicing {
    const struct v2v_comm *comm;
    int64_t slices, height, width;
    struct v2v_part *rows;                /* [ranks] */
    struct v2v_part *in_rows, *in_slices; /* [ranks] what one turn moves */
};

enum v2v_status v2v_slicing_create(struct v2v_slicing **slicing, const struct v2v_comm *comm,
                                   int64_t slices, int64_t height, int64_t width,
                                   const struct v2v_part *rows)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_slicing *self = NULL;
    int ranks = v2v_comm_size(comm);
    V2V_TRY(V2V_ALLOC(self, "par.slicing", 1));
    *self = (struct v2v_slicing){.comm = comm, .slices = slices, .height = height, .width = width};
    struct v2v_part **parts[] = {&self->rows, &self->in_rows, &self->in_slices};
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        V2V_TRY(V2V_ALLOC(*parts[i], "par.slicing", ranks));
    }
    memcpy(self->rows, rows, (size_t)ranks * sizeof *rows);
done:
    if (rc != V2V_OK) {
        v2v_slicing_destroy(&self);
    }
    *slicing = self;
    return rc;
}

void v2v_slicing_destroy(struct v2v_slicing **slicing)
{
    struct v2v_slicing *self = *slicing;
    if (self == NULL) {
        return;
    }
    v2v_mem_free(self->rows);
    v2v_mem_free(self->in_rows);
    v2v_mem_free(self->in_slices);
    v2v_mem_free(self);
    *slicing = NULL;
}

static struct v2v_part slices_of(const struct v2v_slicing *self, int rank)
{
    return v2v_par_part(self->slices, v2v_comm_size(self->comm), rank);
}

struct v2v_part v2v_slicing_own(const struct v2v_slicing *slicing)
{
    return slices_of(slicing, v2v_comm_rank(slicing->comm));
}

/* Turn j moves the j-th slice of every rank: of it each rank has some rows. */
static void list_parts(struct v2v_slicing *self, int64_t j)
{
    const int rank = v2v_comm_rank(self->comm);
    const int64_t mine = self->rows[rank].count * self->width;
    for (int r = 0; r < v2v_comm_size(self->comm); r++) {
        const struct v2v_part slices = slices_of(self, r), rows = self->rows[r];
        self->in_rows[r] =
            (struct v2v_part){(slices.first + j) * mine, j < slices.count ? mine : 0};
        self->in_slices[r] =
            (struct v2v_part){(j * self->height + rows.first) * self->width,
                              j < slices_of(self, rank).count ? rows.count * self->width : 0};
    }
}

/* The first rank has the most slices. */
static int64_t turns(const struct v2v_slicing *self)
{
    return slices_of(self, 0).count;
}

void v2v_slicing_to_slices(struct v2v_slicing *slicing, float *slices, const float *rows)
{
    for (int64_t j = 0; j < turns(slicing); j++) {
        list_parts(slicing, j);
        v2v_par_alltoall(slicing->comm, slices, slicing->in_slices, rows, slicing->in_rows,
                         sizeof *rows);
    }
}

void v2v_slicing_to_rows(struct v2v_slicing *slicing, float *rows, const float *slices)
{
    for (int64_t j = 0; j < turns(slicing); j++) {
        list_parts(slicing, j);
        v2v_par_alltoall(slicing->comm, rows, slicing->in_rows, slices, slicing->in_slices,
                         sizeof *rows);
    }
}
