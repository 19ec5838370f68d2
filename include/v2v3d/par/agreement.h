#ifndef V2V3D_PAR_AGREEMENT_H
#define V2V3D_PAR_AGREEMENT_H
#include "v2v3d/par/comm.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Agreement of ranks that work in rounds, each by itself: a rank goes on with its next round
 *  before it knows how the others fared in this one, and is never more than one round ahead.
 *  What one rank tells goes straight to all others (ranks^2 messages of four bytes a round): once
 *  ranks are connected, its way leads over none that is computing.
 *
 *  A frame may take longer on one rank than the watchdog grants a rank that waits: beats of a rank
 *  that computes are told to the others, a few times in the watchdog's period, and a rank waits on
 *  as long as one that it waits for is alive. */
struct v2v_agreement;

/** From here to its destruction it listens to this process's beats: one at a time. @kind Local.
 *  @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_agreement_create(struct v2v_agreement **agreement,
                                     const struct v2v_comm *comm) V2V_MUST_CHECK;
/** Nothing may be under way. @kind Local; accepts NULL; nulls the pointer. */
void v2v_agreement_destroy(struct v2v_agreement **agreement);

/** Tell how this round went here, and learn how the one before went everywhere (at first: well).
 *  Whoever failed comes once more, with the same code and message, to learn it. After a failure
 *  nothing is under way, and what failed in the round behind it is not told. @kind
 * Collective(comm), waits for the ranks' round before. @return the worst code, with the message of
 * the lowest rank that holds it, as v2v_par_agree */
enum v2v_status v2v_agreement_tell(struct v2v_agreement *agreement,
                                   enum v2v_status rc) V2V_MUST_CHECK;

/** Learn how the last round that was told went everywhere. @kind Collective(comm). @return likewise
 */
enum v2v_status v2v_agreement_end(struct v2v_agreement *agreement) V2V_MUST_CHECK;

/** Wait until every rank is here, before a collective step that ranks may reach at very different
 *  times. @kind Collective(comm). @return that of the round that was told last */
enum v2v_status v2v_agreement_meet(struct v2v_agreement *agreement) V2V_MUST_CHECK;

/** Rank 0 does `work`, and beats; the others wait as long as it is alive. No other agreement may
 *  listen. @kind Collective(comm). @return work's on rank 0, as v2v_par_agree | V2V_E_MEMORY */
enum v2v_status v2v_agreement_alone(const struct v2v_comm *comm,
                                    enum v2v_status (*work)(void *context),
                                    void *context) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
