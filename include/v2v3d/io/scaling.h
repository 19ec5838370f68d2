#ifndef V2V3D_IO_SCALING_H
#define V2V3D_IO_SCALING_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/par/comm.h"

#ifdef __cplusplus
extern "C" {
#endif

/** What the network sees is (counts - offset) * gain: one pair for a whole recording, but for
 *  v2v_scaling_level. */
struct v2v_scaling {
    double offset, gain;
    double pedestal; /**< counts that may be the camera's zero, though nothing says it; 0: none */
    int is_guessed;  /**< bool: the offset is 32767, since nothing is said of one */
    const struct v2v_calibration *calibration; /**< its shading is divided out; NULL: none */
};

/** Decide them: given numbers as they are; none: 0 and 1; auto offset: what the recording states,
 *  else 32767 when its mean is above it, no sample above 65535 and the first frame's dark not far
 *  below, else 0; auto gain: the mean of the recording's samples that see something, after the
 *  offset, becomes 0.2 (REFERENCE.md 1). Where nothing is stated and auto takes 0, the pedestal is
 *  what the first frame has at least (v2v_dark_of_images). Reads all frames once when the
 *  offset has to be guessed or the gain is auto, split over ranks.
 *  @kind Collective(comm). @return V2V_OK | V2V_E_MEMORY | V2V_E_INPUT (auto gain and a mean that
 *  no float32 gain makes 0.2); agreed */
enum v2v_status v2v_scaling_decide(struct v2v_scaling *scaling, struct v2v_recording *recording,
                                   const struct v2v_input_settings *settings,
                                   const struct v2v_comm *comm) V2V_MUST_CHECK;

/** A pedestal that was left, and an offset that was guessed, are worth a warning, by rank 0.
 *  @kind Local.
 *  @param recording what it is called */
void v2v_scaling_warn(const struct v2v_scaling *scaling, const char *recording,
                      const struct v2v_comm *comm);

/** x <- (x - offset) * gain / shading, in place; V2V_BLIND stays. @kind Local.
 *  @param x with a calibration, all its views [v,y,x] */
void v2v_scaling_apply(const struct v2v_scaling *scaling, float *x, int64_t count);

/** Frame t so, and 0 where nothing is seen. @kind Local. @param x [v,y,x] @param blind out: samples
 *  that see nothing; NULL: not asked for @return as v2v_recording_read_seen */
enum v2v_status v2v_scaling_read_dark(const struct v2v_scaling *scaling,
                                      struct v2v_recording *recording, float *x, int64_t *blind,
                                      int64_t t) V2V_MUST_CHECK;

/** Bring a frame to a level of its own, for a network that is to be homogeneous in brightness:
 *  x <- x * f, f = 0.2 / max(|mean|, mean noise of a view / 10), so that s x becomes what x becomes
 *  (REFERENCE.md 1); an empty frame, or one that is not finite, is left as it is. In place.
 *  @kind Local, deterministic. @param x [v,y,x] @param scratch [y,x] @return f, else 1
 *  @cost a selection among the pixels of every view */
double v2v_scaling_level(float *x, float *scratch, int64_t views, int64_t height, int64_t width);

#ifdef __cplusplus
}
#endif

#endif
