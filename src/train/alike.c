#include "train/alike.h"

#include "v2v3d/io/file.h"
#include "v2v3d/op/instructions.h"

#include <omp.h>
#include <stdio.h>

enum v2v_status v2v_alike_processors(const struct v2v_config *config, const struct v2v_comm *comm)
{
    enum { INSTRUCTIONS, THREADS, KINDS };
    const int64_t own[KINDS] = {v2v_op_instructions(), omp_get_max_threads()};
    int64_t most[2 * KINDS] = {own[0], own[1], -own[0], -own[1]};
    if (!config->parallel.reproducible) {
        return V2V_OK;
    }
    v2v_par_max_i64(comm, most, 2 * KINDS);
    if (most[INSTRUCTIONS] != -most[KINDS + INSTRUCTIONS]) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "parallel.reproducible: the ranks' processors have different instructions, "
                        "which round differently; choose hosts of one kind, or limit all by "
                        "DNNL_MAX_CPU_ISA");
    }
    if (most[THREADS] != -most[KINDS + THREADS]) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "parallel.reproducible: the ranks have from %lld to %lld threads; set "
                        "parallel.threads",
                        (long long)-most[KINDS + THREADS], (long long)most[THREADS]);
    }
    return V2V_OK;
}

enum { NOT_HELD = -1 };

static void take_checksums(struct v2v_trainer *trainer, int64_t *checksum)
{
    const struct v2v_schema *schema = &trainer->network->schema;
    for (int64_t g = 0; g < schema->groups; g++) {
        const struct v2v_group *group = &schema->group[g];
        const float *weights = trainer->network->weights + group->first;
        int held = group->count > 0 && !trainer->grid.idle;
        uint32_t crc = v2v_file_crc32c(0, weights, group->count * (int64_t)sizeof *weights);
        checksum[g] = held ? (int64_t)crc : NOT_HELD;
    }
}

/* How many ranks hold what rank r holds of a group; checksum [rank,group] begins at that group. */
static int count_alike(const int64_t *checksum, int size, int64_t groups, int r)
{
    int count = 0;
    for (int other = 0; other < size; other++) {
        count += checksum[other * groups] == checksum[r * groups];
    }
    return count;
}

/* Most ranks are right; of a tie, the lower ones. The same answer on all ranks. */
static enum v2v_status compare(const int64_t *checksum, int size, int64_t groups, const char *name,
                               int64_t step)
{
    enum { NAMED = 8 };
    char ranks[16 * NAMED] = "";
    int right = NOT_HELD, wrong = 0, length = 0;
    for (int r = 0; r < size; r++) {
        if (checksum[r * groups] != NOT_HELD &&
            (right == NOT_HELD ||
             count_alike(checksum, size, groups, r) > count_alike(checksum, size, groups, right))) {
            right = r;
        }
    }
    for (int r = 0; r < size && right != NOT_HELD; r++) {
        int64_t held = checksum[r * groups];
        if (held == NOT_HELD || held == checksum[right * groups]) {
            continue;
        }
        if (wrong++ < NAMED) {
            length += snprintf(ranks + length, sizeof ranks - (size_t)length, "%s%d",
                               length > 0 ? ", " : "", r);
        }
    }
    if (wrong == 0) {
        return V2V_OK;
    }
    return V2V_FAIL(V2V_E_INTERNAL,
                    "after step %lld the weights of %s on rank %s%s are not those of rank %d: "
                    "memory or network of a host is bad; the last checkpoint is older than that",
                    (long long)step, name, ranks, wrong > NAMED ? ", .." : "", right);
}

enum v2v_status v2v_alike_weights(struct v2v_trainer *trainer, int64_t step)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_comm *world = trainer->grid.world;
    const struct v2v_schema *schema = &trainer->network->schema;
    const int64_t groups = schema->groups;
    int size = v2v_comm_size(world);
    int64_t *checksum = trainer->checksums;
    if (size == 1) {
        return V2V_OK;
    }
    for (int64_t i = 0; i < size * groups; i++) {
        checksum[i] = 0;
    }
    take_checksums(trainer, checksum + v2v_comm_rank(world) * groups);
    v2v_par_sum_i64(world, checksum, size * groups);
    for (int64_t g = 0; g < groups; g++) {
        V2V_TRY(compare(checksum + g, size, groups, schema->group[g].name, step));
    }
done:
    return rc;
}
