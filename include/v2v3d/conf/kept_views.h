#ifndef V2V3D_CONF_KEPT_VIEWS_H
#define V2V3D_CONF_KEPT_VIEWS_H

#include "v2v3d/base/status.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** The views of a PSF set and of its recordings that are used: all but those that
 *  input.without_views lists, as "3, 7". */
struct v2v_kept_views {
    int64_t count;
    int64_t *view; /**< [count] numbers among all of them, ascending; owned */
};

/** @kind Local. @param without "": all are used @param views of the set
 *  @return V2V_OK | V2V_E_CONFIG (no list of numbers below `views`, one twice, none is left) |
 *  V2V_E_MEMORY */
enum v2v_status v2v_kept_views_init(struct v2v_kept_views *kept, const char *without,
                                    int64_t views) V2V_MUST_CHECK;
/** The number, among all of them, of the `view`-th that is kept: what messages and files call it.
 *  @kind Local. @param without that v2v_kept_views_init took */
int64_t v2v_kept_views_number(const char *without, int64_t view);
/** @kind Local. Accepts a zeroed one. */
void v2v_kept_views_fini(struct v2v_kept_views *kept);

#ifdef __cplusplus
}
#endif

#endif
