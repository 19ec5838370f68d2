#include "io/h5_checksum.h"
#include "io/h5_common.h"
#include "io/h5_packed.h"
#include "io/h5_resume.h"
#include "io/h5_writer.h"
#include "io/stack.h"
#include "io/volume_pack.h"
#include "io/volume_tiff.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/tiff.h"
#include "v2v3d/io/volume.h"
#include "v2v3d/par/agreement.h"
#include <string.h>

/* An attribute ends at 64 KiB; longer text becomes a dataset of the same name. */
#define MOST_ATTRIBUTE_BYTES 60000

struct v2v_volume_writer {
    struct v2v_h5_writer *h5; /* one of the two */
    struct v2v_volume_tiff *tiff;
    struct v2v_volume_pack pack; /* of `h5`, where the file is not what it writes */
};

/* What rank 0 writes beside the data. */
struct description {
    const struct v2v_volume_info *info;
    unsigned datasets;
    const struct v2v_attribute *attributes;
    int64_t attribute_count;
};

static enum v2v_status describe_dataset(hid_t set, const char *path,
                                        const struct v2v_volume_info *info)
{
    enum v2v_status rc = V2V_OK;
    const double size[3] = {info->slice_spacing_um, info->pixel_size_um, info->pixel_size_um};
    V2V_TRY(v2v_h5_set_text(set, path, "axes", v2v_h5_volume.axes));
    if (size[0] > 0.0 && size[1] > 0.0) {
        V2V_TRY(v2v_h5_set_numbers(set, path, "element_size_um", size, 3));
    } else if (size[0] > 0.0) {
        V2V_TRY(v2v_h5_set_numbers(set, path, "slice_spacing_um", &size[0], 1));
    } else if (size[1] > 0.0) {
        V2V_TRY(v2v_h5_set_numbers(set, path, "pixel_size_um", &size[1], 1));
    }
    if (info->frame_interval_s > 0.0) {
        V2V_TRY(v2v_h5_set_numbers(set, path, "frame_interval_s", &info->frame_interval_s, 1));
    }
done:
    return rc;
}

static enum v2v_status describe(hid_t file, const char *path, const void *context)
{
    enum v2v_status rc = V2V_OK;
    const struct description *description = context;
    hid_t set = H5I_INVALID_HID;
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        if (description->datasets & (1u << i)) {
            set = H5Dopen2(file, v2v_h5_volume_sets[i], H5P_DEFAULT);
            V2V_TRY(describe_dataset(set, path, description->info));
            V2V_TRY(v2v_h5_close_written(V2V_OK, &set, path, v2v_h5_volume_sets[i]));
        }
    }
    for (int64_t i = 0; i < description->attribute_count; i++) {
        const struct v2v_attribute *attribute = &description->attributes[i];
        if (attribute->text == NULL) {
            V2V_TRY(v2v_h5_set_numbers(file, path, attribute->name, &attribute->number, 1));
        } else if (strlen(attribute->text) < MOST_ATTRIBUTE_BYTES) {
            V2V_TRY(v2v_h5_set_text(file, path, attribute->name, attribute->text));
        } else {
            V2V_TRY(v2v_h5_put_text(file, path, attribute->name, attribute->text));
        }
    }
done:
    v2v_h5_close(&set);
    return rc;
}

static enum v2v_status check_request(const char *path, const struct v2v_volume_info *info,
                                     unsigned datasets)
{
    const enum v2v_file_kind kind = v2v_file_kind_of_name(path);
    V2V_ASSERT((datasets & (1u << V2V_VOLUME_MEAN)) && datasets < (1u << V2V_H5_WRITER_SETS));
    if (kind != V2V_FILE_HDF5 && kind != V2V_FILE_TIFF) {
        return V2V_FAIL(V2V_E_USAGE, "%s: a volume's name ends in .h5, .hdf5, .hdf, .tif or .tiff",
                        path);
    }
    if (kind == V2V_FILE_TIFF && info->storage.deflate > 0) {
        return V2V_FAIL(V2V_E_USAGE, "%s: compression needs an HDF5 file (.h5)", path);
    }
    if (kind == V2V_FILE_TIFF && datasets != 1u << V2V_VOLUME_MEAN) {
        return V2V_FAIL(V2V_E_USAGE,
                        "%s: a TIFF holds the mean volume only; branches and uncertainty need .h5",
                        path);
    }
    return kind == V2V_FILE_HDF5 && v2v_volume_pack_is_needed(&info->storage)
               ? v2v_h5_packed_check(path, info)
               : V2V_OK;
}

/* Is it written as plain HDF5, at least at first? */
static int is_written_as_hdf5(const char *path, const struct v2v_volume_info *info)
{
    return v2v_file_kind_of_name(path) == V2V_FILE_HDF5 ||
           v2v_volume_pack_is_needed(&info->storage);
}

static const char *task_of(const struct v2v_attribute *attributes, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        if (strcmp(attributes[i].name, V2V_VOLUME_TASK) == 0) {
            return attributes[i].text;
        }
    }
    return NULL;
}

static void make_plan(struct v2v_h5_plan *plan, const struct description *description)
{
    const struct v2v_volume_info *info = description->info;
    *plan = (struct v2v_h5_plan){
        .shape = {info->frames, info->slices, info->height, info->width},
        .with_done = 1,
        .task = task_of(description->attributes, description->attribute_count),
        .describe = describe,
        .context = description,
    };
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        plan->dataset[i] = description->datasets & (1u << i) ? v2v_h5_volume_sets[i] : NULL;
    }
}

/* What becomes of the plain file. */
static enum v2v_status make_pack(struct v2v_volume_pack *pack, const char *path,
                                 const struct description *description,
                                 const struct v2v_tiff_told *told)
{
    *pack = (struct v2v_volume_pack){.info = *description->info,
                                     .datasets = description->datasets,
                                     .is_tiff = v2v_file_kind_of_name(path) == V2V_FILE_TIFF,
                                     .is_ome = v2v_tiff_is_ome_name(path),
                                     .told = *told};
    return v2v_text_format(pack->path, sizeof pack->path, "%s", path);
}

static enum v2v_status begin(struct v2v_volume_writer **writer, const char *path,
                             const struct description *description, int resume,
                             const struct v2v_comm *comm)
{
    enum v2v_status rc = check_request(path, description->info, description->datasets);
    struct v2v_volume_writer *fresh = NULL;
    struct v2v_h5_plan plan;
    struct v2v_volume_tiff_plan tiff = {.is_ome = v2v_tiff_is_ome_name(path)};
    *writer = NULL;
    make_plan(&plan, description);
    plan.resume = resume;
    if (rc == V2V_OK) {
        rc = v2v_tiff_told_of(&tiff.told, description->attributes, description->attribute_count);
    }
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(fresh, "io.volume", 1);
    }
    if (rc == V2V_OK && v2v_volume_pack_is_needed(&description->info->storage)) {
        rc = make_pack(&fresh->pack, path, description, &tiff.told);
        plan.pack = &fresh->pack;
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    if (is_written_as_hdf5(path, description->info)) {
        V2V_TRY(v2v_h5_writer_create(&fresh->h5, path, &plan, comm));
    } else {
        V2V_TRY(v2v_volume_tiff_create(&fresh->tiff, path, description->info, &tiff, comm));
    }
    *writer = fresh;
    fresh = NULL;
done:
    v2v_mem_free(fresh);
    return rc;
}

enum v2v_status v2v_volume_create(struct v2v_volume_writer **writer, const char *path,
                                  const struct v2v_volume_info *info, unsigned datasets,
                                  const struct v2v_attribute *attributes, int64_t attribute_count,
                                  const struct v2v_comm *comm)
{
    const struct description description = {info, datasets, attributes, attribute_count};
    return begin(writer, path, &description, 0, comm);
}

enum v2v_status v2v_volume_resume(struct v2v_volume_writer **writer, const char *path,
                                  const struct v2v_volume_info *info, unsigned datasets,
                                  const struct v2v_attribute *attributes, int64_t attribute_count,
                                  const struct v2v_comm *comm)
{
    const struct description description = {info, datasets, attributes, attribute_count};
    return begin(writer, path, &description, 1, comm);
}

enum v2v_status v2v_volume_left(struct v2v_volume_left *left, const char *path, const char *task)
{
    char temporary[V2V_PATH_BYTES];
    *left = (struct v2v_volume_left){0};
    return v2v_file_temporary(temporary, path) == V2V_OK ? v2v_h5_left(left, temporary, task)
                                                         : V2V_OK;
}

/* Collective(comm). */
static enum v2v_status check_h5(const char *path, const struct v2v_h5_plan *plan,
                                const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    uint8_t *done = NULL;
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(done, "io.volume", plan->shape[0])));
    V2V_TRY(v2v_h5_good_frames(done, path, plan, comm));
    for (int64_t t = 0; t < plan->shape[0]; t++) {
        if (!done[t]) {
            V2V_TRY(
                V2V_FAIL(V2V_E_INPUT, "%s: frame %lld is missing or damaged", path, (long long)t));
        }
    }
done:
    v2v_mem_free(done);
    return rc;
}

struct tiff_check {
    const char *path, *task;
    const struct v2v_volume_info *info;
};

static enum v2v_status check_tiff(void *context)
{
    const struct tiff_check *check = context;
    return v2v_volume_tiff_check(check->path, check->info, check->task);
}

enum v2v_status v2v_volume_check(const char *path, const struct v2v_volume_info *info,
                                 unsigned datasets, const struct v2v_attribute *attributes,
                                 int64_t attribute_count, const struct v2v_comm *comm)
{
    const struct description description = {info, datasets, attributes, attribute_count};
    struct v2v_h5_plan plan;
    enum v2v_status rc = check_request(path, info, datasets);
    make_plan(&plan, &description);
    plan.storage = &info->storage;
    V2V_TRY(v2v_par_agree(comm, rc));
    if (v2v_file_kind_of_name(path) == V2V_FILE_HDF5) {
        return check_h5(path, &plan, comm);
    }
    V2V_TRY(v2v_agreement_alone(
        comm, check_tiff, &(struct tiff_check){.path = path, .task = plan.task, .info = info}));
done:
    return rc;
}

int v2v_volume_is_done(const struct v2v_volume_writer *writer, int64_t t)
{
    return writer->h5 != NULL && v2v_h5_writer_is_done(writer->h5, t);
}

enum v2v_status v2v_volume_write(struct v2v_volume_writer *writer, int dataset, const float *slices,
                                 int64_t t, int64_t first, int64_t count)
{
    if (writer->h5 != NULL) {
        return v2v_h5_writer_write(writer->h5, dataset, slices, t, first, count);
    }
    V2V_ASSERT(dataset == V2V_VOLUME_MEAN);
    return v2v_volume_tiff_write(writer->tiff, slices, t, first, count);
}

int v2v_volume_keeps_step(const struct v2v_volume_writer *writer)
{
    return writer->h5 == NULL;
}

enum v2v_status v2v_volume_put(struct v2v_volume_writer *writer, int dataset, const float *slices,
                               int64_t t, int64_t first, int64_t count)
{
    return writer->h5 != NULL ? v2v_h5_writer_put(writer->h5, dataset, slices, t, first, count)
                              : v2v_volume_write(writer, dataset, slices, t, first, count);
}

enum v2v_status v2v_volume_mark_done(struct v2v_volume_writer *writer, int64_t t,
                                     const struct v2v_comm *writers)
{
    /* A TIFF has no marks: it appears when all its frames are there, or not at all. */
    return writer->h5 != NULL ? v2v_h5_writer_mark_done(writer->h5, t, writers) : V2V_OK;
}

enum v2v_status v2v_volume_put_later(struct v2v_volume_writer *writer, int dataset,
                                     const float *slices, int64_t t, int64_t first, int64_t count)
{
    return writer->h5 != NULL
               ? v2v_h5_writer_put_later(writer->h5, dataset, slices, t, first, count)
               : v2v_volume_write(writer, dataset, slices, t, first, count);
}

enum v2v_status v2v_volume_mark_later(struct v2v_volume_writer *writer, int64_t t,
                                      const struct v2v_comm *writers)
{
    return writer->h5 != NULL ? v2v_h5_writer_mark_later(writer->h5, t, writers) : V2V_OK;
}

enum v2v_status v2v_volume_wait(struct v2v_volume_writer *writer)
{
    return writer->h5 != NULL ? v2v_h5_writer_wait(writer->h5) : V2V_OK;
}

enum v2v_status v2v_volume_finish(struct v2v_volume_writer **writer)
{
    const enum v2v_status rc = (*writer)->h5 != NULL ? v2v_h5_writer_finish(&(*writer)->h5)
                                                     : v2v_volume_tiff_finish(&(*writer)->tiff);
    v2v_mem_free(*writer);
    *writer = NULL;
    return rc;
}

void v2v_volume_suspend(struct v2v_volume_writer **writer)
{
    if (*writer != NULL) {
        v2v_h5_writer_suspend(&(*writer)->h5);
        v2v_volume_abandon(writer);
    }
}

void v2v_volume_abandon(struct v2v_volume_writer **writer)
{
    if (*writer != NULL) {
        v2v_h5_writer_abandon(&(*writer)->h5);
        v2v_volume_tiff_abandon(&(*writer)->tiff);
        v2v_mem_free(*writer);
        *writer = NULL;
    }
}
