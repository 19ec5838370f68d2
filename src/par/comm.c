#include "v2v3d/par/comm.h"

#include "par/comm_mpi.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* MPI_Abort can wait for daemons that are gone; this long, then the rank leaves by itself. */
#define ABORT_SECONDS 10.0

struct v2v_comm {
    MPI_Comm mpi;
    int rank;
    int size;
    int world_rank; /**< the rank that messages name */
    int *scratch;   /**< 4 * size numbers: counts and offsets of what is sent and received */
};

MPI_Comm v2v_comm_mpi(const struct v2v_comm *comm)
{
    return comm != NULL ? comm->mpi : MPI_COMM_SELF;
}

int *v2v_comm_scratch(const struct v2v_comm *comm)
{
    return comm != NULL ? comm->scratch : NULL;
}

int v2v_comm_rank(const struct v2v_comm *comm)
{
    return comm != NULL ? comm->rank : 0;
}

int v2v_comm_size(const struct v2v_comm *comm)
{
    return comm != NULL ? comm->size : 1;
}

/** Storage for a communicator of `size` ranks; *comm stays NULL on failure. */
static enum v2v_status comm_alloc(struct v2v_comm **comm, int size)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_comm *fresh = NULL;
    *comm = NULL;
    V2V_TRY(V2V_ALLOC(fresh, "par.comm", 1));
    fresh->mpi = MPI_COMM_NULL;
    V2V_TRY(V2V_ALLOC(fresh->scratch, "par.comm", 4 * (int64_t)size));
    *comm = fresh;
    fresh = NULL;
done:
    v2v_mem_free(fresh);
    return rc;
}

static void abort_after_bug(void)
{
    v2v_par_abort(v2v_status_exit_code(V2V_E_INTERNAL));
}

/* Launchers speak PMIx or PMI to what they start. */
static int is_alone(void)
{
    return getenv("PMIX_NAMESPACE") == NULL && getenv("PMI_RANK") == NULL &&
           getenv("PMI_FD") == NULL;
}

/* mpirun says how many of the ranks it started here. */
static int is_one_host(void)
{
    const char *all = getenv("OMPI_COMM_WORLD_SIZE");
    const char *here = getenv("OMPI_COMM_WORLD_LOCAL_SIZE");
    return all != NULL && here != NULL && strcmp(all, here) == 0;
}

/* What Open MPI need not look for: networks, on one host (its start 0.11 s instead of 0.33); a
 * daemon that could start more ranks, without mpirun (the whole program 0.13 s instead of 0.33).
 * Medians of three, two cores. */
static void start_lightly(void)
{
    if (is_alone()) {
        setenv("OMPI_MCA_pml", "ob1", 0);
        setenv("OMPI_MCA_btl", "self", 0);
        setenv("OMPI_MCA_ess_singleton_isolated", "1", 0);
        /* Its name would be every lone program's, of which the first to end removes it. */
        setenv("OMPI_MCA_orte_create_session_dirs", "0", 0);
    } else if (is_one_host()) {
        setenv("OMPI_MCA_pml", "ob1", 0);
        setenv("OMPI_MCA_btl", "self,vader", 0);
    }
}

enum v2v_status v2v_par_init(struct v2v_comm **world, int *argc, char ***argv)
{
    enum v2v_status rc = V2V_OK;
    int provided = 0, size = 0, rank = 0;
    *world = NULL;
    /* Nothing here uses MPI's shared file pointers. For them Open MPI would make a lock file beside
     * every output of ranks on several hosts, which a killed run leaves behind; the component named
     * here is for one host alone. */
    setenv("OMPI_MCA_sharedfp", "sm", 0);
    /* HDF5 from 1.13.2 on refuses what ranks write by themselves where MPI wants MPI_File_sync to
     * make it visible to others: here nobody reads it before the file is closed and on the disk. */
    setenv("HDF5_DO_MPI_FILE_SYNC", "0", 0);
    start_lightly();
    MPI_Init_thread(argc, argv, MPI_THREAD_FUNNELED, &provided);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    v2v_log_set_rank(rank, size);
    v2v_fault_set_rank(rank);
    v2v_status_on_bug(abort_after_bug);
    if (provided < MPI_THREAD_FUNNELED) {
        rc = V2V_FAIL(V2V_E_INTERNAL, "this MPI library does not allow threads");
    } else {
        rc = comm_alloc(world, size);
    }
    /* There is no struct v2v_comm to agree on yet. */
    int code = (int)rc;
    MPI_Allreduce(MPI_IN_PLACE, &code, 1, MPI_INT, MPI_MAX, MPI_COMM_WORLD);
    if (rc == V2V_OK && code != (int)V2V_OK) {
        rc = V2V_FAIL((enum v2v_status)code, "another rank could not start");
    }
    V2V_TRY(rc);
    MPI_Comm_dup(MPI_COMM_WORLD, &(*world)->mpi);
    (*world)->rank = (*world)->world_rank = rank;
    (*world)->size = size;
done:
    if (rc != V2V_OK) {
        v2v_par_finalize(world);
    }
    return rc;
}

void v2v_par_finalize(struct v2v_comm **world)
{
    v2v_comm_destroy(world);
    v2v_status_on_bug(NULL);
    MPI_Finalize();
}

void v2v_par_abort(int exit_code)
{
    int started = 0, ended = 0;
    MPI_Initialized(&started);
    MPI_Finalized(&ended);
    if (started && !ended) {
        v2v_watchdog_arm(ABORT_SECONDS, "MPI_Abort");
        MPI_Abort(MPI_COMM_WORLD, exit_code);
    }
    _exit(exit_code);
}

/* Ranks of `from`, which holds some of the parent's, by colour and key. Collective(parent). */
static enum v2v_status split(struct v2v_comm **comm, const struct v2v_comm *parent, MPI_Comm from,
                             int colour, int key)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_par_agree(parent, comm_alloc(comm, parent->size)));
    MPI_Comm_split(from, colour, key, &(*comm)->mpi);
    MPI_Comm_rank((*comm)->mpi, &(*comm)->rank);
    MPI_Comm_size((*comm)->mpi, &(*comm)->size);
    (*comm)->world_rank = parent->world_rank;
done:
    if (rc != V2V_OK) {
        v2v_comm_destroy(comm);
    }
    return rc;
}

enum v2v_status v2v_comm_split(struct v2v_comm **comm, const struct v2v_comm *parent, int colour,
                               int key)
{
    *comm = NULL;
    if (parent == NULL) {
        return V2V_OK; /* alone is alone */
    }
    V2V_ASSERT(colour >= 0);
    return split(comm, parent, parent->mpi, colour, key);
}

enum v2v_status v2v_comm_split_host(struct v2v_comm **comm, const struct v2v_comm *parent, int most)
{
    enum v2v_status rc = V2V_OK;
    const int64_t processors = v2v_larger(sysconf(_SC_NPROCESSORS_ONLN), 1);
    const int together = (int)v2v_smaller(most, processors);
    MPI_Comm host = MPI_COMM_NULL;
    int rank = 0;
    *comm = NULL;
    if (parent == NULL) {
        return V2V_OK; /* alone is alone */
    }
    V2V_ASSERT(most >= 1);
    MPI_Comm_split_type(parent->mpi, MPI_COMM_TYPE_SHARED, parent->rank, MPI_INFO_NULL, &host);
    MPI_Comm_rank(host, &rank);
    rc = split(comm, parent, host, rank / together, rank);
    MPI_Comm_free(&host);
    return rc;
}

void v2v_comm_destroy(struct v2v_comm **comm)
{
    if (*comm == NULL) {
        return;
    }
    if ((*comm)->mpi != MPI_COMM_NULL) {
        MPI_Comm_free(&(*comm)->mpi);
    }
    v2v_mem_free((*comm)->scratch);
    v2v_mem_free(*comm);
    *comm = NULL;
}

/** This rank's record, for all. The rank's name is put in front once, however many communicators
 * agree on the failure one after the other. */
static void verdict_fill(struct v2v_status_record *verdict, int world_rank)
{
    const char *message = v2v_status_message();
    int rank = 0, used = 0;
    if (sscanf(message, "rank %d: %n", &rank, &used) == 1 && used > 0) {
        snprintf(verdict->message, sizeof verdict->message, "%s", message);
    } else {
        snprintf(verdict->message, sizeof verdict->message, "rank %d: %s", world_rank, message);
    }
    snprintf(verdict->place, sizeof verdict->place, "%s", v2v_status_place());
}

enum v2v_status v2v_par_agree(const struct v2v_comm *comm, enum v2v_status rc)
{
    struct {
        int code;
        int rank;
    } worst;
    if (v2v_comm_size(comm) == 1) {
        return rc;
    }
    worst.code = (int)rc;
    worst.rank = comm->rank;
    double began = v2v_clock_now();
    /* Of equal codes MPI_MAXLOC takes the lowest rank. */
    MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_2INT, MPI_MAXLOC, comm->mpi);
    if (worst.code != (int)V2V_OK) {
        struct v2v_status_record verdict = {{0}, {0}};
        if (comm->rank == worst.rank) {
            verdict_fill(&verdict, comm->world_rank);
        }
        MPI_Bcast(&verdict, (int)sizeof verdict, MPI_BYTE, worst.rank, comm->mpi);
        v2v_status_restore(&verdict);
    }
    v2v_par_spent(V2V_PAR_AGREE, began);
    return (enum v2v_status)worst.code;
}
