#ifndef V2V_CONF_TEXT_FILE_H
#define V2V_CONF_TEXT_FILE_H

#include "v2v3d/base/status.h"
#include <stdint.h>

/** The whole of a text file of at most 1 MiB, with a NUL behind it.
 *  @kind Local. @param text to be freed with v2v_mem_free
 *  @return V2V_OK | V2V_E_CONFIG (no regular file, unreadable, larger, a NUL byte: names its line)
 *  | V2V_E_MEMORY */
enum v2v_status v2v_text_file_read(char **text, int64_t *bytes, const char *path) V2V_MUST_CHECK;

/** The line of text[offset], from 1. @kind Local. */
int64_t v2v_text_line(const char *text, int64_t offset);

#endif
