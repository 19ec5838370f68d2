/* A disk that is full from the write number FULL_FROM on, by the call that HDF5 writes with. */
#include <errno.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <unistd.h>

static ssize_t write_or_fail(int file, const void *data, size_t bytes, off_t at)
{
    static long writes;
    const char *from = getenv("FULL_FROM");
    if (from != NULL && ++writes >= strtol(from, NULL, 10)) {
        errno = ENOSPC;
        return -1;
    }
    return syscall(SYS_pwrite64, file, data, bytes, at);
}

/* The same under both names: off_t has 64 bits. */
ssize_t pwrite(int file, const void *data, size_t bytes, off_t at)
{
    return write_or_fail(file, data, bytes, at);
}

ssize_t pwrite64(int file, const void *data, size_t bytes, off_t at)
{
    return write_or_fail(file, data, bytes, at);
}
