#ifndef V2V3D_PAR_TRANSFER_H
#define V2V3D_PAR_TRANSFER_H
#include "v2v3d/par/comm.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Messages between pairs of ranks that are on their way while the ranks compute. What two ranks
 *  send each other arrives in the order in which it was sent. */
struct v2v_transfers;

/** For at most `most` messages at a time. @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_transfers_create(struct v2v_transfers **transfers, const struct v2v_comm *comm,
                                     int64_t most) V2V_MUST_CHECK;
/** Nothing may be under way. @kind Local; accepts NULL; nulls the pointer. */
void v2v_transfers_destroy(struct v2v_transfers **transfers);

/** Begin to send, or to receive, `count` floats; they are not to be touched before
 *  v2v_transfers_wait. Nothing happens for count = 0. @kind Collective(the two ranks). */
void v2v_transfers_send(struct v2v_transfers *transfers, const float *x, int64_t count, int to);
void v2v_transfers_receive(struct v2v_transfers *transfers, float *x, int64_t count, int from);

/** All that was begun has arrived. @kind Collective(all ranks that are sent to or from). */
void v2v_transfers_wait(struct v2v_transfers *transfers);

#ifdef __cplusplus
}
#endif

#endif
