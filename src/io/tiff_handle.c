#include "io/tiff_internal.h"

#include <stdio.h>
#include <string.h>

/* The largest single piece of memory that a file may make libtiff take: one compressed strip or one
 * table of offsets. */
static const tmsize_t largest_allocation = (tmsize_t)256 << 20;

__attribute__((format(printf, 4, 0))) static int
keep_error(TIFF *handle, void *data, const char *module, const char *format, va_list arguments)
{
    struct v2v_tiff_log *log = data;

    (void)handle;
    (void)module;
    if (log->error[0] == '\0') {
        (void)vsnprintf(log->error, sizeof log->error, format, arguments);
    }
    return 1;
}

/* Does libtiff go on without a tag that would change what the file is, since its value cannot be
 * read? Programs put long values at the end of the file, where a cut takes them. */
static int is_lost(const char *warning)
{
    static const char *const reasons[] = {"IO error during reading of \"",
                                          "Sanity check on size of \"",
                                          "Out of memory reading of \""};
    static const char *const tags[] = {"ImageDescription\"", "Software\"", "PageName\"",
                                       "XResolution\"", "YResolution\""};
    for (size_t r = 0; r < sizeof reasons / sizeof *reasons; r++) {
        const size_t length = strlen(reasons[r]);
        for (size_t t = 0; t < sizeof tags / sizeof *tags; t++) {
            if (strncmp(warning, reasons[r], length) == 0 &&
                strncmp(warning + length, tags[t], strlen(tags[t])) == 0) {
                return 1;
            }
        }
    }
    return 0;
}

__attribute__((format(printf, 4, 0))) static int
keep_warning(TIFF *handle, void *data, const char *module, const char *format, va_list arguments)
{
    struct v2v_tiff_log *log = data;

    (void)handle;
    (void)module;
    if (!log->miscounted && !log->lost) {
        (void)vsnprintf(log->warning, sizeof log->warning, format, arguments);
        log->miscounted = strstr(log->warning, "ByteCounts") != NULL;
        log->lost = is_lost(log->warning);
    }
    return 1;
}

TIFF *v2v_tiff_wrap(int descriptor, const char *path, const char *mode, struct v2v_tiff_log *log)
{
    TIFFOpenOptions *options = TIFFOpenOptionsAlloc();

    if (options == NULL) {
        return NULL;
    }
    TIFFOpenOptionsSetMaxSingleMemAlloc(options, largest_allocation);
    TIFFOpenOptionsSetErrorHandlerExtR(options, keep_error, log);
    TIFFOpenOptionsSetWarningHandlerExtR(options, keep_warning, log);
    TIFF *handle = TIFFFdOpenExt(descriptor, path, mode, options);
    TIFFOpenOptionsFree(options);
    return handle;
}

void v2v_tiff_log_clear(struct v2v_tiff_log *log)
{
    log->error[0] = '\0';
    log->warning[0] = '\0';
    log->miscounted = 0;
    log->lost = 0;
}

const char *v2v_tiff_log_reason(const struct v2v_tiff_log *log)
{
    if (log->error[0] != '\0') {
        return log->error;
    }
    return log->warning[0] != '\0' ? log->warning : "libtiff gives no reason";
}
