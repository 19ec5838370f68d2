#include "par/mates.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

struct mate {
    int64_t host; /* equal for ranks that see each other's processes */
    int64_t process, rank;
};

/* Read by a signal handler, which gets no argument. */
static struct {
    struct mate *mate;
    int count;
    int64_t host, process; /* of this rank */
} known;

/* A container may hide the processes of another one on the same host. */
static int64_t name_of_host(void)
{
    char text[512] = "";
    size_t length = 0;
    if (gethostname(text, sizeof text / 2) == 0) {
        length = strlen(text);
    }
    ssize_t got = readlink("/proc/self/ns/pid", text + length, sizeof text - 1 - length);
    text[length + (got > 0 ? (size_t)got : 0)] = '\0';
    return (int64_t)(v2v_random_fnv1a64(text) >> 1);
}

void v2v_mates_learn(MPI_Comm world)
{
    int size = 0, rank = 0;
    MPI_Comm_size(world, &size);
    MPI_Comm_rank(world, &rank);
    known.host = name_of_host();
    known.process = getpid();
    struct mate own = {known.host, known.process, rank}, *all = NULL;
    int lacking = V2V_ALLOC(all, "par.mates", size) != V2V_OK;
    MPI_Allreduce(MPI_IN_PLACE, &lacking, 1, MPI_INT, MPI_MAX, world);
    if (!lacking) {
        MPI_Allgather(&own, 3, MPI_INT64_T, all, 3, MPI_INT64_T, world);
        known.mate = all;
        known.count = size;
        all = NULL;
    }
    v2v_mem_free(all);
}

void v2v_mates_forget(void)
{
    struct mate *mate = known.mate;
    known.count = 0;
    known.mate = NULL;
    v2v_mem_free(mate);
}

/* Append a word, or a number. */
static size_t put(char *text, size_t bytes, size_t length, const char *word)
{
    while (*word != '\0' && length < bytes) {
        text[length++] = *word++;
    }
    return length;
}

static size_t put_number(char *text, size_t bytes, size_t length, int64_t number)
{
    char digits[24];
    size_t first = sizeof digits - 1;
    digits[first] = '\0';
    do {
        digits[--first] = (char)('0' + number % 10);
        number /= 10;
    } while (number > 0);
    return put(text, bytes, length, digits + first);
}

/* The letter of proc(5): R, S, D, T, .. 'X' for a process that is no more, '?' where the kernel
 * does not say. */
static char state_of(int64_t process)
{
    char text[512];
    size_t length = put(text, sizeof text - 1, 0, "/proc/");
    length = put_number(text, sizeof text - 1, length, process);
    length = put(text, sizeof text - 1, length, "/stat");
    text[length] = '\0';
    int file = open(text, O_RDONLY | O_CLOEXEC);
    if (file < 0) {
        return errno == ENOENT ? 'X' : '?';
    }
    ssize_t got = read(file, text, sizeof text);
    close(file);
    /* "process (name) S ..": a name may hold anything, brackets too */
    for (ssize_t i = got - 3; i >= 0; i--) {
        if (text[i] == ')') {
            return text[i + 2];
        }
    }
    return '?';
}

static const char *trouble_of(char state)
{
    switch (state) {
    case 'T':
    case 't':
        return " is stopped; ";
    case 'D':
        return " waits for a device; ";
    case 'Z':
    case 'X':
        return " is gone; ";
    default:
        return NULL;
    }
}

size_t v2v_mates_lost(char *text, size_t bytes)
{
    size_t length = 0;
    for (int i = 0; i < known.count; i++) {
        const struct mate *mate = &known.mate[i];
        if (mate->host != known.host || mate->process == known.process) {
            continue;
        }
        const char *trouble = trouble_of(state_of(mate->process));
        if (trouble != NULL) {
            length = put(text, bytes, length, "rank ");
            length = put_number(text, bytes, length, mate->rank);
            length = put(text, bytes, length, trouble);
        }
    }
    return length;
}
