#include "v2v3d/sim/recording.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/optics/calibration.h"
#include "v2v3d/optics/grouped.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/statistics.h"

struct v2v_simulator {
    const struct v2v_comm *comm;
    struct v2v_grouped *projector;             /* NULL: of planes */
    const struct v2v_calibration *calibration; /* NULL: none */
    struct v2v_part slices;                    /* of this rank, to project */
    struct v2v_part mine;                      /* views of this rank, to write */
    int64_t depth, views, height, width;
    int64_t pixels; /* of one view */
    float *slab;    /* [slices of this rank,y,x] */
    float *clean;   /* [v,y,x] */
    float *noisy;   /* [views of this rank,y,x] */
    float *scratch; /* [y,x] */
};

/* The files that a simulation writes; NULL where it does not. */
struct outputs {
    struct v2v_recording_writer *noisy, *clean;
    struct v2v_volume_writer *truth;
};

/* Local: memory for a planned simulator. */
static enum v2v_status take_memory(struct v2v_simulator *simulator)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = simulator->pixels, views = simulator->views;
    V2V_TRY(V2V_ALLOC(simulator->slab, "sim.slices", simulator->slices.count * pixels));
    V2V_TRY(V2V_ALLOC(simulator->clean, "sim.views", views * pixels));
    V2V_TRY(V2V_ALLOC(simulator->scratch, "sim.distorted", pixels));
    V2V_TRY(V2V_ALLOC(simulator->noisy, "sim.noisy", simulator->mine.count * pixels));
done:
    return rc;
}

enum v2v_status v2v_simulator_create(struct v2v_simulator **simulator,
                                     const struct v2v_psf_file *psf, int64_t height, int64_t width,
                                     const struct v2v_calibration *calibration,
                                     const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_simulator *fresh = NULL;
    *simulator = NULL;
    if (calibration != NULL) {
        V2V_TRY(v2v_calibration_check(calibration, psf->views, height, width,
                                      "the volume's projection"));
    }
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(fresh, "sim.simulator", 1)));
    fresh->comm = comm;
    fresh->calibration = calibration;
    fresh->depth = psf->slices;
    fresh->views = psf->views;
    fresh->height = height;
    fresh->width = width;
    fresh->pixels = height * width;
    fresh->mine = v2v_par_part(psf->views, v2v_comm_size(comm), v2v_comm_rank(comm));
    fresh->slices = v2v_par_part(psf->slices, v2v_comm_size(comm), v2v_comm_rank(comm));
    V2V_TRY(v2v_par_agree(comm, take_memory(fresh)));
    if (psf->data != NULL) {
        V2V_TRY(v2v_grouped_create(&fresh->projector, psf, height, width, V2V_SPLIT_SLICES,
                                   INT64_MAX, comm));
    }
    *simulator = fresh;
    fresh = NULL;
done:
    v2v_simulator_destroy(&fresh);
    return rc;
}

void v2v_simulator_destroy(struct v2v_simulator **simulator)
{
    struct v2v_simulator *old = *simulator;
    if (old == NULL) {
        return;
    }
    v2v_mem_free(old->noisy);
    v2v_mem_free(old->scratch);
    v2v_mem_free(old->clean);
    v2v_mem_free(old->slab);
    v2v_grouped_destroy(&old->projector);
    v2v_mem_free(old);
    *simulator = NULL;
}

static enum v2v_status check(const struct v2v_simulator *simulator,
                             const struct v2v_simulation *simulation)
{
    V2V_ASSERT((simulator->projector == NULL) == (simulation->planes != NULL));
    const int64_t slices = simulation->volume != NULL  ? v2v_volume_info(simulation->volume)->slices
                           : simulation->scene != NULL ? simulation->scene->slices
                                                       : 0;
    if (simulation->frames < 1) {
        return V2V_FAIL(V2V_E_USAGE, "a recording of %lld frames", (long long)simulation->frames);
    }
    if (slices != simulator->depth) {
        return V2V_FAIL(V2V_E_INPUT, "the volume has %lld slices, the PSF set %lld",
                        (long long)slices, (long long)simulator->depth);
    }
    return V2V_OK;
}

/* Frames that differ: the others show them again. */
static int64_t count_sources(const struct v2v_simulation *simulation)
{
    const int64_t frames = simulation->frames;
    const int64_t own = simulation->volume != NULL ? v2v_volume_info(simulation->volume)->frames
                        : simulation->scene != NULL && simulation->scene->motion_um > 0 ? frames
                                                                                        : 1;
    return v2v_smaller(own, frames);
}

static enum v2v_status open_outputs(struct outputs *outputs, const struct v2v_simulator *simulator,
                                    const struct v2v_simulation *simulation)
{
    enum v2v_status rc = V2V_OK;
    const int is_camera = simulation->noise.kind == V2V_NOISE_CAMERA;
    struct v2v_recording_info info = {.frames = simulation->frames,
                                      .views = simulator->views,
                                      .height = simulator->height,
                                      .width = simulator->width,
                                      .pixel_size_um = simulation->pixel_size_um,
                                      .frame_interval_s = simulation->frame_interval_s,
                                      .offset = is_camera ? simulation->noise.offset : 0,
                                      .is_uint16 = is_camera};
    const struct v2v_volume_info truth = {.frames = count_sources(simulation),
                                          .slices = simulator->depth,
                                          .height = simulator->height,
                                          .width = simulator->width,
                                          .pixel_size_um = simulation->pixel_size_um,
                                          .slice_spacing_um = simulation->slice_spacing_um,
                                          .frame_interval_s = simulation->frame_interval_s};
    V2V_TRY(v2v_recording_create(&outputs->noisy, simulation->output, &info, simulator->comm));
    info.is_uint16 = 0;
    if (simulation->clean != NULL) {
        V2V_TRY(v2v_recording_create(&outputs->clean, simulation->clean, &info, simulator->comm));
    }
    if (simulation->truth != NULL) {
        V2V_TRY(v2v_volume_create(&outputs->truth, simulation->truth, &truth, 1u << V2V_VOLUME_MEAN,
                                  NULL, 0, simulator->comm));
    }
done:
    return rc;
}

static enum v2v_status finish_outputs(struct outputs *outputs)
{
    enum v2v_status rc = V2V_OK;
    if (outputs->truth != NULL) {
        V2V_TRY(v2v_volume_finish(&outputs->truth));
    }
    if (outputs->clean != NULL) {
        V2V_TRY(v2v_recording_finish(&outputs->clean));
    }
    V2V_TRY(v2v_recording_finish(&outputs->noisy));
done:
    return rc;
}

/* All ranks hold the clean views of source frame t; its volume is written where asked. */
static enum v2v_status project_frame(struct v2v_simulator *simulator,
                                     const struct v2v_simulation *simulation,
                                     struct v2v_volume_writer *truth, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_part slices = simulator->slices;
    v2v_watchdog_beat("projecting a frame");
    for (int64_t v = 0; simulation->planes != NULL && v < simulator->views; v++) {
        v2v_planes_draw(simulator->clean + v * simulator->pixels, simulation->planes, v);
    }
    if (simulation->planes != NULL) {
        return V2V_OK;
    }
    if (simulation->volume != NULL) {
        rc = v2v_volume_read(simulation->volume, simulator->slab, t, slices.first, slices.count);
    } else {
        v2v_watchdog_beat("drawing a scene");
        v2v_scene_draw(simulator->slab, simulation->scene, t, slices.first, slices.count);
    }
    V2V_TRY(v2v_par_agree(simulator->comm, rc));
    if (truth != NULL) {
        V2V_TRY(v2v_volume_write(truth, V2V_VOLUME_MEAN, simulator->slab, t, slices.first,
                                 slices.count));
        V2V_TRY(v2v_volume_mark_done(truth, t, simulator->comm));
    }
    V2V_TRY(v2v_grouped_forward(simulator->projector, simulator->clean, simulator->slab, 1.0f));
    if (simulator->calibration != NULL) {
        v2v_calibration_distort(simulator->clean, simulator->scratch, simulator->calibration,
                                simulator->height, simulator->width);
    }
    if (v2v_first_not_finite(simulator->clean, simulator->views * simulator->pixels) >= 0) {
        rc = V2V_FAIL(V2V_E_NUMERIC, "frame %lld: its views leave the range of float32",
                      (long long)t);
    }
    V2V_TRY(v2v_par_agree(simulator->comm, rc));
done:
    return rc;
}

/* Each rank writes its views of frame t, noisy and clean. */
static enum v2v_status write_frame(struct v2v_simulator *simulator, const struct outputs *outputs,
                                   const struct v2v_simulation *simulation, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_noise *noise = &simulation->noise;
    const struct v2v_part mine = simulator->mine;
    const int64_t first = mine.first * simulator->pixels, count = mine.count * simulator->pixels;
    v2v_watchdog_beat("writing a frame");
    V2V_TRY(v2v_par_agree(simulator->comm,
                          v2v_stop_requested()
                              ? V2V_FAIL(V2V_STOPPED, "stopped on request; nothing is kept")
                              : V2V_OK));
    v2v_noise_apply(simulator->noisy, simulator->clean + first, count, noise, simulation->seed, t,
                    first);
    V2V_TRY(v2v_recording_write(outputs->noisy, simulator->noisy, t, mine.first, mine.count));
    if (outputs->clean != NULL) {
        v2v_noise_expected(simulator->noisy, simulator->clean + first, count, noise);
        V2V_TRY(v2v_recording_write(outputs->clean, simulator->noisy, t, mine.first, mine.count));
    }
done:
    return rc;
}

enum v2v_status v2v_simulator_record(struct v2v_simulator *simulator,
                                     struct v2v_simulation *simulation)
{
    enum v2v_status rc = V2V_OK;
    struct outputs outputs = {0};
    V2V_TRY(check(simulator, simulation)); /* the same arguments, so the same verdict, everywhere */
    V2V_TRY(open_outputs(&outputs, simulator, simulation));
    const int64_t sources = count_sources(simulation);
    const int64_t samples = simulator->views * simulator->pixels;
    v2v_stop_heed_ending();
    for (int64_t source = 0; source < sources; source++) {
        V2V_TRY(project_frame(simulator, simulation, outputs.truth, source));
        if (source == 0) {
            rc = v2v_noise_level(&simulation->noise, simulator->clean, samples);
        }
        if (rc == V2V_OK) {
            rc = v2v_noise_check(&simulation->noise, simulator->clean, samples);
        }
        V2V_TRY(v2v_par_agree(simulator->comm, rc));
        for (int64_t t = source; t < simulation->frames; t += sources) {
            V2V_TRY(write_frame(simulator, &outputs, simulation, t));
        }
    }
    V2V_TRY(finish_outputs(&outputs));
done:
    v2v_volume_abandon(&outputs.truth);
    v2v_recording_abandon(&outputs.clean);
    v2v_recording_abandon(&outputs.noisy);
    return rc;
}
