#include "io/h5_packed.h"

#include "io/deflate.h"
#include "io/file_internal.h"
#include "io/h5_checksum.h"
#include "io/h5_common.h"
#include "par/comm_mpi.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include <limits.h>
#include <string.h>
#include <unistd.h>

struct v2v_h5_packed {
    char path[V2V_PATH_BYTES];
    const struct v2v_volume_pack *pack;
    const struct v2v_comm *comm;
    hid_t file; /* rank 0 */
    hid_t set[V2V_H5_WRITER_SETS];
    int64_t image_bytes, room;  /* of an image, and the most that is stored of one */
    uint16_t *integers;         /* [z,y,x] of a frame; NULL: it is stored as floats */
    uint8_t *shuffled, *stored; /* [z] each of a frame; NULL where nothing is compressed */
    int64_t *bytes;             /* [z] of what is stored of a frame */
    uint8_t *received;          /* rank 0: one image of another rank */
    int64_t *received_bytes;    /* [z] likewise of its frame */
    int64_t unsynced;           /* rank 0: bytes */
};

static hid_t stored_type(const struct v2v_h5_packed *packed)
{
    return packed->pack->info.storage.sample == V2V_SAMPLE_UINT16 ? H5T_NATIVE_UINT16
                                                                  : H5T_NATIVE_FLOAT;
}

/* A number or text of fixed length, whatever its type, with the same name and value. */
static herr_t copy_attribute(hid_t from, const char *name, const H5A_info_t *info, void *to)
{
    hid_t attribute = H5Aopen(from, name, H5P_DEFAULT);
    hid_t type = H5Aget_type(attribute), space = H5Aget_space(attribute);
    hid_t copy = H5Acreate2(*(hid_t *)to, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
    char *value = v2v_mem_alloc("io.pack", (int64_t)info->data_size, 1);
    const int ok = value != NULL && copy >= 0 && H5Aread(attribute, type, value) >= 0 &&
                   H5Awrite(copy, type, value) >= 0;
    v2v_mem_free(value);
    v2v_h5_close(&copy);
    v2v_h5_close(&space);
    v2v_h5_close(&type);
    v2v_h5_close(&attribute);
    return ok ? 0 : -1;
}

static enum v2v_status copy_attributes(hid_t to, hid_t from, const char *path, const char *name)
{
    return H5Aiterate2(from, H5_INDEX_NAME, H5_ITER_INC, NULL, copy_attribute, &to) >= 0
               ? V2V_OK
               : V2V_H5_FAIL(V2V_E_IO, path, name, "attributes can't be copied");
}

static int is_made_anew(const char *name)
{
    int made = strcmp(name, V2V_H5_CHECKSUM + 1) == 0;
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        made |= strcmp(name, v2v_h5_volume_sets[i] + 1) == 0;
    }
    return made;
}

/* What the plain file has beside its volumes. */
static enum v2v_status copy_the_rest(hid_t to, hid_t from, const char *path)
{
    enum v2v_status rc = V2V_OK;
    H5G_info_t group = {0};
    char name[256];
    V2V_TRY(copy_attributes(to, from, path, "/"));
    if (H5Gget_info(from, &group) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_IO, path, "/", "can't be listed"));
    }
    for (hsize_t i = 0; i < group.nlinks; i++) {
        if (H5Lget_name_by_idx(from, "/", H5_INDEX_NAME, H5_ITER_INC, i, name, sizeof name,
                               H5P_DEFAULT) < 0 ||
            (!is_made_anew(name) && H5Ocopy(from, name, to, name, H5P_DEFAULT, H5P_DEFAULT) < 0)) {
            V2V_TRY(V2V_H5_FAIL(V2V_E_IO, path, "/", "can't be copied"));
        }
    }
done:
    return rc;
}

/* One image a chunk. Without the time of day, so that the same volume is the same file. */
static enum v2v_status create_images(struct v2v_h5_packed *packed, int set, hid_t part, double step)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = &packed->pack->info;
    const char *name = v2v_h5_volume_sets[set];
    const hsize_t extent[4] = {(hsize_t)info->frames, (hsize_t)info->slices, (hsize_t)info->height,
                               (hsize_t)info->width};
    const hsize_t chunk[4] = {1, 1, extent[2], extent[3]};
    hid_t space = H5Screate_simple(4, extent, NULL), creation = H5Pcreate(H5P_DATASET_CREATE);
    hid_t from = H5Dopen2(part, name, H5P_DEFAULT);
    if (from < 0 || H5Pset_chunk(creation, 4, chunk) < 0 ||
        H5Pset_fill_time(creation, H5D_FILL_TIME_NEVER) < 0 ||
        H5Pset_obj_track_times(creation, 0) < 0 ||
        (info->storage.deflate > 0 &&
         (H5Pset_shuffle(creation) < 0 ||
          H5Pset_deflate(creation, (unsigned)info->storage.deflate) < 0)) ||
        (packed->set[set] = H5Dcreate2(packed->file, name, stored_type(packed), space, H5P_DEFAULT,
                                       creation, H5P_DEFAULT)) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_IO, packed->path, name, "can't be created"));
    }
    V2V_TRY(copy_attributes(packed->set[set], from, packed->path, name));
    if (info->storage.sample == V2V_SAMPLE_UINT16) {
        V2V_TRY(v2v_h5_set_numbers(packed->set[set], packed->path, V2V_VOLUME_STEP, &step, 1));
    }
done:
    v2v_h5_close(&from);
    v2v_h5_close(&creation);
    v2v_h5_close(&space);
    return rc;
}

/* Rank 0. */
static enum v2v_status create_file(struct v2v_h5_packed *packed, const char *part_path,
                                   const double *step)
{
    enum v2v_status rc = V2V_OK;
    hid_t part = H5I_INVALID_HID;
    V2V_TRY(V2V_FAULT_POINT("h5.create"));
    V2V_TRY(v2v_h5_open(&part, part_path));
    V2V_TRY(v2v_h5_create(&packed->file, packed->path, 1, 0, 0));
    for (int set = 0; set < V2V_H5_WRITER_SETS; set++) {
        if (packed->pack->datasets & 1u << set) {
            V2V_TRY(create_images(packed, set, part, step[set]));
        }
    }
    V2V_TRY(copy_the_rest(packed->file, part, packed->path));
done:
    v2v_h5_close(&part);
    return rc;
}

/* Bytes of a slice as they are stored, but for compression; -1: more than there are numbers. */
static int64_t bytes_of_image(const struct v2v_volume_info *info)
{
    return v2v_mem_product(info->height, info->width,
                           info->storage.sample == V2V_SAMPLE_UINT16 ? 2 : 4);
}

enum v2v_status v2v_h5_packed_check(const char *path, const struct v2v_volume_info *info)
{
    const int64_t bytes = bytes_of_image(info);
    return bytes >= 0 && bytes <= INT_MAX / 2
               ? V2V_OK
               : V2V_FAIL(V2V_E_INPUT,
                          "%s: slices of %lld x %lld pixels are too large to be packed", path,
                          (long long)info->height, (long long)info->width);
}

/* Local: memory for a frame as it is stored. */
static enum v2v_status allocate(struct v2v_h5_packed *packed)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = &packed->pack->info;
    const int deflates = info->storage.deflate > 0;
    packed->image_bytes = bytes_of_image(info);
    packed->room = deflates ? v2v_deflate_bound(packed->image_bytes) : packed->image_bytes;
    V2V_TRY(V2V_ALLOC(packed->bytes, "io.pack", info->slices));
    if (info->storage.sample == V2V_SAMPLE_UINT16) {
        V2V_TRY(V2V_ALLOC(packed->integers, "io.pack",
                          v2v_mem_product(info->slices, info->height, info->width)));
    }
    if (deflates) {
        V2V_TRY(V2V_ALLOC(packed->shuffled, "io.pack",
                          v2v_mem_product(info->slices, packed->image_bytes, 1)));
        V2V_TRY(
            V2V_ALLOC(packed->stored, "io.pack", v2v_mem_product(info->slices, packed->room, 1)));
    }
    if (v2v_comm_rank(packed->comm) == 0) {
        V2V_TRY(V2V_ALLOC(packed->received, "io.pack", packed->room));
        V2V_TRY(V2V_ALLOC(packed->received_bytes, "io.pack", info->slices));
    }
done:
    return rc;
}

enum v2v_status v2v_h5_packed_create(struct v2v_h5_packed **packed, const char *path,
                                     const struct v2v_volume_pack *pack, const char *part,
                                     const double *step, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_h5_packed *fresh = NULL;
    *packed = NULL;
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(fresh, "io.pack", 1)));
    fresh->pack = pack;
    fresh->comm = comm;
    rc = v2v_text_format(fresh->path, sizeof fresh->path, "%s", path);
    if (rc == V2V_OK) {
        rc = allocate(fresh);
    }
    if (rc == V2V_OK && v2v_comm_rank(comm) == 0) {
        rc = create_file(fresh, part, step);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    *packed = fresh;
    fresh = NULL;
done:
    v2v_h5_packed_abandon(&fresh);
    return rc;
}

/* Local: slice z of a frame, as its chunk is stored. */
static enum v2v_status encode(struct v2v_h5_packed *packed, const float *voxels, int64_t z)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = &packed->pack->info;
    const int64_t pixels = info->height * info->width, bytes = packed->image_bytes;
    const void *image = voxels + z * pixels;
    packed->bytes[z] = packed->room;
    V2V_TRY(V2V_FAULT_POINT("volume.encode"));
    if (packed->integers != NULL) {
        uint16_t *integers = packed->integers + z * pixels;
        for (int64_t i = 0; i < pixels; i++) {
            integers[i] = (uint16_t)voxels[z * pixels + i];
        }
        image = integers;
    }
    if (info->storage.deflate > 0) {
        uint8_t *shuffled = packed->shuffled + z * bytes;
        v2v_shuffle(shuffled, image, pixels, bytes / pixels);
        V2V_TRY(v2v_deflate(packed->stored + z * packed->room, &packed->bytes[z], shuffled, bytes,
                            info->storage.deflate));
    }
done:
    return rc;
}

enum v2v_status v2v_h5_packed_encode(struct v2v_h5_packed *packed, const float *voxels)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_status_record record = {{0}, {0}};
#pragma omp parallel for schedule(dynamic)
    for (int64_t z = 0; z < packed->pack->info.slices; z++) {
        const enum v2v_status one = encode(packed, voxels, z);
        if (one != V2V_OK) {
#pragma omp critical(v2v_h5_packed_failure)
            {
                rc = one;
                v2v_status_keep(&record); /* it is that thread's */
            }
        }
    }
    if (rc != V2V_OK) {
        v2v_status_restore(&record);
    }
    return rc;
}

/* Rank 0. */
static enum v2v_status write_chunk(struct v2v_h5_packed *packed, int set, int64_t t, int64_t z,
                                   const uint8_t *data, int64_t bytes)
{
    enum v2v_status rc = V2V_OK;
    const hsize_t at[4] = {(hsize_t)t, (hsize_t)z, 0, 0};
    V2V_TRY(V2V_FAULT_POINT("h5.write"));
    if (H5Dwrite_chunk(packed->set[set], H5P_DEFAULT, 0, at, (size_t)bytes, data) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_IO, packed->path, v2v_h5_volume_sets[set], "writing failed"));
    }
    V2V_TRY(v2v_file_sync_piece(&packed->unsynced, bytes, packed->path));
done:
    return rc;
}

/* This rank's chunks: on rank 0 they are written, else sent there. */
static enum v2v_status hand_over(struct v2v_h5_packed *packed, int set, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const int64_t slices = packed->pack->info.slices;
    const uint8_t *data =
        packed->stored != NULL ? packed->stored : (const uint8_t *)packed->integers;
    const int is_root = v2v_comm_rank(packed->comm) == 0;
    MPI_Comm comm = v2v_comm_mpi(packed->comm);
    if (!is_root) {
        MPI_Send(packed->bytes, (int)slices, MPI_INT64_T, 0, V2V_TAG_PACKED, comm);
    }
    for (int64_t z = 0; z < slices; z++) {
        if (!is_root) {
            MPI_Send(data + z * packed->room, (int)packed->bytes[z], MPI_BYTE, 0, V2V_TAG_PACKED,
                     comm);
        } else if (rc == V2V_OK) {
            rc = write_chunk(packed, set, t, z, data + z * packed->room, packed->bytes[z]);
        }
    }
    return rc;
}

/* Rank 0: those of another rank; after a failure they are taken in and dropped. */
static enum v2v_status take_over(struct v2v_h5_packed *packed, int set, int64_t t, int rank)
{
    enum v2v_status rc = V2V_OK;
    const int64_t slices = packed->pack->info.slices;
    MPI_Comm comm = v2v_comm_mpi(packed->comm);
    MPI_Recv(packed->received_bytes, (int)slices, MPI_INT64_T, rank, V2V_TAG_PACKED, comm,
             MPI_STATUS_IGNORE);
    for (int64_t z = 0; z < slices; z++) {
        MPI_Recv(packed->received, (int)packed->received_bytes[z], MPI_BYTE, rank, V2V_TAG_PACKED,
                 comm, MPI_STATUS_IGNORE);
        if (rc == V2V_OK) {
            rc = write_chunk(packed, set, t, z, packed->received, packed->received_bytes[z]);
        }
    }
    return rc;
}

enum v2v_status v2v_h5_packed_put(struct v2v_h5_packed *packed, int set, int64_t t, int rank)
{
    enum v2v_status rc = V2V_OK;
    const int own = v2v_comm_rank(packed->comm);
    if (own == rank) {
        rc = hand_over(packed, set, t);
    } else if (own == 0) {
        rc = take_over(packed, set, t, rank);
    }
    return v2v_par_agree(packed->comm, rc);
}

/* One number for every frame. */
static enum v2v_status write_numbers(hid_t file, const char *path, const char *name, hid_t type,
                                     hid_t memory, const void *numbers, int64_t frames)
{
    enum v2v_status rc = V2V_OK;
    const hsize_t extent = (hsize_t)frames;
    hid_t space = H5Screate_simple(1, &extent, NULL), creation = H5Pcreate(H5P_DATASET_CREATE);
    hid_t set = H5I_INVALID_HID;
    if (H5Pset_obj_track_times(creation, 0) < 0 ||
        (set = H5Dcreate2(file, name, type, space, H5P_DEFAULT, creation, H5P_DEFAULT)) < 0 ||
        H5Dwrite(set, memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers) < 0) {
        rc = V2V_H5_FAIL(V2V_E_IO, path, name, "can't be written");
    }
    rc = v2v_h5_close_written(rc, &set, path, name);
    v2v_h5_close(&creation);
    v2v_h5_close(&space);
    return rc;
}

/* Rank 0. */
static enum v2v_status complete(struct v2v_h5_packed *packed, const int64_t *checksum,
                                const int64_t *clipped)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = &packed->pack->info;
    if (checksum != NULL) {
        V2V_TRY(write_numbers(packed->file, packed->path, V2V_H5_CHECKSUM, H5T_STD_U64LE,
                              H5T_NATIVE_UINT64, checksum, info->frames));
    }
    if (info->storage.sample == V2V_SAMPLE_UINT16) {
        V2V_TRY(write_numbers(packed->file, packed->path, V2V_H5_CLIPPED, H5T_STD_I64LE,
                              H5T_NATIVE_INT64, clipped, info->frames));
    }
    for (int set = 0; set < V2V_H5_WRITER_SETS; set++) {
        V2V_TRY(
            v2v_h5_close_written(V2V_OK, &packed->set[set], packed->path, v2v_h5_volume_sets[set]));
    }
    V2V_TRY(V2V_FAULT_POINT("h5.flush"));
    const herr_t closed = H5Fclose(packed->file);
    packed->file = H5I_INVALID_HID;
    if (closed < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_IO, packed->path, "/", "can't be closed"));
    }
done:
    return rc;
}

enum v2v_status v2v_h5_packed_finish(struct v2v_h5_packed **packed, const int64_t *checksum,
                                     const int64_t *clipped)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_h5_packed *own = *packed;
    if (v2v_comm_rank(own->comm) == 0) {
        rc = complete(own, checksum, clipped);
    }
    V2V_TRY(v2v_par_agree(own->comm, rc));
    own->path[0] = '\0'; /* so that it isn't removed */
done:
    v2v_h5_packed_abandon(packed);
    return rc;
}

void v2v_h5_packed_abandon(struct v2v_h5_packed **packed)
{
    struct v2v_h5_packed *own = *packed;
    *packed = NULL;
    if (own == NULL) {
        return;
    }
    for (int set = 0; set < V2V_H5_WRITER_SETS; set++) {
        v2v_h5_close(&own->set[set]);
    }
    v2v_h5_close(&own->file);
    if (own->path[0] != '\0' && v2v_comm_rank(own->comm) == 0) {
        unlink(own->path);
    }
    v2v_mem_free(own->bytes);
    v2v_mem_free(own->received_bytes);
    v2v_mem_free(own->received);
    v2v_mem_free(own->stored);
    v2v_mem_free(own->shuffled);
    v2v_mem_free(own->integers);
    v2v_mem_free(own);
}
