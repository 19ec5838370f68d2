#ifndef V2V3D_PAR_WATCHDOG_H
#define V2V3D_PAR_WATCHDOG_H

#ifdef __cplusplus
extern "C" {
#endif

/** A clock beside the MPI path: when it is not re-armed within its time, the rank prints what it
 *  was waiting in and ends the whole job with exit code 74; who is missed is the rank that says
 *  nothing, or says it last. Needed because HDF5 and MPI can wait for ever once one rank has
 *  failed: they did after 8 of 16 injected I/O errors. All @kind Local. */

/** (Re-)arm for `seconds` (<= 0: disarm); `what` is a string literal, printed when it fires. */
void v2v_watchdog_arm(double seconds, const char *what);
void v2v_watchdog_disarm(void);

/** The program's time for one piece of work (<= 0: v2v_watchdog_beat arms nothing, as before the
 *  first call), and the end of a piece: re-arm for it. Libraries beat, programs decide the time. */
void v2v_watchdog_set_period(double seconds);
void v2v_watchdog_beat(const char *what);

/** A beat of a rank that waits for others: not told to the listener, and half as long again. */
void v2v_watchdog_wait(const char *what);

/** From now on listen(context) is called at every beat, on the thread that beats; NULL: nobody
 *  listens. One listener a process. */
void v2v_watchdog_listen(void (*listen)(void *context), void *context);
double v2v_watchdog_period(void);

#ifdef __cplusplus
}
#endif

#endif
