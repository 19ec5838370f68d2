#include "train/checkpoint.h"

#include "v2v3d/base/fault.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/weights_file.h"
#include "v2v3d/train/train.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define DAMAGED "weights.bad.h5"

enum { ARENAS = V2V_WEIGHTS_GROUPS, MAIN_RANK = 0, OTHER_RANK = 1 };

static enum v2v_status path_in(char *path, const char *folder, const char *name)
{
    return v2v_text_format(path, V2V_PATH_BYTES, "%s/%s", folder, name);
}

int v2v_checkpoint_exists(const char *folder)
{
    char newest[V2V_PATH_BYTES], previous[V2V_PATH_BYTES];
    return path_in(newest, folder, V2V_RUN_WEIGHTS) == V2V_OK &&
           path_in(previous, folder, V2V_RUN_WEIGHTS_BEFORE) == V2V_OK &&
           (v2v_file_exists(newest) || v2v_file_exists(previous));
}

enum v2v_status v2v_checkpoint_forget(const char *folder)
{
    /* the previous one first: what a kill leaves in between is the newest */
    static const char *const name[] = {V2V_RUN_WEIGHTS_BEFORE, V2V_RUN_WEIGHTS, DAMAGED};
    enum v2v_status rc = V2V_OK;
    char path[V2V_PATH_BYTES];
    for (size_t i = 0; i < sizeof name / sizeof *name; i++) {
        V2V_TRY(path_in(path, folder, name[i]));
        if (unlink(path) != 0 && errno != ENOENT) {
            V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: cannot be removed: %s", path, strerror(errno)));
        }
    }
done:
    return rc;
}

/* ---- write ---- */

/* The arenas of the whole network on rank 0. When the outputs are on two ranks, groups that only
 * the other one has are fetched from there, else they are the trainer's own. */
struct whole {
    struct v2v_schema schema;
    float *arena[ARENAS]; /* in the order of the file's groups; NULL: there is none */
    float *taken;         /* what this rank had to allocate */
};

static void list_arenas(const struct v2v_trainer *trainer, float *arena[ARENAS])
{
    const int averages = trainer->average != NULL;
    arena[V2V_WEIGHTS] = averages ? trainer->average : trainer->network->weights;
    arena[V2V_WEIGHTS_M] = trainer->m;
    arena[V2V_WEIGHTS_V] = trainer->v;
    arena[V2V_WEIGHTS_LAST] = averages ? trainer->network->weights : NULL;
}

static enum v2v_status take_whole(struct whole *whole, struct v2v_trainer *trainer)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_network_spec spec = {.config = trainer->config,
                                          .views = trainer->network->views,
                                          .slices = trainer->network->slices,
                                          .outputs = V2V_NETWORK_ALL};
    V2V_TRY(v2v_network_schema(&whole->schema, trainer->ops->name, &spec));
    const int64_t total = whole->schema.fields.total;
    V2V_TRY(V2V_ALLOC(whole->taken, "checkpoint", v2v_mem_product(ARENAS, total, 1)));
    for (int i = 0; i < ARENAS; i++) {
        const int is_kept = i != V2V_WEIGHTS_LAST || trainer->average != NULL;
        whole->arena[i] = is_kept ? whole->taken + i * total : NULL;
    }
done:
    return rc;
}

/* A group's part of all arenas: copied, or from the other rank. Collective over the pair of rank 0.
 */
static void gather_group(struct whole *whole, struct v2v_trainer *trainer, int64_t g)
{
    float *own[ARENAS];
    const struct v2v_comm *pair = trainer->grid.pair;
    const struct v2v_group *here = &trainer->network->schema.group[g];
    const struct v2v_group *there = &whole->schema.group[g];
    int is_main = trainer->grid.branch_rank == MAIN_RANK;
    int64_t is_held = here->count > 0;
    list_arenas(trainer, own);
    v2v_par_broadcast(pair, &is_held, sizeof is_held, MAIN_RANK);
    for (int i = 0; i < ARENAS && own[i] != NULL; i++) {
        if (!is_held) {
            float *place = is_main ? whole->arena[i] + there->first : own[i] + here->first;
            int64_t count = is_main ? there->count : here->count;
            v2v_par_broadcast(pair, place, count * (int64_t)sizeof(float), OTHER_RANK);
        } else if (is_main) {
            memcpy(whole->arena[i] + there->first, own[i] + here->first,
                   (size_t)here->count * sizeof(float));
        }
    }
}

/* Keep the newest as the previous generation; at every moment one of them is complete. */
static enum v2v_status rotate(const char *folder)
{
    enum v2v_status rc = V2V_OK;
    char newest[V2V_PATH_BYTES], previous[V2V_PATH_BYTES], between[V2V_PATH_BYTES];
    V2V_TRY(path_in(newest, folder, V2V_RUN_WEIGHTS));
    V2V_TRY(path_in(previous, folder, V2V_RUN_WEIGHTS_BEFORE));
    V2V_TRY(v2v_file_temporary(between, previous));
    if (!v2v_file_exists(newest)) {
        goto done;
    }
    (void)unlink(between);
    if (link(newest, between) != 0 || rename(between, previous) != 0) {
        /* a file system without hard links: a short time with the previous generation alone */
        if (rename(newest, previous) != 0) {
            V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: cannot keep the older checkpoint: %s", newest,
                             strerror(errno)));
        }
    }
    (void)unlink(between); /* rename() keeps it when both names are the same file already */
done:
    return rc;
}

static enum v2v_status write_files(struct v2v_trainer *trainer, const struct whole *whole,
                                   const char *folder, const struct v2v_trained *trained,
                                   const char *config)
{
    enum v2v_status rc = V2V_OK;
    char path[V2V_PATH_BYTES];
    const struct v2v_network *network = trainer->network;
    struct v2v_weights_info info;
    V2V_TRY(v2v_network_describe(&info, trainer->config, network->views, network->slices,
                                 trained->steps));
    info.seconds = trained->seconds;
    info.levels = v2v_sampler_sources(trainer->sampler)->levels;
    info.psf_sum = trainer->psf_sum;
    V2V_TRY(V2V_FAULT_POINT("checkpoint.write"));
    V2V_TRY(rotate(folder));
    V2V_TRY(path_in(path, folder, V2V_RUN_WEIGHTS));
    const float *group[ARENAS];
    for (int i = 0; i < ARENAS; i++) {
        group[i] = whole->arena[i];
    }
    V2V_TRY(v2v_weights_file_write(path, &info, &whole->schema.fields, group, NULL, config));
done:
    return rc;
}

enum v2v_status v2v_checkpoint_write(struct v2v_trainer *trainer, const char *folder,
                                     const struct v2v_trained *trained, const char *config)
{
    enum v2v_status rc = V2V_OK, mine = V2V_OK;
    struct whole whole = {0};
    const struct v2v_grid *grid = &trainer->grid;
    int writes = v2v_comm_rank(grid->world) == 0, split = grid->branch_size > 1;
    if (writes && split) {
        mine = take_whole(&whole, trainer);
    }
    V2V_TRY(v2v_par_agree(grid->world, mine));
    if (split && grid->data_rank == 0 && grid->shard_rank == 0 && !grid->idle) {
        for (int64_t g = 0; g < trainer->network->schema.groups; g++) {
            gather_group(&whole, trainer, g);
        }
    } else if (writes) {
        list_arenas(trainer, whole.arena);
    }
    if (writes) {
        struct whole view = whole;
        if (!split) {
            view.schema = trainer->network->schema;
        }
        mine = write_files(trainer, &view, folder, trained, config);
    }
    V2V_TRY(v2v_par_agree(grid->world, mine));
done:
    v2v_schema_fini(&whole.schema);
    v2v_mem_free(whole.taken);
    return rc;
}

/* ---- read ---- */

/* Settings for a message. */
static const char *in_one_line(char *settings)
{
    for (char *at = settings; *at != '\0'; at++) {
        *at = *at == '\n' ? ' ' : *at;
    }
    return settings;
}

static int is_near(double a, double b)
{
    return fabs(a - b) <= 1e-6 * fabs(b); /* another processor rounds otherwise */
}

/* As far as they are known. */
static int are_same_levels(const struct v2v_level_range *a, const struct v2v_level_range *b)
{
    if (a->frames == 0 || b->frames == 0) {
        return 1;
    }
    int are_same = a->frames == b->frames;
    for (int i = 0; i < V2V_LEVEL_FIGURES; i++) {
        are_same = are_same && is_near(a->least[i], b->least[i]) && is_near(a->most[i], b->most[i]);
    }
    return are_same;
}

static enum v2v_status read_file(struct v2v_trainer *trainer, const char *path,
                                 struct v2v_trained *trained)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_weights_info info;
    const struct v2v_network *network = trainer->network;
    const struct v2v_fields *fields = &network->schema.fields;
    struct v2v_weights_info own;
    struct v2v_config config = *trainer->config;
    const int is_any = (trainer->ops->traits & V2V_TRAIT_ANY) != 0; /* views and slices */
    V2V_TRY(V2V_FAULT_POINT("checkpoint.read"));
    V2V_TRY(v2v_weights_file_info(&info, path));
    *trained = (struct v2v_trained){info.step, info.seconds};
    const int on_root = v2v_comm_rank(trainer->grid.world) == 0;
    if (on_root && !v2v_weights_suit(&info, trainer->psf_sum)) {
        v2v_log(V2V_LOG_WARNING,
                "%s: was trained with other PSFs, or another calibration of them, until here",
                path);
    }
    if (on_root && !are_same_levels(&info.levels, &v2v_sampler_sources(trainer->sampler)->levels)) {
        v2v_log(V2V_LOG_WARNING, "%s: was trained on other frames until here", path);
    }
    V2V_TRY(v2v_network_adopt(&config, &info, path)); /* settings as this program writes them */
    V2V_TRY(v2v_network_describe(&info, &config, info.views, info.slices, info.step));
    V2V_TRY(v2v_network_describe(&own, trainer->config, network->views, network->slices, 0));
    if (strcmp(info.method, own.method) != 0 || strcmp(info.settings, own.settings) != 0 ||
        (!is_any && (info.views != own.views || info.slices != own.slices))) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG,
                         "%s: a network %s of %lld views, %lld slices with %s; this run has %s, "
                         "%lld, %lld, %s",
                         path, info.method, (long long)info.views, (long long)info.slices,
                         in_one_line(info.settings), own.method, (long long)own.views,
                         (long long)own.slices, in_one_line(own.settings)));
    }
    const int has_last = trainer->average != NULL || v2v_weights_file_has(path, "last");
    const char *last = has_last ? "last" : "weights"; /* an average may end with this attempt */
    rc = v2v_weights_file_read(network->weights, path, last, fields);
    if (rc == V2V_E_INPUT && trainer->average != NULL && !v2v_weights_file_has(path, "last") &&
        v2v_weights_file_read(network->weights, path, "weights", fields) == V2V_OK) {
        rc = V2V_FAIL(V2V_E_CONFIG,
                      "%s: its run averages no weights: it goes on with train.average=0 alone",
                      path);
    }
    V2V_TRY(rc);
    if (trainer->average != NULL) {
        V2V_TRY(v2v_weights_file_read(trainer->average, path, "weights", fields));
    }
    V2V_TRY(v2v_weights_file_read(trainer->m, path, "adam_m", fields));
    V2V_TRY(v2v_weights_file_read(trainer->v, path, "adam_v", fields));
done:
    return rc;
}

/* The previous generation was read: it becomes the newest one, what was damaged steps aside. Else
 * the next rotation would put the damaged file in the place of the good one. Rank 0. */
static enum v2v_status promote_previous(const char *folder)
{
    enum v2v_status rc = V2V_OK;
    char newest[V2V_PATH_BYTES], previous[V2V_PATH_BYTES], damaged[V2V_PATH_BYTES];
    V2V_TRY(path_in(newest, folder, V2V_RUN_WEIGHTS));
    V2V_TRY(path_in(previous, folder, V2V_RUN_WEIGHTS_BEFORE));
    V2V_TRY(path_in(damaged, folder, DAMAGED));
    if ((v2v_file_exists(newest) && rename(newest, damaged) != 0) ||
        rename(previous, newest) != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %s cannot take its place: %s", newest, previous,
                         strerror(errno)));
    }
done:
    return rc;
}

/* Files are opened by their names, and a name may be another file on another host. Agreed. */
static enum v2v_status check_same(const struct v2v_comm *world, const char *path, int64_t number)
{
    int64_t ends[2] = {number, -number};
    v2v_par_max_i64(world, ends, 2);
    return ends[0] == -ends[1] ? V2V_OK
                               : V2V_FAIL(V2V_E_IO,
                                          "%s: ranks see different files by this name: is the "
                                          "folder on a file system that all share?",
                                          path);
}

enum v2v_status v2v_checkpoint_read(struct v2v_trainer *trainer, const char *folder,
                                    struct v2v_trained *trained)
{
    static const char *const generation[] = {V2V_RUN_WEIGHTS, V2V_RUN_WEIGHTS_BEFORE};
    enum v2v_status rc = V2V_OK, read = V2V_OK;
    char path[V2V_PATH_BYTES];
    int main_rank = v2v_comm_rank(trainer->grid.world) == 0;
    for (size_t i = 0; i < sizeof generation / sizeof *generation; i++) {
        V2V_TRY(v2v_par_agree(trainer->grid.world, path_in(path, folder, generation[i])));
        const int64_t there = v2v_file_exists(path);
        V2V_TRY(check_same(trainer->grid.world, path, there));
        if (!there) {
            continue;
        }
        read = v2v_par_agree(trainer->grid.world, read_file(trainer, path, trained));
        if (read == V2V_OK) {
            V2V_TRY(check_same(trainer->grid.world, path, trained->steps));
            int promotes = i > 0 && main_rank;
            V2V_TRY(
                v2v_par_agree(trainer->grid.world, promotes ? promote_previous(folder) : V2V_OK));
            goto done;
        }
        if (read != V2V_E_INPUT) {
            V2V_TRY(read); /* the file may be good: memory is short, the disk fails */
        }
        if (main_rank) {
            v2v_log(V2V_LOG_WARNING, "cannot resume from %s: %s", path, v2v_status_message());
        }
    }
    rc = read;
done:
    return rc;
}
