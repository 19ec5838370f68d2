#include "network/forecast.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/nn/rule.h"
#include <math.h>
#include <omp.h>
#include <time.h>

enum { BRANCHES = V2V_FORECAST_BRANCHES, TURNS = 3 };

/* A network ready to run. */
struct trial {
    struct v2v_model *model;
    float *views, *volume[BRANCHES];
};

static enum v2v_status prepare(struct trial *trial, const struct v2v_model_spec *spec,
                               const struct v2v_shifts *shifts, int64_t side)
{
    enum v2v_status rc = V2V_OK;
    const int64_t count = v2v_mem_product(spec->views, side, side);
    V2V_TRY(v2v_model_create(&trial->model, spec, shifts));
    V2V_TRY(v2v_rule_weights(v2v_model_fields(trial->model), v2v_model_weights(trial->model),
                             V2V_RULE_HE, 1));
    V2V_TRY(v2v_model_plan(trial->model, side, side, 0));
    V2V_TRY(V2V_ALLOC(trial->views, "forecast.views", count));
    for (int b = 0; b < BRANCHES; b++) {
        V2V_TRY(V2V_ALLOC(trial->volume[b], "forecast.volumes",
                          v2v_mem_product(spec->slices, side, side)));
    }
    for (int64_t i = 0; i < count; i++) {
        trial->views[i] = (float)(i % 7); /* any light does: nothing is skipped */
    }
done:
    return rc;
}

static void give_back(struct trial *trial)
{
    for (int b = 0; b < BRANCHES; b++) {
        v2v_mem_free(trial->volume[b]);
    }
    v2v_mem_free(trial->views);
    v2v_model_destroy(&trial->model);
}

static double pass_s(const struct trial *trial)
{
    const double start = v2v_clock_now();
    v2v_model_forward(trial->model, trial->volume[0], trial->volume[1], trial->views);
    return v2v_clock_now() - start;
}

/* Ranks that wait for a message would keep their cores busy. */
static void rest(double seconds)
{
    const double whole = floor(seconds);
    const struct timespec pause = {(time_t)whole, (long)(1e9 * (seconds - whole))};
    nanosleep(&pause, NULL);
}

static double middle(const double x[TURNS])
{
    return fmax(fmin(x[0], x[1]), fmin(fmax(x[0], x[1]), x[2]));
}

static void time_passes(struct v2v_forecast_speed *speed, const struct trial *trial,
                        const struct v2v_comm *comm)
{
    double together[TURNS], alone[TURNS];
    pass_s(trial); /* touches the memory */
    for (int turn = 0; turn < TURNS; turn++) {
        v2v_par_barrier(comm);
        together[turn] = pass_s(trial);
        v2v_par_max_f64(comm, &together[turn], 1);
        alone[turn] = 0.0;
        if (v2v_comm_rank(comm) == 0) {
            alone[turn] = pass_s(trial);
        } else {
            rest(together[turn]);
        }
        v2v_par_max_f64(comm, &alone[turn], 1);
    }
    speed->together_s = middle(together);
    speed->alone_s = middle(alone);
}

/* What a host with all cores busy loses, from one with `busy` threads. */
static double crowd_of(const struct v2v_forecast_machine *machine,
                       const struct v2v_forecast_speed *speed, double busy)
{
    const double ratio = speed->together_s / speed->alone_s;
    const double cores = machine->cores, threads = machine->threads;
    if (busy >= cores) {
        return fmax(1.0, ratio * cores / busy);
    }
    return busy > threads ? fmax(1.0, 1.0 + (ratio - 1.0) * (cores - threads) / (busy - threads))
                          : 1.0;
}

/* What an exchange over all ranks takes longer than inside a host is the link's, which the ranks of
 * a host share. */
static void part_network(struct v2v_forecast_machine *machine, const struct v2v_comm_cost *all,
                         int neighbours)
{
    const double abroad = (double)(all->ranks - neighbours) / (all->ranks - 1);
    machine->link_byte_s = fmax(all->byte_s - machine->inside.byte_s, 0.0) / (abroad * neighbours);
    machine->link_message_s = fmax(all->message_s - machine->inside.message_s, 0.0) / abroad;
}

enum v2v_status v2v_forecast_measure(struct v2v_forecast_machine *machine,
                                     struct v2v_forecast_speed *speed,
                                     const struct v2v_forecast_network *network,
                                     const struct v2v_shifts *shifts, int64_t side,
                                     const struct v2v_comm *host, const struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    struct trial trial = {0};
    struct v2v_comm_cost all;
    const int neighbours = v2v_comm_size(host);
    int64_t most = neighbours;
    *speed = (struct v2v_forecast_speed){.side = side};
    machine->threads = omp_get_max_threads();
    V2V_TRY(v2v_par_agree(world, prepare(&trial, &network->spec, shifts, side)));
    time_passes(speed, &trial, world);
    machine->mac_s = speed->alone_s / v2v_forecast_macs(network, side, side);
    machine->crowd = crowd_of(machine, speed, (double)machine->threads * neighbours);
    rc = v2v_comm_cost_measure(&machine->inside, host);
    if (rc == V2V_OK) {
        rc = v2v_comm_cost_measure_sums(&machine->inside, host);
    }
    V2V_TRY(v2v_par_agree(world, rc));
    v2v_par_max_i64(world, &most, 1);
    speed->is_link_measured = most < v2v_comm_size(world);
    if (speed->is_link_measured) {
        V2V_TRY(v2v_comm_cost_measure(&all, world));
        part_network(machine, &all, neighbours);
    }
    v2v_par_broadcast(world, machine, (int64_t)sizeof *machine, 0);
done:
    give_back(&trial);
    return rc;
}
