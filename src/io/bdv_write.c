#include "io/bdv_xml.h"
#include "io/file_internal.h"
#include "io/h5_common.h"
#include "io/rounding.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/bdv.h"
#include "v2v3d/par/watchdog.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* The coarsest level is no wider, and blocks are read one by one: 128 kB. */
enum { COARSEST = 128, BLOCK_XY = 64, BLOCK_Z = 16 };

int v2v_bdv_is_name(const char *path)
{
    return v2v_text_ends_in(path, ".xml");
}

enum v2v_status v2v_bdv_data_name(char data[V2V_PATH_BYTES], const char *path)
{
    V2V_ASSERT(v2v_bdv_is_name(path));
    return v2v_text_format(data, V2V_PATH_BYTES, "%.*s.bdv.h5", (int)(strlen(path) - 4), path);
}

int v2v_bdv_levels(struct v2v_bdv_level level[V2V_BDV_MOST_LEVELS],
                   const struct v2v_volume_info *info)
{
    const int64_t whole[3] = {info->width, info->height, info->slices};
    const double ratio = info->pixel_size_um > 0.0 && info->slice_spacing_um > 0.0
                             ? info->slice_spacing_um / info->pixel_size_um
                             : 1.0;
    int64_t factor[3] = {1, 1, 1};
    int count = 0;
    for (;;) {
        struct v2v_bdv_level *own = &level[count++];
        for (int axis = 0; axis < 3; axis++) {
            const int64_t block = axis < 2 ? BLOCK_XY : BLOCK_Z;
            own->factor[axis] = factor[axis];
            own->size[axis] = whole[axis] / factor[axis];
            own->block[axis] = own->size[axis] < block ? own->size[axis] : block;
        }
        if ((own->size[0] <= COARSEST && own->size[1] <= COARSEST) ||
            count == V2V_BDV_MOST_LEVELS) {
            return count;
        }
        const int z_too =
            ratio * (double)factor[2] <= (double)(factor[0] > factor[1] ? factor[0] : factor[1]);
        for (int axis = 0; axis < 3; axis++) {
            factor[axis] *= own->size[axis] > 1 && (axis < 2 || z_too) ? 2 : 1;
        }
    }
}

/* A volume on its way. */
struct export
{
    struct v2v_volume *volume;
    const struct v2v_volume_info *info;
    const struct v2v_volume_storage *storage;
    const char *path; /* of the HDF5 file */
    struct v2v_bdv_level level[V2V_BDV_MOST_LEVELS];
    int levels;
    hid_t file;
    float *frame;      /* [z,y,x] of a level, in place of the one before */
    int16_t *integers; /* as it is stored */
    double step;
    int64_t clipped;
};

/* One table [level][x,y,z] of all levels. */
static enum v2v_status write_table(const struct export *out, const char *name, hid_t type,
                                   int blocks)
{
    enum v2v_status rc = V2V_OK;
    const hsize_t extent[2] = {(hsize_t)out->levels, 3};
    double table[V2V_BDV_MOST_LEVELS][3];
    for (int l = 0; l < out->levels; l++) {
        for (int axis = 0; axis < 3; axis++) {
            table[l][axis] =
                (double)(blocks ? out->level[l].block[axis] : out->level[l].factor[axis]);
        }
    }
    hid_t space = H5Screate_simple(2, extent, NULL);
    hid_t set = H5Dcreate2(out->file, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    if (set < 0 || H5Dwrite(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, table) < 0) {
        rc = V2V_H5_FAIL(V2V_E_IO, out->path, name, "can't be written");
    }
    rc = v2v_h5_close_written(rc, &set, out->path, name);
    v2v_h5_close(&space);
    return rc;
}

static enum v2v_status write_tables(const struct export *out)
{
    enum v2v_status rc = V2V_OK;
    hid_t group = H5Gcreate2(out->file, "/s00", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    if (group < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_IO, out->path, "/s00", "can't be created"));
    }
    V2V_TRY(write_table(out, "/s00/resolutions", H5T_IEEE_F64LE, 0));
    V2V_TRY(write_table(out, "/s00/subdivisions", H5T_STD_I32LE, 1));
    V2V_TRY(v2v_h5_set_numbers(group, out->path, V2V_VOLUME_STEP, &out->step, 1));
done:
    v2v_h5_close(&group);
    return rc;
}

/* Means of the level before, over what is now one voxel; what is over at an end is left out. */
static void halve(float *frame, const struct v2v_bdv_level *from, const struct v2v_bdv_level *to)
{
    int64_t part[3], at = 0;
    for (int axis = 0; axis < 3; axis++) {
        part[axis] = to->factor[axis] / from->factor[axis];
    }
    const float weight = 1.0f / (float)(part[0] * part[1] * part[2]);
    for (int64_t z = 0; z < to->size[2]; z++) {
        for (int64_t y = 0; y < to->size[1]; y++) {
            for (int64_t x = 0; x < to->size[0]; x++) {
                float sum = 0.0f;
                for (int64_t i = 0; i < part[0] * part[1] * part[2]; i++) {
                    const int64_t dx = i % part[0], dy = i / part[0] % part[1];
                    const int64_t dz = i / (part[0] * part[1]);
                    sum += frame[((z * part[2] + dz) * from->size[1] + y * part[1] + dy) *
                                     from->size[0] +
                                 x * part[0] + dx];
                }
                frame[at++] = weight * sum; /* before everything that is still to be read */
            }
        }
    }
}

/* BigDataViewer reads int16 and takes its bits for uint16. */
static void to_integers(const struct export *out, const struct v2v_bdv_level *level)
{
    const int64_t voxels = level->size[0] * level->size[1] * level->size[2];
    for (int64_t i = 0; i < voxels; i++) {
        const uint16_t number = (uint16_t)lrintf(out->frame[i]);
        memcpy(&out->integers[i], &number, sizeof number);
    }
}

static enum v2v_status write_cells(const struct export *out, int64_t t, int l)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_bdv_level *level = &out->level[l];
    hsize_t extent[3], chunk[3];
    char name[64];
    for (int i = 0; i < 3; i++) {
        extent[i] = (hsize_t)level->size[2 - i];
        chunk[i] = (hsize_t)level->block[2 - i];
    }
    snprintf(name, sizeof name, "/t%05lld/s00/%d/cells", (long long)t, l);
    hid_t space = H5Screate_simple(3, extent, NULL), links = H5Pcreate(H5P_LINK_CREATE);
    hid_t creation = H5Pcreate(H5P_DATASET_CREATE), set = H5I_INVALID_HID;
    if (H5Pset_create_intermediate_group(links, 1) < 0 || H5Pset_chunk(creation, 3, chunk) < 0 ||
        (out->storage->deflate > 0 &&
         (H5Pset_shuffle(creation) < 0 ||
          H5Pset_deflate(creation, (unsigned)out->storage->deflate) < 0)) ||
        (set = H5Dcreate2(out->file, name, H5T_STD_I16LE, space, links, creation, H5P_DEFAULT)) <
            0 ||
        H5Dwrite(set, H5T_NATIVE_INT16, H5S_ALL, H5S_ALL, H5P_DEFAULT, out->integers) < 0) {
        rc = V2V_H5_FAIL(V2V_E_IO, out->path, name, "can't be written");
    }
    rc = v2v_h5_close_written(rc, &set, out->path, name);
    v2v_h5_close(&creation);
    v2v_h5_close(&links);
    v2v_h5_close(&space);
    return rc;
}

static enum v2v_status write_frame(struct export *out, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = out->info;
    v2v_watchdog_beat("writing a frame for BigDataViewer");
    V2V_TRY(v2v_volume_read(out->volume, out->frame, t, 0, info->slices));
    out->clipped +=
        v2v_rounding_apply(out->frame, info->slices * info->height * info->width, out->step);
    for (int l = 0; l < out->levels; l++) {
        if (l > 0) {
            halve(out->frame, &out->level[l - 1], &out->level[l]);
        }
        to_integers(out, &out->level[l]);
        V2V_TRY(write_cells(out, t, l));
    }
done:
    return rc;
}

static enum v2v_status settle_step(struct export *out)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = out->info;
    double peak = out->storage->peak;
    for (int64_t t = 0; out->storage->peak == 0.0 && t < info->frames; t++) {
        v2v_watchdog_beat("looking for the brightest voxel");
        V2V_TRY(v2v_volume_read(out->volume, out->frame, t, 0, info->slices));
        peak = v2v_rounding_peak(peak, out->frame, info->slices * info->height * info->width);
    }
    out->step = v2v_rounding_step(peak);
done:
    return rc;
}

static enum v2v_status write_data(struct export *out)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = out->info;
    char temporary[V2V_PATH_BYTES];
    int64_t unsynced = 0;
    const int64_t of_frame =
        v2v_mem_product(info->slices, info->height * info->width, sizeof(uint16_t));
    V2V_TRY(v2v_h5_begin(&out->file, temporary, out->path));
    rc = write_tables(out);
    for (int64_t t = 0; rc == V2V_OK && t < out->info->frames; t++) {
        rc = write_frame(out, t);
        if (rc == V2V_OK) {
            rc = v2v_file_sync_piece(&unsynced, of_frame, temporary);
        }
    }
    rc = v2v_h5_end(rc, &out->file, temporary, out->path);
done:
    return rc;
}

enum v2v_status v2v_bdv_write(const char *path, struct v2v_volume *volume,
                              const struct v2v_volume_storage *storage)
{
    enum v2v_status rc = V2V_OK;
    char data[V2V_PATH_BYTES], lock_name[V2V_PATH_BYTES];
    int lock = -1;
    const struct v2v_volume_info *info = v2v_volume_info(volume);
    const int64_t voxels = v2v_mem_product(info->slices, info->height, info->width);
    struct export out = {
        .volume = volume, .info = info, .storage = storage, .path = data, .file = H5I_INVALID_HID};
    V2V_TRY(v2v_bdv_data_name(data, path));
    V2V_TRY(v2v_file_lock_output(&lock, lock_name, data));
    out.levels = v2v_bdv_levels(out.level, info);
    V2V_TRY(V2V_ALLOC(out.frame, "io.bdv", voxels));
    V2V_TRY(V2V_ALLOC(out.integers, "io.bdv", voxels));
    V2V_TRY(settle_step(&out));
    V2V_TRY(write_data(&out));
    V2V_TRY(v2v_bdv_write_xml(path, data, info));
    v2v_rounding_report(data, out.step, out.clipped);
done:
    v2v_file_unlock_output(&lock, lock_name);
    v2v_mem_free(out.integers);
    v2v_mem_free(out.frame);
    return rc;
}
