#include "io/volume_pack.h"

#include "io/h5_checksum.h"
#include "io/h5_common.h"
#include "io/h5_packed.h"
#include "io/rounding.h"
#include "io/volume_tiff.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"
#include <string.h>
#include <unistd.h>

struct work {
    const struct v2v_volume_pack *pack;
    const struct v2v_comm *comm;
    const char *part;
    struct v2v_h5_summed source;
    uint64_t *checksum; /* [t] of the plain file; NULL: it has none */
    double step[V2V_H5_WRITER_SETS];
    float *frame;             /* [z,y,x] */
    int64_t *sums, *clipped;  /* [t] of this rank's frames */
    struct v2v_h5_packed *h5; /* one of the two */
    struct v2v_volume_tiff *tiff;
};

int v2v_volume_pack_is_needed(const struct v2v_volume_storage *storage)
{
    return storage->sample != V2V_SAMPLE_FLOAT32 || storage->deflate > 0;
}

static int has_set(const struct work *work, int set)
{
    return (work->pack->datasets & 1u << set) != 0;
}

/* Local: the plain file, and memory for a frame of it. */
static enum v2v_status open_part(struct work *work)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = &work->pack->info;
    const char *dataset[V2V_H5_WRITER_SETS];
    for (int set = 0; set < V2V_H5_WRITER_SETS; set++) {
        dataset[set] = has_set(work, set) ? v2v_h5_volume_sets[set] : NULL;
    }
    V2V_TRY(v2v_h5_summed_open(&work->source, work->part, dataset));
    const hid_t file = work->source.array[V2V_VOLUME_MEAN].file;
    if (H5Lexists(file, V2V_H5_CHECKSUM, H5P_DEFAULT) > 0) {
        V2V_TRY(V2V_ALLOC(work->checksum, "io.pack", info->frames));
        V2V_TRY(v2v_h5_read_of_frames(work->checksum, file, work->part, V2V_H5_CHECKSUM,
                                      H5T_NATIVE_UINT64, info->frames));
    }
    V2V_TRY(V2V_ALLOC(work->sums, "io.pack", info->frames));
    V2V_TRY(V2V_ALLOC(work->clipped, "io.pack", info->frames));
    V2V_TRY(V2V_ALLOC(work->frame, "io.pack",
                      v2v_mem_product(info->slices, info->height, info->width)));
done:
    return rc;
}

/* What a set's frame t, which lies in work->frame, adds to the frame's checksum. */
static uint64_t checksum_of(const struct work *work, int set, int64_t t)
{
    const struct v2v_volume_info *info = &work->pack->info;
    const int64_t rows = info->slices * info->height;
    return v2v_h5_rows_checksum(work->frame, (set * info->frames + t) * rows, rows, info->width);
}

static enum v2v_status read_frame(struct work *work, int set, int64_t t)
{
    return v2v_h5_array_read(&work->source.array[set], work->frame, t, 0, work->pack->info.slices);
}

/* The steps of integers; a recording without any light has the finest. Collective(comm). */
static enum v2v_status settle_steps(struct work *work)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = &work->pack->info;
    const struct v2v_part mine =
        v2v_par_part(info->frames, v2v_comm_size(work->comm), v2v_comm_rank(work->comm));
    const int64_t voxels = v2v_mem_product(info->slices, info->height, info->width);
    double peak[V2V_H5_WRITER_SETS] = {0.0};
    for (int set = 0; set < V2V_H5_WRITER_SETS; set++) {
        peak[set] = info->storage.peak;
    }
    for (int64_t t = mine.first; info->storage.peak == 0.0 && t < mine.first + mine.count; t++) {
        v2v_watchdog_beat("looking for the brightest voxel");
        for (int set = 0; rc == V2V_OK && set < V2V_H5_WRITER_SETS; set++) {
            rc = has_set(work, set) ? read_frame(work, set, t) : V2V_OK;
            if (rc == V2V_OK && has_set(work, set)) {
                peak[set] = v2v_rounding_peak(peak[set], work->frame, voxels);
            }
        }
    }
    V2V_TRY(v2v_par_agree(work->comm, rc));
    v2v_par_max_f64(work->comm, peak, V2V_H5_WRITER_SETS);
    for (int set = 0; set < V2V_H5_WRITER_SETS; set++) {
        work->step[set] = v2v_rounding_step(peak[set]);
    }
done:
    return rc;
}

/* Local: a set's frame as it is to be stored, in work->frame. @param sum of the plain file's */
static enum v2v_status prepare_frame(struct work *work, uint64_t *sum, int set, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = &work->pack->info;
    V2V_TRY(V2V_FAULT_POINT("volume.pack"));
    V2V_TRY(read_frame(work, set, t));
    uint64_t part = work->checksum != NULL ? checksum_of(work, set, t) : 0;
    *sum += part;
    if (info->storage.sample == V2V_SAMPLE_UINT16) {
        work->clipped[t] += v2v_rounding_apply(
            work->frame, info->slices * info->height * info->width, work->step[set]);
        part = work->checksum != NULL && work->h5 != NULL ? checksum_of(work, set, t) : 0;
    }
    work->sums[t] = (int64_t)((uint64_t)work->sums[t] + part);
    if (work->h5 != NULL) {
        V2V_TRY(v2v_h5_packed_encode(work->h5, work->frame));
    }
done:
    return rc;
}

/* Collective(comm): a frame of each rank in turn, from `first` on. */
static enum v2v_status write_round(struct work *work, int set, int64_t first)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = &work->pack->info;
    const int rank = v2v_comm_rank(work->comm), size = v2v_comm_size(work->comm);
    for (int r = 0; r < size && first + r < info->frames; r++) {
        v2v_watchdog_beat("writing a packed frame");
        V2V_TRY(work->h5 != NULL ? v2v_h5_packed_put(work->h5, set, first + r, r)
                                 : v2v_volume_tiff_write(work->tiff, work->frame, first + r, 0,
                                                         rank == r ? info->slices : 0));
    }
done:
    return rc;
}

/* Collective(comm): a frame of each rank, from `first` on. */
static enum v2v_status pack_round(struct work *work, int64_t first)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = &work->pack->info;
    const int64_t t = first + v2v_comm_rank(work->comm);
    const int is_mine = t < info->frames;
    uint64_t sum = 0;
    for (int set = 0; set < V2V_H5_WRITER_SETS; set++) {
        if (!has_set(work, set)) {
            continue;
        }
        V2V_TRY(v2v_par_agree(work->comm, is_mine ? prepare_frame(work, &sum, set, t) : V2V_OK));
        V2V_TRY(write_round(work, set, first));
    }
    if (is_mine && work->checksum != NULL && sum != work->checksum[t]) {
        rc = V2V_FAIL(V2V_E_INPUT, "%s: frame %lld is damaged: its checksum doesn't hold",
                      work->part, (long long)t);
    }
    V2V_TRY(v2v_par_agree(work->comm, rc));
done:
    return rc;
}

static enum v2v_status create(struct work *work, const char *packed)
{
    const struct v2v_volume_pack *pack = work->pack;
    const struct v2v_volume_tiff_plan tiff = {.is_ome = pack->is_ome,
                                              .is_packed = 1,
                                              .step = work->step[V2V_VOLUME_MEAN],
                                              .told = pack->told};
    return pack->is_tiff
               ? v2v_volume_tiff_create(&work->tiff, packed, &pack->info, &tiff, work->comm)
               : v2v_h5_packed_create(&work->h5, packed, pack, work->part, work->step, work->comm);
}

/* Collective(comm). */
static enum v2v_status finish(struct work *work)
{
    const int64_t frames = work->pack->info.frames;
    v2v_par_sum_i64(work->comm, work->sums, frames);
    v2v_par_sum_i64(work->comm, work->clipped, frames);
    if (work->tiff != NULL) {
        return v2v_volume_tiff_finish(&work->tiff);
    }
    return v2v_h5_packed_finish(&work->h5, work->checksum != NULL ? work->sums : NULL,
                                work->clipped);
}

/* Local: what integers cost. */
static void report(const struct work *work)
{
    int64_t clipped = 0;
    for (int64_t t = 0; t < work->pack->info.frames; t++) {
        clipped += work->clipped[t];
    }
    if (v2v_comm_rank(work->comm) == 0) {
        v2v_rounding_report(work->pack->path, work->step[V2V_VOLUME_MEAN], clipped);
    }
}

enum v2v_status v2v_volume_pack_run(const struct v2v_volume_pack *pack, const char *packed,
                                    const char *part, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct work work = {.pack = pack, .comm = comm, .part = part};
    V2V_TRY(v2v_par_agree(comm, open_part(&work)));
    if (pack->info.storage.sample == V2V_SAMPLE_UINT16) {
        V2V_TRY(settle_steps(&work));
    }
    V2V_TRY(create(&work, packed));
    for (int64_t first = 0; first < pack->info.frames; first += v2v_comm_size(comm)) {
        v2v_watchdog_beat("packing a frame");
        V2V_TRY(pack_round(&work, first));
    }
    V2V_TRY(finish(&work));
    if (pack->info.storage.sample == V2V_SAMPLE_UINT16) {
        report(&work);
    }
done:
    v2v_volume_tiff_abandon(&work.tiff);
    v2v_h5_packed_abandon(&work.h5);
    v2v_h5_summed_close(&work.source);
    v2v_mem_free(work.frame);
    v2v_mem_free(work.clipped);
    v2v_mem_free(work.sums);
    v2v_mem_free(work.checksum);
    return rc;
}
