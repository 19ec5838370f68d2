#include "io/stack.h"
#include "io/h5_guard.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file_sum.h"
#include <stdio.h>
#include <string.h>
#include <strings.h>

const struct v2v_h5_kind v2v_h5_views = {.dataset = "/views",
                                         .axes = "tvyx",
                                         .axis = {"frame", "view", "y", "x"},
                                         .may_be_other = 1,
                                         .may_be_folder = 1,
                                         .least_rank = 3};
const struct v2v_h5_kind v2v_h5_volume = {.dataset = "/volume",
                                          .axes = "tzyx",
                                          .axis = {"frame", "slice", "y", "x"},
                                          .may_be_other = 1,
                                          .least_rank = 3};
const struct v2v_h5_kind v2v_h5_psf = {
    .dataset = "/psf", .axes = "vzyx", .axis = {"view", "slice", "y", "x"}, .least_rank = 4};

/* The stack's pages become those of one channel. */
static enum v2v_status choose_channel(struct v2v_stack *stack, int64_t channel)
{
    struct v2v_stack_axes *axes = &stack->axes;
    if (channel > axes->channels) {
        return V2V_FAIL(V2V_E_INPUT, "%s: has %lld channel%s: there is no channel %lld (from 1)",
                        stack->path, (long long)axes->channels, axes->channels > 1 ? "s" : "",
                        (long long)channel);
    }
    if (channel > 0) {
        stack->first_of_file = channel - 1;
        stack->step_of_file = axes->channels;
        stack->pages_of_file /= axes->channels;
        axes->channels = 1;
    }
    return V2V_OK;
}

/* Another dataset than the kind's. */
static enum v2v_status choose_dataset(struct v2v_stack *stack, const char *dataset, int hdf5)
{
    if (dataset[0] == '\0') {
        return V2V_OK;
    }
    if (!hdf5) {
        return V2V_FAIL(V2V_E_INPUT, "%s: is a TIFF, in which there is no dataset '%s'",
                        stack->path, dataset);
    }
    stack->named = *stack->kind;
    stack->named.dataset = stack->dataset;
    stack->kind = &stack->named;
    return v2v_text_format(stack->dataset, sizeof stack->dataset, "%s%s",
                           dataset[0] == '/' ? "" : "/", dataset);
}

/* A file or a folder as one row of pages. */
static enum v2v_status open_tiff(struct v2v_stack *stack, int is_folder,
                                 const struct v2v_input_settings *settings)
{
    enum v2v_status rc = V2V_OK;
    if (is_folder) {
        V2V_TRY(v2v_tiff_folder_open(&stack->folder, stack->path));
    } else {
        V2V_TRY(v2v_tiff_open(&stack->tiff, stack->path));
    }
    const struct v2v_tiff_info *info =
        is_folder ? v2v_tiff_folder_info(stack->folder) : v2v_tiff_info(stack->tiff);
    stack->is_tiff = 1;
    stack->frames = 1;
    stack->files = is_folder ? v2v_tiff_folder_files(stack->folder) : 1;
    stack->pages_of_file = info->pages;
    stack->height = info->height;
    stack->width = info->width;
    stack->type_max = info->type_max;
    stack->pixel_size_um = info->pixel_size_um;
    stack->slice_spacing_um = info->slice_spacing_um;
    stack->frame_interval_s = info->frame_interval_s;
    stack->axes = (struct v2v_stack_axes){info->channels, info->slices, info->frames};
    stack->is_own = info->is_own && !is_folder;
    stack->step_of_file = 1;
    V2V_TRY(choose_channel(stack, settings->channel));
    if (is_folder) {
        V2V_TRY(v2v_stack_lay_out_folder(stack, settings));
    }
    stack->images = stack->files * stack->pages_of_file;
done:
    return rc;
}

static enum v2v_status open_hdf5(struct v2v_stack *stack, const struct v2v_input_settings *settings)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_h5_array_open(&stack->array, stack->path, stack->kind));
    stack->frames = stack->array.shape[0];
    stack->images = stack->array.shape[1];
    stack->height = stack->array.shape[2];
    stack->width = stack->array.shape[3];
    stack->type_max = stack->array.type_max;
    stack->axes = (struct v2v_stack_axes){1, stack->images, stack->frames};
    V2V_TRY(choose_channel(stack, settings->channel));
done:
    return rc;
}

enum form { TIFF_FILE, TIFF_FOLDER, HDF5_FILE };

static enum v2v_status open_local(struct v2v_stack *stack, int form,
                                  const struct v2v_input_settings *settings)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(choose_dataset(stack, settings->dataset, form == HDF5_FILE));
    if (form == TIFF_FOLDER) { /* it looks at its files */
        V2V_TRY(open_tiff(stack, 1, settings));
    } else {
        V2V_TRY(v2v_file_remember(&stack->state, stack->path));
        rc = form == HDF5_FILE ? open_hdf5(stack, settings) : open_tiff(stack, 0, settings);
        V2V_TRY(v2v_file_unchanged(rc, &stack->state, stack->path));
    }
    stack->pages = stack->frames * stack->images;
done:
    return rc;
}

/* What the path is. Rank-0. */
static enum v2v_status look(int *form, const struct v2v_stack *stack)
{
    enum v2v_status rc = V2V_OK;
    *form = TIFF_FOLDER;
    if (stack->kind->may_be_folder && v2v_file_is_folder(stack->path)) {
        return V2V_OK;
    }
    V2V_TRY(v2v_file_check_input(stack->path));
    *form = v2v_file_is_hdf5(stack->path) ? HDF5_FILE : TIFF_FILE;
    if (*form == HDF5_FILE) {
        V2V_TRY(v2v_h5_guard(stack->path));
    }
done:
    return rc;
}

enum v2v_status v2v_stack_open(struct v2v_stack *stack, const char *path,
                               const struct v2v_h5_kind *kind,
                               const struct v2v_input_settings *settings,
                               const struct v2v_comm *comm)
{
    *stack = (struct v2v_stack){.kind = kind};
    enum v2v_status rc = v2v_text_format(stack->path, sizeof stack->path, "%s", path);
    int form = TIFF_FILE;
    int64_t files = 0;
    if (rc == V2V_OK && v2v_comm_rank(comm) == 0) {
        rc = look(&form, stack);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    v2v_par_broadcast(comm, &form, sizeof form, 0);
    V2V_TRY(v2v_par_agree(comm, open_local(stack, form, settings)));
    files = stack->files;
    v2v_par_broadcast(comm, &files, sizeof files, 0);
    if (files != stack->files) {
        rc = V2V_FAIL(V2V_E_INPUT, "%s: changed while it was read: has %lld files, had %lld", path,
                      (long long)stack->files, (long long)files);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    V2V_TRY(v2v_file_agree(path, comm));
    if (stack->folder != NULL && v2v_comm_rank(comm) == 0) {
        v2v_tiff_folder_warn(stack->folder);
    }
done:
    if (rc != V2V_OK) {
        v2v_stack_fini(stack);
    }
    return rc;
}

/* Page `page` of the row. */
static enum v2v_status read_page(struct v2v_stack *stack, float *out, int64_t page)
{
    const int64_t file = stack->by_view ? page % stack->files : page / stack->pages_of_file;
    const int64_t index = stack->by_view ? page / stack->files : page % stack->pages_of_file;
    const int64_t at = stack->first_of_file + index * stack->step_of_file;
    return stack->folder != NULL ? v2v_tiff_folder_read(stack->folder, out, file, at)
                                 : v2v_tiff_read(stack->tiff, out, at, 1);
}

enum v2v_status v2v_stack_read(struct v2v_stack *stack, float *out, int64_t page, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    V2V_ASSERT(page >= 0 && count >= 0 && page + count <= stack->pages);
    for (int64_t i = 0; stack->is_tiff && i < count; i++) {
        V2V_TRY(read_page(stack, out + i * stack->height * stack->width, page + i));
    }
    while (!stack->is_tiff && count > 0) {
        const int64_t t = page / stack->images, first = page % stack->images;
        const int64_t here = count < stack->images - first ? count : stack->images - first;
        V2V_TRY(v2v_h5_array_read(&stack->array, out, t, first, here));
        V2V_TRY(v2v_h5_array_unpack(&stack->array, out, here * stack->height * stack->width));
        out += here * stack->height * stack->width;
        page += here;
        count -= here;
    }
done:
    return stack->folder != NULL ? rc : v2v_file_unchanged(rc, &stack->state, stack->path);
}

void v2v_stack_fini(struct v2v_stack *stack)
{
    v2v_h5_array_close(&stack->array);
    v2v_tiff_folder_close(&stack->folder);
    v2v_tiff_close(&stack->tiff);
}
