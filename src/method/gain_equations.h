/** Gains of views by what a volume of them misses, whatever the volume itself is off by:
 *  generalised least squares, the volume's errors being a random field. REFERENCE.md 13. */
#ifndef V2V_METHOD_GAIN_EQUATIONS_H
#define V2V_METHOD_GAIN_EQUATIONS_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/par/comm.h"
#include "v2v3d/par/slicing.h"

struct v2v_gain_equations;

/** What is known before a solution. */
struct v2v_gain_knowledge {
    double noise; /**< deviation of a sample; 0: none is seen */
    double light; /**< mean square of a voxel */
};

/** For views of [height,width] through these PSFs, judged in these rows and columns.
 *  @kind Collective(comm). @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_gain_equations_create(struct v2v_gain_equations **equations,
                                          const struct v2v_psf_file *psf, int64_t height,
                                          int64_t width, struct v2v_part rows,
                                          struct v2v_part columns, enum v2v_split split,
                                          const struct v2v_comm *comm) V2V_MUST_CHECK;
/** @kind Collective(comm). */
void v2v_gain_equations_destroy(struct v2v_gain_equations **equations);

/** Products with the matrix of the equations that a solution takes at most. @kind Local. */
int v2v_gain_equations_products(void);

/** The parts of their projections by which views are brighter, less what all are by: times the
 *  projections' squares their sum is 0. 0 for a view that shows nothing. @kind Collective(comm), no
 *  allocation, the same bits on any number of ranks.
 *  @param gain [views] out
 *  @param missed [views,y,x] of views, less their projections; where views are blind V2V_BLIND.
 *         Written over
 *  @param predicted [views,y,x]: the projections. Written over */
void v2v_gain_equations_solve(struct v2v_gain_equations *equations, double *gain, float *missed,
                              float *predicted, const struct v2v_gain_knowledge *knowledge);

#endif
