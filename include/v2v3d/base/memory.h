#ifndef V2V3D_BASE_MEMORY_H
#define V2V3D_BASE_MEMORY_H
#include "v2v3d/base/status.h"
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** What disks and file systems take as it is, from a place in memory of the same multiple. */
#define V2V_PAGE_BYTES 4096

/** Zeroed memory, 64-byte aligned, from 1 MB on by V2V_PAGE_BYTES, counted under its label.
 *  @kind   Local
 *  @param  label string literal such as "unet.weights"; kept by pointer
 *  @param  count elements, >= 0 (0 gives a valid pointer); size bytes of one; the product is
 * checked
 *  @return NULL when memory or the limit is short; the failure is recorded */
void *v2v_mem_alloc(const char *label, int64_t count, size_t size);

/** Give it back; accepts NULL. @kind Local. */
void v2v_mem_free(void *memory);

/** Take `count` elements for pointer `p`: V2V_TRY(V2V_ALLOC(p, "label", count)). */
#define V2V_ALLOC(p, label, count)                                                                 \
    (((p) = v2v_mem_alloc((label), (count), sizeof *(p))) != NULL ? V2V_OK : V2V_E_MEMORY)

/** Refuse to hold more than this many bytes; 0 = no limit. @kind Local. */
void v2v_mem_set_limit(size_t bytes);

/** Bytes that are left of the limit; SIZE_MAX without one. @kind Local. */
size_t v2v_mem_room(void);

/** Bytes held now, and the most ever held. @kind Local. */
size_t v2v_mem_held(void);
size_t v2v_mem_peak(void);

/** Print peak bytes by label, largest first, through the log. @kind Local. */
void v2v_mem_report(void);

/** a * b * c, or -1 when it leaves int64_t or a factor is negative. @kind Local. */
int64_t v2v_mem_product(int64_t a, int64_t b, int64_t c);

/** Bytes of `floats` and `more` bytes; INT64_MAX where that, or a product that `floats` comes from
 *  (-1), leaves int64_t. @kind Local. */
static inline int64_t v2v_mem_bytes(int64_t floats, int64_t more)
{
    const int64_t most = INT64_MAX / (int64_t)sizeof(float);
    return floats < 0 || floats > most || more > INT64_MAX - floats * (int64_t)sizeof(float)
               ? INT64_MAX
               : floats * (int64_t)sizeof(float) + more;
}

#ifdef __cplusplus
}
#endif

#endif
