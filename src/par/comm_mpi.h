/** The one way from struct v2v_comm to MPI, for the rooms that may speak it: par, io, fft. */
#ifndef V2V3D_PAR_COMM_MPI_PRIVATE_H
#define V2V3D_PAR_COMM_MPI_PRIVATE_H

#include "v2v3d/base/clock.h"
#include "v2v3d/par/comm.h"
#include "v2v3d/par/time.h"

#include <mpi.h>

/** The communicator behind `comm`, borrowed; MPI_COMM_SELF for NULL. @kind Local. */
MPI_Comm v2v_comm_mpi(const struct v2v_comm *comm);

/** 4 * size numbers that belong to the communicator; NULL for NULL. @kind Local. */
int *v2v_comm_scratch(const struct v2v_comm *comm);

/** The parts of `count` items that ranks 0 .. size-1 have, as MPI's counts and offsets.
 *  @kind Local. */
void v2v_par_list_parts(int *counts, int *offsets, int64_t count, int size);

/** Who sends to a rank beside others tells its messages from theirs. */
enum {
    V2V_TAG_PAIR = 1,
    V2V_TAG_PARTS,
    V2V_TAG_TRANSFER,
    V2V_TAG_AGREEMENT,
    V2V_TAG_ALIVE,
    V2V_TAG_TIFF,
    V2V_TAG_PACKED
};

/** Book the time since `began`, a v2v_clock_now() before a call of MPI that may wait. @kind Local,
 *  MPI's thread. */
void v2v_par_spent(enum v2v_par_kind kind, double began);

#endif
