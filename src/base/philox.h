#ifndef V2V3D_BASE_PHILOX_PRIVATE_H
#define V2V3D_BASE_PHILOX_PRIVATE_H
#include <stdint.h>

/** Philox 4x32-10 of Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011: ten
 *  rounds over `counter` in place. @kind Local. */
void v2v_philox(uint32_t counter[4], const uint32_t key[2]);

#endif
