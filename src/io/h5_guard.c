#include "io/h5_guard.h"
#include "io/h5_chunks.h"
#include "io/h5_common.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/log.h"
#include <errno.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

/* Of processor time: an object of the file, and all of it. */
enum { GUARD_SECONDS = 10, GUARD_MOST_SECONDS = 60 };
/* By the clock, for a disk may be slow and a processor busy: until the next object was looked at,
 * and all of it. */
static const double guard_wait = 60.0, guard_most_wait = 300.0;
/* On top of what the process holds already: chunks of up to 2 GiB and their decoding. */
#define GUARD_BYTES ((rlim_t)6 << 30)

/* How a look ended: well, or by one of these, or by a signal (> 0). */
enum { WELL = 0, LATE = -1, NOT_DONE = -2, FAILED = -3, STUCK = -4 };

/* ---- limits ---- */

static void set_limit(int resource, rlim_t value, rlim_t most)
{
    struct rlimit limit;
    if (getrlimit(resource, &limit) == 0) {
        const rlim_t hard = most < limit.rlim_max ? most : limit.rlim_max;
        limit = (struct rlimit){.rlim_cur = value < hard ? value : hard, .rlim_max = hard};
        setrlimit(resource, &limit);
    }
}

/* From now on. SIGXCPU tells the parent why; with both limits equal the kernel sends SIGKILL at
 * once. */
static void limit_processor_time(void)
{
    struct rusage used = {0};
    getrusage(RUSAGE_SELF, &used);
    const double parts = 1e-6 * (double)(used.ru_utime.tv_usec + used.ru_stime.tv_usec);
    const rlim_t whole = (rlim_t)used.ru_utime.tv_sec + (rlim_t)used.ru_stime.tv_sec;
    const rlim_t until = whole + (rlim_t)parts + GUARD_SECONDS;
    set_limit(RLIMIT_CPU, until < GUARD_MOST_SECONDS ? until : GUARD_MOST_SECONDS,
              GUARD_MOST_SECONDS + 1);
}

/* ---- the look ---- */

static int told = -1; /* in the child: the parent's pipe */

/* What can't be read with this little memory would take the caller long, or all memory. */
static void need(int done)
{
    if (!done) {
        _exit(1);
    }
}

/* An object is done: the parent waits for the next one. */
static void tell(void)
{
    limit_processor_time();
    while (told >= 0 && write(told, "", 1) != 1) {
        need(errno == EINTR); /* else there is no parent any more */
    }
}

/* A number, a few of them, or a text. */
static herr_t look_at_attribute(hid_t object, const char *name, const H5A_info_t *info, void *data)
{
    enum { NUMBERS = 16, TEXT = 65536 };
    static char text[TEXT];
    double numbers[NUMBERS];
    const hid_t attribute = H5Aopen(object, name, H5P_DEFAULT);
    const hid_t type = H5Aget_type(attribute), space = H5Aget_space(attribute);
    const H5T_class_t class = H5Tget_class(type);
    const hssize_t count = H5Sget_simple_extent_npoints(space);
    (void)info;
    (void)data;
    need(attribute >= 0 && type >= 0 && space >= 0);
    if ((class == H5T_INTEGER || class == H5T_FLOAT) && count > 0 && count <= NUMBERS) {
        need(H5Aread(attribute, H5T_NATIVE_DOUBLE, numbers) >= 0);
    } else if (class == H5T_STRING && count == 1 && H5Tget_size(type) <= TEXT) {
        const hid_t native = H5Tget_native_type(type, H5T_DIR_DEFAULT);
        need(H5Aread(attribute, native, text) >= 0);
        H5Tclose(native);
    }
    H5Sclose(space);
    H5Tclose(type);
    H5Aclose(attribute);
    return 0;
}

/* The first element and the last, unless the dataset's storage is refused: so will the caller. */
static void read_ends(hid_t set, const char *path, const char *name)
{
    const hsize_t one = 1;
    hsize_t at[H5S_MAX_RANK] = {0}, ones[H5S_MAX_RANK];
    struct v2v_h5_chunks *chunks = NULL;
    float value;
    if (v2v_h5_chunks_create(&chunks, set, path, name) != V2V_OK) {
        return;
    }
    for (int i = 0; i < H5S_MAX_RANK; i++) {
        ones[i] = 1;
    }
    const hid_t space = H5Dget_space(set), memory = H5Screate_simple(1, &one, NULL);
    const int rank = H5Sget_simple_extent_ndims(space);
    need(rank >= 0 && memory >= 0);
    for (int end = 0; end < 2 && rank > 0 && H5Sget_simple_extent_npoints(space) > 0; end++) {
        need(v2v_h5_chunks_check(chunks, name, at, ones) == V2V_OK);
        tell(); /* a chunk may have taken seconds */
        need(H5Sselect_elements(space, H5S_SELECT_SET, 1, at) >= 0 &&
             H5Dread(set, H5T_NATIVE_FLOAT, memory, space, H5P_DEFAULT, &value) >= 0 &&
             H5Sget_simple_extent_dims(space, at, NULL) == rank);
        for (int i = 0; i < rank; i++) {
            at[i]--;
        }
    }
    H5Sclose(memory);
    H5Sclose(space);
    v2v_h5_chunks_destroy(&chunks);
}

/* Datasets that v2v_h5_open_dataset refuses are not read later on either. */
static herr_t look_at_link(hid_t file, const char *name, const H5L_info_t *info, void *path)
{
    hid_t set = H5I_INVALID_HID;
    if (info->type != H5L_TYPE_HARD) {
        return 0;
    }
    const hid_t object = H5Oopen(file, name, H5P_DEFAULT);
    need(object >= 0);
    need(H5Aiterate(object, H5_INDEX_NAME, H5_ITER_NATIVE, NULL, look_at_attribute, NULL) >= 0);
    if (H5Iget_type(object) == H5I_DATASET &&
        v2v_h5_open_dataset(&set, file, path, name) == V2V_OK) {
        const hid_t type = H5Dget_type(set);
        const H5T_class_t class = H5Tget_class(type);
        H5Tclose(type);
        if (class == H5T_INTEGER || class == H5T_FLOAT) {
            read_ends(set, path, name);
        }
    }
    v2v_h5_close(&set);
    H5Oclose(object);
    tell();
    return 0;
}

/* In the child, which then ends. A file that HDF5 doesn't open is refused by the
 * caller, who says why. */
static void look_at_file(const char *path)
{
    char name[V2V_PATH_BYTES];
    hid_t file = H5I_INVALID_HID;
    snprintf(name, sizeof name, "%s", path);
    if (v2v_h5_open(&file, name) == V2V_OK) {
        need(H5Aiterate(file, H5_INDEX_NAME, H5_ITER_NATIVE, NULL, look_at_attribute, NULL) >= 0);
        need(H5Lvisit(file, H5_INDEX_NAME, H5_ITER_NATIVE, look_at_link, name) >= 0);
    }
}

/* ---- the child ---- */

#ifndef __SANITIZE_ADDRESS__
/* Virtual size of this process in bytes, 0 when unknown. */
static rlim_t virtual_size(void)
{
    unsigned long long pages = 0;
    FILE *statm = fopen("/proc/self/statm", "r");
    if (statm == NULL) {
        return 0;
    }
    if (fscanf(statm, "%llu", &pages) != 1) {
        pages = 0;
    }
    fclose(statm);
    return (rlim_t)pages * (rlim_t)sysconf(_SC_PAGESIZE);
}
#endif

static void restrain_child(void)
{
    /* Open MPI and the sanitizers print stacks on these; the parent reports them in one line. */
    static const int crashes[] = {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGILL};
    for (size_t i = 0; i < sizeof crashes / sizeof crashes[0]; i++) {
        signal(crashes[i], SIG_DFL);
    }
    set_limit(RLIMIT_CORE, 0, 0);
    limit_processor_time();
#ifndef __SANITIZE_ADDRESS__ /* its shadow memory is terabytes of address space */
    const rlim_t held = virtual_size();
    if (held > 0) {
        set_limit(RLIMIT_AS, held + GUARD_BYTES, held + GUARD_BYTES);
    }
#endif
}

/* Does the other end of the pipe close, as it does when the child ends, while there is something to
 * be read every now and then? */
static int ends_in_time(int in)
{
    const double last = v2v_clock_now() + guard_most_wait;
    double end = v2v_clock_now() + guard_wait;
    struct pollfd waiting = {.fd = in, .events = POLLIN};
    for (;;) {
        char bytes[512];
        const double left = fmax(fmin(end, last) - v2v_clock_now(), 0.0);
        const int ready = poll(&waiting, 1, (int)ceil(left * 1000.0));
        const ssize_t got = ready > 0 ? read(in, bytes, sizeof bytes) : -1;
        if (ready == 0 || got == 0) {
            return got == 0;
        }
        if (got > 0) {
            end = v2v_clock_now() + guard_wait;
        } else if (errno != EINTR) {
            return 0;
        }
    }
}

/* What was killed while it waits for a disk may not end: it is left behind after a second. */
static pid_t wait_for(pid_t child, int *how, int is_killed)
{
    const double began = v2v_clock_now();
    pid_t ended = -1;
    do {
        ended = waitpid(child, how, is_killed ? WNOHANG : 0);
        if (ended == 0) {
            usleep(10000);
        }
    } while ((ended == 0 && v2v_clock_now() - began < 1.0) || (ended < 0 && errno == EINTR));
    return ended;
}

static int watch(const char *path, void (*look)(const char *path))
{
    int ends[2] = {-1, -1}, how = 0;
    const pid_t child = pipe(ends) == 0 ? fork() : -1;
    if (child < 0 && ends[0] >= 0) {
        close(ends[0]);
        close(ends[1]);
    }
    if (child < 0) {
        return NOT_DONE;
    }
    if (child == 0) {
        close(ends[0]);
        told = ends[1];
        restrain_child();
        look(path);
        _exit(0);
    }
    close(ends[1]);
    const int is_stuck = !ends_in_time(ends[0]);
    close(ends[0]);
    if (is_stuck) {
        kill(child, SIGKILL);
    }
    const pid_t ended = wait_for(child, &how, is_stuck);
    if (is_stuck) {
        return STUCK;
    }
    if (ended < 0) { /* nobody knows how: SIGCHLD is ignored */
        return NOT_DONE;
    }
    if (WIFSIGNALED(how) && WTERMSIG(how) == SIGXCPU) {
        return LATE;
    }
    return WIFSIGNALED(how) ? WTERMSIG(how) : WEXITSTATUS(how) == 0 ? WELL : FAILED;
}

static enum v2v_status judge(const char *path, int how)
{
    if (how == NOT_DONE) {
        v2v_log(V2V_LOG_WARNING, "%s: is read without a look from a child process first", path);
        return V2V_OK;
    }
    if (how == LATE) {
        return V2V_FAIL(V2V_E_INPUT,
                        "%s: is damaged: HDF5 looked at it for more than %d s, or at a part of it "
                        "for more than %d s",
                        path, GUARD_MOST_SECONDS, GUARD_SECONDS);
    }
    if (how == STUCK) {
        return V2V_FAIL(V2V_E_IO,
                        "%s: cannot be looked at: for %.0f s nothing of it was read, or in %.0f s "
                        "not all of it",
                        path, guard_wait, guard_most_wait);
    }
    if (how == FAILED) {
        return V2V_FAIL(V2V_E_INPUT, "%s: is damaged: HDF5 can't read all of it", path);
    }
    return how == WELL
               ? V2V_OK
               : V2V_FAIL(V2V_E_INPUT, "%s: is damaged: HDF5 crashed on it (signal %d)", path, how);
}

enum v2v_status v2v_h5_guard_with(const char *path, void (*look)(const char *path))
{
    return judge(path, watch(path, look));
}

/* ---- the helper ---- */

static int helper = -1; /* this process's end of the socket; written before MPI starts */

/* Paths in, how each look ended out, until the other end closes. Signals to the job are not meant
 * for it. */
static _Noreturn void serve(int line)
{
    static const int others[] = {SIGINT, SIGTERM, SIGHUP, SIGUSR1, SIGUSR2};
    char path[V2V_PATH_BYTES];
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        signal(others[i], SIG_IGN);
    }
    while (recv(line, path, sizeof path, 0) > 0) {
        path[sizeof path - 1] = '\0';
        const int how = watch(path, look_at_file);
        if (send(line, &how, sizeof how, MSG_NOSIGNAL) != (ssize_t)sizeof how) {
            break;
        }
    }
    _exit(0);
}

void v2v_file_guard_start(void)
{
    int ends[2];
    if (helper >= 0 || socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0) {
        return;
    }
    const pid_t child = fork();
    if (child == 0) {
        close(ends[0]);
        serve(ends[1]);
    }
    close(ends[1]);
    helper = ends[0];
}

void v2v_file_guard_stop(void)
{
    close(helper);
    helper = -1;
}

/* How looks ended, the last ones of this thread: a command opens its inputs several times. A file
 * that was just written may be written again without another time. */
enum { REMEMBERED = 8, SETTLED_SECONDS = 2 };
static _Thread_local struct {
    struct v2v_file_state state;
    int how;
} looked[REMEMBERED];
static _Thread_local int next_looked;

static int is_remembered(int *how, const struct v2v_file_state *state)
{
    for (int i = 0; i < REMEMBERED; i++) {
        if (looked[i].state.inode != 0 && memcmp(&looked[i].state, state, sizeof *state) == 0) {
            *how = looked[i].how;
            return 1;
        }
    }
    return 0;
}

/* What could not be read may be read another time. */
static void remember(int how, const struct v2v_file_state *state)
{
    if (how != NOT_DONE && how != FAILED &&
        state->seconds + SETTLED_SECONDS < (int64_t)time(NULL)) {
        looked[next_looked].state = *state;
        looked[next_looked].how = how;
        next_looked = (next_looked + 1) % REMEMBERED;
    }
}

enum v2v_status v2v_h5_guard(const char *path)
{
    int how = NOT_DONE;
    ssize_t got = -1;
    const size_t bytes = strlen(path) + 1;
    struct v2v_status_record earlier;
    struct v2v_file_state state = {0};
    v2v_status_keep(&earlier);
    const int is_there = v2v_file_remember(&state, path) == V2V_OK;
    v2v_status_restore(&earlier);
    if (is_there && is_remembered(&how, &state)) {
        return judge(path, how);
    }
    if (helper >= 0 && send(helper, path, bytes, MSG_NOSIGNAL) == (ssize_t)bytes) {
        do {
            got = recv(helper, &how, sizeof how, 0);
        } while (got < 0 && errno == EINTR);
    }
    if (got != (ssize_t)sizeof how) {
        how = watch(path, look_at_file);
    }
    if (is_there) {
        remember(how, &state);
    }
    return judge(path, how);
}

enum v2v_status v2v_h5_guard_input(struct v2v_file_state *state, const char *path)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_file_check_input(path));
    V2V_TRY(v2v_file_remember(state, path));
    V2V_TRY(v2v_h5_guard(path));
done:
    return rc;
}
