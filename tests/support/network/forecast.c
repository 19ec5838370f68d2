#include "network/forecast.h"

#include "network/network_table.h"
#include "network/work.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/par/bucket_sum.h"
#include <math.h>

enum { BRANCHES = V2V_FORECAST_BRANCHES };

/* Of a step: the forward pass, gradients of data and of weights. What is more is losses and Adam.
 */
static const double network_passes = 3.0, backward_passes = 2.0;

/* Collectives of a round that carry next to nothing: of a step's ranks, all of them, on norms and
 * votes; of a frame's, to agree on views, volumes and slices, and to mark the frame. */
static const double step_latencies = 4.0, frame_latencies = 6.0;

/* ---- the network ---- */

static int64_t count_layers(const struct v2v_net_layer *table)
{
    int64_t count = 0;
    while (table[count].name != NULL) {
        count++;
    }
    return count;
}

/* Its output has a quarter of the frame's sides or less. */
static int is_whole(const struct v2v_net_layer *layer)
{
    return layer->shrink * layer->stride >= 4 * layer->grow;
}

static enum v2v_status fill_branch(struct v2v_forecast_network *network, int b,
                                   const struct v2v_shifts *shifts)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_model_spec *spec = &network->spec;
    struct v2v_work work;
    int64_t views = (spec->views + 1 - b) / BRANCHES;
    network->branch[b].views = views;
    for (int i = 0; i < network->layers; i++) {
        const struct v2v_net_layer *layer = &v2v_net_unet[network->layers - 1 - i];
        V2V_TRY(v2v_work_of_layer(&work, layer, spec, shifts, b, 1.0));
        network->branch[b].layer[i] = (struct v2v_forecast_layer){
            work.macs, v2v_work_weights(layer, spec, views) * (double)sizeof(float)};
        *(is_whole(layer) ? &network->branch[b].whole_macs : &network->branch[b].cut_macs) +=
            work.macs;
    }
done:
    return rc;
}

enum v2v_status v2v_forecast_network_of(struct v2v_forecast_network *network,
                                        const struct v2v_model_spec *spec,
                                        const struct v2v_shifts *shifts)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_work work;
    *network =
        (struct v2v_forecast_network){.spec = *spec, .layers = (int)count_layers(v2v_net_unet)};
    V2V_ASSERT(network->layers <= V2V_FORECAST_LAYERS);
    for (const struct v2v_net_layer *layer = v2v_net_encoder; layer->name != NULL; layer++) {
        V2V_TRY(v2v_work_of_layer(&work, layer, spec, shifts, 0, 1.0));
        network->view_macs += work.macs;
        network->encoder_bytes += v2v_work_weights(layer, spec, 0) * (double)sizeof(float);
    }
    for (int b = 0; b < BRANCHES; b++) {
        V2V_TRY(fill_branch(network, b, shifts));
    }
done:
    return rc;
}

/* Of the first branch or of both, a pixel of the frame. */
static double macs_of(const struct v2v_forecast_network *network, int branches)
{
    double macs = 0.0;
    for (int b = 0; b < branches; b++) {
        macs += (double)network->branch[b].views * network->view_macs +
                network->branch[b].cut_macs + network->branch[b].whole_macs;
    }
    return macs;
}

double v2v_forecast_macs(const struct v2v_forecast_network *network, int64_t height, int64_t width)
{
    return macs_of(network, BRANCHES) * (double)height * (double)width;
}

/* ---- one rank's share ---- */

/* The job on one grid. */
struct plan {
    const struct v2v_forecast_machine *machine;
    const struct v2v_forecast_job *job;
    int64_t height, width; /* padded */
    int ranks, hosts, branches, shards, data;
    int host_ranks;
    double rows; /* that the largest slab computes, margins included */
    double pixels;
};

static double bytes_of(double floats)
{
    return floats * (double)sizeof(float);
}

static double rows_of_slab(const struct v2v_model_spec *spec, int64_t height, int shards)
{
    struct v2v_grid_work work;
    v2v_model_describe_work(&work, spec, height, V2V_MODEL_GRID);
    return (double)v2v_grid_slab_rows(&work, shards);
}

static void plan_for(struct plan *plan, const struct v2v_grid_shape *shape)
{
    plan->branches = shape->branches;
    plan->shards = shape->shards;
    plan->data = plan->ranks / (shape->branches * shape->shards);
    plan->rows = rows_of_slab(&plan->job->network->spec, plan->height, shape->shards);
}

/* Of the largest rank's branches. */
static double branch_macs(const struct plan *plan, int b)
{
    const struct v2v_forecast_network *network = plan->job->network;
    double views = ceil((double)network->branch[b].views / plan->shards);
    return views * network->view_macs +
           network->branch[b].cut_macs * plan->rows / (double)plan->height +
           network->branch[b].whole_macs;
}

/* Forward passes over one item that its largest rank computes. */
static double passes_of_rank(const struct plan *plan)
{
    const struct v2v_forecast_network *network = plan->job->network;
    double first = branch_macs(plan, 0), second = branch_macs(plan, 1);
    double macs = plan->branches == BRANCHES ? fmax(first, second) : first + second;
    double part = macs * plan->pixels / v2v_forecast_macs(network, plan->height, plan->width);
    double rest = V2V_FORECAST_STEP_PASSES - network_passes; /* of the whole crop on every rank */
    return plan->job->training ? network_passes * part + rest / plan->branches : part;
}

static double passes_of_item(const struct v2v_forecast_job *job)
{
    return job->training ? V2V_FORECAST_STEP_PASSES : 1.0;
}

/* How many times as long as alone a rank computes that shares its host. */
static double slowness(const struct plan *plan)
{
    const struct v2v_forecast_machine *machine = plan->machine;
    int used = plan->data * plan->branches * plan->shards;
    double busy = (double)machine->threads * (double)v2v_smaller(plan->host_ranks, used);
    double cores = machine->cores, threads = machine->threads;
    if (busy >= cores) {
        return machine->crowd * busy / cores;
    }
    return 1.0 + (machine->crowd - 1.0) * (busy - threads) / (cores - threads);
}

/* ---- moving data ---- */

/* `size` ranks that talk, one of `stride` of neighbouring ranks. */
struct group {
    int size, stride;
};

/* Of the others of a group, those on other hosts. */
static double part_abroad(const struct plan *plan, struct group group)
{
    int here = plan->host_ranks / group.stride;
    here = here < 1 ? 1 : here > group.size ? group.size : here;
    return group.size == 1 ? 0.0 : (double)(group.size - here) / (group.size - 1);
}

/* The link's time for what a rank sends to others; all ranks of the host do. */
static double link_s(const struct plan *plan, struct group group, double bytes, double messages)
{
    double abroad = part_abroad(plan, group);
    return abroad * (messages * plan->machine->link_message_s +
                     bytes * plan->host_ranks * plan->machine->link_byte_s);
}

/* What copying takes longer where threads share cores. */
static double sharing(const struct plan *plan)
{
    return fmax(1.0,
                (double)plan->machine->threads * plan->host_ranks / (double)plan->machine->cores);
}

static double exchange_s(const struct plan *plan, struct group group, double bytes, double times)
{
    return sharing(plan) * v2v_comm_exchange_s(&plan->machine->inside, group.size, bytes, times) +
           link_s(plan, group, bytes, times * (group.size - 1));
}

static double allreduce_s(const struct plan *plan, struct group group, double bytes)
{
    double sent = 2.0 * (group.size - 1) / group.size * bytes;
    return sharing(plan) * v2v_comm_allreduce_s(&plan->machine->inside, group.size, bytes) +
           link_s(plan, group, sent, 2.0 * log2(group.size));
}

/* Of one item: what ranks that share it tell each other. */
static double item_s(const struct plan *plan)
{
    const struct v2v_model_spec *spec = &plan->job->network->spec;
    const struct group shard = {plan->shards, 1}, pair = {plan->branches, plan->shards};
    const int training = plan->job->training, others = plan->shards - 1;
    const double held = (double)(BRANCHES / plan->branches);
    const double volume = bytes_of((double)spec->slices * plan->pixels);
    double seconds = 0.0;
    if (plan->shards > 1) {
        double views = ceil((double)spec->views / (plan->branches * plan->shards));
        double features =
            views * bytes_of((double)spec->features * (double)plan->width) * plan->rows * others;
        double quarter = bytes_of((double)spec->width * plan->rows * (double)plan->width / 16.0);
        seconds += (training ? 2.0 : 1.0) * exchange_s(plan, shard, features, views);
        /* E1, and going back what its layer's neighbour above reads, of three times the channels */
        seconds += held * exchange_s(plan, shard, (training ? 4.0 : 1.0) * quarter * others, 1.0);
        seconds +=
            training ? held * exchange_s(plan, shard, volume / plan->shards * others, 1.0)
                     : exchange_s(plan, shard, volume / plan->shards * others / plan->shards, 1.0);
    }
    if (plan->branches > 1) {
        seconds += training ? exchange_s(plan, pair, volume, 1.0)
                            : allreduce_s(plan, pair, volume / plan->shards);
    }
    return seconds;
}

/* A run of gradients in buckets: every rank's parts to those that add them up, `ways` 2: and back.
 */
static double buckets_link_s(const struct plan *plan, struct group group, double bytes, double ways)
{
    double buckets = bytes / bytes_of(V2V_BUCKET_FLOATS);
    double others = group.size - 1;
    return link_s(plan, group, ways * bytes * others / group.size, ways * buckets * others);
}

/* How long after a round's backward pass the link is done with the gradients, which begin to travel
 * when their layer is through. */
static double left_behind(const struct plan *plan, double backward_s, double ways)
{
    const struct v2v_forecast_network *network = plan->job->network;
    const struct group unet = {plan->data * plan->shards, plan->branches};
    const struct group encoder = {plan->data * plan->branches, plan->shards};
    const int branches = BRANCHES / plan->branches;
    const double mac_s = backward_s / macs_of(network, branches);
    double time = 0.0, done = 0.0;
    for (int b = 0; b < branches; b++) {
        for (int i = 0; i < network->layers; i++) {
            const struct v2v_forecast_layer *layer = &network->branch[b].layer[i];
            time += layer->macs * mac_s;
            done =
                fmax(done, fmin(time, backward_s)) + buckets_link_s(plan, unet, layer->bytes, ways);
        }
        time += (double)network->branch[b].views * network->view_macs * mac_s;
    }
    done = fmax(done, backward_s) + buckets_link_s(plan, encoder, network->encoder_bytes, ways);
    return done - backward_s;
}

/* A step's gradients: adding and copying them is the cores' work, the link's goes on beside. */
static double gradients_s(const struct plan *plan, int64_t rounds, double backward_s)
{
    const struct v2v_forecast_network *network = plan->job->network;
    const struct v2v_comm_cost *inside = &plan->machine->inside;
    const double ranks = (double)plan->data * plan->shards;
    double bytes = 0.0, buckets;
    if (plan->data * plan->shards * plan->branches == 1) {
        return 0.0;
    }
    for (int b = 0; b < BRANCHES / plan->branches; b++) {
        for (int i = 0; i < network->layers; i++) {
            bytes += network->branch[b].layer[i].bytes;
        }
    }
    buckets = ceil(bytes / bytes_of(V2V_BUCKET_FLOATS));
    double times = (double)rounds + 1.0; /* each round is summed up, the last spread */
    double inside_s = sharing(plan) * times *
                      (bytes * (ranks - 1.0) / ranks * inside->sum_byte_s +
                       buckets * (ranks - 1.0) * inside->message_s);
    return inside_s + (double)(rounds - 1) * left_behind(plan, backward_s, 1.0) +
           left_behind(plan, backward_s, 2.0);
}

/* ---- the whole ---- */

static double file_bytes(const struct v2v_forecast_job *job)
{
    const struct v2v_model_spec *spec = &job->network->spec;
    double images = (double)spec->views + (job->training ? 0.0 : (double)spec->slices);
    return bytes_of(images * (double)(job->items * job->height * job->width));
}

static struct v2v_forecast forecast_plan(const struct plan *plan)
{
    const struct v2v_forecast_machine *machine = plan->machine;
    const struct v2v_forecast_job *job = plan->job;
    const int parts = plan->branches * plan->shards;
    const double pass_s =
        machine->mac_s * v2v_forecast_macs(job->network, plan->height, plan->width);
    const double whole_s = pass_s * passes_of_item(job), rank_s = pass_s * passes_of_rank(plan);
    const double slow = slowness(plan), items = (double)job->items;
    const int64_t rounds = (job->items + plan->data - 1) / plan->data;
    struct v2v_forecast result = {.ranks = plan->ranks,
                                  .hosts = plan->hosts,
                                  .data = plan->data,
                                  .idle = plan->ranks - plan->data * parts,
                                  .shape = {plan->branches, plan->shards},
                                  .rounds = rounds};
    const double group_s = (double)rounds * whole_s / parts;
    result.compute_s = items * whole_s / plan->ranks;
    result.uneven_s = group_s - result.compute_s;
    result.repeated_s = (double)rounds * rank_s - group_s;
    result.crowded_s = (slow - 1.0) * (double)rounds * rank_s;
    result.file_s = file_bytes(job) * machine->file_byte_s;
    const struct group together = {job->training ? plan->ranks : plan->branches * plan->shards, 1};
    const double latencies = job->training ? step_latencies : frame_latencies;
    result.network_s =
        (double)rounds * (item_s(plan) + latencies * allreduce_s(plan, together, 0.0));
    if (job->training) {
        const double backward_s = backward_passes / V2V_FORECAST_STEP_PASSES * rank_s * slow;
        result.network_s += gradients_s(plan, rounds, backward_s);
    }
    result.seconds = result.compute_s + result.crowded_s + result.repeated_s + result.uneven_s +
                     result.network_s + result.file_s;
    return result;
}

/* The grids that training may get: as trainer.c lays it out for each number of slabs. */
static enum v2v_status forecast_training(struct v2v_forecast *forecast, struct plan *plan)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_grid_work work = {
        .items = plan->job->items, .height = 1, .unit = 1, .most_branches = 2};
    const int64_t units = plan->height / V2V_MODEL_GRID;
    for (int slabs = 1; slabs <= units; slabs++) {
        const struct v2v_grid_shape wanted = {0, slabs};
        struct v2v_grid_shape shape;
        if (slabs > 1 && plan->job->items * BRANCHES * slabs > plan->ranks) {
            break;
        }
        V2V_TRY(v2v_grid_choose(&shape, &wanted, &work, plan->ranks));
        plan_for(plan, &shape);
        struct v2v_forecast tried = forecast_plan(plan);
        if (slabs == 1 || tried.seconds < forecast->seconds) {
            *forecast = tried;
        }
    }
done:
    return rc;
}

enum v2v_status v2v_forecast(struct v2v_forecast *forecast,
                             const struct v2v_forecast_machine *machine,
                             const struct v2v_forecast_job *job, int ranks, int hosts)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_grid_shape any = {0, 0};
    struct v2v_grid_work work;
    struct v2v_grid_shape shape;
    struct plan plan = {.machine = machine,
                        .job = job,
                        .height = v2v_round_up(job->height, V2V_MODEL_GRID),
                        .width = v2v_round_up(job->width, V2V_MODEL_GRID),
                        .ranks = ranks,
                        .hosts = hosts,
                        .host_ranks = (ranks + hosts - 1) / hosts};
    plan.pixels = (double)plan.height * (double)plan.width;
    if (job->training) {
        return forecast_training(forecast, &plan);
    }
    v2v_model_describe_work(&work, &job->network->spec, job->height, job->width);
    work.items = job->items;
    work.most_shards = ranks;
    V2V_TRY(v2v_grid_choose(&shape, &any, &work, ranks));
    plan_for(&plan, &shape);
    *forecast = forecast_plan(&plan);
done:
    return rc;
}
