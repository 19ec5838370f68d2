#ifndef V2V3D_PAR_GRID_H
#define V2V3D_PAR_GRID_H
#include "v2v3d/par/comm.h"

#ifdef __cplusplus
extern "C" {
#endif

/** The process grid data x branch (DESIGN.md 3; shards come with a later issue). World rank
 *  r = data * branches + branch. */
struct v2v_grid {
    int data_size, data_rank;     /**< different crops or frames */
    int branch_size, branch_rank; /**< 1: this rank holds both branches; 2: one each */
    int idle;                     /**< a left-over rank: data_rank = branch_rank = -1, it holds no
                                       branch but joins the world's collectives */
    struct v2v_comm *world;       /**< borrowed */
    struct v2v_comm *pair;        /**< ranks that share a sample: branch_size ranks */
    struct v2v_comm *column;      /**< ranks that hold the same branch: data_size ranks */
};

/** Lay the world out. `branches` 1 or 2, or 0 to choose: 2 when the rank count is even, else 1.
 * With an odd rank count and branches = 2 the last rank is idle (a pair and a column of its own).
 *  @kind Collective(world). @return V2V_OK | V2V_E_CONFIG (branches = 2 on one rank) | V2V_E_MEMORY
 */
enum v2v_status v2v_grid_create(struct v2v_grid *grid, struct v2v_comm *world,
                                int branches) V2V_MUST_CHECK;

/** @kind Collective(world) */
void v2v_grid_destroy(struct v2v_grid *grid);

#ifdef __cplusplus
}
#endif

#endif
