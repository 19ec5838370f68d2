/* How the room's collectives count their time: about every call of MPI that may wait. */
#ifndef V2V3D_PAR_SPENT_PRIVATE_H
#define V2V3D_PAR_SPENT_PRIVATE_H

#include "v2v3d/base/clock.h"
#include "v2v3d/par/time.h"

/* Count the time since `began`, a v2v_clock_now() before the call. MPI's thread only. */
void v2v_par_spent(enum v2v_par_kind kind, double began);

#endif
