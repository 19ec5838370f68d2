/** Ranks: communicators, reductions, and the agreement that keeps a failing rank from hanging the
 *  others.
 *
 *  Purpose: the only room (with fft and io) that speaks MPI; everyone else sees struct v2v_comm.
 *  Invariants: every collective here is entered by all ranks of its communicator or by none; an MPI
 *  error aborts the job; a NULL communicator means "this rank alone" everywhere.
 *
 *  Example (compiled by tests/mpi/par):
 *
 *      enum v2v_status rc = load_my_views(views);   // Local: may fail, may not leave
 *      V2V_TRY(v2v_par_agree(comm, rc));            // Collective: all hold the same code now
 *      v2v_par_sum_f32(comm, views, count);         // Collective: nobody is missing
 *  done:
 *      return rc;
 */
#ifndef V2V3D_PAR_COMM_H
#define V2V3D_PAR_COMM_H
#include "v2v3d/base/status.h"
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct v2v_comm;

/** Start MPI (thread level FUNNELED) and name the rank for log, fault points and bugs.
 *  @kind Collective(world) */
enum v2v_status v2v_par_init(struct v2v_comm **world, int *argc, char ***argv) V2V_MUST_CHECK;

/** End MPI. @kind Collective(world) */
void v2v_par_finalize(struct v2v_comm **world);

/** End the whole job at once with this exit code. @kind Local. */
__attribute__((noreturn)) void v2v_par_abort(int exit_code);

/** Rank and size; 0 and 1 for NULL. @kind Local. */
int v2v_comm_rank(const struct v2v_comm *comm);
int v2v_comm_size(const struct v2v_comm *comm);

/** Ranks of equal colour (>= 0), ordered by key, get a communicator of their own; NULL for NULL.
 *  @kind Collective(parent). @return V2V_OK | V2V_E_MEMORY (agreed) */
enum v2v_status v2v_comm_split(struct v2v_comm **comm, const struct v2v_comm *parent, int colour,
                               int key) V2V_MUST_CHECK;

/** Ranks of one host, at most `most` of them and no more than it has processors, get a communicator
 *  of their own; NULL for NULL.
 *  @kind Collective(parent). @return V2V_OK | V2V_E_MEMORY (agreed) */
enum v2v_status v2v_comm_split_host(struct v2v_comm **comm, const struct v2v_comm *parent,
                                    int most) V2V_MUST_CHECK;

/** @kind Collective(*comm); accepts NULL; nulls the pointer. */
void v2v_comm_destroy(struct v2v_comm **comm);

/** All ranks leave with the worst code, and with the message of the lowest rank that holds it.
 *  @kind Collective(comm) */
enum v2v_status v2v_par_agree(const struct v2v_comm *comm, enum v2v_status rc) V2V_MUST_CHECK;

/** Sums in place over ranks, any count (split below INT_MAX). @kind Collective(comm) */
void v2v_par_sum_f32(const struct v2v_comm *comm, float *x, int64_t count);
void v2v_par_sum_f64(const struct v2v_comm *comm, double *x, int64_t count);
void v2v_par_sum_i64(const struct v2v_comm *comm, int64_t *x, int64_t count);

/** Reproducible sum: x = its sum over the ranks, added up in their order from 0 on. @param scratch
 *  V2V_PAR_SCRATCH floats. @kind Collective(comm) */
enum { V2V_PAR_SCRATCH = 1 << 20 };
void v2v_par_sum_ordered_f32(const struct v2v_comm *comm, float *x, int64_t count, float *scratch);

/** Maximum in place. @kind Collective(comm) */
void v2v_par_max_i64(const struct v2v_comm *comm, int64_t *x, int64_t count);
void v2v_par_max_f64(const struct v2v_comm *comm, double *x, int64_t count);

/** Bytes of rank `root` to all. @kind Collective(comm) */
void v2v_par_broadcast(const struct v2v_comm *comm, void *data, int64_t bytes, int root);

/** Contributions of rank r, count[r] floats, end at out + offset[r] on every rank; `mine` may be
 *  out + offset[rank] itself. @kind Collective(comm) */
void v2v_par_allgather_f32(const struct v2v_comm *comm, float *out, const float *mine,
                           const int64_t *count, const int64_t *offset);

/** Exchange equal counts with one other rank (the same one on both sides). @kind Collective(pair)
 */
void v2v_par_exchange_f32(const struct v2v_comm *comm, float *received, const float *sent,
                          int64_t count, int other);

/** @kind Collective(comm) */
void v2v_par_barrier(const struct v2v_comm *comm);

/** Part `index` of n items cut into `parts` runs whose lengths differ by at most one. */
struct v2v_part {
    int64_t first;
    int64_t count;
};
struct v2v_part v2v_par_part(int64_t n, int64_t parts, int64_t index);

#ifdef __cplusplus
}
#endif

#endif
