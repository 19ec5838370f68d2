#ifndef V2V3D_PAR_GRID_H
#define V2V3D_PAR_GRID_H
#include "v2v3d/par/comm.h"

#ifdef __cplusplus
extern "C" {
#endif

/** How the world is laid out: world rank r = (data * branches + branch) * shards + shard. */
struct v2v_grid_shape {
    int branches; /**< ranks that share a sample, one branch each: 2, or 1 with both on every rank
                   */
    int shards;   /**< ranks that share a frame or crop, one slab of rows each */
};

/** What a run has to spread over its ranks. */
struct v2v_grid_work {
    int64_t items;  /**< frames, or samples of a batch: as many at a time as there are data ranks */
    int64_t height; /**< rows of an item */
    int64_t unit;   /**< slabs are multiples of so many rows .. */
    int64_t margin; /**< .. and computed with so many more at every cut */
    int64_t most_bytes;  /**< that a rank may hold; 0: no limit */
    int64_t bytes;       /**< that an item takes on one rank, and .. */
    int64_t fixed_bytes; /**< .. what of it a slab takes whatever its rows, a branch half of */
    int most_shards;
    int most_branches; /**< outputs of the method, that ranks may hold one each */
};

/** Rows that the slab with most of them computes, margins included. @kind Local. */
int64_t v2v_grid_slab_rows(const struct v2v_grid_work *work, int shards);

/** The shape that ends first by the work's arithmetic, with what is asked for kept: `wanted` 0 is
 *  free. Frames side by side come first, then branches, then slabs: that is the order of what they
 *  lose. Shapes that do not fit most_bytes are left out while there are others.
 *  @kind Local: the same on all ranks. @return V2V_OK | V2V_E_CONFIG (more than `ranks`; branches
 *  outside [0, work->most_branches]) */
enum v2v_status v2v_grid_choose(struct v2v_grid_shape *shape, const struct v2v_grid_shape *wanted,
                                const struct v2v_grid_work *work, int ranks) V2V_MUST_CHECK;

/** The process grid data x branch x shard (jobs/README.md, Ranks). */
struct v2v_grid {
    int data_size, data_rank;     /**< different crops or frames */
    int branch_size, branch_rank; /**< 1: this rank holds both branches; 2: one each */
    int shard_size, shard_rank;   /**< slabs of one frame or crop */
    int idle; /**< a left-over rank: data_rank = branch_rank = shard_rank = -1, it holds no branch
                   but joins the world's collectives */
    struct v2v_comm *world;  /**< borrowed */
    struct v2v_comm *shard;  /**< ranks that share a branch of a sample: shard_size ranks */
    struct v2v_comm *pair;   /**< ranks that share a slab of a sample: branch_size ranks */
    struct v2v_comm *sample; /**< ranks that share a sample: branch_size * shard_size ranks */
    struct v2v_comm *column; /**< ranks that hold the same slab and branch: data_size ranks */
};

/** Lay the world out in this shape. Ranks that are left over are idle, each with communicators of
 * its own.
 *  @kind Collective(world). @return V2V_OK | V2V_E_CONFIG (a shape of more ranks than there are) |
 *  V2V_E_MEMORY */
enum v2v_status v2v_grid_create(struct v2v_grid *grid, struct v2v_comm *world,
                                const struct v2v_grid_shape *shape) V2V_MUST_CHECK;

/** Choose the shape (v2v_grid_choose), by what the largest rank takes, lay the world out in it
 *  and log it. @kind Collective(world). @return as the two above */
enum v2v_status v2v_grid_lay_out(struct v2v_grid *grid, struct v2v_comm *world,
                                 const struct v2v_grid_shape *wanted,
                                 const struct v2v_grid_work *work) V2V_MUST_CHECK;

/** @kind Collective(world) */
void v2v_grid_destroy(struct v2v_grid *grid);

#ifdef __cplusplus
}
#endif

#endif
