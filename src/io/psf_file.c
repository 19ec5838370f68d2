#include "v2v3d/io/psf_file.h"
#include "io/folder.h"
#include "io/h5_common.h"
#include "io/h5_guard.h"
#include "io/stack.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/conf/kept_views.h"
#include "v2v3d/io/file.h"
#include <dirent.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

/* Elements of the set, -1 when its sizes make no memory. */
static int64_t elements(const struct v2v_psf_file *file)
{
    return v2v_mem_product(v2v_mem_product(file->views, file->slices, 1), file->height,
                           file->width);
}

/* N of psf_N.tif, in any spelling of .tif and with zeros before it or not; -1: it is none. */
static int64_t view_number(const char *name)
{
    enum { MOST_DIGITS = 18 };
    int64_t number = 0;
    const char *digit = name + strlen("psf_");
    if (strncmp(name, "psf_", strlen("psf_")) != 0) {
        return -1;
    }
    const size_t digits = strspn(digit, "0123456789");
    for (size_t i = 0; i < digits && digits <= MOST_DIGITS; i++) {
        number = 10 * number + (digit[i] - '0');
    }
    const char *ending = digit + digits;
    const int is_number = digits > 0 && digits <= MOST_DIGITS;
    return is_number && (strcasecmp(ending, ".tif") == 0 || strcasecmp(ending, ".tiff") == 0)
               ? number
               : -1;
}

/* Are there views at all? What begins like one and is none might be meant as one. */
static enum v2v_status look_at_names(const char *folder)
{
    char first[NAME_MAX + 1] = "";
    int64_t count = 0, views = 0;
    DIR *directory = opendir(folder);
    if (directory == NULL) {
        return V2V_FAIL(V2V_E_INPUT, "%s: can't be listed", folder);
    }
    for (struct dirent *entry = readdir(directory); entry != NULL; entry = readdir(directory)) {
        const char *name = entry->d_name;
        views += view_number(name) >= 0;
        if (strncasecmp(name, "psf_", strlen("psf_")) == 0 && view_number(name) < 0) {
            if (count++ == 0 || v2v_folder_compare(name, first) < 0) {
                (void)snprintf(first, sizeof first, "%s", name);
            }
        }
    }
    closedir(directory);
    if (count > 0) {
        v2v_log(V2V_LOG_WARNING, "%s: %s is not used, no view being called so (psf_N.tif)%s",
                folder, first, count > 1 ? "; likewise others" : "");
    }
    return views > 0 ? V2V_OK : V2V_FAIL(V2V_E_INPUT, "%s: holds no psf_1.tif", folder);
}

/* Of the folder's TIFF files in the order of their numbers, keep the views: psf_1, psf_2, .. */
static enum v2v_status list_views(struct v2v_folder *list, int64_t *count, const char *folder)
{
    enum v2v_status rc = V2V_OK;
    int64_t views = 0;
    *count = 0;
    V2V_TRY(look_at_names(folder));
    V2V_TRY(v2v_folder_list(list, folder));
    for (int64_t i = 0; i < list->count; i++) {
        char *name = list->name[i];
        const int64_t number = view_number(name);
        if (number < 0) {
            continue;
        }
        if (number == 0) {
            V2V_TRY(
                V2V_FAIL(V2V_E_INPUT, "%s: holds %s; the first view is psf_1.tif", folder, name));
        }
        if (number == views) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: holds %s and %s: two of view %lld", folder,
                             list->name[views - 1], name, (long long)number));
        }
        if (number > views + 1) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s/psf_%lld.tif: is missing, %s is there", folder,
                             (long long)views + 1, name));
        }
        list->name[i] = list->name[views]; /* a swap: all are freed in the end */
        list->name[views++] = name;
    }
    *count = views;
done:
    return rc;
}

/* The first file gives the shape of the set and its memory. */
static enum v2v_status adopt_shape(struct v2v_psf_file *file, const struct v2v_tiff_info *info)
{
    file->slices = info->pages;
    file->height = info->height;
    file->width = info->width;
    file->pixel_size_um = info->pixel_size_um;
    file->slice_spacing_um = info->slice_spacing_um;
    return V2V_ALLOC(file->data, "io.psf", elements(file));
}

/* @param first the name of that which gave the shape; NULL: this one does */
static enum v2v_status read_view(struct v2v_psf_file *file, const char *path, int64_t v,
                                 const char *first)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff *tiff = NULL;
    V2V_TRY(v2v_tiff_open(&tiff, path));
    const struct v2v_tiff_info *info = v2v_tiff_info(tiff);
    if (info->channels > 1 || (info->slices > 1 && info->frames > 1)) {
        V2V_TRY(V2V_FAIL(
            V2V_E_INPUT, "%s: has %lld channels, %lld slices and %lld frames; a PSF has slices",
            path, (long long)info->channels, (long long)info->slices, (long long)info->frames));
    }
    if (first == NULL) {
        V2V_TRY(adopt_shape(file, info));
    }
    if (info->pages != file->slices || info->height != file->height || info->width != file->width) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: is %lld x %lld x %lld, but %s %lld x %lld x %lld", path,
                         (long long)info->pages, (long long)info->height, (long long)info->width,
                         first, (long long)file->slices, (long long)file->height,
                         (long long)file->width));
    }
    if (v2v_file_is_other_size(info->pixel_size_um, file->pixel_size_um)) {
        v2v_log(V2V_LOG_WARNING, "%s: says pixels of %.6g um, but %s of %.6g, which counts", path,
                info->pixel_size_um, first, file->pixel_size_um);
    }
    V2V_TRY(v2v_tiff_read(tiff, file->data + v * file->slices * file->height * file->width, 0,
                          file->slices));
done:
    v2v_tiff_close(&tiff);
    return rc;
}

/* All are remembered before the first is read: a set is not to be made of two. */
static enum v2v_status read_folder(struct v2v_psf_file *file, struct v2v_kept_views *kept,
                                   const char *folder, const char *without)
{
    enum v2v_status rc = V2V_OK;
    char path[V2V_PATH_BYTES];
    struct v2v_folder list = {0};
    struct v2v_file_state *states = NULL;
    int64_t views = 0;
    V2V_TRY(list_views(&list, &views, folder));
    V2V_TRY(v2v_kept_views_init(kept, without, views));
    file->views = kept->count;
    V2V_TRY(V2V_ALLOC(states, "io.psf", file->views));
    for (int64_t v = 0; v < file->views; v++) {
        V2V_TRY(v2v_folder_path(path, &list, kept->view[v]));
        V2V_TRY(v2v_file_remember(&states[v], path));
    }
    for (int64_t v = 0; v < file->views; v++) {
        V2V_TRY(v2v_folder_path(path, &list, kept->view[v]));
        V2V_TRY(v2v_file_unchanged(
            read_view(file, path, v, v > 0 ? list.name[kept->view[0]] : NULL), &states[v], path));
    }
    for (int64_t v = 0; v < file->views; v++) {
        V2V_TRY(v2v_folder_path(path, &list, kept->view[v]));
        V2V_TRY(v2v_file_unchanged(V2V_OK, &states[v], path));
    }
done:
    v2v_folder_fini(&list);
    v2v_mem_free(states);
    return rc;
}

int v2v_psf_file_is_folder(const char *path)
{
    DIR *directory = opendir(path);
    int is_there = 0;
    if (directory == NULL) {
        return 0;
    }
    for (struct dirent *entry = readdir(directory); entry != NULL; entry = readdir(directory)) {
        is_there |= view_number(entry->d_name) == 1;
    }
    closedir(directory);
    return is_there;
}

static enum v2v_status read_hdf5(struct v2v_psf_file *file, struct v2v_kept_views *kept,
                                 const char *path, const char *without)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_h5_array array = {0};
    struct v2v_file_state state;
    V2V_TRY(v2v_h5_guard_input(&state, path));
    V2V_TRY(v2v_h5_array_open(&array, path, &v2v_h5_psf));
    V2V_TRY(v2v_kept_views_init(kept, without, array.shape[0]));
    file->views = kept->count;
    file->slices = array.shape[1];
    file->height = array.shape[2];
    file->width = array.shape[3];
    V2V_TRY(v2v_h5_get_length(&file->pixel_size_um, array.set, path, "pixel_size_um"));
    V2V_TRY(v2v_h5_get_length(&file->slice_spacing_um, array.set, path, "slice_spacing_um"));
    V2V_TRY(V2V_ALLOC(file->data, "io.psf", elements(file)));
    const int64_t view = file->slices * file->height * file->width;
    for (int64_t v = 0; v < file->views; v++) {
        V2V_TRY(v2v_h5_array_read(&array, file->data + v * view, kept->view[v], 0, file->slices));
        V2V_TRY(v2v_h5_array_unpack(&array, file->data + v * view, view));
    }
    rc = v2v_file_unchanged(V2V_OK, &state, path);
done:
    v2v_h5_array_close(&array);
    return rc;
}

/* Light is not negative, and a view that collects none can't be a view. */
static enum v2v_status check_light(const struct v2v_psf_file *file,
                                   const struct v2v_kept_views *kept, const char *path)
{
    const int64_t view = file->slices * file->height * file->width;
    for (int64_t v = 0; v < file->views; v++) {
        const float *data = file->data + v * view;
        double sum = 0.0;
        for (int64_t i = 0; i < view; i++) {
            if (data[i] < 0.0f) {
                return V2V_FAIL(
                    V2V_E_INPUT, "%s: view %lld, slice %lld, y %lld, x %lld: %g is negative", path,
                    (long long)kept->view[v], (long long)(i / file->width / file->height),
                    (long long)(i / file->width % file->height), (long long)(i % file->width),
                    (double)data[i]);
            }
            sum += data[i];
        }
        if (!(sum > 0.0)) {
            return V2V_FAIL(V2V_E_INPUT, "%s: view %lld is zero everywhere", path,
                            (long long)kept->view[v]);
        }
    }
    return V2V_OK;
}

static enum v2v_status read_on_root(struct v2v_psf_file *file, const char *path,
                                    const char *without)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_kept_views kept = {0};
    if (v2v_file_is_folder(path)) {
        V2V_TRY(read_folder(file, &kept, path, without));
    } else {
        V2V_TRY(v2v_file_check_input(path));
        if (!v2v_file_is_hdf5(path)) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                             "%s: is neither a folder of psf_1.tif .. psf_V.tif nor an HDF5 file",
                             path));
        }
        V2V_TRY(read_hdf5(file, &kept, path, without));
    }
    V2V_TRY(check_light(file, &kept, path));
done:
    v2v_kept_views_fini(&kept);
    return rc;
}

enum v2v_status v2v_psf_file_read(struct v2v_psf_file *file, const char *path, const char *without,
                                  const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const int rank = v2v_comm_rank(comm);
    struct v2v_psf_file header = {0};
    *file = header;
    V2V_TRY(v2v_par_agree(comm, rank == 0 ? read_on_root(file, path, without) : V2V_OK));
    header = *file;
    v2v_par_broadcast(comm, &header, sizeof header, 0);
    if (rank != 0) {
        *file = header;
        rc = V2V_ALLOC(file->data, "io.psf", elements(file));
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    v2v_par_broadcast(comm, file->data, elements(file) * (int64_t)sizeof *file->data, 0);
done:
    if (rc != V2V_OK) {
        v2v_psf_file_fini(file);
    }
    return rc;
}

uint32_t v2v_psf_file_sum(const struct v2v_psf_file *file)
{
    return file->data != NULL
               ? v2v_file_crc32c(0, file->data, elements(file) * (int64_t)sizeof *file->data)
               : 0;
}

static enum v2v_status write_dataset(const struct v2v_psf_file *file, hid_t h5, const char *path)
{
    enum v2v_status rc = V2V_OK;
    const hsize_t extent[4] = {(hsize_t)file->views, (hsize_t)file->slices, (hsize_t)file->height,
                               (hsize_t)file->width};
    const hsize_t chunk[4] = {1, 1, extent[2], extent[3]}; /* one slice */
    hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
    hid_t space = H5Screate_simple(4, extent, NULL);
    hid_t set = H5I_INVALID_HID;
    V2V_TRY(V2V_FAULT_POINT("h5.write"));
    if (H5Pset_chunk(creation, 4, chunk) < 0 || H5Pset_fletcher32(creation) < 0 ||
        (set = H5Dcreate2(h5, v2v_h5_psf.dataset, H5T_IEEE_F32LE, space, H5P_DEFAULT, creation,
                          H5P_DEFAULT)) < 0 ||
        H5Dwrite(set, H5T_NATIVE_FLOAT, H5S_ALL, H5S_ALL, H5P_DEFAULT, file->data) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_IO, path, v2v_h5_psf.dataset, "can't be written"));
    }
    V2V_TRY(v2v_h5_set_text(set, path, "axes", v2v_h5_psf.axes));
    if (file->pixel_size_um > 0.0) {
        V2V_TRY(v2v_h5_set_numbers(set, path, "pixel_size_um", &file->pixel_size_um, 1));
    }
    if (file->slice_spacing_um > 0.0) {
        V2V_TRY(v2v_h5_set_numbers(set, path, "slice_spacing_um", &file->slice_spacing_um, 1));
    }
done:
    rc = v2v_h5_close_written(rc, &set, path, v2v_h5_psf.dataset);
    v2v_h5_close(&space);
    v2v_h5_close(&creation);
    return rc;
}

enum v2v_status v2v_psf_file_write(const struct v2v_psf_file *file, const char *path)
{
    enum v2v_status rc = V2V_OK;
    char temporary[V2V_PATH_BYTES];
    hid_t h5 = H5I_INVALID_HID;
    V2V_TRY(v2v_h5_check_name(path));
    V2V_TRY(v2v_h5_begin(&h5, temporary, path));
    V2V_TRY(write_dataset(file, h5, path));
done:
    return v2v_h5_end(rc, &h5, temporary, path);
}

void v2v_psf_file_fini(struct v2v_psf_file *file)
{
    v2v_mem_free(file->data);
    *file = (struct v2v_psf_file){0};
}
