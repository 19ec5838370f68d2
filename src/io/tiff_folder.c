#include "io/tiff_folder.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/file.h"
#include "v2v3d/par/watchdog.h"

/* Far below what a process may have open (1024, usually), and above the views of a frame. */
enum { MOST_OPEN = 128 };

/* One file of it: as it was when the folder was opened. */
struct member {
    struct v2v_file_state state;
    struct v2v_tiff *tiff; /* NULL: not open */
};

struct v2v_tiff_folder {
    struct v2v_folder list;
    struct member *member;          /* [list.count] */
    struct member *open[MOST_OPEN]; /* the next that is opened takes the place of the oldest */
    int64_t opened;                 /* so far */
    struct v2v_tiff_info info;
    int64_t other_pixels; /* the first file that says pixels of another size; 0: none */
    double other_pixel_size_um;
};

static enum v2v_status open_member(struct v2v_tiff_folder *folder, struct member *member,
                                   const char *path)
{
    struct member **place = &folder->open[folder->opened % MOST_OPEN];
    if (member->tiff != NULL) {
        return V2V_OK;
    }
    if (*place != NULL) {
        v2v_tiff_close(&(*place)->tiff);
    }
    *place = member;
    folder->opened++;
    return v2v_tiff_open(&member->tiff, path);
}

static enum v2v_status check_alike(const struct v2v_tiff_folder *folder, const char *path,
                                   const struct v2v_tiff_info *info)
{
    const struct v2v_tiff_info *first = &folder->info;
    if (info->pages != first->pages || info->height != first->height ||
        info->width != first->width) {
        return V2V_FAIL(V2V_E_INPUT,
                        "%s: has %lld pages of %lld x %lld pixels, but %s has %lld of %lld x %lld",
                        path, (long long)info->pages, (long long)info->height,
                        (long long)info->width, folder->list.name[0], (long long)first->pages,
                        (long long)first->height, (long long)first->width);
    }
    if (info->bits != first->bits || info->is_float != first->is_float ||
        info->channels != first->channels || info->slices != first->slices) {
        return V2V_FAIL(V2V_E_INPUT, "%s: has another type or other channels and slices than %s",
                        path, folder->list.name[0]);
    }
    return V2V_OK;
}

static void look_at_pixels(struct v2v_tiff_folder *folder, int64_t file, double pixel_size_um)
{
    if (folder->other_pixels == 0 &&
        v2v_file_is_other_size(pixel_size_um, folder->info.pixel_size_um)) {
        folder->other_pixels = file;
        folder->other_pixel_size_um = pixel_size_um;
    }
}

enum v2v_status v2v_tiff_folder_open(struct v2v_tiff_folder **folder, const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff_folder *fresh = NULL;
    char file[V2V_PATH_BYTES];
    *folder = NULL;
    V2V_TRY(V2V_ALLOC(fresh, "io.tiff_folder", 1));
    V2V_TRY(v2v_folder_list(&fresh->list, path));
    V2V_TRY(V2V_ALLOC(fresh->member, "io.tiff_folder", fresh->list.count));
    for (int64_t i = 0; i < fresh->list.count; i++) {
        struct member *member = &fresh->member[i];
        v2v_watchdog_beat("looking at the files of a folder");
        V2V_TRY(v2v_folder_path(file, &fresh->list, i));
        V2V_TRY(v2v_file_check_input(file));
        V2V_TRY(v2v_file_remember(&member->state, file));
        V2V_TRY(v2v_file_unchanged(open_member(fresh, member, file), &member->state, file));
        if (i == 0) {
            fresh->info = *v2v_tiff_info(member->tiff);
        }
        V2V_TRY(check_alike(fresh, file, v2v_tiff_info(member->tiff)));
        look_at_pixels(fresh, i, v2v_tiff_info(member->tiff)->pixel_size_um);
    }
    *folder = fresh;
    fresh = NULL;
done:
    v2v_tiff_folder_close(&fresh);
    return rc;
}

void v2v_tiff_folder_warn(const struct v2v_tiff_folder *folder)
{
    const struct v2v_folder *list = &folder->list;
    char missing[V2V_PATH_BYTES];
    if (v2v_folder_gap(missing, list)) {
        v2v_log(V2V_LOG_WARNING,
                "%s: by its files' numbers %s is missing; they are taken one "
                "after the other",
                list->path, missing);
    }
    if (folder->other_pixels > 0) {
        v2v_log(V2V_LOG_WARNING, "%s: %s says pixels of %.6g um, but %s of %.6g, which counts",
                list->path, list->name[folder->other_pixels], folder->other_pixel_size_um,
                list->name[0], folder->info.pixel_size_um);
    }
}

int64_t v2v_tiff_folder_files(const struct v2v_tiff_folder *folder)
{
    return folder->list.count;
}

const struct v2v_tiff_info *v2v_tiff_folder_info(const struct v2v_tiff_folder *folder)
{
    return &folder->info;
}

enum v2v_status v2v_tiff_folder_read(struct v2v_tiff_folder *folder, float *out, int64_t file,
                                     int64_t page)
{
    enum v2v_status rc = V2V_OK;
    struct member *member = &folder->member[file];
    char path[V2V_PATH_BYTES];
    V2V_TRY(v2v_folder_path(path, &folder->list, file));
    rc = open_member(folder, member, path);
    if (rc == V2V_OK) {
        rc = v2v_tiff_read(member->tiff, out, page, 1);
    }
    V2V_TRY(v2v_file_unchanged(rc, &member->state, path));
done:
    return rc;
}

void v2v_tiff_folder_close(struct v2v_tiff_folder **folder)
{
    struct v2v_tiff_folder *own = *folder;
    *folder = NULL;
    if (own == NULL) {
        return;
    }
    for (int64_t i = 0; own->member != NULL && i < own->list.count; i++) {
        v2v_tiff_close(&own->member[i].tiff);
    }
    v2v_mem_free(own->member);
    v2v_folder_fini(&own->list);
    v2v_mem_free(own);
}
