#include "v2v3d/io/file.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

enum v2v_status v2v_file_remember(struct v2v_file_state *state, const char *path)
{
    struct stat status;

    if (stat(path, &status) != 0) {
        return V2V_FAIL(V2V_E_INPUT, "%s: %s", path, strerror(errno));
    }
    *state = (struct v2v_file_state){.bytes = status.st_size,
                                     .inode = (int64_t)status.st_ino,
                                     .seconds = status.st_mtim.tv_sec,
                                     .nanoseconds = status.st_mtim.tv_nsec};
    return V2V_OK;
}

/* What differs, as a message says it; NULL: nothing. */
static const char *difference(const struct v2v_file_state *now, const struct v2v_file_state *then)
{
    if (now->inode != then->inode) {
        return "another file took its place";
    }
    if (now->seconds != then->seconds || now->nanoseconds != then->nanoseconds) {
        return "it was written to";
    }
    return now->bytes != then->bytes ? "its size differs" : NULL;
}

enum v2v_status v2v_file_unchanged(enum v2v_status rc, const struct v2v_file_state *state,
                                   const char *path)
{
    struct v2v_file_state now = {0};
    char sizes[64] = "";
    if (rc != V2V_OK && rc != V2V_E_INPUT) {
        return rc;
    }
    if (v2v_file_remember(&now, path) != V2V_OK) {
        return V2V_FAIL(V2V_E_INPUT, "%s: changed while it was read: it is gone: %s", path,
                        strerror(errno));
    }
    const char *what = difference(&now, state);
    if (what == NULL) {
        return rc;
    }
    if (now.bytes != state->bytes) {
        snprintf(sizes, sizeof sizes, ", had %lld bytes, has %lld", (long long)state->bytes,
                 (long long)now.bytes);
    }
    return V2V_FAIL(V2V_E_INPUT, "%s: changed while it was read: %s%s", path, what, sizes);
}
