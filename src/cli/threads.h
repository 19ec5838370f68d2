#ifndef V2V_CLI_THREADS_H
#define V2V_CLI_THREADS_H

#include "v2v3d/par/comm.h"
#include <stddef.h>
#include <stdint.h>

/** Threads of this rank: `wanted` when positive; else the cores that this rank may run on, shared
 * with the ranks of this host that may run on the same ones, at most OMP_NUM_THREADS when that is
 * set, and at least 1. @kind Collective(world) */
int v2v_cli_threads(int64_t wanted, const struct v2v_comm *world);

/** Ranks on this host whose cores are the same as this rank's. @kind Collective(world) */
int v2v_cli_neighbours(const struct v2v_comm *world);

/** Cores that this rank may run on. @kind Local */
int v2v_cli_cores(void);

/** How long a thread looks for work before it sleeps, where the user did not say: libgomp's own
 *  10 ms are spent in vain whenever another thread of the barrier has lost its core to other work;
 *  hundredths of a millisecond are enough for those of idle cores. libgomp reads the variable when
 *  it is loaded: the program starts once more with it.
 *  @kind Local, before MPI starts; may not return */
void v2v_cli_settle_waiting(char **argv);

/** What says so: a variable and its value. @kind Local. @param text of `bytes` */
void v2v_cli_waiting(char *text, size_t bytes);

#endif
