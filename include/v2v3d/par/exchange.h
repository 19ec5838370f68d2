#ifndef V2V3D_PAR_EXCHANGE_H
#define V2V3D_PAR_EXCHANGE_H
#include "v2v3d/par/comm.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Everybody gives everybody a piece: to_part[r] of `sent` goes to rank r, what rank r gives lands
 *  at from_part[r] of `received`; either may be empty. Counted in words of 4, 8 or 16 bytes, any
 *  number of them. @kind Collective(comm) */
void v2v_par_alltoall(const struct v2v_comm *comm, void *received, const struct v2v_part *from_part,
                      const void *sent, const struct v2v_part *to_part, size_t word);

#ifdef __cplusplus
}
#endif

#endif
