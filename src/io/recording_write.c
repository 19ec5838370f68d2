#include "io/h5_common.h"
#include "io/h5_writer.h"
#include "io/stack.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/recording.h"

#include <math.h>

struct v2v_recording_writer {
    struct v2v_h5_writer *h5;
};

static enum v2v_status describe(hid_t file, const char *path, const void *context)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = context;
    const struct {
        const char *name;
        double value;
        int is_stated; /* bool */
    } attributes[] = {{"pixel_size_um", info->pixel_size_um, info->pixel_size_um != 0.0},
                      {"frame_interval_s", info->frame_interval_s, info->frame_interval_s != 0.0},
                      {"offset", info->offset, !isnan(info->offset)}};
    hid_t set = H5Dopen2(file, v2v_h5_views.dataset, H5P_DEFAULT);
    V2V_TRY(v2v_h5_set_text(set, path, "axes", v2v_h5_views.axes));
    for (size_t i = 0; i < sizeof attributes / sizeof attributes[0]; i++) {
        if (attributes[i].is_stated) {
            V2V_TRY(v2v_h5_set_numbers(set, path, attributes[i].name, &attributes[i].value, 1));
        }
    }
done:
    return v2v_h5_close_written(rc, &set, path, v2v_h5_views.dataset);
}

enum v2v_status v2v_recording_create(struct v2v_recording_writer **writer, const char *path,
                                     const struct v2v_recording_info *info,
                                     const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_recording_writer *fresh = NULL;
    const struct v2v_h5_plan plan = {
        .dataset = {v2v_h5_views.dataset},
        .shape = {info->frames, info->views, info->height, info->width},
        .is_uint16 = info->is_uint16,
        .describe = describe,
        .context = info,
    };
    *writer = NULL;
    V2V_TRY(v2v_h5_check_name(path));
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(fresh, "io.recording", 1)));
    V2V_TRY(v2v_h5_writer_create(&fresh->h5, path, &plan, comm));
    *writer = fresh;
    fresh = NULL;
done:
    v2v_mem_free(fresh);
    return rc;
}

enum v2v_status v2v_recording_write(struct v2v_recording_writer *writer, const float *views,
                                    int64_t t, int64_t first, int64_t count)
{
    return v2v_h5_writer_write(writer->h5, 0, views, t, first, count);
}

enum v2v_status v2v_recording_finish(struct v2v_recording_writer **writer)
{
    const enum v2v_status rc = v2v_h5_writer_finish(&(*writer)->h5);
    v2v_mem_free(*writer);
    *writer = NULL;
    return rc;
}

void v2v_recording_abandon(struct v2v_recording_writer **writer)
{
    if (*writer != NULL) {
        v2v_h5_writer_abandon(&(*writer)->h5);
        v2v_mem_free(*writer);
        *writer = NULL;
    }
}
