/** What becomes of two volumes of a frame.
 *
 *  The mean, the larger voxel, or weights of slices that are learned from the frame: those with
 *  which the volume explains its views best (REFERENCE.md 4).
 */
#ifndef RECON_COMBINATION_H
#define RECON_COMBINATION_H

#include "v2v3d/method/estimator.h"
#include "v2v3d/par/slicing.h"

struct v2v_combination;

/** Floats that v2v_combination_create would take on one of so many ranks of a shard, beside a
 *  volume of the rows that it has. @kind Local. */
int64_t v2v_combination_floats(const struct v2v_problem *problem, int ranks);

/** @kind  Collective(grid->shard)
 *  @param grid and slicing are borrowed; slicing: of rows into whole slices, NULL: they are whole
 *  @param rows of every slice that this rank has
 *  @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_combination_create(struct v2v_combination **combination,
                                       const struct v2v_problem *problem,
                                       const struct v2v_grid *grid, struct v2v_slicing *slicing,
                                       int64_t rows) V2V_MUST_CHECK;
void v2v_combination_destroy(struct v2v_combination **combination);

/** @kind   Collective(grid->sample), no allocation
 *  @param  result [slices,rows,x] out, the same on both ranks of a pair
 *  @param  volume [2] of these, NULL the one that the other rank of the pair holds
 *  @param  views [v,y,x], of the frame; their units do not matter */
void v2v_combination_run(struct v2v_combination *combination, float *result,
                         const float *const *volume, const float *views);

#endif
