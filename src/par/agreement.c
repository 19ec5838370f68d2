#include "v2v3d/par/agreement.h"

#include "par/comm_mpi.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"

#include <time.h>

/* In a period of the watchdog a rank that computes tells so this often. */
#define ALIVE_PARTS 4

/* Between two looks of a rank that waits. Its core is free for threads that compute meanwhile. */
#define LOOK_NANOSECONDS 50000

/* What the ranks tell of one round. */
struct round {
    int *code;            /* [ranks] */
    MPI_Request *request; /* [2 * ranks] */
    int under_way;        /* told, and not learnt yet */
};

static int is_missed(const struct round *round, int rank)
{
    return round->request[2 * rank] != MPI_REQUEST_NULL;
}

struct v2v_agreement {
    const struct v2v_comm *comm;
    struct round round[2];
    int now;    /* which of them is told next */
    int *index; /* [2 * ranks], scratch */
    double told_alive;
};

/* Of a rank that computes, to all others: no payload, so that none has to receive it soon. */
static void tell_alive(void *context)
{
    struct v2v_agreement *self = context;
    const double now = v2v_clock_now(), period = v2v_watchdog_period();
    if (!(period > 0.0) || now - self->told_alive < period / ALIVE_PARTS) {
        return;
    }
    self->told_alive = now;
    for (int r = 0; r < v2v_comm_size(self->comm); r++) {
        MPI_Request request = MPI_REQUEST_NULL;
        if (r != v2v_comm_rank(self->comm)) {
            MPI_Isend(NULL, 0, MPI_BYTE, r, V2V_TAG_ALIVE, v2v_comm_mpi(self->comm), &request);
            MPI_Request_free(&request);
        }
    }
}

/* Has one of the ranks that are missed in this round said that it is alive? */
static int hear_alive(const struct v2v_agreement *self, const struct round *round)
{
    MPI_Comm mpi = v2v_comm_mpi(self->comm);
    int heard = 0, is_there = 1;
    while (is_there) {
        MPI_Status status;
        MPI_Iprobe(MPI_ANY_SOURCE, V2V_TAG_ALIVE, mpi, &is_there, &status);
        if (is_there) {
            MPI_Recv(NULL, 0, MPI_BYTE, status.MPI_SOURCE, V2V_TAG_ALIVE, mpi, MPI_STATUS_IGNORE);
            heard = heard || is_missed(round, status.MPI_SOURCE);
        }
    }
    return heard;
}

enum v2v_status v2v_agreement_create(struct v2v_agreement **agreement, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_agreement *self = NULL;
    int64_t ranks = v2v_comm_size(comm);
    V2V_TRY(V2V_ALLOC(self, "par.agreement", 1));
    self->comm = comm;
    V2V_TRY(V2V_ALLOC(self->index, "par.agreement", 2 * ranks));
    for (int i = 0; i < 2; i++) {
        V2V_TRY(V2V_ALLOC(self->round[i].code, "par.agreement", ranks));
        V2V_TRY(V2V_ALLOC(self->round[i].request, "par.agreement", 2 * ranks));
    }
    if (ranks > 1) {
        v2v_watchdog_listen(tell_alive, self);
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
    v2v_watchdog_listen(NULL, NULL);
    v2v_mem_free(self->index);
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

static void await(const struct v2v_agreement *self, struct round *round)
{
    static const char what[] = "waiting for a round of other ranks";
    const struct timespec pause = {.tv_nsec = LOOK_NANOSECONDS};
    const int requests = 2 * v2v_comm_size(self->comm);
    int done = 0; /* MPI_UNDEFINED: nothing is left */
    v2v_watchdog_wait(what);
    for (;;) {
        MPI_Testsome(requests, round->request, &done, self->index, MPI_STATUSES_IGNORE);
        if (done == MPI_UNDEFINED) {
            return;
        }
        if (hear_alive(self, round)) {
            v2v_watchdog_wait(what);
        }
        nanosleep(&pause, NULL);
    }
}

/* The lowest of the ranks whose code is the worst. */
static int learn(const struct v2v_agreement *self, struct round *round)
{
    int ranks = v2v_comm_size(self->comm), worst = 0;
    if (ranks > 1) {
        double began = v2v_clock_now();
        await(self, round);
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

enum v2v_status v2v_agreement_meet(struct v2v_agreement *self)
{
    const enum v2v_status rc = v2v_agreement_tell(self, V2V_OK);
    return rc == V2V_OK ? v2v_agreement_end(self) : rc;
}

enum v2v_status v2v_agreement_alone(const struct v2v_comm *comm,
                                    enum v2v_status (*work)(void *context), void *context)
{
    struct v2v_agreement *agreement = NULL;
    enum v2v_status rc = v2v_agreement_create(&agreement, comm);
    V2V_TRY(v2v_par_agree(comm, rc));
    V2V_TRY(v2v_agreement_meet(agreement)); /* all are connected: beats get through */
    if (v2v_comm_rank(comm) == 0) {
        rc = work(context);
    }
    V2V_TRY(v2v_agreement_tell(agreement, rc));
    V2V_TRY(v2v_agreement_end(agreement));
done:
    v2v_agreement_destroy(&agreement);
    return rc;
}
