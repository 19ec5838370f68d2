/* The ranks of this host, as its kernel sees them: for the last words of one that waits in vain. */
#ifndef V2V3D_PAR_MATES_PRIVATE_H
#define V2V3D_PAR_MATES_PRIVATE_H

#include <mpi.h>
#include <stddef.h>

/* Learn the process numbers of this host's other ranks; forget them. Without memory for it nobody
 * is known. Collective(world); local. */
void v2v_mates_learn(MPI_Comm world);
void v2v_mates_forget(void);

/* Write who of them no longer runs, such as "rank 2 is stopped; ", to text; returns its length. For
 * signal handlers: no memory, no locks, no stdio. */
size_t v2v_mates_lost(char *text, size_t bytes);

#endif
