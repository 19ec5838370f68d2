#include "v2v3d/par/time.h"

#include "par/comm_mpi.h"
#include "v2v3d/base/log.h"

/* A process has one account, as it has one MPI: communicators come and go. */
static double account[V2V_PAR_KINDS];

void v2v_par_spent(enum v2v_par_kind kind, double began)
{
    account[kind] += v2v_clock_now() - began;
}

struct v2v_par_time v2v_par_time_now(void)
{
    struct v2v_par_time now = {.clock = v2v_clock_now()};
    for (int kind = 0; kind < V2V_PAR_KINDS; kind++) {
        now.spent[kind] = account[kind];
    }
    return now;
}

double v2v_par_spent_between(const struct v2v_par_time *from, const struct v2v_par_time *to)
{
    double sum = 0.0;
    for (int kind = 0; kind < V2V_PAR_KINDS; kind++) {
        sum += to->spent[kind] - from->spent[kind];
    }
    return sum;
}

struct v2v_par_shares v2v_par_shares_since(const struct v2v_comm *comm,
                                           const struct v2v_par_time *since)
{
    struct v2v_par_shares shares = {0};
    struct v2v_par_time now = v2v_par_time_now();
    double seconds = now.clock - since->clock, mine = 0.0;
    for (int kind = 0; kind < V2V_PAR_KINDS; kind++) {
        shares.kind[kind] = seconds > 0.0 ? (now.spent[kind] - since->spent[kind]) / seconds : 0.0;
        mine += shares.kind[kind];
    }
    shares.largest = mine;
    v2v_par_max_f64(comm, &shares.largest, 1);
    v2v_par_sum_f64(comm, shares.kind, V2V_PAR_KINDS);
    int64_t holder = mine >= shares.largest ? v2v_comm_rank(comm) : -1;
    v2v_par_max_i64(comm, &holder, 1);
    shares.largest_rank = (int)holder;
    for (int kind = 0; kind < V2V_PAR_KINDS; kind++) {
        shares.kind[kind] /= v2v_comm_size(comm);
        shares.mean += shares.kind[kind];
    }
    return shares;
}

void v2v_par_log_shares(const struct v2v_comm *comm, const struct v2v_par_shares *shares)
{
    if (v2v_comm_size(comm) == 1) {
        return;
    }
    v2v_log(V2V_LOG_INFO,
            "communication: %.1f %% of the time (largest rank %d: %.1f %%): agreement %.1f, sums "
            "%.1f, spreading %.1f, exchange %.1f %%",
            100.0 * shares->mean, shares->largest_rank, 100.0 * shares->largest,
            100.0 * shares->kind[V2V_PAR_AGREE], 100.0 * shares->kind[V2V_PAR_SUM],
            100.0 * shares->kind[V2V_PAR_SPREAD], 100.0 * shares->kind[V2V_PAR_EXCHANGE]);
}
