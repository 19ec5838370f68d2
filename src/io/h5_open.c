#include "io/h5_common.h"
#include "io/h5_guard.h"
#include "v2v3d/base/memory.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

int v2v_file_is_hdf5(const char *path)
{
    static const char hdf5[] = "\x89HDF\r\n\x1a\n";
    char first[8] = {0};
    FILE *file = fopen(path, "rb");
    if (file != NULL) {
        const size_t length = fread(first, 1, sizeof first, file);
        fclose(file);
        if (length == sizeof first && memcmp(first, hdf5, sizeof first) == 0) {
            return 1;
        }
        if (memcmp(first, "II", 2) == 0 || memcmp(first, "MM", 2) == 0) {
            return 0;
        }
    }
    return v2v_file_kind_of_name(path) == V2V_FILE_HDF5;
}

/* Why HDF5 does not open a file, in the words of who has it. */
static enum v2v_status refuse_file(const char *path)
{
    char reason[V2V_H5_REASON_BYTES];
    unsigned major = 0, minor = 0, release = 0;
    unsigned long long have = 0, base = 0, wanted = 0;
    (void)v2v_h5_reason(reason);
    (void)H5get_libversion(&major, &minor, &release);
    if (sscanf(reason, "truncated file: eof = %llu, sblock->base_addr = %llu, stored_eof = %llu",
               &have, &base, &wanted) == 3) {
        return V2V_FAIL(V2V_E_INPUT,
                        "%s: is cut off: it has %llu of its %llu bytes; a copy or its writing was "
                        "not finished",
                        path, have, wanted);
    }
    if (strstr(reason, "version number") != NULL) {
        return V2V_FAIL(V2V_E_INPUT,
                        "%s: HDF5 %u.%u.%u can't open it: %s; a newer HDF5 wrote it, or it is "
                        "damaged",
                        path, major, minor, release, reason);
    }
    return V2V_FAIL(V2V_E_INPUT, "%s: HDF5 can't open it, it is cut off or damaged: %s", path,
                    reason);
}

enum v2v_status v2v_h5_open(hid_t *file, const char *path)
{
    enum v2v_status rc = V2V_OK;
    hid_t access = H5I_INVALID_HID;
    *file = H5I_INVALID_HID;
    V2V_TRY(v2v_file_check_input(path));
    v2v_h5_quiet();
    if (H5Fis_hdf5(path) <= 0) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: is not an HDF5 file", path));
    }
    access = H5Pcreate(H5P_FILE_ACCESS);
    if (access < 0 || H5Pset_file_locking(access, 0, 1) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_MEMORY, path, "/", "no access properties"));
    }
    *file = H5Fopen(path, H5F_ACC_RDONLY, access);
    if (*file < 0) {
        V2V_TRY(refuse_file(path));
    }
done:
    v2v_h5_close(&access);
    return rc;
}

/* Datasets by what they may be good for: images or PSFs, by their axes; others; what this program
 * keeps beside its results. */
enum { IMAGES, OTHERS, KEPT_BESIDE, SORTS };
static const char *const kept_beside[] = {"checksum", "done", "adam_m/", "adam_v/", "last/"};

/* Of each sort the first, of a group few of them where there are more than are named. */
enum { MOST_NAMES = 8, MOST_OF_GROUP = 3, MOST_LINKS = 100000, NAME_BYTES = 64 };

struct names {
    char name[SORTS][MOST_NAMES][NAME_BYTES];
    int kept[SORTS];
    int most_of_group;
    int64_t count, links; /* seen so far */
};

static int sort_of(const char *name, hid_t set)
{
    for (size_t i = 0; i < sizeof kept_beside / sizeof kept_beside[0]; i++) {
        const size_t length = strlen(kept_beside[i]);
        const int is_group = kept_beside[i][length - 1] == '/';
        if (strncmp(name, kept_beside[i], is_group ? length : length + 1) == 0) {
            return KEPT_BESIDE;
        }
    }
    hid_t space = H5Dget_space(set), type = H5Dget_type(set);
    const H5T_class_t class = H5Tget_class(type);
    const int rank = H5Sget_simple_extent_ndims(space);
    v2v_h5_close(&type);
    v2v_h5_close(&space);
    return (class == H5T_INTEGER || class == H5T_FLOAT) && (rank == 3 || rank == 4) ? IMAGES
                                                                                    : OTHERS;
}

/* How many of those that are kept are of the group of a name; none is where it is of no group. */
static int of_group(char (*kept)[NAME_BYTES], int count, const char *name)
{
    const char *slash = strrchr(name, '/');
    const size_t length = slash != NULL ? (size_t)(slash - name) + 1 : 0;
    int found = 0;
    for (int i = 0; i < count && length > 0; i++) {
        found += strncmp(kept[i], name, length) == 0 && strchr(kept[i] + length, '/') == NULL;
    }
    return found;
}

static herr_t add_name(hid_t file, const char *name, const H5L_info_t *info, void *data)
{
    struct names *names = data;
    int sort = OTHERS; /* of a link, which may be to a dataset */
    if (info->type == H5L_TYPE_HARD) {
        hid_t object = H5Oopen(file, name, H5P_DEFAULT);
        const int is_dataset = H5Iget_type(object) == H5I_DATASET;
        sort = is_dataset ? sort_of(name, object) : SORTS;
        v2v_h5_close(&object);
    }
    if (sort < SORTS) {
        char(*kept)[NAME_BYTES] = names->name[sort];
        int *count = &names->kept[sort];
        if (*count < MOST_NAMES && of_group(kept, *count, name) < names->most_of_group) {
            (void)snprintf(kept[(*count)++], NAME_BYTES, "%s", name);
        }
        names->count++;
    }
    return ++names->links >= MOST_LINKS;
}

/* On one line, whatever they carry. */
static void print_names(char *text, size_t bytes, const struct names *names)
{
    int named = 0;
    for (int sort = 0; sort < SORTS; sort++) {
        for (int i = 0; i < names->kept[sort] && named < MOST_NAMES; i++, named++) {
            const size_t used = strlen(text);
            (void)snprintf(text + used, bytes - used, "%s/%s", named > 0 ? ", " : "has ",
                           names->name[sort][i]);
        }
    }
    const size_t used = strlen(text);
    if (names->count == 0) {
        (void)snprintf(text, bytes, "has no dataset");
    } else if (names->count > named) {
        (void)snprintf(text + used, bytes - used, " and %s%lld more",
                       names->links >= MOST_LINKS ? "at least " : "",
                       (long long)names->count - named);
    }
    for (char *c = text; *c != '\0'; c++) {
        *c = (unsigned char)*c < 0x20 || *c == 0x7f ? '?' : *c;
    }
}

void v2v_h5_list(char *text, size_t bytes, hid_t file)
{
    struct names names = {.most_of_group = MOST_NAMES};
    (void)snprintf(text, bytes, "%s", "");
    (void)H5Lvisit(file, H5_INDEX_NAME, H5_ITER_INC, add_name, &names);
    if (names.count > MOST_NAMES) {
        names = (struct names){.most_of_group = MOST_OF_GROUP};
        (void)H5Lvisit(file, H5_INDEX_NAME, H5_ITER_INC, add_name, &names);
    }
    print_names(text, bytes, &names);
}

enum v2v_status v2v_file_hdf5_names(char *text, size_t bytes, const char *path)
{
    enum v2v_status rc = V2V_OK;
    hid_t file = H5I_INVALID_HID;
    V2V_TRY(v2v_h5_guard(path));
    V2V_TRY(v2v_h5_open(&file, path));
    v2v_h5_list(text, bytes, file);
done:
    v2v_h5_close(&file);
    return rc;
}

int v2v_h5_has(hid_t file, const char *name)
{
    char part[V2V_PATH_BYTES];
    const int length = snprintf(part, sizeof part, "%s", name);
    /* H5Lexists wants every group on the way to exist */
    for (int i = 1; i <= length && i < V2V_PATH_BYTES; i++) {
        if (part[i] != '/' && part[i] != '\0') {
            continue;
        }
        const char kept = part[i];
        part[i] = '\0';
        if (H5Lexists(file, part, H5P_DEFAULT) <= 0) {
            return 0;
        }
        part[i] = kept;
    }
    return length > 0;
}

enum v2v_status v2v_h5_there_is_none(hid_t file, const char *path, const char *name,
                                     const char *hint)
{
    char names[V2V_H5_LIST_BYTES];
    v2v_h5_list(names, sizeof names, file);
    return V2V_FAIL(V2V_E_INPUT, "%s: %s: there is no such dataset; it %s%s", path, name, names,
                    hint);
}

/* HDF5 asks before it follows a link into another file: never. */
static herr_t refuse_external_link(const char *parent_file, const char *parent_group,
                                   const char *child_file, const char *child_object,
                                   unsigned *flags, hid_t access, void *refused)
{
    (void)parent_file, (void)parent_group, (void)child_file, (void)child_object;
    (void)flags, (void)access;
    *(int *)refused = 1;
    return -1;
}

static enum v2v_status check_decoding(hid_t set, int *filtered, const char *path, const char *name)
{
    enum v2v_status rc = V2V_OK;
    hid_t creation = H5Dget_create_plist(set);
    const int filters = H5Pget_nfilters(creation);
    if (creation < 0 || filters < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, path, name, "its layout can't be read"));
    }
    if (H5Pget_layout(creation) == H5D_VIRTUAL || H5Pget_external_count(creation) != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: keeps its data in other files", path, name));
    }
    *filtered = filters > 0;
    for (int i = 0; i < filters; i++) {
        unsigned flags = 0, config = 0;
        size_t values = 0;
        const H5Z_filter_t filter =
            H5Pget_filter2(creation, (unsigned)i, &flags, &values, NULL, 0, NULL, &config);
        if (filter < 0 || H5Zfilter_avail(filter) <= 0) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: needs HDF5 filter %d, which is not installed",
                             path, name, (int)filter));
        }
    }
done:
    v2v_h5_close(&creation);
    return rc;
}

/* Where frames share chunks, decoded ones are kept, as many as a frame lies in: so does the next
 * one. Else HDF5's own megabyte, as where they are more than the most bytes. */
static void keep_chunks(hid_t access, hid_t set)
{
    enum { SLOTS_OF_CHUNK = 100, MOST_SLOTS = 1000000 }; /* as HDF5's manual advises; 8 MB */
    const double most = fmin(1e9, 0.25 * (double)v2v_mem_room());
    hsize_t extent[H5S_MAX_RANK], chunk[H5S_MAX_RANK];
    hid_t creation = H5Dget_create_plist(set), space = H5Dget_space(set), type = H5Dget_type(set);
    const int rank = H5Sget_simple_extent_dims(space, extent, NULL);
    size_t slots = H5D_CHUNK_CACHE_NSLOTS_DEFAULT, bytes = H5D_CHUNK_CACHE_NBYTES_DEFAULT;
    if (rank > 0 && H5Pget_layout(creation) == H5D_CHUNKED &&
        H5Pget_chunk(creation, rank, chunk) == rank) {
        double wanted = (double)H5Tget_size(type) * (double)chunk[0], count = 1.0;
        for (int i = 1; i < rank; i++) {
            const double along = ceil((double)extent[i] / (double)chunk[i]);
            wanted *= along * (double)chunk[i];
            count *= along;
        }
        if (chunk[0] > 1 && wanted <= most && SLOTS_OF_CHUNK * count < MOST_SLOTS) {
            bytes = (size_t)wanted > bytes ? (size_t)wanted : bytes;
            slots = SLOTS_OF_CHUNK * (size_t)count + 1;
        }
    }
    H5Pset_chunk_cache(access, slots, bytes, H5D_CHUNK_CACHE_W0_DEFAULT);
    v2v_h5_close(&creation);
    v2v_h5_close(&space);
    v2v_h5_close(&type);
}

enum v2v_status v2v_h5_open_dataset(hid_t *set, hid_t file, const char *path, const char *name)
{
    enum v2v_status rc = V2V_OK;
    int refused = 0, filtered = 0;
    hid_t access = H5Pcreate(H5P_DATASET_ACCESS);
    *set = H5I_INVALID_HID;
    /* What is not cached is read from where the index says, in the dataset's own size. */
    if (H5Pset_elink_cb(access, refuse_external_link, &refused) >= 0 &&
        H5Pset_chunk_cache(access, 0, 0, H5D_CHUNK_CACHE_W0_DEFAULT) >= 0) {
        *set = H5Dopen2(file, name, access);
    }
    if (refused) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: is a link to another file", path, name));
    }
    if (*set < 0) {
        rc = V2V_H5_FAIL(V2V_E_INPUT, path, name, "can't be opened as a dataset");
        V2V_TRY(v2v_h5_has(file, name) ? rc : v2v_h5_there_is_none(file, path, name, ""));
    }
    V2V_TRY(check_decoding(*set, &filtered, path, name));
    if (filtered) {
        keep_chunks(access, *set);
        v2v_h5_close(set);
        *set = H5Dopen2(file, name, access);
        if (*set < 0) {
            V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, path, name, "can't be opened as a dataset"));
        }
    }
done:
    v2v_h5_close(&access);
    if (rc != V2V_OK) {
        v2v_h5_close(set);
    }
    return rc;
}
