/** The ground floor: what every other room stands on.
 *
 *  Purpose: one way to fail (status.h), to report (log.h), to take memory (memory.h), to draw
 * random numbers (random.h), to tell the time (clock.h) and to break on purpose (fault.h).
 *  Invariants: no function here communicates; a failure is described once, where it is known, and
 *  printed once, by the command line; random numbers depend on their counter alone, never on order.
 *
 *  Example (compiled by tests/unit/base):
 *
 *      enum v2v_status rc = V2V_OK;
 *      float *x = NULL;
 *      V2V_TRY(V2V_ALLOC(x, "example", 1000));
 *      for (int64_t i = 0; i < 1000; i++) {
 *          x[i] = (float)v2v_random_normal(7, 0, (uint64_t)i);
 *      }
 *      if (x[0] != x[0]) {
 *          V2V_TRY(V2V_FAIL(V2V_E_NUMERIC, "sample 0 is NaN"));
 *      }
 *  done:
 *      v2v_mem_free(x);
 *      return rc;
 */
#ifndef V2V3D_BASE_STATUS_H
#define V2V3D_BASE_STATUS_H

#ifdef __cplusplus
extern "C" {
#endif

/** What a function that can fail returns. A larger value is worse: agreement over ranks takes the
 *  maximum. */
enum v2v_status {
    V2V_OK = 0,
    V2V_STOPPED,    /**< stopped on request, resumable           exit 85 */
    V2V_E_USAGE,    /**< the command line                        exit 2 */
    V2V_E_CONFIG,   /**< the configuration                       exit 78 */
    V2V_E_INPUT,    /**< an input file or its content            exit 65 */
    V2V_E_BUSY,     /**< another run holds the output            exit 75 */
    V2V_E_IO,       /**< reading or writing failed               exit 74 */
    V2V_E_NUMERIC,  /**< NaN or Inf where none may be            exit 70 */
    V2V_E_MEMORY,   /**< out of memory, or over the limit        exit 70 */
    V2V_E_INTERNAL, /**< a library refused what it should take   exit 70 */
    V2V_STATUS_COUNT
};

#define V2V_MUST_CHECK __attribute__((warn_unused_result))

/** Longest failure message in bytes, with the closing zero. */
#define V2V_MESSAGE_BYTES 1024

/** Longest place of a failure, likewise. */
#define V2V_PLACE_BYTES 128

/** @kind Local. The process exit code of a status (src/io/README.md lists them). */
int v2v_status_exit_code(enum v2v_status status);

/** @kind Local. A short name such as "bad input". */
const char *v2v_status_name(enum v2v_status status);

/** Record a failure and hand its code back; the newest record wins. Use V2V_FAIL.
 *  @kind Local, from any thread (the record belongs to the calling thread). */
enum v2v_status v2v_status_fail(enum v2v_status status, const char *file, int line,
                                const char *format, ...) __attribute__((format(printf, 4, 5)));

/** @kind Local. The recorded message of the last failure, "" if there was none. */
const char *v2v_status_message(void);

/** @kind Local. Where the last failure was recorded, as "file:line". */
const char *v2v_status_place(void);

/** @kind Local. Replace the record, as agreement over ranks does with the failing rank's message.
 */
void v2v_status_set_message(const char *message, const char *place);

/** The record of a failure: kept over what fails after it, or until another thread tells it. */
struct v2v_status_record {
    char message[V2V_MESSAGE_BYTES];
    char place[V2V_PLACE_BYTES];
};

/** @kind Local. The calling thread's record, and that one as the calling thread's. */
void v2v_status_keep(struct v2v_status_record *record);
void v2v_status_restore(const struct v2v_status_record *record);

/** Print rank and place of a bug and abort the whole job. @kind Local, does not return. */
__attribute__((noreturn)) void v2v_status_bug(const char *file, int line, const char *condition);

/** What v2v_status_bug calls instead of abort() once MPI runs (par sets it). @kind Local. */
void v2v_status_on_bug(void (*abort_job)(void));

#define V2V_FAIL(status, ...) v2v_status_fail((status), __FILE__, __LINE__, __VA_ARGS__)

/** Go to the one `done:` label with `rc` set when the call failed. */
#define V2V_TRY(call)                                                                              \
    do {                                                                                           \
        rc = (call);                                                                               \
        if (rc != V2V_OK) {                                                                        \
            goto done;                                                                             \
        }                                                                                          \
    } while (0)

/** A condition that only a bug can break. */
#define V2V_ASSERT(condition)                                                                      \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            v2v_status_bug(__FILE__, __LINE__, #condition);                                        \
        }                                                                                          \
    } while (0)

#ifdef __cplusplus
}
#endif

#endif
