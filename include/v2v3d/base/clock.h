#ifndef V2V3D_BASE_CLOCK_H
#define V2V3D_BASE_CLOCK_H
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Seconds of the monotonic clock: for differences only. @kind Local. */
double v2v_clock_now(void);

/** Write the wall-clock time as ISO 8601 in UTC ("2026-01-31T12:00:00Z"). @kind Local. */
void v2v_clock_iso8601(char *text, size_t bytes);

/** Parse a duration: "90", "90s", "20m", "3h", "1h30m". Seconds, or -1 when it is none.
 *  @kind Local. */
double v2v_clock_parse_duration(const char *text);

#ifdef __cplusplus
}
#endif

#endif
