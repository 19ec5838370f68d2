#ifndef V2V3D_BASE_TEXT_H
#define V2V3D_BASE_TEXT_H
#include "v2v3d/base/status.h"
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Strict numbers: the whole text, in range, finite, '.' as decimal point whatever the locale.
 *  `what` names the thing in the message ("--iterations"). `code` is the status of a failure.
 *  @kind Local. @return V2V_OK | code */
enum v2v_status v2v_text_to_i64(int64_t *value, const char *text, int64_t least, int64_t most,
                                const char *what, enum v2v_status code) V2V_MUST_CHECK;
enum v2v_status v2v_text_to_f64(double *value, const char *text, double least, double most,
                                const char *what, enum v2v_status code) V2V_MUST_CHECK;

/** How many things "a b, a b, .." lists; of an empty text none. @kind Local. */
int64_t v2v_text_count_listed(const char *text);

/** pair[i] of such a text, v2v_text_count_listed of them; `what` names the setting and `one` what a
 *  pair is ("view"). @kind Local. @return V2V_OK | V2V_E_CONFIG (the first that is none) */
enum v2v_status v2v_text_to_pairs(double (*pair)[2], const char *text, double least, double most,
                                  const char *what, const char *one) V2V_MUST_CHECK;

/** The candidate with the smallest edit distance to `word` (NULL when all are far: more than half
 * of the word's length). @kind Local. */
const char *v2v_text_nearest(const char *word, const char *const *candidates, int64_t count);

/** Does it end so, in upper or lower case? @kind Local. */
int v2v_text_ends_in(const char *text, const char *ending);

/** printf into a caller's buffer, failing instead of cutting. @kind Local.
 *  @return V2V_OK | V2V_E_INPUT when it does not fit (a path that is too long) */
enum v2v_status v2v_text_format(char *text, size_t bytes, const char *format, ...)
    __attribute__((format(printf, 3, 4))) V2V_MUST_CHECK;

/** A stream that makes a text of what is printed to it; `what` names the text in the message ("the
 *  calibration's text"). Once it is closed, *text ends in '\0' after *bytes bytes: to be freed with
 *  free(). Closing hands `rc`, of the printing, back, unless memory was short meanwhile.
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY; rc | V2V_E_MEMORY */
enum v2v_status v2v_text_open(FILE **stream, char **text, size_t *bytes,
                              const char *what) V2V_MUST_CHECK;
enum v2v_status v2v_text_close(enum v2v_status rc, FILE *stream, char *const *text,
                               const char *what) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
