#ifndef V2V3D_SIM_NOISE_H
#define V2V3D_SIM_NOISE_H

#include "v2v3d/base/status.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** The most counts of a camera. */
#define V2V_NOISE_MOST_COUNTS 65535

enum v2v_noise_kind { V2V_NOISE_NONE, V2V_NOISE_GAUSSIAN, V2V_NOISE_POISSON, V2V_NOISE_CAMERA };

/** gaussian:S: standard deviation S * level. poisson:N: N photons at `level`, in the views' units.
 *  camera:N:GAIN:OFFSET:READ: what a camera's 16 bits hold of N photons at `level`: whole counts,
 *  rint(OFFSET + GAIN * (photons + READ * normal)), 0 .. 65535.
 *  level = 99.5th percentile of the clean views. */
struct v2v_noise {
    int kind;
    double amount;             /**< S or N */
    double gain, offset, read; /**< counts a photon; counts at no light; photons */
    double level;
};

/** "none", "gaussian:S" (S >= 0), "poisson:N" (N > 0), "camera:N[:GAIN[:OFFSET[:READ]]]" (1, 100,
 *  1.6). @kind Local. @return V2V_OK | V2V_E_USAGE */
enum v2v_status v2v_noise_parse(struct v2v_noise *noise, const char *text) V2V_MUST_CHECK;

/** Set the level from all clean views of a frame.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (with noise, a level that is not above 1e-5 of the
 *  brightest sample, which is round-off) | V2V_E_MEMORY */
enum v2v_status v2v_noise_level(struct v2v_noise *noise, const float *clean,
                                int64_t count) V2V_MUST_CHECK;

/** Can the noise of these samples be drawn?
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (more than 1e15 photons in one; a camera saturates
 *  before) */
enum v2v_status v2v_noise_check(const struct v2v_noise *noise, const float *clean,
                                int64_t count) V2V_MUST_CHECK;

/** expected[i], what noisy[i] is in the mean: clean[i], but for a camera, whose counts never
 *  saturate there. @kind Local; expected may be clean. */
void v2v_noise_expected(float *expected, const float *clean, int64_t count,
                        const struct v2v_noise *noise);

/** noisy[i] of sample number first + i of frame t. @kind Local; noisy may be clean. */
void v2v_noise_apply(float *noisy, const float *clean, int64_t count, const struct v2v_noise *noise,
                     uint64_t seed, int64_t t, int64_t first);

#ifdef __cplusplus
}
#endif

#endif
