#include "io/volume_tiff.h"
#include "io/rounding.h"
#include "par/comm_mpi.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/tiff.h"
#include "v2v3d/par/watchdog.h"
#include <string.h>

/* Floats of one message: MPI counts are ints. */
#define MOST_MESSAGE ((int64_t)1 << 28)

/* A frame that waits on rank 0 for its slices or for its turn. */
struct pending {
    struct pending *next;
    int64_t t;
    int64_t have;  /* slices that are here */
    float *slices; /* [z,y,x] */
};

/* What a rank brings to one collective write. */
struct block {
    int64_t t, first, count;
};

struct v2v_volume_tiff {
    char path[V2V_PATH_BYTES];
    const struct v2v_comm *comm;
    struct v2v_volume_info info;
    struct v2v_tiff_writer *writer; /* rank 0 */
    struct block *blocks;           /* [ranks], rank 0 */
    struct pending *pending;
    int64_t next;           /* the frame whose pages come next in the file */
    enum v2v_status failed; /* agreed: nothing more is written */
};

enum v2v_status v2v_volume_tiff_create(struct v2v_volume_tiff **tiff, const char *path,
                                       const struct v2v_volume_info *info,
                                       const struct v2v_volume_tiff_plan *plan,
                                       const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume_tiff *fresh = NULL;
    struct v2v_tiff_info file = {
        .pages = v2v_mem_product(info->frames, info->slices, 1),
        .height = info->height,
        .width = info->width,
        .channels = 1,
        .slices = info->slices,
        .frames = info->frames,
        .bits = plan->step > 0.0 ? 16 : 32,
        .is_float = plan->step == 0.0,
        .is_ome = plan->is_ome,
        .is_packed = plan->is_packed,
        .step = plan->step,
        .told = plan->told,
        .pixel_size_um = info->pixel_size_um,
        .slice_spacing_um = info->slice_spacing_um,
        .frame_interval_s = info->frame_interval_s,
    };
    *tiff = NULL;
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(fresh, "io.volume", 1)));
    fresh->comm = comm;
    fresh->info = *info;
    rc = v2v_text_format(fresh->path, sizeof fresh->path, "%s", path);
    if (rc == V2V_OK && v2v_comm_rank(comm) == 0) {
        rc = V2V_ALLOC(fresh->blocks, "io.volume", v2v_comm_size(comm));
        if (rc == V2V_OK) {
            rc = v2v_tiff_create(&fresh->writer, path, &file);
        }
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    *tiff = fresh;
    fresh = NULL;
done:
    v2v_volume_tiff_abandon(&fresh);
    return rc;
}

enum v2v_status v2v_volume_tiff_check(const char *path, const struct v2v_volume_info *info,
                                      const char *task)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff *tiff = NULL;
    float *page = NULL;
    V2V_TRY(v2v_tiff_open(&tiff, path));
    const struct v2v_tiff_info *file = v2v_tiff_info(tiff);
    if (task == NULL || strcmp(file->told.task, task) != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: is of another task: inputs, settings or program differ",
                         path));
    }
    const int is_integer = info->storage.sample == V2V_SAMPLE_UINT16;
    if (file->is_float == is_integer || (is_integer && info->storage.peak > 0.0 &&
                                         file->step != v2v_rounding_step(info->storage.peak))) {
        V2V_TRY(
            V2V_FAIL(V2V_E_INPUT, "%s: is stored with another type or peak than asked for", path));
    }
    if (file->frames != info->frames || file->slices != info->slices ||
        file->height != info->height || file->width != info->width) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: has not the shape expected", path));
    }
    V2V_TRY(V2V_ALLOC(page, "io.volume", v2v_mem_product(info->height, info->width, 1)));
    for (int64_t i = 0; i < file->pages; i++) {
        v2v_watchdog_beat("checking pages");
        V2V_TRY(v2v_tiff_read(tiff, page, i, 1));
    }
done:
    v2v_mem_free(page);
    v2v_tiff_close(&tiff);
    return rc;
}

/* The place on rank 0 for frame t's slices, made when it is new; NULL when memory is short. */
static struct pending *pending_frame(struct v2v_volume_tiff *tiff, int64_t t)
{
    const struct v2v_volume_info *info = &tiff->info;
    struct pending *frame = tiff->pending;
    while (frame != NULL && frame->t != t) {
        frame = frame->next;
    }
    if (frame != NULL) {
        return frame;
    }
    frame = v2v_mem_alloc("io.volume.waiting", 1, sizeof *frame);
    if (frame == NULL) {
        return NULL;
    }
    const int64_t image = v2v_mem_product(info->height, info->width, 1);
    frame->t = t;
    frame->slices = v2v_mem_alloc("io.volume.waiting", v2v_mem_product(info->slices, image, 1),
                                  sizeof *frame->slices);
    if (frame->slices == NULL) {
        v2v_mem_free(frame);
        return NULL;
    }
    frame->next = tiff->pending;
    tiff->pending = frame;
    return frame;
}

/* Rank 0: take this rank's slices in. Other ranks: send them. */
static void collect(struct v2v_volume_tiff *tiff, const float *slices, const struct block *mine)
{
    const int64_t image = tiff->info.height * tiff->info.width;
    const int rank = v2v_comm_rank(tiff->comm), size = v2v_comm_size(tiff->comm);
    for (int r = rank; r < (rank == 0 ? size : rank + 1); r++) {
        const struct block *block = rank == 0 ? &tiff->blocks[r] : mine;
        struct pending *frame =
            rank == 0 && block->count > 0 ? pending_frame(tiff, block->t) : NULL;
        float *to = frame != NULL ? frame->slices + block->first * image : NULL;
        if (r == 0 && to != NULL) {
            memcpy(to, slices, (size_t)(block->count * image) * sizeof *slices);
        }
        for (int64_t i = 0; r != 0 && i < block->count * image; i += MOST_MESSAGE) {
            const int64_t left = block->count * image - i;
            const int now = (int)(left < MOST_MESSAGE ? left : MOST_MESSAGE);
            if (rank == 0) {
                MPI_Recv(to + i, now, MPI_FLOAT, r, V2V_TAG_TIFF, v2v_comm_mpi(tiff->comm),
                         MPI_STATUS_IGNORE);
            } else {
                MPI_Send(slices + i, now, MPI_FLOAT, 0, V2V_TAG_TIFF, v2v_comm_mpi(tiff->comm));
            }
        }
        if (frame != NULL) {
            frame->have += block->count;
        }
    }
}

/* Rank 0: write the frames that are complete and whose turn it is. */
static enum v2v_status write_ready(struct v2v_volume_tiff *tiff)
{
    enum v2v_status rc = V2V_OK;
    const int64_t image = tiff->info.height * tiff->info.width;
    struct pending **link = &tiff->pending;
    while (*link != NULL) {
        struct pending *frame = *link;
        if (frame->t != tiff->next || frame->have < tiff->info.slices) {
            link = &frame->next;
            continue;
        }
        V2V_ASSERT(frame->have == tiff->info.slices);
        for (int64_t z = 0; z < tiff->info.slices; z++) {
            V2V_TRY(v2v_tiff_write_page(tiff->writer, frame->slices + z * image));
        }
        *link = frame->next;
        v2v_mem_free(frame->slices);
        v2v_mem_free(frame);
        tiff->next++;
        link = &tiff->pending; /* the next in turn may have come before */
    }
done:
    return rc;
}

enum v2v_status v2v_volume_tiff_write(struct v2v_volume_tiff *tiff, const float *slices, int64_t t,
                                      int64_t first, int64_t count)
{
    enum v2v_status rc = tiff->failed;
    if (rc != V2V_OK) {
        return rc;
    }
    rc = V2V_FAULT_POINT("volume.write");
    const int rank = v2v_comm_rank(tiff->comm), size = v2v_comm_size(tiff->comm);
    const struct block mine = {t, first, count};
    if (size == 1) {
        tiff->blocks[0] = mine;
    } else {
        MPI_Gather(&mine, 3, MPI_INT64_T, tiff->blocks, 3, MPI_INT64_T, 0,
                   v2v_comm_mpi(tiff->comm));
    }
    for (int r = 0; rank == 0 && r < size; r++) {
        const struct block *block = &tiff->blocks[r];
        V2V_ASSERT(block->count == 0 ||
                   (block->t >= tiff->next && block->t < tiff->info.frames && block->first >= 0 &&
                    block->count > 0 && block->count <= tiff->info.slices - block->first));
        if (rc == V2V_OK && block->count > 0 && pending_frame(tiff, block->t) == NULL) {
            rc = V2V_E_MEMORY;
        }
    }
    V2V_TRY(v2v_par_agree(tiff->comm, rc));
    collect(tiff, slices, &mine);
    V2V_TRY(v2v_par_agree(tiff->comm, rank == 0 ? write_ready(tiff) : V2V_OK));
done:
    tiff->failed = rc;
    return rc;
}

enum v2v_status v2v_volume_tiff_finish(struct v2v_volume_tiff **tiff)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume_tiff *own = *tiff;
    if (v2v_comm_rank(own->comm) == 0) {
        rc = own->next == own->info.frames ? v2v_tiff_finish(&own->writer)
                                           : V2V_FAIL(V2V_E_IO, "%s: frame %lld was not written",
                                                      own->path, (long long)own->next);
    }
    V2V_TRY(v2v_par_agree(own->comm, rc));
done:
    v2v_volume_tiff_abandon(tiff);
    return rc;
}

void v2v_volume_tiff_abandon(struct v2v_volume_tiff **tiff)
{
    struct v2v_volume_tiff *own = *tiff;
    *tiff = NULL;
    if (own == NULL) {
        return;
    }
    v2v_tiff_abandon(&own->writer);
    while (own->pending != NULL) {
        struct pending *frame = own->pending;
        own->pending = frame->next;
        v2v_mem_free(frame->slices);
        v2v_mem_free(frame);
    }
    v2v_mem_free(own->blocks);
    v2v_mem_free(own);
}
