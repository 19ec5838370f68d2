/** Numbers of views, as gains and shifts, by what a volume of them misses, whatever the volume
 *  itself is off by: generalised least squares, the volume's errors being a random field.
 *  REFERENCE.md 13. */
#ifndef V2V_METHOD_LEAST_SQUARES_H
#define V2V_METHOD_LEAST_SQUARES_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/par/comm.h"
#include "v2v3d/par/slicing.h"

/** Numbers of a view, at most. */
enum { V2V_LEAST_SQUARES_TERMS = 2 };

struct v2v_least_squares;

/** What is known before a solution. */
struct v2v_volume_errors {
    double noise;  /**< deviation of what a sample is missed by; of much less than projections
                      single precision makes nothing, REFERENCE.md 13 */
    double square; /**< mean square of a voxel's error; 0: nothing is shown */
};

/** What is asked for. */
struct v2v_least_squares_terms {
    int count;       /**< numbers of a view */
    float *images;   /**< [count,views,y,x]: what a unit of each adds to its view. Written over */
    int is_relative; /**< what numbers have in common is the volume's: times the squares of images
                        their sum is 0 */
};

/** For views of [height,width] through these PSFs, judged in these rows and columns.
 *  @kind Collective(comm). @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_least_squares_create(struct v2v_least_squares **least_squares,
                                         const struct v2v_psf_file *psf, int64_t height,
                                         int64_t width, struct v2v_part rows,
                                         struct v2v_part columns, enum v2v_split split,
                                         const struct v2v_comm *comm) V2V_MUST_CHECK;
/** @kind Collective(comm). */
void v2v_least_squares_destroy(struct v2v_least_squares **least_squares);

/** Products with the matrix of the equations that a solution takes at most. @kind Local. */
int v2v_least_squares_products(void);

/** The numbers by which views differ from their projections. 0 for those whose images are 0, or so
 *  small that noise alone would make two units.
 *  @kind Collective(comm), no allocation, the same bits on any number of ranks.
 *  @param numbers [terms->count,views] out
 *  @param missed [views,y,x] of views, less their projections; where views are blind V2V_BLIND.
 *         Written over */
void v2v_least_squares_solve(struct v2v_least_squares *least_squares, double *numbers,
                             float *missed, const struct v2v_least_squares_terms *terms,
                             const struct v2v_volume_errors *errors);

#endif
