#ifndef V2V3D_EVAL_QUALITY_H
#define V2V3D_EVAL_QUALITY_H

#include "v2v3d/base/status.h"
#include "v2v3d/eval/structure.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/par/comm.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** How a view y is met by the projection p of a volume, without a truth. */
struct v2v_match {
    double yy, yp, pp;              /**< sums over the pixels of y*y, y*p, p*p .. */
    double y, p;                    /**< .. and of each */
    double noise;                   /**< sum of sigma^2 */
    struct v2v_structure structure; /**< by v2v_match_views */
};

/** One view, but for blind samples (tensor/blind.h), its structure left out. Add the members for
 *  several. @kind Local. @param recorded, projected, scratch [y,x] */
struct v2v_match v2v_match_of(float *scratch, const float *recorded, const float *projected,
                              int64_t height, int64_t width);
void v2v_match_add(struct v2v_match *sum, const struct v2v_match *match);

/** All views of a frame, of_view [count] out. @kind Local. @return their sum
 *  @param  recorded, projected [count,y,x]; both 0 on return where samples were blind
 *  @param  scratch [y,x] */
struct v2v_match v2v_match_views(struct v2v_match *of_view, float *scratch, float *recorded,
                                 float *projected, int64_t count, int64_t height, int64_t width);

/** The factor s with the least |y - s p|; 1 for a dark projection. @kind Local. */
double v2v_match_scale(const struct v2v_match *match);
/** |y - scale p| / |y|, to 1e-8, NaN for dark views; and in units of the noise, the root mean
 *  square: 1 where nothing but noise is missed, NaN where the views have none. NaN, too, where the
 *  projection left the range of float32. @kind Local. */
double v2v_match_residual(const struct v2v_match *match, double scale);
double v2v_match_sigmas(const struct v2v_match *match, double scale);
/** sum p / sum y: light of the volume, as the PSFs bring it into the frame, over that recorded.
 *  Light that the volume sends beyond the border counts on neither side; light that comes from
 *  beyond it is recorded and in no volume. NaN where sum y <= 0. @kind Local. */
double v2v_match_flux(const struct v2v_match *match);

/** A flux from which on, or below one over it, a volume's light is not that of its views. */
#define V2V_MATCH_MUCH_LIGHT 1.25

/** Of views and projections of one frame, the view that is most unlike the volume's in brightness
 *  (v2v_structure_brightness). @kind Local. @param times out: as bright as it should be
 *  @return the view; -1: none is */
int64_t v2v_match_odd_view(double *times, const struct v2v_match *of_view, int64_t views);

/** Mean of x[0], x[stride] .. that are not NaN; NaN when none is. @kind Local. */
double v2v_mean_of_known(const double *x, int64_t count, int64_t stride);

/** The match of one frame.
 *  @kind   Local
 *  @param  of_view [count] out: of each view; match: of all
 *  @param  displaced [count] out: pixels that each view lies from its projection, where 0.03 of the
 *          structure or more is missed; NaN where not, or where there is no telling
 *  @param  views, projected [count,y,x]; both 0 on return where samples were blind
 *  @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_match_frame(struct v2v_match *match, struct v2v_match *of_view,
                                double *displaced, float *views, float *projected, int64_t count,
                                int64_t height, int64_t width) V2V_MUST_CHECK;

/** Views of a volume, for once: as many at a time as have half a gigabyte of OTFs over all ranks,
 *  or half of what a memory limit leaves a rank, or one; nothing is kept.
 *  @kind   Collective(comm)
 *  @param  projected [v,y,x] out, whole @param slices [v2v_par_part(Z, ranks, rank),y,x]
 *  @param  scale 1, or 1/Z for the mean over z
 *  @return V2V_OK | V2V_E_MEMORY; agreed
 *  @cost   V * Z transforms of PSFs, Z of slices for as many views as go together, and V inverse,
 *          over all ranks */
enum v2v_status v2v_match_project(float *projected, const struct v2v_psf_file *psf,
                                  const float *slices, int64_t height, int64_t width, float scale,
                                  const struct v2v_comm *comm) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
