#include "conf/text_file.h"

#include "v2v3d/base/memory.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { MOST_BYTES = 1 << 20 };

int64_t v2v_text_line(const char *text, int64_t offset)
{
    int64_t line = 1;
    for (int64_t i = 0; i < offset; i++) {
        line += text[i] == '\n';
    }
    return line;
}

/* The buffer has room for one byte more than is allowed. */
static enum v2v_status read_all(char *text, int64_t *bytes, const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct stat status;
    /* O_NONBLOCK: a FIFO must not make us wait for its writer. */
    int file = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (file < 0 || fstat(file, &status) != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s: can't open it: %s", path, strerror(errno)));
    }
    if (!S_ISREG(status.st_mode)) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s: not a regular file", path));
    }
    *bytes = 0;
    for (ssize_t got = 1; got > 0 && *bytes <= MOST_BYTES; *bytes += got) {
        got = read(file, text + *bytes, (size_t)(MOST_BYTES + 1 - *bytes));
        if (got < 0) {
            V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s: can't read it: %s", path, strerror(errno)));
        }
    }
    if (*bytes > MOST_BYTES) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s: larger than 1 MiB: not a configuration", path));
    }
done:
    if (file >= 0) {
        close(file);
    }
    return rc;
}

enum v2v_status v2v_text_file_read(char **text, int64_t *bytes, const char *path)
{
    enum v2v_status rc = V2V_OK;
    *text = NULL;
    V2V_TRY(V2V_ALLOC(*text, "conf.file", MOST_BYTES + 2));
    V2V_TRY(read_all(*text, bytes, path));
    (*text)[*bytes] = '\0';
    const char *nul = memchr(*text, '\0', (size_t)*bytes);
    if (nul != NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s:%lld: holds a NUL byte: not a text file", path,
                         (long long)v2v_text_line(*text, nul - *text)));
    }
done:
    if (rc != V2V_OK) {
        v2v_mem_free(*text);
        *text = NULL;
    }
    return rc;
}
