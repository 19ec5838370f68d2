#include "v2v3d/sim/recording.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/optics/calibration.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/par/watchdog.h"

struct job {
    struct v2v_projector *projector;
    struct v2v_recording_writer *writer;
    struct v2v_part slices;                    /* of this rank, to project */
    int64_t row_pixels;                        /* of a view, of this rank */
    struct v2v_part mine;                      /* views of this rank, to write */
    int64_t views, pixels;                     /* pixels of one view */
    float *slab;                               /* [slices of this rank,y,x] */
    float *rows;                               /* [v, rows of this rank, x] */
    float *clean;                              /* [v,y,x] */
    float *noisy;                              /* [views of this rank,y,x] */
    float *scratch;                            /* [y,x] */
    const struct v2v_calibration *calibration; /* NULL: none */
};

static enum v2v_status check(const struct v2v_volume_info *info, const struct v2v_psf_file *psf,
                             int64_t frames)
{
    if (frames < 1) {
        return V2V_FAIL(V2V_E_USAGE, "a recording of %lld frames", (long long)frames);
    }
    if (info->slices != psf->slices) {
        return V2V_FAIL(V2V_E_INPUT, "the volume has %lld slices, the PSF set %lld",
                        (long long)info->slices, (long long)psf->slices);
    }
    return V2V_OK;
}

/** Local: memory for a planned job. */
static enum v2v_status job_take(struct job *job)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(V2V_ALLOC(job->slab, "sim.slices", job->slices.count * job->pixels));
    V2V_TRY(V2V_ALLOC(job->rows, "sim.views", job->views * job->row_pixels));
    V2V_TRY(V2V_ALLOC(job->clean, "sim.views", job->views * job->pixels));
    V2V_TRY(V2V_ALLOC(job->scratch, "sim.distorted", job->pixels));
    V2V_TRY(V2V_ALLOC(job->noisy, "sim.noisy", job->mine.count * job->pixels));
done:
    return rc;
}

/** Collective(comm): all ranks hold the clean views of the volume's frame t. */
static enum v2v_status project_frame(struct job *job, struct v2v_volume *volume, int64_t t,
                                     const struct v2v_comm *comm)
{
    v2v_watchdog_beat("projecting a frame");
    enum v2v_status rc =
        v2v_volume_read(volume, job->slab, t, job->slices.first, job->slices.count);
    V2V_TRY(v2v_par_agree(comm, rc));
    v2v_projector_forward(job->projector, job->rows, job->slab, NULL, job->views, 1.0f);
    v2v_projector_gather_views(job->projector, job->clean, job->rows, job->views);
    if (job->calibration != NULL) {
        v2v_calibration_distort(job->clean, job->scratch, job->calibration);
    }
done:
    return rc;
}

/** Collective(comm): each rank adds the noise of its views and writes them. */
static enum v2v_status write_frame(struct job *job, const struct v2v_noise *noise, uint64_t seed,
                                   int64_t t)
{
    int64_t first = job->mine.first * job->pixels;
    v2v_watchdog_beat("writing a frame");
    v2v_noise_apply(job->noisy, job->clean + first, job->mine.count * job->pixels, noise, seed, t,
                    first);
    return v2v_recording_write(job->writer, job->noisy, t, job->mine.first, job->mine.count);
}

enum v2v_status v2v_simulate_recording(const char *output, struct v2v_volume *volume,
                                       const struct v2v_psf_file *psf, struct v2v_noise *noise,
                                       uint64_t seed, int64_t frames,
                                       const struct v2v_calibration *calibration,
                                       const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct job job = {.calibration = calibration};
    const struct v2v_volume_info *info = v2v_volume_info(volume);
    V2V_TRY(check(info, psf, frames)); /* the same arguments, so the same verdict, on all ranks */
    if (calibration != NULL) {
        V2V_TRY(v2v_calibration_check(calibration, psf->views, info->height, info->width,
                                      "the volume's projection"));
    }
    V2V_TRY(v2v_projector_create(&job.projector, psf, info->height, info->width, V2V_SPLIT_SLICES,
                                 comm));
    job.views = psf->views;
    job.pixels = info->height * info->width;
    const struct v2v_projector_share share = v2v_projector_share(job.projector);
    job.slices = share.slices;
    job.row_pixels = share.view_rows.count * info->width;
    job.mine = v2v_par_part(psf->views, v2v_comm_size(comm), v2v_comm_rank(comm));
    V2V_TRY(v2v_par_agree(comm, job_take(&job)));

    struct v2v_recording_info out = {.frames = frames,
                                     .views = psf->views,
                                     .height = info->height,
                                     .width = info->width,
                                     .pixel_size_um = info->pixel_size_um > 0 ? info->pixel_size_um
                                                                              : psf->pixel_size_um,
                                     .frame_interval_s = info->frame_interval_s};
    V2V_TRY(v2v_recording_create(&job.writer, output, &out, comm));
    for (int64_t source = 0; source < info->frames && source < frames; source++) {
        V2V_TRY(project_frame(&job, volume, source, comm));
        if (source == 0) {
            V2V_TRY(v2v_par_agree(comm, v2v_noise_level(noise, job.clean, job.views * job.pixels)));
        }
        for (int64_t t = source; t < frames; t += info->frames) {
            V2V_TRY(write_frame(&job, noise, seed, t));
        }
    }
    V2V_TRY(v2v_recording_finish(&job.writer));
done:
    v2v_recording_abandon(&job.writer);
    v2v_mem_free(job.noisy);
    v2v_mem_free(job.scratch);
    v2v_mem_free(job.clean);
    v2v_mem_free(job.rows);
    v2v_mem_free(job.slab);
    v2v_projector_destroy(&job.projector);
    return rc;
}
