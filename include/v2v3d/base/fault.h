#ifndef V2V3D_BASE_FAULT_H
#define V2V3D_BASE_FAULT_H
#include "v2v3d/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/** A fault point: in builds with V2V_FAULTS the n-th passage of `site` on one rank fails when the
 *  environment has V2V_FAULT=site:rank:nth (n from 1; `nth+`: every passage from the n-th on). The
 *  site "mem" is every v2v_mem_alloc. Elsewhere it is V2V_OK and costs nothing.
 *  @kind Local. @return V2V_OK | V2V_E_IO (injected) */
enum v2v_status v2v_fault_at(const char *site);

/** The rank that V2V_FAULT is compared with. @kind Local. */
void v2v_fault_set_rank(int rank);

#ifdef V2V_FAULTS
#define V2V_FAULT_POINT(site) v2v_fault_at(site)
#else
#define V2V_FAULT_POINT(site) V2V_OK
#endif

#ifdef __cplusplus
}
#endif

#endif
