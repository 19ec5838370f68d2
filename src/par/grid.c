#include "v2v3d/par/grid.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"

enum { BRANCHES = 2 };

/* On psf/2psam at width 128: the part of a frame's multiply-adds that every rank of a shard does, a
 * quarter of the sides and less; and what a pair loses to its larger branch, over half a frame.
 * That is 1.07 by multiply-adds; less is taken, as what slabs lose to exchanges is not counted
 * either. */
static const double whole_share = 0.02, pair_loss = 1.04;

static enum v2v_status check(const struct v2v_grid_shape *shape, int most_branches, int ranks)
{
    int least =
        (shape->branches > 0 ? shape->branches : 1) * (shape->shards > 0 ? shape->shards : 1);
    if (shape->branches < 0 || shape->branches > most_branches) {
        return V2V_FAIL(V2V_E_CONFIG, "parallel.branches: %d is outside [0, %d]", shape->branches,
                        most_branches);
    }
    if (shape->shards < 0) {
        return V2V_FAIL(V2V_E_CONFIG, "parallel.shards: %d is below 0", shape->shards);
    }
    if (least > ranks) {
        return V2V_FAIL(
            V2V_E_CONFIG,
            "parallel.branches, parallel.shards: %d x %d need %d ranks, this run has %d",
            shape->branches, shape->shards, least, ranks);
    }
    return V2V_OK;
}

int64_t v2v_grid_slab_rows(const struct v2v_grid_work *work, int shards)
{
    int64_t units = v2v_parts(work->height, work->unit), cuts = v2v_smaller(shards - 1, 2);
    int64_t rows = v2v_par_part(units, shards, 0).count * work->unit;
    return v2v_smaller(rows + cuts * work->margin, units * work->unit);
}

/* Those rows as a part of the frame. */
static double part_of_slab(const struct v2v_grid_work *work, int shards)
{
    return (double)v2v_grid_slab_rows(work, shards) /
           (double)v2v_round_up(work->height, work->unit);
}

/* In units of one item on one rank. */
static double seconds_of(const struct v2v_grid_work *work, const struct v2v_grid_shape *shape,
                         int ranks)
{
    int64_t data = ranks / (shape->branches * shape->shards);
    int64_t rounds = (work->items + data - 1) / data;
    double part = shape->shards > 1
                      ? whole_share + (1.0 - whole_share) * part_of_slab(work, shape->shards)
                      : 1.0;
    return (double)rounds * part * (shape->branches > 1 ? pair_loss / BRANCHES : 1.0);
}

static int fits(const struct v2v_grid_work *work, const struct v2v_grid_shape *shape)
{
    double part = part_of_slab(work, shape->shards);
    double fixed = (double)work->fixed_bytes / shape->branches;
    double rest = (double)(work->bytes - work->fixed_bytes) * part;
    return work->most_bytes == 0 || fixed + rest <= (double)work->most_bytes;
}

enum v2v_status v2v_grid_choose(struct v2v_grid_shape *shape, const struct v2v_grid_shape *wanted,
                                const struct v2v_grid_work *work, int ranks)
{
    enum v2v_status rc = V2V_OK;
    double least = 0.0;
    int found = 0, found_fits = 0;
    V2V_TRY(check(wanted, work->most_branches, ranks));
    for (int shards = 1; shards <= ranks; shards++) {
        for (int branches = 1; branches <= work->most_branches; branches++) {
            const struct v2v_grid_shape tried = {branches, shards};
            int is_wanted =
                (wanted->branches == 0 || wanted->branches == branches) &&
                (wanted->shards == 0 ? shards <= work->most_shards : wanted->shards == shards);
            if (!is_wanted || branches * shards > ranks) {
                continue;
            }
            double seconds = seconds_of(work, &tried, ranks);
            int is_fitting = fits(work, &tried);
            if (!found || is_fitting > found_fits ||
                (is_fitting == found_fits && seconds < least)) {
                *shape = tried;
                least = seconds;
                found_fits = is_fitting;
                found = 1;
            }
        }
    }
    V2V_ASSERT(found);
done:
    return rc;
}

enum v2v_status v2v_grid_create(struct v2v_grid *grid, struct v2v_comm *world,
                                const struct v2v_grid_shape *shape)
{
    enum v2v_status rc = V2V_OK;
    int size = v2v_comm_size(world), rank = v2v_comm_rank(world);
    int branches = shape->branches, shards = shape->shards, together = branches * shards;
    *grid = (struct v2v_grid){.world = world};
    V2V_ASSERT(branches >= 1 && shards >= 1);
    V2V_TRY(check(shape, BRANCHES, size));
    grid->data_size = size / together;
    grid->branch_size = branches;
    grid->shard_size = shards;
    grid->idle = rank >= grid->data_size * together;
    grid->data_rank = grid->idle ? -1 : rank / together;
    grid->branch_rank = grid->idle ? -1 : rank / shards % branches;
    grid->shard_rank = grid->idle ? -1 : rank % shards;
    /* An idle rank's colour is one that nobody else has. */
    int alone = size + rank;
    V2V_TRY(v2v_comm_split(&grid->shard, world, grid->idle ? alone : rank / shards, rank));
    V2V_TRY(v2v_comm_split(&grid->pair, world,
                           grid->idle ? alone : grid->data_rank * shards + grid->shard_rank, rank));
    V2V_TRY(v2v_comm_split(&grid->sample, world, grid->idle ? alone : grid->data_rank, rank));
    V2V_TRY(v2v_comm_split(&grid->column, world,
                           grid->idle ? alone : grid->branch_rank * shards + grid->shard_rank,
                           rank));
done:
    if (rc != V2V_OK) {
        v2v_grid_destroy(grid);
    }
    return rc;
}

enum v2v_status v2v_grid_lay_out(struct v2v_grid *grid, struct v2v_comm *world,
                                 const struct v2v_grid_shape *wanted,
                                 const struct v2v_grid_work *work)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_grid_shape shape;
    struct v2v_grid_work largest = *work; /* ranks of more threads take more memory */
    int ranks = v2v_comm_size(world);
    v2v_par_max_i64(world, &largest.bytes, 1);
    v2v_par_max_i64(world, &largest.fixed_bytes, 1);
    V2V_TRY(v2v_grid_choose(&shape, wanted, &largest, ranks));
    V2V_TRY(v2v_grid_create(grid, world, &shape));
    v2v_log(V2V_LOG_INFO, "grid: %d data x %d branch x %d shard ranks, %d idle", grid->data_size,
            grid->branch_size, grid->shard_size,
            ranks - grid->data_size * grid->branch_size * grid->shard_size);
done:
    return rc;
}

void v2v_grid_destroy(struct v2v_grid *grid)
{
    v2v_comm_destroy(&grid->shard);
    v2v_comm_destroy(&grid->pair);
    v2v_comm_destroy(&grid->sample);
    v2v_comm_destroy(&grid->column);
    *grid = (struct v2v_grid){0};
}
