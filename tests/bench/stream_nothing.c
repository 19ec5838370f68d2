/* For stream.sh: large writes, or syncs, that do nothing. What was written already stays: small
 * writes are the file's description, and frames that are not there read as zeros. */
#include <dlfcn.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <unistd.h>

enum { LARGE = 1 << 20 };

static int is_left_out(const char *what)
{
    const char *which = getenv("STREAM_NOTHING");
    return which != NULL && (strcmp(which, what) == 0 || strcmp(which, "writes") == 0);
}

int fsync(int file)
{
    return is_left_out("syncs") ? 0 : (int)syscall(SYS_fsync, file);
}

int fdatasync(int file)
{
    return is_left_out("syncs") ? 0 : (int)syscall(SYS_fdatasync, file);
}

/* Writes that end on the disk are those of a frame. */
int open(const char *path, int flags, ...)
{
    va_list more;
    va_start(more, flags);
    const mode_t mode = (flags & O_CREAT) ? va_arg(more, mode_t) : 0;
    va_end(more);
    return (int)syscall(SYS_openat, AT_FDCWD, path, is_left_out("syncs") ? flags & ~O_DSYNC : flags,
                        mode);
}

ssize_t pwrite(int file, const void *data, size_t bytes, off_t at)
{
    const char *which = getenv("STREAM_NOTHING");
    if (bytes >= LARGE && which != NULL && strcmp(which, "writes") == 0) {
        return (ssize_t)bytes;
    }
    return syscall(SYS_pwrite64, file, data, bytes, at);
}
