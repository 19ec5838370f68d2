#include "v2v3d/par/grid.h"

enum v2v_status v2v_grid_create(struct v2v_grid *grid, struct v2v_comm *world, int branches)
{
    enum v2v_status rc = V2V_OK;
    int size = v2v_comm_size(world), rank = v2v_comm_rank(world);
    *grid = (struct v2v_grid){.world = world};
    if (branches < 0 || branches > 2) {
        return V2V_FAIL(V2V_E_CONFIG, "parallel.branches: %d is outside [0, 2]", branches);
    }
    if (branches == 2 && size == 1) {
        return V2V_FAIL(V2V_E_CONFIG, "parallel.branches: 2 needs two ranks, this run has one");
    }
    if (branches == 0) {
        branches = size % 2 == 0 ? 2 : 1;
    }
    grid->data_size = size / branches;
    grid->branch_size = branches;
    grid->idle = rank >= grid->data_size * branches;
    grid->data_rank = grid->idle ? -1 : rank / branches;
    grid->branch_rank = grid->idle ? -1 : rank % branches;
    /* The idle rank's colour is one that nobody else has. */
    V2V_TRY(v2v_comm_split(&grid->pair, world, grid->idle ? size : grid->data_rank, rank));
    V2V_TRY(v2v_comm_split(&grid->column, world, grid->idle ? size : grid->branch_rank, rank));
done:
    if (rc != V2V_OK) {
        v2v_grid_destroy(grid);
    }
    return rc;
}

void v2v_grid_destroy(struct v2v_grid *grid)
{
    v2v_comm_destroy(&grid->pair);
    v2v_comm_destroy(&grid->column);
    *grid = (struct v2v_grid){0};
}
