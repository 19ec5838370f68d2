#ifndef V2V3D_BASE_LOG_H
#define V2V3D_BASE_LOG_H
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum v2v_log_level { V2V_LOG_ERROR, V2V_LOG_WARNING, V2V_LOG_INFO, V2V_LOG_DEBUG };

/** Set the level and the rank that log lines carry. Info and debug lines are printed on rank 0
 * only, warnings and errors everywhere, with the rank. @kind Local. */
void v2v_log_configure(enum v2v_log_level level, int rank);

/** The rank, and of how many: lines carry the rank only when there are several. par calls it when
 * MPI starts. @kind Local. */
void v2v_log_set_rank(int rank, int ranks);

/** One line on stderr. @kind Local. */
void v2v_log(enum v2v_log_level level, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/** A progress bar with rate and remaining time: redrawn in place on a terminal, a plain line every
 *  ten seconds otherwise; silent on ranks other than 0. Caller's storage. */
struct v2v_progress {
    const char *title;
    int64_t total;
    int64_t first;       /**< work that was done before this run (resume) */
    double started;      /**< seconds, v2v_clock_now */
    double most_s;       /**< that it may take from then on; 0: as long as it takes */
    double last_printed; /**< seconds */
    int on_terminal;
    int64_t done;  /**< the latest step .. */
    char note[80]; /**< .. and its note */
};

/** Start at `first` of `total`; title is borrowed. @kind Local. */
void v2v_progress_begin(struct v2v_progress *progress, const char *title, int64_t first,
                        int64_t total);

/** `done` of `total` is done; `note` (may be NULL) is appended. @kind Local. */
void v2v_progress_step(struct v2v_progress *progress, int64_t done, const char *note);

/** The bar stays behind as a line; nothing where it never began (zeroed). @kind Local. */
void v2v_progress_end(struct v2v_progress *progress);

#ifdef __cplusplus
}
#endif

#endif
