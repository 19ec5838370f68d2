#include "v2v3d/par/agreement.h"

#include "par/comm_mpi.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"

/* What the ranks tell of one round. */
struct round {
    int *code;            /* [ranks] */
    MPI_Request *request; /* [2 * ranks] */
    int under_way;        /* told, and not learnt yet */
};

struct v2v_agreement {
    const struct v2v_comm *comm;
    struct round round[2];
    int now; /* which of them is told next */
};

enum v2v_status v2v_agreement_create(struct v2v_agreement **agreement, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_agreement *self = NULL;
    int64_t ranks = v2v_comm_size(comm);
    V2V_TRY(V2V_ALLOC(self, "par.agreement", 1));
    self->comm = comm;
    for (int i = 0; i < 2; i++) {
        V2V_TRY(V2V_ALLOC(self->round[i].code, "par.agreement", ranks));
        V2V_TRY(V2V_ALLOC(self->round[i].request, "par.agreement", 2 * ranks));
    }
done:
    if (rc != V2V_OK) {
        v2v_agreement_destroy(&self);
    }
    *agreement = self;
    return rc;
}

void v2v_agreement_destroy(struct v2v_agreement **agreement)
{
    struct v2v_agreement *self = *agreement;
    if (self == NULL) {
        return;
    }
    for (int i = 0; i < 2; i++) {
        V2V_ASSERT(!self->round[i].under_way);
        v2v_mem_free(self->round[i].code);
        v2v_mem_free(self->round[i].request);
    }
    v2v_mem_free(self);
    *agreement = NULL;
}

static void tell(const struct v2v_agreement *self, struct round *round, enum v2v_status rc)
{
    int ranks = v2v_comm_size(self->comm), rank = v2v_comm_rank(self->comm);
    MPI_Comm mpi = v2v_comm_mpi(self->comm);
    round->code[rank] = (int)rc;
    for (int r = 0; r < ranks; r++) {
        MPI_Request *request = &round->request[2 * r];
        request[0] = request[1] = MPI_REQUEST_NULL;
        if (r != rank) {
            MPI_Irecv(&round->code[r], 1, MPI_INT, r, V2V_TAG_AGREEMENT, mpi, &request[0]);
            MPI_Isend(&round->code[rank], 1, MPI_INT, r, V2V_TAG_AGREEMENT, mpi, &request[1]);
        }
    }
    round->under_way = 1;
}

/* The lowest of the ranks whose code is the worst. */
static int learn(const struct v2v_agreement *self, struct round *round)
{
    int ranks = v2v_comm_size(self->comm), worst = 0;
    if (ranks > 1) {
        v2v_watchdog_beat("waiting for a round of other ranks");
        double began = v2v_clock_now();
        MPI_Waitall(2 * ranks, round->request, MPI_STATUSES_IGNORE);
        v2v_par_spent(V2V_PAR_AGREE, began);
    }
    round->under_way = 0;
    for (int r = 1; r < ranks; r++) {
        worst = round->code[r] > round->code[worst] ? r : worst;
    }
    return worst;
}

/* Learn the older round, if one was told; after a failure, nothing stays under way. */
static enum v2v_status learn_older(struct v2v_agreement *self, struct round *older,
                                   struct round *newer)
{
    if (!older->under_way) {
        return V2V_OK;
    }
    int worst = learn(self, older);
    enum v2v_status rc = (enum v2v_status)older->code[worst];
    if (rc == V2V_OK) {
        return V2V_OK;
    }
    if (newer->under_way) {
        (void)learn(self, newer);
    }
    /* All ranks are here, and the failure's message is still this one's. */
    return v2v_par_agree(self->comm, v2v_comm_rank(self->comm) == worst ? rc : V2V_OK);
}

enum v2v_status v2v_agreement_tell(struct v2v_agreement *self, enum v2v_status rc)
{
    struct round *now = &self->round[self->now], *before = &self->round[1 - self->now];
    tell(self, now, rc);
    self->now = 1 - self->now;
    return learn_older(self, before, now);
}

enum v2v_status v2v_agreement_end(struct v2v_agreement *self)
{
    return learn_older(self, &self->round[1 - self->now], &self->round[self->now]);
}
