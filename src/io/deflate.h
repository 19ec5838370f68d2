/** Images as HDF5's filters "shuffle" and "deflate" store them. */
#ifndef V2V_IO_DEFLATE_H
#define V2V_IO_DEFLATE_H

#include "v2v3d/base/status.h"
#include <stdint.h>

/** Bytes that v2v_deflate may need for an image of so many. @kind Local. */
int64_t v2v_deflate_bound(int64_t bytes);

/** The first bytes of all elements, then the second ones, ...: neighbours are alike there.
 *  @kind Local. @param out [bytes], not `in` */
void v2v_shuffle(uint8_t *out, const uint8_t *in, int64_t elements, int64_t element_bytes);

/** @kind Local. @param count in: the room of `out`; out: bytes there
 *  @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_deflate(uint8_t *out, int64_t *count, const uint8_t *in, int64_t bytes,
                            int level) V2V_MUST_CHECK;

#endif
