/** The local half of an iteration of total variation (method/tv.c): everything but the data step.
 *
 *  Duals of what is to be small: of the differences of x along x, y and z, together of magnitude
 *  lambda at most, of its curvature (REFERENCE.md 10) in the plane, and w of x >= 0, at most what x
 *  itself costs. Every number of a step depends on its neighbours alone. A rank holds rows of the
 *  torus and, at either side, two more of the volume and one of the duals, computed there as
 *  here.
 */
#ifndef METHOD_TV_PLANES_H
#define METHOD_TV_PLANES_H

#include "v2v3d/base/status.h"
#include "v2v3d/optics/data_step.h"
#include "v2v3d/par/transfer.h"
#include <stdint.h>

enum { V2V_TV_BELOW, V2V_TV_ABOVE, V2V_TV_SIDES };
enum { V2V_TV_DX, V2V_TV_DY, V2V_TV_DZ, V2V_TV_CURVATURE, V2V_TV_DUALS };

/** Rows of the volume beyond a rank's at either side; a rank of several has as many of its own. */
enum { V2V_TV_BEYOND = 2 };

struct v2v_tv_planes {
    const struct v2v_comm *comm; /* borrowed */
    int threads;
    int64_t slices, rows, width; /* of this rank; the torus is periodic in rows and columns */
    float *volume;               /* [z,rows,x]: 2 x' - x, and K^T u in its place */
    float *beside;               /* [V2V_TV_SIDES,z,2,x]: rows of it beyond this rank's */
    float *edges;                /* [V2V_TV_SIDES,z,2,x]: rows that others have there */
    float *dual[V2V_TV_DUALS];   /* [z,rows+2,x], from one row above on */
    float *positive;             /* [z,rows,x]: w */
    float *scratch;              /* [thread,4,x+2] */
    struct v2v_transfers *transfers;
};

/** Weights of an iteration. K is all that has a dual: x times `plain`, its differences, its
 *  Laplacian times `bend`. */
struct v2v_tv_steps {
    float lambda; /**< weight of the total variation, in units of the volume */
    float depth;  /**< of a difference along z, against one along x or y */
    float plain;  /**< of x in K .. */
    float sparse; /**< what x costs, over `plain`: the largest w */
    float bend;   /**< .. and of the Laplacian, against a difference along x or y .. */
    float bound;  /**< .. and the largest magnitude of its dual, in units of the volume */
    float sigma;  /**< of the dual step */
    float shrink; /**< 0 .. 1: of the duals before they are bounded; 1: total variation, less: its
                       square where differences are small (Huber) .. */
    float shrink_bent; /**< .. and of the curvature's */
    float relax;       /**< 1 .. 2: over-relaxation */
};

/** What a step of the volume costs beside these: sigma K^T K, differences along z by their bound.
 *  @kind Local. */
struct v2v_penalty v2v_tv_planes_penalty(const struct v2v_tv_steps *steps);

/** Duals of x >= 0 times `factor`, for `plain` over it: K^T u stays. @kind Local. */
void v2v_tv_planes_rescale(struct v2v_tv_planes *planes, float factor);

/** @kind Local. @return V2V_OK | V2V_E_MEMORY; _fini after both */
enum v2v_status v2v_tv_planes_init(struct v2v_tv_planes *planes, int64_t slices, int64_t rows,
                                   int64_t width, const struct v2v_comm *comm) V2V_MUST_CHECK;
void v2v_tv_planes_fini(struct v2v_tv_planes *planes);

/** Floats of a rank with so many rows. @kind Local. */
int64_t v2v_tv_planes_floats(int64_t slices, int64_t rows, int64_t width);

/** An empty volume, no duals. @kind Local. */
void v2v_tv_planes_clear(struct v2v_tv_planes *planes);

/** The duals u move along K of `volume`, 2 x' - x of the data step, which becomes K^T u.
 *  @kind Collective(comm), no allocation */
void v2v_tv_planes_step(struct v2v_tv_planes *planes, const struct v2v_tv_steps *steps);

/** `volume` becomes K^T u again. @kind Local, after a step of the same weights. */
void v2v_tv_planes_gradient(struct v2v_tv_planes *planes, const struct v2v_tv_steps *steps);

#endif
