#ifndef V2V3D_PAR_COST_H
#define V2V3D_PAR_COST_H
#include "v2v3d/par/comm.h"

#ifdef __cplusplus
extern "C" {
#endif

/** What moving data between ranks costs, as two straight lines: the time of an exchange, in which
 *  every rank sends a part of its data to every other, and that of an all-reduce, over the bytes.
 *  Measured with as many ranks as there are; predictions for other counts take the lines to hold.
 *  All zero: one rank. */
struct v2v_comm_cost {
    int ranks;         /**< that it was measured with */
    double message_s;  /**< a message of an exchange that carries nothing */
    double byte_s;     /**< a byte that a rank sends in an exchange while all others do */
    double sum_step_s; /**< a step of an all-reduce of nothing: it takes 2 * log2(ranks) */
    double sum_byte_s; /**< a byte that a rank sends in an all-reduce, with its addition */
};

/** Measure exchanges with messages of up to a megabyte; all-reduces are taken to cost nothing. 0.04
 *  s, or six turns where they take longer. All ranks get the same figures.
 *  @kind Collective(comm). @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_comm_cost_measure(struct v2v_comm_cost *cost,
                                      const struct v2v_comm *comm) V2V_MUST_CHECK;

/** Measure all-reduces, too, likewise, as long again.
 *  @kind Collective(comm). @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_comm_cost_measure_sums(struct v2v_comm_cost *cost,
                                           const struct v2v_comm *comm) V2V_MUST_CHECK;

/** Seconds that `run` takes the slowest rank when all run it at once: the median of as many turns
 *  as 0.02 s have room for, of three at least; the same on all ranks.
 *  @kind Collective(comm) */
double v2v_comm_median_s(void (*run)(const void *context), const void *context,
                         const struct v2v_comm *comm);

/** Seconds of an exchange over `ranks` ranks in which each sends `bytes` to all others together, in
 *  `times` turns. @kind Local. */
double v2v_comm_exchange_s(const struct v2v_comm_cost *cost, int ranks, double bytes, double times);

/** Seconds of an all-reduce of `bytes` over `ranks` ranks: a rank sends 2 (ranks-1)/ranks of them.
 *  @kind Local. */
double v2v_comm_allreduce_s(const struct v2v_comm_cost *cost, int ranks, double bytes);

#ifdef __cplusplus
}
#endif

#endif
