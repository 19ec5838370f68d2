#include "v2v3d/par/cost.h"

#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/exchange.h"

#include <math.h>
#include <stdlib.h>

/* Bytes, and floats, that a rank sends in the large measurement. */
enum { LARGE = 1 << 20, WORDS = LARGE / (int)sizeof(float) };

/* Of one figure: repeated for these seconds. */
static const double seconds = 0.02;
enum { LEAST_TURNS = 3, MOST_TURNS = 201 }; /* one outlier is not the median of three */

struct trial {
    const struct v2v_comm *comm;
    float *sent, *received; /* LARGE bytes each */
    struct v2v_part *to, *from;
    int64_t words; /* floats that a rank sends to others, or sums */
};

static void exchange(const void *context)
{
    const struct trial *trial = context;
    v2v_par_alltoall(trial->comm, trial->received, trial->from, trial->sent, trial->to,
                     sizeof *trial->sent);
}

static void sum(const void *context)
{
    const struct trial *trial = context;
    v2v_par_sum_f32(trial->comm, trial->sent, trial->words);
}

/** Equal parts for all others, nothing for this rank itself. */
static void cut(struct trial *trial, int64_t words)
{
    int rank = v2v_comm_rank(trial->comm), size = v2v_comm_size(trial->comm);
    int64_t each = words / (size - 1);
    for (int r = 0; r < size; r++) {
        int64_t place = (r > rank ? r - 1 : r) * each;
        trial->to[r] = trial->from[r] = (struct v2v_part){place, r == rank ? 0 : each};
    }
    trial->words = words;
}

static int by_size(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double v2v_comm_median_s(void (*run)(const void *context), const void *context,
                         const struct v2v_comm *comm)
{
    double taken[MOST_TURNS];
    int turns = 1;
    for (int i = 0; i < turns; i++) {
        v2v_par_barrier(comm);
        double start = v2v_clock_now();
        run(context);
        taken[i] = v2v_clock_now() - start;
        if (i == 0) {
            v2v_par_max_f64(comm, taken, 1);
            turns = (int)fmin(fmax(seconds / fmax(taken[0], 1e-9), LEAST_TURNS), MOST_TURNS);
        }
    }
    v2v_par_max_f64(comm, taken, turns);
    qsort(taken, (size_t)turns, sizeof *taken, by_size);
    return taken[turns / 2];
}

static enum v2v_status take_memory(struct trial *trial, int size)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(V2V_ALLOC(trial->sent, "par.cost", WORDS));
    V2V_TRY(V2V_ALLOC(trial->received, "par.cost", WORDS));
    V2V_TRY(V2V_ALLOC(trial->to, "par.cost", size));
    V2V_TRY(V2V_ALLOC(trial->from, "par.cost", size));
done:
    return rc;
}

/** What is left of `whole` without `fixed`: never less than nothing on a noisy machine. */
static double rest(double whole, double fixed)
{
    return fmax(whole - fixed, 0.01 * whole);
}

static void measure_exchanges(struct v2v_comm_cost *cost, struct trial *trial)
{
    cut(trial, cost->ranks - 1);
    const double empty = v2v_comm_median_s(exchange, trial, trial->comm);
    cost->message_s = empty / (double)(cost->ranks - 1);
    cut(trial, WORDS);
    cost->byte_s = rest(v2v_comm_median_s(exchange, trial, trial->comm), empty) / LARGE;
}

static void measure_sums(struct v2v_comm_cost *cost, struct trial *trial)
{
    const double sent = 2.0 * LARGE * (cost->ranks - 1) / cost->ranks;
    trial->words = 1;
    const double nothing = v2v_comm_median_s(sum, trial, trial->comm);
    cost->sum_step_s = nothing / (2 * log2(cost->ranks));
    trial->words = WORDS;
    cost->sum_byte_s = rest(v2v_comm_median_s(sum, trial, trial->comm), nothing) / sent;
}

/** Collective(comm): figures that one rank alone doesn't have. */
static enum v2v_status measure(struct v2v_comm_cost *cost, const struct v2v_comm *comm,
                               void (*figures)(struct v2v_comm_cost *cost, struct trial *trial))
{
    enum v2v_status rc = V2V_OK;
    struct trial trial = {.comm = comm};
    cost->ranks = v2v_comm_size(comm);
    V2V_TRY(v2v_par_agree(comm, take_memory(&trial, cost->ranks)));
    if (cost->ranks > 1) {
        figures(cost, &trial);
    }
done:
    v2v_mem_free(trial.from);
    v2v_mem_free(trial.to);
    v2v_mem_free(trial.received);
    v2v_mem_free(trial.sent);
    return rc;
}

enum v2v_status v2v_comm_cost_measure(struct v2v_comm_cost *cost, const struct v2v_comm *comm)
{
    *cost = (struct v2v_comm_cost){0};
    return measure(cost, comm, measure_exchanges);
}

enum v2v_status v2v_comm_cost_measure_sums(struct v2v_comm_cost *cost, const struct v2v_comm *comm)
{
    return measure(cost, comm, measure_sums);
}

double v2v_comm_exchange_s(const struct v2v_comm_cost *cost, int ranks, double bytes, double times)
{
    return ranks == 1 ? 0.0 : times * (ranks - 1) * cost->message_s + bytes * cost->byte_s;
}

double v2v_comm_allreduce_s(const struct v2v_comm_cost *cost, int ranks, double bytes)
{
    return ranks == 1 ? 0.0
                      : 2 * log2(ranks) * cost->sum_step_s +
                            2.0 * (ranks - 1) / ranks * bytes * cost->sum_byte_s;
}
