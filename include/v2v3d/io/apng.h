#ifndef V2V3D_IO_APNG_H
#define V2V3D_IO_APNG_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/png.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Pictures in a row that browsers and viewers play, over and over: an animated PNG, of which other
 *  programs show the first. All are of the first one's size. It has its name once it is finished.
 *  @kind Local. @return V2V_OK | V2V_E_IO | V2V_E_MEMORY; after a failure v2v_apng_abandon
 *  @source PNG, third edition (W3C, 2025), 11.3.2: acTL, fcTL, fdAT */
struct v2v_apng;
enum v2v_status v2v_apng_create(struct v2v_apng **apng, const char *path, int64_t frames,
                                int frames_per_second) V2V_MUST_CHECK;
enum v2v_status v2v_apng_put(struct v2v_apng *apng, const struct v2v_canvas *canvas) V2V_MUST_CHECK;
/** *apng is NULL afterwards. */
enum v2v_status v2v_apng_finish(struct v2v_apng **apng) V2V_MUST_CHECK;
/** Accepts NULL. */
void v2v_apng_abandon(struct v2v_apng **apng);

#ifdef __cplusplus
}
#endif

#endif
