#include "cli/threads.h"

#include "v2v3d/base/random.h"
#include "v2v3d/base/text.h"
#include <sched.h>
#include <stdlib.h>
#include <unistd.h>

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
