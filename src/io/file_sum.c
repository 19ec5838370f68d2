#include "v2v3d/io/file_sum.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/io/file.h"
#include "v2v3d/par/watchdog.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

enum { PIECE = 1 << 24 };

/* Pieces rank, rank + ranks, ... to the end of the file. Local. */
static enum v2v_status sum_pieces(uint64_t *sum, const char *path, int64_t rank, int64_t ranks)
{
    enum v2v_status rc = V2V_OK;
    char *piece = NULL;
    FILE *file = NULL;
    *sum = 0;
    V2V_TRY(v2v_file_check_input(path));
    V2V_TRY(V2V_ALLOC(piece, "io.file_sum", PIECE));
    file = fopen(path, "rbe");
    if (file == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s", path, strerror(errno)));
    }
    for (int64_t i = rank;; i += ranks) {
        if (fseeko(file, (off_t)(i * PIECE), SEEK_SET) != 0) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s", path, strerror(errno)));
        }
        const size_t bytes = fread(piece, 1, PIECE, file);
        if (ferror(file)) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: cannot be read", path));
        }
        if (bytes == 0) {
            break;
        }
        v2v_watchdog_beat("checksum of an input");
        const uint32_t crc = v2v_file_crc32c(0, piece, (int64_t)bytes);
        *sum += v2v_random_splitmix64(v2v_random_splitmix64((uint64_t)i) + crc);
    }
done:
    if (file != NULL) {
        fclose(file);
    }
    v2v_mem_free(piece);
    return rc;
}

enum v2v_status v2v_file_sum(uint64_t *sum, const char *path, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    uint64_t part = 0;
    rc = sum_pieces(&part, path, v2v_comm_rank(comm), v2v_comm_size(comm));
    V2V_TRY(v2v_par_agree(comm, rc));
    int64_t all = (int64_t)part;
    v2v_par_sum_i64(comm, &all, 1);
    *sum = (uint64_t)all;
done:
    return rc;
}
