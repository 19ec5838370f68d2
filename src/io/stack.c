#include "io/stack.h"
#include "io/h5_guard.h"
#include "v2v3d/base/text.h"
#include <stdio.h>
#include <string.h>
#include <strings.h>

const struct v2v_h5_kind v2v_h5_views = {.dataset = "/views",
                                         .axes = "tvyx",
                                         .axis = {"frame", "view", "y", "x"},
                                         .may_be_other = 1,
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
        stack->images /= axes->channels;
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

static enum v2v_status open_local(struct v2v_stack *stack, int hdf5,
                                  const struct v2v_input_settings *settings)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(choose_dataset(stack, settings->dataset, hdf5));
    if (hdf5) {
        V2V_TRY(v2v_h5_array_open(&stack->array, stack->path, stack->kind));
        stack->frames = stack->array.shape[0];
        stack->images = stack->array.shape[1];
        stack->height = stack->array.shape[2];
        stack->width = stack->array.shape[3];
        stack->type_max = stack->array.type_max;
        stack->axes = (struct v2v_stack_axes){1, stack->images, stack->frames};
    } else {
        V2V_TRY(v2v_tiff_open(&stack->tiff, stack->path));
        const struct v2v_tiff_info *info = v2v_tiff_info(stack->tiff);
        stack->frames = 1;
        stack->images = info->pages;
        stack->height = info->height;
        stack->width = info->width;
        stack->type_max = info->type_max;
        stack->axes = (struct v2v_stack_axes){info->channels, info->slices, info->frames};
        stack->step_of_file = 1;
    }
    V2V_TRY(choose_channel(stack, settings->channel));
    stack->pages = stack->frames * stack->images;
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
    int hdf5 = 0;
    if (rc == V2V_OK && v2v_comm_rank(comm) == 0) {
        rc = v2v_file_check_input(stack->path);
        if (rc == V2V_OK) {
            rc = v2v_file_remember(&stack->state, stack->path);
        }
        hdf5 = rc == V2V_OK && v2v_file_is_hdf5(stack->path);
        if (hdf5) {
            rc = v2v_h5_guard(stack->path);
        }
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    v2v_par_broadcast(comm, &hdf5, sizeof hdf5, 0);
    if (v2v_comm_rank(comm) != 0) {
        rc = v2v_file_remember(&stack->state, stack->path);
    }
    if (rc == V2V_OK) {
        rc = v2v_file_unchanged(open_local(stack, hdf5, settings), &stack->state, stack->path);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
done:
    if (rc != V2V_OK) {
        v2v_stack_fini(stack);
    }
    return rc;
}

enum v2v_status v2v_stack_read(struct v2v_stack *stack, float *out, int64_t page, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    V2V_ASSERT(page >= 0 && count >= 0 && page + count <= stack->pages);
    for (int64_t i = 0; stack->tiff != NULL && i < count; i++) {
        V2V_TRY(v2v_tiff_read(stack->tiff, out + i * stack->height * stack->width,
                              stack->first_of_file + (page + i) * stack->step_of_file, 1));
    }
    while (stack->tiff == NULL && count > 0) {
        const int64_t t = page / stack->images, first = page % stack->images;
        const int64_t here = count < stack->images - first ? count : stack->images - first;
        V2V_TRY(v2v_h5_array_read(&stack->array, out, t, first, here));
        out += here * stack->height * stack->width;
        page += here;
        count -= here;
    }
done:
    return v2v_file_unchanged(rc, &stack->state, stack->path);
}

void v2v_stack_fini(struct v2v_stack *stack)
{
    v2v_h5_array_close(&stack->array);
    v2v_tiff_close(&stack->tiff);
}
