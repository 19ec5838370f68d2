#include "io/write_behind.h"

#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

/* More than the datasets of a frame, its checksum and its mark. */
enum { MOST_WAITING = 16 };

struct v2v_write_behind {
    char name[V2V_PATH_BYTES];
    int descriptor;
    int direct; /* past the system's memory, in whole pages; -1: the file system has no such way */
    pthread_t thread;
    int is_running;
    pthread_mutex_t lock;
    pthread_cond_t changed;
    /* behind the lock: */
    struct v2v_piece waiting[MOST_WAITING];
    int first, count; /* of those; the first one is in work until it is taken off */
    int is_ending;
    enum v2v_status rc; /* of the first failure, with its words */
    struct v2v_status_record words;
};

/* ---- the thread ---- */

/* Whole pages go to the disk as they are, which costs a fifth of copying them first. */
static int descriptor_for(const struct v2v_write_behind *behind, const unsigned char *data,
                          int64_t bytes, int64_t at)
{
    const int is_paged = (uintptr_t)data % V2V_PAGE_BYTES == 0 && bytes % V2V_PAGE_BYTES == 0 &&
                         at % V2V_PAGE_BYTES == 0;
    return is_paged && behind->direct >= 0 ? behind->direct : behind->descriptor;
}

static enum v2v_status write_all(struct v2v_write_behind *behind, const unsigned char *data,
                                 int64_t bytes, int64_t at)
{
    while (bytes > 0) {
        const int to = descriptor_for(behind, data, bytes, at);
        const ssize_t written = pwrite(to, data, (size_t)bytes, (off_t)at);
        if (written < 0 && errno == EINTR) {
            continue;
        }
        if (written < 0 && to == behind->direct) {
            close(behind->direct); /* it can't, or the disk can't, which the other way tells */
            behind->direct = -1;
            continue;
        }
        if (written <= 0) {
            return V2V_FAIL(V2V_E_IO, "%s: writing failed: %s", behind->name,
                            strerror(written < 0 ? errno : ENOSPC));
        }
        data += written;
        bytes -= (int64_t)written;
        at += (int64_t)written;
    }
    return V2V_OK;
}

static enum v2v_status write_piece(struct v2v_write_behind *behind, const struct v2v_piece *piece)
{
    enum v2v_status rc = V2V_OK;
    unsigned char number[sizeof piece->number];
    V2V_TRY(V2V_FAULT_POINT(piece->fault));
    for (size_t i = 0; i < sizeof number; i++) {
        number[i] = (unsigned char)(piece->number >> 8 * i);
    }
    V2V_TRY(write_all(behind, piece->data != NULL ? piece->data : number, piece->bytes, piece->at));
    if (piece->data != NULL) {
        /* It is on the disk, and nobody reads it soon: the next frame takes the same memory, which
         * costs a quarter of taking fresh one, and what others read stays in memory. */
        (void)posix_fadvise(behind->descriptor, (off_t)piece->at, (off_t)piece->bytes,
                            POSIX_FADV_DONTNEED);
    }
done:
    return rc;
}

/* Behind the lock. */
static void keep_failure(struct v2v_write_behind *behind, enum v2v_status rc)
{
    behind->rc = rc;
    v2v_status_keep(&behind->words);
    behind->count = 0;
}

static void *work(void *context)
{
    struct v2v_write_behind *behind = context;
    pthread_mutex_lock(&behind->lock);
    for (;;) {
        while (behind->count == 0 && !behind->is_ending) {
            pthread_cond_wait(&behind->changed, &behind->lock);
        }
        if (behind->is_ending) {
            break;
        }
        const struct v2v_piece piece = behind->waiting[behind->first];
        pthread_mutex_unlock(&behind->lock);
        const enum v2v_status rc = write_piece(behind, &piece);
        pthread_mutex_lock(&behind->lock);
        if (rc == V2V_OK) {
            behind->first = (behind->first + 1) % MOST_WAITING;
            behind->count--;
        } else {
            keep_failure(behind, rc);
        }
        pthread_cond_broadcast(&behind->changed);
    }
    pthread_mutex_unlock(&behind->lock);
    return NULL;
}

/* ---- its owner ---- */

/* Signals are for the owner: one that asks to stop is not to be lost here. */
static enum v2v_status start_thread(struct v2v_write_behind *behind)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    const int failed = pthread_create(&behind->thread, NULL, work, behind);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    behind->is_running = failed == 0;
    return behind->is_running ? V2V_OK
                              : V2V_FAIL(V2V_E_MEMORY, "%s: no thread to write: %s", behind->name,
                                         strerror(failed));
}

enum v2v_status v2v_write_behind_create(struct v2v_write_behind **behind, const char *path,
                                        const char *name)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_write_behind *fresh = NULL;
    *behind = NULL;
    V2V_TRY(V2V_ALLOC(fresh, "io.write_behind", 1));
    pthread_mutex_init(&fresh->lock, NULL);
    pthread_cond_init(&fresh->changed, NULL);
    fresh->descriptor = fresh->direct = -1;
    V2V_TRY(v2v_text_format(fresh->name, sizeof fresh->name, "%s", name));
    /* A write ends when its data are on the disk. To write only, and in this way, makes NFS send
     * the bytes given and no more: other hosts' are in the same pages. */
    fresh->descriptor = open(path, O_WRONLY | O_DSYNC | O_NOFOLLOW | O_CLOEXEC);
    if (fresh->descriptor < 0) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %s", path, strerror(errno)));
    }
    fresh->direct = open(path, O_WRONLY | O_DSYNC | O_DIRECT | O_NOFOLLOW | O_CLOEXEC);
    V2V_TRY(start_thread(fresh));
    *behind = fresh;
    fresh = NULL;
done:
    v2v_write_behind_destroy(&fresh);
    return rc;
}

/* Behind the lock. */
static enum v2v_status tell(const struct v2v_write_behind *behind)
{
    if (behind->rc != V2V_OK) {
        v2v_status_restore(&behind->words);
    }
    return behind->rc;
}

enum v2v_status v2v_write_behind_put(struct v2v_write_behind *behind, const struct v2v_piece *piece)
{
    V2V_ASSERT(piece->data != NULL || piece->bytes <= (int64_t)sizeof piece->number);
    pthread_mutex_lock(&behind->lock);
    while (behind->count == MOST_WAITING) {
        pthread_cond_wait(&behind->changed, &behind->lock);
    }
    const enum v2v_status rc = tell(behind);
    if (rc == V2V_OK) {
        behind->waiting[(behind->first + behind->count++) % MOST_WAITING] = *piece;
        pthread_cond_broadcast(&behind->changed);
    }
    pthread_mutex_unlock(&behind->lock);
    return rc;
}

enum v2v_status v2v_write_behind_wait(struct v2v_write_behind *behind)
{
    pthread_mutex_lock(&behind->lock);
    while (behind->count > 0) {
        pthread_cond_wait(&behind->changed, &behind->lock);
    }
    const enum v2v_status rc = tell(behind);
    pthread_mutex_unlock(&behind->lock);
    return rc;
}

void v2v_write_behind_destroy(struct v2v_write_behind **behind)
{
    struct v2v_write_behind *old = *behind;
    *behind = NULL;
    if (old == NULL) {
        return;
    }
    if (old->is_running) {
        pthread_mutex_lock(&old->lock);
        old->is_ending = 1;
        pthread_cond_broadcast(&old->changed);
        pthread_mutex_unlock(&old->lock);
        pthread_join(old->thread, NULL);
    }
    if (old->descriptor >= 0) {
        (void)close(old->descriptor); /* every write of it is on the disk */
    }
    if (old->direct >= 0) {
        (void)close(old->direct);
    }
    pthread_cond_destroy(&old->changed);
    pthread_mutex_destroy(&old->lock);
    v2v_mem_free(old);
}
