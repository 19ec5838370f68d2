#ifndef V2V_CLI_THREADS_H
#define V2V_CLI_THREADS_H

#include "v2v3d/par/comm.h"
#include <stdint.h>

/** Threads of this rank: `wanted` when positive; else the cores that this rank may run on, shared
 * with the ranks of this host that may run on the same ones, at most OMP_NUM_THREADS when that is
 * set, and at least 1. @kind Collective(world) */
int v2v_cli_threads(int64_t wanted, const struct v2v_comm *world);

/** Ranks on this host whose cores are the same as this rank's. @kind Collective(world) */
int v2v_cli_neighbours(const struct v2v_comm *world);

/** Cores that this rank may run on. @kind Local */
int v2v_cli_cores(void);

#endif
