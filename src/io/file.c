#include "v2v3d/io/file.h"

#include "io/file_internal.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/text.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

int v2v_file_exists(const char *path)
{
    struct stat status;
    return lstat(path, &status) == 0;
}

int64_t v2v_file_taken(const char *path)
{
    enum { BLOCK = 512 }; /* stat's, whatever the file system's */
    struct stat status;
    return lstat(path, &status) == 0 ? (int64_t)status.st_blocks * BLOCK : 0;
}

int v2v_file_is_folder(const char *path)
{
    struct stat status;
    return stat(path, &status) == 0 && S_ISDIR(status.st_mode);
}

enum v2v_file_kind v2v_file_kind_of_name(const char *path)
{
    static const struct {
        const char *ending;
        enum v2v_file_kind kind;
    } kinds[] = {{".tif", V2V_FILE_TIFF},  {".tiff", V2V_FILE_TIFF},
                 {".h5", V2V_FILE_HDF5},   {".hdf5", V2V_FILE_HDF5},
                 {".hdf", V2V_FILE_HDF5},  {".safetensors", V2V_FILE_SAFETENSORS},
                 {".yaml", V2V_FILE_YAML}, {".yml", V2V_FILE_YAML}};
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        if (v2v_text_ends_in(path, kinds[i].ending)) {
            return kinds[i].kind;
        }
    }
    return V2V_FILE_OTHER;
}

enum v2v_status v2v_file_check_input(const char *path)
{
    struct stat status;

    if (stat(path, &status) != 0) {
        return V2V_FAIL(V2V_E_INPUT, "%s: %s", path, strerror(errno));
    }
    if (S_ISDIR(status.st_mode)) {
        return V2V_FAIL(V2V_E_INPUT, "%s: is a folder, not a file", path);
    }
    if (!S_ISREG(status.st_mode)) {
        return V2V_FAIL(V2V_E_INPUT, "%s: is a device, a pipe or a socket, not a regular file",
                        path);
    }
    if (access(path, R_OK) != 0) {
        return V2V_FAIL(V2V_E_INPUT, "%s: %s", path, strerror(errno));
    }
    return V2V_OK;
}

/* "a/b" -> "a", "/b" -> "/", "b" -> ".". */
static enum v2v_status parent_folder(char folder[V2V_PATH_BYTES], const char *path)
{
    const char *slash = strrchr(path, '/');

    if (slash == NULL) {
        return v2v_text_format(folder, V2V_PATH_BYTES, ".");
    }
    if (slash == path) {
        return v2v_text_format(folder, V2V_PATH_BYTES, "/");
    }
    return v2v_text_format(folder, V2V_PATH_BYTES, "%.*s", (int)(slash - path), path);
}

static int same_file(const char *a, const char *b)
{
    struct stat status_a, status_b;

    return stat(a, &status_a) == 0 && stat(b, &status_b) == 0 &&
           status_a.st_dev == status_b.st_dev && status_a.st_ino == status_b.st_ino;
}

static enum v2v_status check_parent(const char *path)
{
    enum v2v_status rc = V2V_OK;
    char folder[V2V_PATH_BYTES];

    V2V_TRY(parent_folder(folder, path));
    if (!v2v_file_is_folder(folder)) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: there is no folder %s", path, folder));
    }
    if (access(folder, W_OK | X_OK) != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: folder %s: %s", path, folder, strerror(errno)));
    }
done:
    return rc;
}

/* A TIFF among those of an input would be one of them. */
static enum v2v_status check_folder(const char *path, const char *input)
{
    enum v2v_status rc = V2V_OK;
    char folder[V2V_PATH_BYTES];
    V2V_TRY(parent_folder(folder, path));
    if (v2v_file_is_folder(input) && same_file(folder, input) &&
        v2v_file_kind_of_name(path) == V2V_FILE_TIFF) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s: the output would lie among the files of the input %s",
                         path, input));
    }
done:
    return rc;
}

enum v2v_status v2v_file_check_output(const char *path, int force, const char *const *inputs,
                                      int64_t count)
{
    enum v2v_status rc = V2V_OK;
    char temporary[V2V_PATH_BYTES], packed[V2V_PATH_BYTES];
    struct stat status;

    if (path[0] == '\0') {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "the name of the output is empty"));
    }
    V2V_TRY(v2v_file_temporary(temporary, path));
    V2V_TRY(v2v_file_packed(packed, path));
    for (int64_t i = 0; i < count; i++) {
        /* What has a temporary name would be removed before anything is read from it. */
        if (same_file(path, inputs[i]) || same_file(temporary, inputs[i]) ||
            same_file(packed, inputs[i])) {
            V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s: the output would overwrite the input %s", path,
                             inputs[i]));
        }
        V2V_TRY(check_folder(path, inputs[i]));
    }
    if (lstat(path, &status) == 0) {
        /* A finished file is renamed over its place: a folder refuses it, a device would vanish. */
        if (stat(path, &status) == 0 && !S_ISREG(status.st_mode)) {
            V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s: exists and is not a regular file", path));
        }
        if (!force) {
            V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s: exists; give --force to replace it", path));
        }
    }
    V2V_TRY(check_parent(path));
done:
    return rc;
}

enum v2v_status v2v_file_check_room(const char *path, int64_t bytes)
{
    enum v2v_status rc = V2V_OK;
    struct statvfs disk;
    char folder[V2V_PATH_BYTES];
    if (bytes < 0) {
        return V2V_FAIL(V2V_E_IO, "%s: its size passes 2^63 bytes", path);
    }
    V2V_TRY(parent_folder(folder, path));
    if (statvfs(folder, &disk) == 0 &&
        (double)bytes > (double)disk.f_bavail * (double)disk.f_frsize) {
        rc = V2V_FAIL(V2V_E_IO, "%s: needs %.3g GB, the disk has %.3g GB left", path,
                      (double)bytes * 1e-9, (double)disk.f_bavail * (double)disk.f_frsize * 1e-9);
    }
done:
    return rc;
}

enum v2v_status v2v_file_temporary(char temporary[V2V_PATH_BYTES], const char *path)
{
    return v2v_text_format(temporary, V2V_PATH_BYTES, "%s.v2v3d-part", path);
}

enum v2v_status v2v_file_packed(char packed[V2V_PATH_BYTES], const char *path)
{
    return v2v_text_format(packed, V2V_PATH_BYTES, "%s.v2v3d-packed", path);
}

enum v2v_status v2v_file_clear(const char *temporary)
{
    /* nothing can have a name that is too long */
    return unlink(temporary) == 0 || errno == ENOENT || errno == ENAMETOOLONG
               ? V2V_OK
               : V2V_FAIL(V2V_E_IO, "%s: cannot be removed: %s", temporary, strerror(errno));
}

enum v2v_status v2v_file_create(int *descriptor, const char *temporary)
{
    enum v2v_status rc = V2V_OK;
    *descriptor = -1;
    V2V_TRY(v2v_file_clear(temporary));
    *descriptor = open(temporary, O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
    if (*descriptor < 0) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %s", temporary, strerror(errno)));
    }
done:
    return rc;
}

/* fsync works on a descriptor that was opened for reading, and on a folder's. */
static enum v2v_status sync_path(const char *path, int flags)
{
    int descriptor = open(path, O_RDONLY | O_CLOEXEC | flags);

    if (descriptor < 0) {
        return V2V_FAIL(V2V_E_IO, "%s: %s", path, strerror(errno));
    }
    int failed = fsync(descriptor) != 0;
    int reason = errno;
    if (close(descriptor) != 0 && !failed) {
        failed = 1;
        reason = errno;
    }
    return failed ? V2V_FAIL(V2V_E_IO, "%s: cannot reach the disk: %s", path, strerror(reason))
                  : V2V_OK;
}

enum v2v_status v2v_file_move(const char *temporary, const char *path)
{
    enum v2v_status rc = V2V_OK;
    char folder[V2V_PATH_BYTES];

    V2V_TRY(V2V_FAULT_POINT("file.commit"));
    V2V_TRY(parent_folder(folder, path));
    V2V_TRY(sync_path(temporary, 0));
    if (rename(temporary, path) != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: cannot be renamed to %s: %s", temporary, path,
                         strerror(errno)));
    }
    V2V_TRY(sync_path(folder, O_DIRECTORY));
done:
    return rc;
}

enum v2v_status v2v_file_commit(const char *temporary, const char *path)
{
    const enum v2v_status rc = v2v_file_move(temporary, path);
    if (rc != V2V_OK) {
        (void)unlink(temporary);
    }
    return rc;
}

enum v2v_status v2v_file_sync(const char *path)
{
    return sync_path(path, 0);
}

enum v2v_status v2v_file_sync_piece(int64_t *pending, int64_t written, const char *path)
{
    const int64_t piece = (int64_t)4 << 30;
    *pending += written;
    if (*pending < piece) {
        return V2V_OK;
    }
    *pending = 0;
    return v2v_file_sync(path);
}

/* Does the name still stand for the open file? Its last holder may have removed it meanwhile. */
static int is_current(int descriptor, const char *path)
{
    struct stat open_one, named_one;

    return fstat(descriptor, &open_one) == 0 && lstat(path, &named_one) == 0 &&
           open_one.st_dev == named_one.st_dev && open_one.st_ino == named_one.st_ino;
}

static int is_regular(int descriptor)
{
    struct stat status;
    return fstat(descriptor, &status) == 0 && S_ISREG(status.st_mode);
}

enum v2v_status v2v_file_lock(int *descriptor, const char *path)
{
    for (;;) {
        /* a pipe without a reader would keep who opens it waiting */
        int fresh = open(path, O_RDWR | O_CREAT | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0666);

        *descriptor = -1;
        if (fresh < 0) {
            return errno == ELOOP ? V2V_FAIL(V2V_E_IO, "%s: is a link; remove it", path)
                                  : V2V_FAIL(V2V_E_IO, "%s: %s", path, strerror(errno));
        }
        if (!is_regular(fresh)) {
            (void)close(fresh);
            return V2V_FAIL(V2V_E_IO, "%s: is not a regular file; remove it", path);
        }
        if (flock(fresh, LOCK_EX | LOCK_NB) != 0) {
            int reason = errno;
            (void)close(fresh);
            return reason == EWOULDBLOCK
                       ? V2V_FAIL(V2V_E_BUSY, "%s: another run holds this lock", path)
                       : V2V_FAIL(V2V_E_IO, "%s: cannot lock: %s", path, strerror(reason));
        }
        if (is_current(fresh, path)) {
            *descriptor = fresh;
            return V2V_OK;
        }
        (void)close(fresh);
    }
}

enum v2v_status v2v_file_lock_output(int *descriptor, char name[V2V_PATH_BYTES], const char *path)
{
    enum v2v_status rc = V2V_OK;
    char packed[V2V_PATH_BYTES];
    *descriptor = -1;
    V2V_TRY(v2v_text_format(name, V2V_PATH_BYTES, "%s.v2v3d-lock", path));
    V2V_TRY(v2v_file_packed(packed, path));
    V2V_TRY(v2v_file_lock(descriptor, name));
    V2V_TRY(v2v_file_clear(packed));
done:
    if (rc != V2V_OK) {
        v2v_file_unlock_output(descriptor, name);
    }
    return rc;
}

void v2v_file_unlock_output(int *descriptor, const char *name)
{
    if (*descriptor >= 0) {
        (void)unlink(name); /* while it is held: who finds it gone makes its own */
        (void)close(*descriptor);
        *descriptor = -1;
    }
}

enum v2v_status v2v_file_check_idle(const char *path)
{
    int descriptor = -1;
    char name[V2V_PATH_BYTES];
    const enum v2v_status rc = v2v_file_lock_output(&descriptor, name, path);
    v2v_file_unlock_output(&descriptor, name);
    return rc;
}

static enum v2v_status make_one_folder(const char *path)
{
    if (mkdir(path, 0777) == 0) {
        return V2V_OK;
    }
    int reason = errno;
    if (reason == EEXIST && v2v_file_is_folder(path)) {
        return V2V_OK;
    }
    return V2V_FAIL(V2V_E_IO, "%s: the folder cannot be made: %s", path, strerror(reason));
}

enum v2v_status v2v_file_make_folder(const char *path)
{
    enum v2v_status rc = V2V_OK;
    char part[V2V_PATH_BYTES];

    V2V_TRY(v2v_text_format(part, sizeof part, "%s", path));
    for (char *at = part; *at != '\0'; at++) {
        if (*at == '/' && at != part) {
            *at = '\0';
            V2V_TRY(make_one_folder(part));
            *at = '/';
        }
    }
    V2V_TRY(make_one_folder(part));
done:
    return rc;
}

enum v2v_status v2v_file_write_text(const char *path, const char *text)
{
    enum v2v_status rc = V2V_OK;
    char temporary[V2V_PATH_BYTES];
    FILE *stream = NULL;

    V2V_TRY(v2v_file_begin(&stream, temporary, path));
    V2V_TRY(V2V_FAULT_POINT("file.write_text"));
    if (fputs(text, stream) < 0 || fflush(stream) != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %s", temporary, strerror(errno)));
    }
done:
    return v2v_file_close_and_commit(rc, stream, temporary, path);
}

enum v2v_status v2v_file_begin(FILE **stream, char temporary[V2V_PATH_BYTES], const char *path)
{
    enum v2v_status rc = V2V_OK;
    int descriptor = -1;

    *stream = NULL;
    V2V_TRY(v2v_file_temporary(temporary, path));
    V2V_TRY(v2v_file_create(&descriptor, temporary));
    *stream = fdopen(descriptor, "w");
    if (*stream == NULL) {
        rc = V2V_FAIL(V2V_E_IO, "%s: %s", temporary, strerror(errno));
        (void)close(descriptor);
        (void)unlink(temporary);
    }
done:
    return rc;
}

enum v2v_status v2v_file_close_and_commit(enum v2v_status rc, FILE *stream, const char *temporary,
                                          const char *path)
{
    if (stream == NULL) {
        return rc;
    }
    if (fclose(stream) != 0 && rc == V2V_OK) {
        rc = V2V_FAIL(V2V_E_IO, "%s: %s", temporary, strerror(errno));
    }
    if (rc == V2V_OK) {
        return v2v_file_commit(temporary, path);
    }
    (void)unlink(temporary);
    return rc;
}

int v2v_file_is_other_size(double um, double of_other_um)
{
    const double nominal = 0.01;
    return um > 0.0 && of_other_um > 0.0 && fabs(um - of_other_um) > nominal * of_other_um;
}
