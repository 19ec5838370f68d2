#include "v2v3d/io/file_sum.h"

#include "io/folder.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/par/watchdog.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

enum { PIECE = 1 << 24 };

/* What is to be done with a piece of a file. */
typedef void take_piece(void *context, int64_t number, const void *piece, int64_t bytes);

/* Pieces first, first + every, ... to the end of the file. Local. */
static enum v2v_status read_pieces(take_piece *take, void *context, const char *path, int64_t first,
                                   int64_t every)
{
    enum v2v_status rc = V2V_OK;
    char *piece = NULL;
    FILE *file = NULL;
    V2V_TRY(v2v_file_check_input(path));
    V2V_TRY(V2V_ALLOC(piece, "io.file_sum", PIECE));
    file = fopen(path, "rbe");
    if (file == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s", path, strerror(errno)));
    }
    for (int64_t i = first;; i += every) {
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
        take(context, i, piece, (int64_t)bytes);
    }
done:
    if (file != NULL) {
        fclose(file);
    }
    v2v_mem_free(piece);
    return rc;
}

static void add_hash(void *context, int64_t number, const void *piece, int64_t bytes)
{
    uint64_t *const sum = context;
    const uint32_t crc = v2v_file_crc32c(0, piece, bytes);
    *sum += v2v_random_splitmix64(v2v_random_splitmix64((uint64_t)number) + crc);
}

static void go_on(void *context, int64_t number, const void *piece, int64_t bytes)
{
    uint32_t *const crc = context;
    (void)number;
    *crc = v2v_file_crc32c(*crc, piece, bytes);
}

enum v2v_status v2v_file_crc32c_of(uint32_t *crc, const char *path)
{
    *crc = 0;
    return read_pieces(go_on, crc, path, 0, 1);
}

/* Of a folder every rank takes part in every file, whose first pieces go round: files of one piece
 * are shared, too. Their order counts. */
static enum v2v_status add_folder(uint64_t *sum, const char *path, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_folder folder = {0};
    char file[V2V_PATH_BYTES];
    const int64_t rank = v2v_comm_rank(comm), size = v2v_comm_size(comm);
    V2V_TRY(v2v_folder_list(&folder, path));
    for (int64_t i = 0; i < folder.count; i++) {
        uint64_t part = 0;
        V2V_TRY(v2v_folder_path(file, &folder, i));
        V2V_TRY(read_pieces(add_hash, &part, file, (rank + i) % size, size));
        *sum += (2 * (uint64_t)i + 1) * part;
    }
done:
    v2v_folder_fini(&folder);
    return rc;
}

enum v2v_status v2v_file_sum(uint64_t *sum, const char *path, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    uint64_t part = 0;
    rc = v2v_file_is_folder(path)
             ? add_folder(&part, path, comm)
             : read_pieces(add_hash, &part, path, v2v_comm_rank(comm), v2v_comm_size(comm));
    V2V_TRY(v2v_par_agree(comm, rc));
    int64_t all = (int64_t)part;
    v2v_par_sum_i64(comm, &all, 1);
    *sum = (uint64_t)all;
done:
    return rc;
}

/* Of a file's size, and where `reads` is set of its first and last piece. Local. */
static enum v2v_status add_sample(uint64_t *sum, const char *path, int reads)
{
    enum v2v_status rc = V2V_OK;
    struct stat state;
    V2V_TRY(v2v_file_check_input(path));
    if (stat(path, &state) != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s", path, strerror(errno)));
    }
    *sum = v2v_random_splitmix64(*sum + (uint64_t)state.st_size);
    const int64_t last = v2v_parts(state.st_size, PIECE) - 1;
    if (reads) {
        V2V_TRY(read_pieces(add_hash, sum, path, 0, v2v_larger(last, 1)));
    }
done:
    return rc;
}

static enum v2v_status sample(uint64_t *sum, const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_folder folder = {0};
    char file[V2V_PATH_BYTES];
    if (!v2v_file_is_folder(path)) {
        return add_sample(sum, path, 1);
    }
    V2V_TRY(v2v_folder_list(&folder, path));
    for (int64_t i = 0; i < folder.count; i++) {
        V2V_TRY(v2v_folder_path(file, &folder, i));
        V2V_TRY(add_sample(sum, file, i == 0));
    }
done:
    v2v_folder_fini(&folder);
    return rc;
}

enum v2v_status v2v_file_agree(const char *path, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    uint64_t own = 0;
    if (v2v_comm_size(comm) == 1) {
        return V2V_OK;
    }
    V2V_TRY(v2v_par_agree(comm, sample(&own, path)));
    uint64_t first = own;
    v2v_par_broadcast(comm, &first, sizeof first, 0);
    if (own != first) {
        rc = V2V_FAIL(V2V_E_INPUT, "%s: is another file here than on rank 0's host", path);
    }
    rc = v2v_par_agree(comm, rc);
done:
    return rc;
}
