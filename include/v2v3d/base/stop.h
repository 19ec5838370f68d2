#ifndef V2V3D_BASE_STOP_H
#define V2V3D_BASE_STOP_H

#ifdef __cplusplus
extern "C" {
#endif

/** Stop on request: SIGUSR1 and SIGUSR2 set a flag that loops poll.
 *  @kind Local: ranks must agree on the flag before they act on it. */
void v2v_stop_install(void);
int v2v_stop_requested(void);

/** From now on SIGTERM and SIGINT ask likewise, and end the process only where it was asked
 *  already, a second ago or more: for loops that poll. @kind Local. */
void v2v_stop_heed_ending(void);

#ifdef __cplusplus
}
#endif

#endif
