#ifndef V2V3D_SRC_OPTICS_ZERNIKE_H
#define V2V3D_SRC_OPTICS_ZERNIKE_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include <stddef.h>
#include <stdint.h>

/** Coefficients of an aberration, in waves RMS, by Noll's index 1 .. V2V_ZERNIKE_MOST. */
struct v2v_zernike {
    double waves[V2V_ZERNIKE_MOST + 1]; /* [0] is not used */
    int64_t last;                       /* largest index that is not 0; 0: none */
};

/** From "4:0.1, 11:-0.05". @kind Local. @return V2V_OK | V2V_E_CONFIG, naming the piece */
enum v2v_status v2v_zernike_parse(struct v2v_zernike *zernike, const char *text) V2V_MUST_CHECK;

/** What v2v_zernike_parse takes. @kind Local. @return V2V_OK | V2V_E_CONFIG: more than `bytes` */
enum v2v_status v2v_zernike_print(char *text, size_t bytes,
                                  const struct v2v_zernike *zernike) V2V_MUST_CHECK;

/** Sum of waves[j] * Z_j(y, x) in the unit disk, waves. Z_j is normalised to a mean square of 1
 *  over the disk. @kind Local. @source R. J. Noll, J. Opt. Soc. Am. 66, 207 (1976), table I */
double v2v_zernike_at(const struct v2v_zernike *zernike, double y, double x);

#endif
