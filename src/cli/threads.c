#include "cli/threads.h"

#include "v2v3d/base/random.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

/* Variables that tell libgomp's threads how to wait, the stronger one first, and what that
 * one is where there is neither. */
static const char *const waiting[] = {"GOMP_SPINCOUNT", "OMP_WAIT_POLICY"};
static const char spins[] = "1000";

int v2v_cli_cores(void)
{
    cpu_set_t set;
    if (sched_getaffinity(0, sizeof set, &set) == 0) {
        return CPU_COUNT(&set);
    }
    long cores = sysconf(_SC_NPROCESSORS_ONLN);
    return cores > 0 ? (int)cores : 1;
}

/* A number that two ranks share when they run on the same cores of the same host. */
static int64_t place_of_rank(void)
{
    char host[256] = "";
    cpu_set_t set;
    uint64_t hash = 0;
    if (gethostname(host, sizeof host - 1) == 0) {
        hash = v2v_random_fnv1a64(host);
    }
    if (sched_getaffinity(0, sizeof set, &set) == 0) {
        for (int core = 0; core < CPU_SETSIZE; core++) {
            if (CPU_ISSET(core, &set)) {
                hash = v2v_random_splitmix64(hash + (uint64_t)core);
            }
        }
    }
    return (int64_t)(hash >> 1); /* stays positive: places are compared, not ordered */
}

int v2v_cli_neighbours(const struct v2v_comm *world)
{
    int size = v2v_comm_size(world);
    int64_t mine = place_of_rank();
    int neighbours = 0;
    for (int r = 0; r < size; r++) {
        int64_t place = mine;
        v2v_par_broadcast(world, &place, (int64_t)sizeof place, r);
        neighbours += place == mine;
    }
    return neighbours;
}

int v2v_cli_threads(int64_t wanted, const struct v2v_comm *world)
{
    int share = v2v_cli_cores() / v2v_cli_neighbours(world);
    const char *limit = getenv("OMP_NUM_THREADS");
    int64_t most = 0;
    if (wanted > 0) {
        return (int)wanted;
    }
    if (limit != NULL &&
        v2v_text_to_i64(&most, limit, 1, 1024, "OMP_NUM_THREADS", V2V_E_CONFIG) == V2V_OK &&
        most < share) {
        share = (int)most;
    }
    return share > 1 ? share : 1;
}

void v2v_cli_settle_waiting(char **argv)
{
    char program[V2V_PATH_BYTES];
    if (getenv(waiting[0]) != NULL || getenv(waiting[1]) != NULL) {
        return;
    }
    const ssize_t length = readlink("/proc/self/exe", program, sizeof program - 1);
    if (length > 0 && setenv(waiting[0], spins, 1) == 0) {
        program[length] = '\0';
        (void)execv(program, argv); /* where it can't, threads wait as libgomp likes */
        (void)unsetenv(waiting[0]);
    }
}

void v2v_cli_waiting(char *text, size_t bytes)
{
    const int i = getenv(waiting[0]) == NULL;
    const char *value = getenv(waiting[i]);
    snprintf(text, bytes, "%s %s", waiting[i], value != NULL ? value : "not set");
}
