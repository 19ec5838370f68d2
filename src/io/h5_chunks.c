#include "io/h5_chunks.h"
#include "io/h5_common.h"
#include "v2v3d/base/memory.h"
#include <limits.h>
#include <stdio.h>
#include <string.h>

/* A chunk is decoded in one piece: this bounds what one read of an image may take. */
#define MOST_CHUNK_BYTES ((int64_t)2 << 30)

/* Of those that HDF5 leaves to programs (256 to 511). */
enum { SIZE_FILTER = 411 };

/* Elements are numbers of so many bytes at most. A pipeline has so many filters at most, which with
 * a check behind each and one in front fit in the 32 bits of HDF5's masks, and so many parameters
 * each. */
enum { MOST_ELEMENT_BYTES = 64, MOST_PARAMETERS = 64, MOST_FILTERS = 15 };

struct v2v_h5_chunks {
    const char *path, *name;
    hid_t set;
    int rank, filters;
    int edges_are_plain; /* chunks that pass the dataset's end are stored without filters */
    hsize_t extent[H5S_MAX_RANK], chunk[H5S_MAX_RANK], grid[H5S_MAX_RANK];
    int64_t count, bytes; /* chunks, and of one once decoded */
    hsize_t file_bytes;
    uint8_t *seen;      /* [count] was decoded well */
    uint8_t *stored;    /* a chunk as it is in the file */
    int64_t room;       /* bytes there */
    hid_t scratch, one; /* a file in memory and its dataset of one chunk, .. */
    uint32_t left_out;  /* filters that its chunk is written without */
    hid_t type, first;  /* .. of these elements, the first of them selected */
};

/* Between filters, where a chunk is decoded: its bytes lie within two bounds. */
static size_t check_size(unsigned flags, size_t count, const unsigned bound[], size_t bytes,
                         size_t *room, void **data)
{
    (void)room, (void)data;
    if (!(flags & H5Z_FLAG_REVERSE) || (count == 2 && bytes >= bound[0] && bytes <= bound[1])) {
        return bytes;
    }
    H5Epush2(H5E_DEFAULT, __FILE__, __func__, __LINE__, H5E_ERR_CLS, H5E_PLINE, H5E_READERROR,
             "a chunk decodes to %zu bytes, not %u%s", bytes, bound[0],
             bound[0] < bound[1] ? " or more" : "");
    return 0;
}

/* Shape, chunks and filters. */
static enum v2v_status describe(struct v2v_h5_chunks *chunks)
{
    enum v2v_status rc = V2V_OK;
    hid_t type = H5Dget_type(chunks->set), space = H5Dget_space(chunks->set);
    hid_t creation = H5Dget_create_plist(chunks->set);
    const int64_t element = (int64_t)H5Tget_size(type);
    const int is_chunked = H5Pget_layout(creation) == H5D_CHUNKED;
    unsigned options = 0;
    chunks->rank = H5Sget_simple_extent_dims(space, chunks->extent, NULL);
    chunks->filters = H5Pget_nfilters(creation);
    if (element <= 0 || element > MOST_ELEMENT_BYTES || chunks->rank < 0 || chunks->filters < 0 ||
        (is_chunked && (H5Pget_chunk(creation, chunks->rank, chunks->chunk) != chunks->rank ||
                        H5Pget_chunk_opts(creation, &options) < 0))) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, chunks->path, chunks->name, "its layout can't be read"));
    }
    chunks->edges_are_plain = (options & H5D_CHUNK_DONT_FILTER_PARTIAL_CHUNKS) != 0;
    chunks->count = 1;
    chunks->bytes = element;
    for (int i = 0; i < chunks->rank; i++) {
        const hsize_t side = is_chunked ? chunks->chunk[i] : chunks->extent[i];
        chunks->chunk[i] = side;
        chunks->grid[i] = side > 0 ? (chunks->extent[i] + side - 1) / side : 0;
        chunks->count = v2v_mem_product(chunks->count, (int64_t)chunks->grid[i], 1);
        chunks->bytes = v2v_mem_product(chunks->bytes, (int64_t)side, 1);
    }
    if (is_chunked && (chunks->bytes < 0 || chunks->bytes > MOST_CHUNK_BYTES)) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: one chunk takes more than 2 GiB", chunks->path,
                         chunks->name));
    }
done:
    v2v_h5_close(&creation);
    v2v_h5_close(&space);
    v2v_h5_close(&type);
    return rc;
}

/* Chunks that were never written read as the fill value without any error: a recording whose writer
 * was killed. Without filters the sum of sizes tells. */
static enum v2v_status check_count(const struct v2v_h5_chunks *chunks)
{
    enum v2v_status rc = V2V_OK;
    hsize_t written = 0;
    hid_t space = H5Dget_space(chunks->set);
    if (H5Dget_num_chunks(chunks->set, space, &written) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, chunks->path, chunks->name, "has no index of chunks"));
    }
    if (written != (hsize_t)chunks->count) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: only %llu of its %lld chunks were ever written",
                         chunks->path, chunks->name, (unsigned long long)written,
                         (long long)chunks->count));
    }
done:
    v2v_h5_close(&space);
    return rc;
}

/* The sum of all recorded sizes; HDF5 walks through the whole index for it. */
static enum v2v_status check_sum(struct v2v_h5_chunks *chunks)
{
    enum v2v_status rc = V2V_OK;
    const hsize_t stored = H5Dget_storage_size(chunks->set);
    const int64_t expected = v2v_mem_product(chunks->count, chunks->bytes, 1);
    hid_t file = H5Iget_file_id(chunks->set);
    if (H5Fget_filesize(file, &chunks->file_bytes) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, chunks->path, chunks->name, "its file has no size"));
    }
    if (stored > chunks->file_bytes) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: %s: is damaged: %llu bytes are said to be stored in a file of %llu",
                         chunks->path, chunks->name, (unsigned long long)stored,
                         (unsigned long long)chunks->file_bytes));
    }
    if (chunks->filters > 0 && (chunks->count < 0 || (hsize_t)chunks->count > chunks->file_bytes)) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: is damaged: more chunks than its file has bytes",
                         chunks->path, chunks->name));
    }
    if (chunks->filters == 0 && stored != (hsize_t)expected) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: %s: %llu bytes are stored, not %lld: it is damaged or "
                         "was not written to its end",
                         chunks->path, chunks->name, (unsigned long long)stored,
                         (long long)expected));
    }
done:
    v2v_h5_close(&file);
    return rc;
}

/* Append the check to a pipeline. */
static int add_check(hid_t to, unsigned least, unsigned most)
{
    const unsigned bound[2] = {least, most};
    return H5Pset_filter(to, SIZE_FILTER, H5Z_FLAG_MANDATORY, 2, bound) >= 0;
}

/* Bytes that a filter takes for granted when it decodes. */
static unsigned least_bytes(H5Z_filter_t filter)
{
    return filter == H5Z_FILTER_FLETCHER32    ? 4
           : filter == H5Z_FILTER_SZIP        ? 4
           : filter == H5Z_FILTER_SCALEOFFSET ? 21
                                              : 1;
}

/* The dataset's filters, each with a check of what it decodes behind it, and the check of the whole
 * chunk in front: the last one decodes first. */
static int copy_pipeline(const struct v2v_h5_chunks *chunks, hid_t to, hid_t from)
{
    static const H5Z_class2_t filter = {H5Z_CLASS_T_VERS,  SIZE_FILTER, 1,    1,
                                        "size of a chunk", NULL,        NULL, check_size};
    const unsigned right = (unsigned)chunks->bytes;
    unsigned value[MOST_PARAMETERS];
    int copied =
        chunks->filters <= MOST_FILTERS && H5Zregister(&filter) >= 0 && add_check(to, right, right);
    for (int i = 0; copied && i < chunks->filters; i++) {
        unsigned flags = 0, config = 0;
        size_t values = MOST_PARAMETERS;
        const H5Z_filter_t own =
            H5Pget_filter2(from, (unsigned)i, &flags, &values, value, 0, NULL, &config);
        copied = own >= 0 && values <= MOST_PARAMETERS &&
                 H5Pset_filter(to, own, flags, values, value) >= 0 &&
                 add_check(to, least_bytes(own), UINT_MAX);
    }
    return copied;
}

/* The filters that a chunk was written without, in that pipeline, where filter i has number 2 i + 1
 * and is left out together with the check behind it. */
static uint32_t left_out_of_copy(uint32_t left_out)
{
    uint32_t copy = 0;
    for (int i = 0; i < MOST_FILTERS; i++) {
        copy |= left_out & (1u << i) ? 3u << (2 * i + 1) : 0;
    }
    return copy;
}

static void drop_scratch(struct v2v_h5_chunks *chunks)
{
    v2v_h5_close(&chunks->first);
    v2v_h5_close(&chunks->type);
    v2v_h5_close(&chunks->one);
    v2v_h5_close(&chunks->scratch);
}

/* A file that is in memory alone: no file can have its name. */
static enum v2v_status create_scratch(struct v2v_h5_chunks *chunks)
{
    enum v2v_status rc = V2V_OK;
    const hsize_t origin[H5S_MAX_RANK] = {0};
    char name[64];
    hid_t access = H5Pcreate(H5P_FILE_ACCESS), to = H5Pcreate(H5P_DATASET_CREATE);
    hid_t from = H5Dget_create_plist(chunks->set);
    chunks->type = H5Dget_type(chunks->set);
    chunks->first = H5Screate_simple(chunks->rank, chunks->chunk, NULL);
    snprintf(name, sizeof name, "/dev/null/%p", (void *)chunks);
    if (H5Pset_fapl_core(access, (size_t)1 << 20, 0) < 0 ||
        H5Pset_chunk(to, chunks->rank, chunks->chunk) < 0 || !copy_pipeline(chunks, to, from) ||
        (chunks->scratch = H5Fcreate(name, H5F_ACC_TRUNC, H5P_DEFAULT, access)) < 0 ||
        (chunks->one = H5Dcreate2(chunks->scratch, "one", chunks->type, chunks->first, H5P_DEFAULT,
                                  to, H5P_DEFAULT)) < 0 ||
        H5Sselect_elements(chunks->first, H5S_SELECT_SET, 1, origin) < 0) {
        rc = V2V_H5_FAIL(V2V_E_INPUT, chunks->path, chunks->name, "its filters can't be followed");
    }
    v2v_h5_close(&from);
    v2v_h5_close(&to);
    v2v_h5_close(&access);
    return rc;
}

enum v2v_status v2v_h5_chunks_create(struct v2v_h5_chunks **chunks, hid_t set, const char *path,
                                     const char *name)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_h5_chunks *fresh = NULL;
    *chunks = NULL;
    V2V_TRY(V2V_ALLOC(fresh, "io.chunks", 1));
    fresh->path = path;
    fresh->name = name;
    fresh->set = set;
    fresh->scratch = fresh->one = fresh->type = fresh->first = H5I_INVALID_HID;
    V2V_TRY(describe(fresh));
    V2V_TRY(check_sum(fresh));
    if (fresh->filters > 0) {
        V2V_TRY(check_count(fresh));
        V2V_TRY(V2V_ALLOC(fresh->seen, "io.chunks", fresh->count));
    }
    *chunks = fresh;
    fresh = NULL;
done:
    v2v_h5_chunks_destroy(&fresh);
    return rc;
}

void v2v_h5_chunks_destroy(struct v2v_h5_chunks **chunks)
{
    struct v2v_h5_chunks *old = *chunks;
    *chunks = NULL;
    if (old != NULL) {
        drop_scratch(old);
        v2v_mem_free(old->stored);
        v2v_mem_free(old->seen);
        v2v_mem_free(old);
    }
}

static enum v2v_status take_room(struct v2v_h5_chunks *chunks, int64_t bytes)
{
    if (bytes <= chunks->room) {
        return V2V_OK;
    }
    v2v_mem_free(chunks->stored);
    chunks->room = 0;
    const enum v2v_status rc = V2V_ALLOC(chunks->stored, "io.chunks", bytes);
    chunks->room = rc == V2V_OK ? bytes : 0;
    return rc;
}

/* The chunk whose first element this is. */
static enum v2v_status check_chunk(struct v2v_h5_chunks *chunks, const char *what,
                                   const hsize_t *start)
{
    enum v2v_status rc = V2V_OK;
    const hsize_t origin[H5S_MAX_RANK] = {0};
    uint8_t element[MOST_ELEMENT_BYTES];
    hsize_t bytes = 0;
    uint32_t left_out = 0; /* a bit for every filter */
    int passes_end = 0;
    for (int i = 0; i < chunks->rank; i++) {
        passes_end |= chunks->extent[i] - start[i] < chunks->chunk[i];
    }
    if (H5Dget_chunk_storage_size(chunks->set, start, &bytes) < 0 || bytes == 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, chunks->path, chunks->name, what));
    }
    if (bytes > chunks->file_bytes) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: %s: a chunk is said to take %llu bytes of %llu",
                         chunks->path, chunks->name, what, (unsigned long long)bytes,
                         (unsigned long long)chunks->file_bytes));
    }
    V2V_TRY(take_room(chunks, (int64_t)bytes));
    if (H5Dread_chunk(chunks->set, H5P_DEFAULT, start, &left_out, chunks->stored) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, chunks->path, chunks->name, what));
    }
    left_out = passes_end && chunks->edges_are_plain ? UINT32_MAX : left_out;
    if (chunks->scratch < 0 || left_out != chunks->left_out) {
        drop_scratch(chunks);
        V2V_TRY(create_scratch(chunks));
        chunks->left_out = left_out;
    }
    int done = H5Dwrite_chunk(chunks->one, H5P_DEFAULT, left_out_of_copy(left_out), origin, bytes,
                              chunks->stored) >= 0;
    if (done && left_out != 0) { /* HDF5 1.10 forgets it until the dataset is opened again */
        v2v_h5_close(&chunks->one);
        chunks->one = H5Dopen2(chunks->scratch, "one", H5P_DEFAULT);
    }
    /* One element is decoded with all the others. */
    if (!done || H5Dread(chunks->one, chunks->type, chunks->first, chunks->first, H5P_DEFAULT,
                         element) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, chunks->path, chunks->name, what));
    }
done:
    return rc;
}

enum v2v_status v2v_h5_chunks_check(struct v2v_h5_chunks *chunks, const char *what,
                                    const hsize_t *start, const hsize_t *count)
{
    enum v2v_status rc = V2V_OK;
    hsize_t first[H5S_MAX_RANK], last[H5S_MAX_RANK], at[H5S_MAX_RANK], element[H5S_MAX_RANK];
    int axis = 0;
    if (chunks->filters == 0 || chunks->count == 0) {
        return V2V_OK;
    }
    for (int i = 0; i < chunks->rank; i++) {
        at[i] = first[i] = start != NULL ? start[i] / chunks->chunk[i] : 0;
        last[i] =
            start != NULL ? (start[i] + count[i] - 1) / chunks->chunk[i] : chunks->grid[i] - 1;
    }
    while (axis >= 0) {
        int64_t number = 0;
        for (int i = 0; i < chunks->rank; i++) {
            number = number * (int64_t)chunks->grid[i] + (int64_t)at[i];
            element[i] = at[i] * chunks->chunk[i];
        }
        if (!chunks->seen[number]) {
            V2V_TRY(check_chunk(chunks, what, element));
            chunks->seen[number] = 1;
        }
        for (axis = chunks->rank - 1; axis >= 0 && at[axis] == last[axis]; axis--) {
            at[axis] = first[axis];
        }
        if (axis >= 0) {
            at[axis]++;
        }
    }
done:
    return rc;
}

enum v2v_status v2v_h5_read_all(void *out, hid_t set, hid_t type, const char *path,
                                const char *name)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_h5_chunks *chunks = NULL;
    V2V_TRY(v2v_h5_chunks_create(&chunks, set, path, name));
    V2V_TRY(v2v_h5_chunks_check(chunks, "can't be read", NULL, NULL));
    if (H5Dread(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, out) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, path, name, "can't be read"));
    }
done:
    v2v_h5_chunks_destroy(&chunks);
    return rc;
}
