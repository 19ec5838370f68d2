#ifndef V2V3D_PAR_TIME_H
#define V2V3D_PAR_TIME_H
#include "v2v3d/par/comm.h"

#ifdef __cplusplus
extern "C" {
#endif

/** What a rank spends its communication on. Waiting for a slower rank counts where it waits. */
enum v2v_par_kind {
    V2V_PAR_AGREE,    /**< v2v_par_agree, v2v_par_barrier: hardly a byte, waiting alone */
    V2V_PAR_SUM,      /**< sums and maxima */
    V2V_PAR_SPREAD,   /**< broadcasts and gathers */
    V2V_PAR_EXCHANGE, /**< between two ranks, or of parts with each */
    V2V_PAR_KINDS
};

/** A moment: the clock, and what this rank had spent on communication by then. */
struct v2v_par_time {
    double clock;
    double spent[V2V_PAR_KINDS]; /**< seconds since the process started, by kind */
};

/** Parts of the time, 0 .. 1. */
struct v2v_par_shares {
    double mean, largest;       /**< over ranks */
    int largest_rank;           /**< of the communicator */
    double kind[V2V_PAR_KINDS]; /**< means over ranks, by kind */
};

/** @kind Local. */
struct v2v_par_time v2v_par_time_now(void);

/** Seconds from one moment to another that this rank spent inside this room's collectives, waiting
 *  included. @kind Local. */
double v2v_par_spent_between(const struct v2v_par_time *from, const struct v2v_par_time *to);

/** The parts of the time since `since` that the ranks spent on communication.
 *  @kind Collective(comm) */
struct v2v_par_shares v2v_par_shares_since(const struct v2v_comm *comm,
                                           const struct v2v_par_time *since);

/** Log them; a rank alone has nothing to say. @kind Local, rank 0 prints. */
void v2v_par_log_shares(const struct v2v_comm *comm, const struct v2v_par_shares *shares);

#ifdef __cplusplus
}
#endif

#endif
