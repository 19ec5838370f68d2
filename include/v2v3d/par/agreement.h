#ifndef V2V3D_PAR_AGREEMENT_H
#define V2V3D_PAR_AGREEMENT_H
#include "v2v3d/par/comm.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Agreement of ranks that work in rounds, each by itself: a rank goes on with its next round
 *  before it knows how the others fared in this one, and is never more than one round ahead.
 *  What one rank tells goes straight to all others (ranks^2 messages of four bytes a round): once
 *  ranks are connected, its way leads over none that is computing. Waiting for a round is a piece
 *  of work of its own for the watchdog. */
struct v2v_agreement;

/** @kind Local. @return V2V_OK | V2V_E_MEMORY */
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

#ifdef __cplusplus
}
#endif

#endif
