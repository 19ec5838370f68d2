#include "io/h5_checksum.h"
#include "io/h5_common.h"
#include "io/stack.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/volume.h"
#include <math.h>

struct v2v_volume {
    struct v2v_volume_info info;
    struct v2v_stack stack;
    int64_t before;     /* frames that a cut left out */
    float scale;        /* of integers: the step that a TIFF states, or 1 / their maximum */
    uint8_t *done;      /* [t]; NULL: the file doesn't say, all frames count */
    uint64_t *checksum; /* [t]; NULL: the file has none */
    uint8_t
        *verified; /* [t] its checksum was seen to hold; with `checksum` alone, as what follows */
    struct v2v_h5_summed summed;
};

/* How many pages of a TIFF make a frame. */
static enum v2v_status lay_out_tiff(struct v2v_volume *volume, int64_t asked)
{
    const struct v2v_stack *stack = &volume->stack;
    const struct v2v_stack_axes *axes = &stack->axes;
    /* one axis alone is a row of pages, which many programs call slices, whatever they are */
    const int is_stated = axes->slices > 1 && axes->frames > 1;
    const int is_own = stack->is_own && axes->frames > 1;
    const int64_t slices = is_stated   ? axes->slices
                           : asked > 0 ? asked
                           : is_own    ? axes->slices
                                       : stack->pages;
    if (axes->channels > 1) {
        return V2V_FAIL(V2V_E_INPUT, "%s: has %lld channels: --channel K (from 1) takes one",
                        stack->path, (long long)axes->channels);
    }
    if (is_stated && asked > 0 && asked != slices) {
        return V2V_FAIL(V2V_E_INPUT, "%s: a frame has %lld slices, but %lld are asked for",
                        stack->path, (long long)slices, (long long)asked);
    }
    if (stack->pages % slices != 0) {
        return V2V_FAIL(V2V_E_INPUT, "%s: %lld pages are %lld frames of %lld slices and %lld more",
                        stack->path, (long long)stack->pages, (long long)(stack->pages / slices),
                        (long long)slices, (long long)(stack->pages % slices));
    }
    volume->info.frames = stack->pages / slices;
    volume->info.slices = slices;
    volume->info.pixel_size_um = stack->pixel_size_um;
    volume->info.slice_spacing_um = stack->slice_spacing_um;
    /* between pages that are called frames; of slices alone it is that of frames of them all */
    const int is_of_page = !is_stated && axes->frames > 1;
    const int is_known = is_of_page || slices == axes->slices;
    volume->info.frame_interval_s =
        is_known ? stack->frame_interval_s * (is_of_page ? (double)slices : 1.0) : 0.0;
    return V2V_OK;
}

/* element_size_um = (z,y,x), else the two lengths by themselves. */
static enum v2v_status read_lengths(struct v2v_volume *volume)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume_info *info = &volume->info;
    const char *path = volume->stack.path;
    const hid_t set = volume->stack.array.set;
    double size[3] = {0.0, 0.0, 0.0};
    int found = 0;
    V2V_TRY(v2v_h5_get_length(&info->frame_interval_s, set, path, "frame_interval_s"));
    V2V_TRY(v2v_h5_get_numbers(size, &found, set, path, "element_size_um", 3));
    if (!found) {
        V2V_TRY(v2v_h5_get_length(&info->pixel_size_um, set, path, "pixel_size_um"));
        V2V_TRY(v2v_h5_get_length(&info->slice_spacing_um, set, path, "slice_spacing_um"));
        goto done;
    }
    if (size[0] < 0.0 || size[1] < 0.0 || size[2] < 0.0) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: attribute element_size_um: is negative", path));
    }
    info->slice_spacing_um = size[0];
    if (fabs(size[1] - size[2]) <= 1e-6 * size[1]) { /* the same but for rounding by the writer */
        info->pixel_size_um = size[1];
    } else {
        v2v_log(V2V_LOG_WARNING, "%s: pixels of %g x %g um are not square: size not used", path,
                size[1], size[2]);
    }
done:
    return rc;
}

/* Of our own files; anything else under that name is none of ours. */
static enum v2v_status read_done(struct v2v_volume *volume)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_stack *stack = &volume->stack;
    if (H5Lexists(stack->array.file, "/done", H5P_DEFAULT) > 0) {
        V2V_TRY(V2V_ALLOC(volume->done, "io.done", stack->frames));
        V2V_TRY(v2v_h5_read_of_frames(volume->done, stack->array.file, stack->path, "/done",
                                      H5T_NATIVE_UINT8, stack->frames));
    }
done:
    return rc;
}

/* Files that can be gone on with have them, and their datasets are what they cover. */
static enum v2v_status read_checksums(struct v2v_volume *volume)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_stack *stack = &volume->stack;
    const hid_t file = stack->array.file;
    const char *there[V2V_H5_WRITER_SETS];
    if (H5Lexists(file, V2V_H5_CHECKSUM, H5P_DEFAULT) <= 0 ||
        H5Aexists(file, V2V_VOLUME_TASK) <= 0) {
        return V2V_OK;
    }
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        const char *name = v2v_h5_volume_sets[i];
        there[i] = H5Lexists(file, name, H5P_DEFAULT) > 0 ? name : NULL;
    }
    V2V_TRY(V2V_ALLOC(volume->checksum, "io.checksum", stack->frames));
    V2V_TRY(V2V_ALLOC(volume->verified, "io.checksum", stack->frames));
    V2V_TRY(v2v_h5_read_of_frames(volume->checksum, file, stack->path, V2V_H5_CHECKSUM,
                                  H5T_NATIVE_UINT64, stack->frames));
    V2V_TRY(v2v_h5_summed_open(&volume->summed, stack->path, there));
done:
    return rc;
}

static enum v2v_status describe(struct v2v_volume *volume,
                                const struct v2v_input_settings *settings)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_stack *stack = &volume->stack;
    const double step = stack->tiff != NULL ? v2v_tiff_info(stack->tiff)->step : 0.0;
    volume->scale = (float)(step > 0.0 ? step : 1.0 / stack->type_max);
    volume->info.height = stack->height;
    volume->info.width = stack->width;
    if (stack->is_tiff) {
        V2V_TRY(lay_out_tiff(volume, settings->slices));
    } else {
        volume->info.frames = stack->frames;
        volume->info.slices = stack->images;
        V2V_TRY(read_lengths(volume));
        V2V_TRY(read_done(volume));
        V2V_TRY(read_checksums(volume));
    }
    v2v_stack_told(&volume->info.pixel_size_um, settings->pixel_size_um);
    v2v_stack_told(&volume->info.slice_spacing_um, settings->slice_spacing_um);
    v2v_stack_told(&volume->info.frame_interval_s, settings->frame_interval_s);
done:
    return rc;
}

enum v2v_status v2v_volume_open(struct v2v_volume **volume, const char *path,
                                const struct v2v_input_settings *settings,
                                const struct v2v_comm *comm)
{
    static const struct v2v_input_settings as_it_says = {0};
    enum v2v_status rc = V2V_OK;
    struct v2v_volume *fresh = NULL;
    *volume = NULL;
    settings = settings != NULL ? settings : &as_it_says;
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(fresh, "io.volume", 1)));
    V2V_TRY(v2v_stack_open(&fresh->stack, path, &v2v_h5_volume, settings, comm));
    V2V_TRY(v2v_par_agree(comm, describe(fresh, settings)));
    *volume = fresh;
    fresh = NULL;
done:
    v2v_volume_close(&fresh);
    return rc;
}

int v2v_volume_has(const struct v2v_volume *volume, int64_t t)
{
    return volume->done == NULL || volume->done[volume->before + t] != 0;
}

enum v2v_status v2v_volume_cut(struct v2v_volume *volume, int64_t first, int64_t count)
{
    struct v2v_volume_info *info = &volume->info;
    V2V_ASSERT(first >= 0 && count > 0);
    if (first >= info->frames) {
        return V2V_FAIL(V2V_E_INPUT, "%s: there is no frame %lld: it has %lld, from 0",
                        volume->stack.path, (long long)first, (long long)info->frames);
    }
    info->frames = v2v_smaller(count, info->frames - first);
    volume->before += first;
    return V2V_OK;
}

const struct v2v_volume_info *v2v_volume_info(const struct v2v_volume *volume)
{
    return &volume->info;
}

/* The whole frame, whatever part of it is asked for: once. */
static enum v2v_status verify(struct v2v_volume *volume, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const char *path = volume->stack.path;
    uint64_t sum = 0;
    if (volume->checksum == NULL || volume->verified[t]) {
        return V2V_OK;
    }
    V2V_TRY(v2v_file_unchanged(v2v_h5_summed_frame(&volume->summed, &sum, t), &volume->stack.state,
                               path));
    if (sum != volume->checksum[t]) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: frame %lld is damaged: its checksum doesn't hold", path,
                         (long long)t));
    }
    volume->verified[t] = 1;
done:
    return rc;
}

enum v2v_status v2v_volume_read(struct v2v_volume *volume, float *out, int64_t t, int64_t first,
                                int64_t count)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = &volume->info;
    const int64_t frame = volume->before + t;
    V2V_ASSERT(t >= 0 && t < info->frames && first >= 0 && count >= 0 &&
               first + count <= info->slices);
    if (!v2v_volume_has(volume, t)) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: /done: frame %lld was never finished",
                         volume->stack.path, (long long)frame));
    }
    V2V_TRY(verify(volume, frame));
    V2V_TRY(v2v_stack_read(&volume->stack, out, frame * info->slices + first, count));
    if (volume->scale != 1.0f) {
        const int64_t elements = count * info->height * info->width;
        for (int64_t i = 0; i < elements; i++) {
            out[i] *= volume->scale;
        }
    }
done:
    return rc;
}

void v2v_volume_close(struct v2v_volume **volume)
{
    if (*volume != NULL) {
        v2v_h5_summed_close(&(*volume)->summed);
        v2v_stack_fini(&(*volume)->stack);
        v2v_mem_free((*volume)->verified);
        v2v_mem_free((*volume)->checksum);
        v2v_mem_free((*volume)->done);
        v2v_mem_free(*volume);
        *volume = NULL;
    }
}
