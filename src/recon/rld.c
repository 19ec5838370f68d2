#include "v2v3d/recon/rld.h"

#include "recon/sensitivity.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/statistics.h"

#include <string.h>

/* Both floors are relative, so that the units of the recording and of the PSFs don't matter.
 * A projection below this fraction of the mean view counts as this fraction: */
static const double projection_floor = 1e-6;
/* A voxel that contributes less than this fraction of a view's total PSF to that view is invisible
 * in it (of 39 slices, an even share is 2.6e-2) and keeps its value; one that no view sees is 0. */
static const double sensitivity_floor = 1e-4;
/* The same fraction makes a pixel blind that would see less of a volume of ones: near the border of
 * a tilted view all of its voxels may lie beyond the frame. Its ratio is recorded light over round-
 * off, up to 1 / projection_floor; the adjoint takes it nowhere, but the transforms' round-off of a
 * number so large spreads over the whole volume (1e-3 of it, measured). */

struct v2v_rld {
    const struct v2v_comm *comm;
    struct v2v_projector *projector;
    struct v2v_sensitivity sensitivity;
    struct v2v_part slices; /* of this rank */
    int64_t views, height, width;
    double weight;
    double constant_view; /* mean over views and pixels of the projection of a volume of ones */
    float *ratio;         /* [y,x]: projection, then recorded / projected */
    float *correction;    /* [slices,y,x]: A_v^T ratio */
    double *seen;         /* [slices,x]: a row of A_v^T 1 for each slice */
    uint8_t *blind;       /* [v,y,x]: no voxel of the frame lights this pixel */
};

/** Project a volume of ones: its mean, and the pixels that stay dark. Collective(comm).
 *  @param light [y,x] scratch */
static void project_ones(struct v2v_rld *rld, double *light)
{
    double sum = 0;
    int64_t pixels = rld->height * rld->width;
    for (int64_t v = 0; v < rld->views; v++) {
        memset(light, 0, (size_t)pixels * sizeof *light);
        for (int64_t y = 0; y < rld->height; y++) {
            v2v_sensitivity_pixels(&rld->sensitivity, light + y * rld->width, v, y);
        }
        v2v_par_sum_f64(rld->comm, light, pixels);
        double floor = sensitivity_floor * rld->sensitivity.total[v];
        for (int64_t i = 0; i < pixels; i++) {
            sum += light[i];
            rld->blind[v * pixels + i] = !(light[i] > floor);
        }
    }
    rld->constant_view = sum / (double)(rld->views * pixels);
}

/** Local: what the run needs beside the projector, and what only its creation needs. */
static enum v2v_status take_memory(struct v2v_rld *rld, double **light,
                                   const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_sensitivity_init(&rld->sensitivity, psf, rld->slices, rld->height, rld->width));
    V2V_TRY(V2V_ALLOC(rld->ratio, "rld.ratio", v2v_mem_product(rld->height, rld->width, 1)));
    V2V_TRY(V2V_ALLOC(rld->correction, "rld.correction",
                      v2v_mem_product(rld->slices.count, rld->height, rld->width)));
    V2V_TRY(
        V2V_ALLOC(rld->seen, "rld.seen",
                  v2v_mem_product(rld->slices.count > 0 ? rld->slices.count : 1, rld->width, 1)));
    V2V_TRY(
        V2V_ALLOC(rld->blind, "rld.blind", v2v_mem_product(rld->views, rld->height, rld->width)));
    V2V_TRY(V2V_ALLOC(*light, "rld.light", v2v_mem_product(rld->height, rld->width, 1)));
done:
    return rc;
}

enum v2v_status v2v_rld_create(struct v2v_rld **rld, const struct v2v_psf_file *psf, int64_t height,
                               int64_t width, double weight, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_rld *made = NULL;
    double *light = NULL;
    *rld = NULL;
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(made, "rld", 1)));
    made->comm = comm;
    made->views = psf->views;
    made->height = height;
    made->width = width;
    made->weight = weight;
    V2V_TRY(v2v_projector_create(&made->projector, psf, height, width, comm));
    made->slices = v2v_projector_slices(made->projector);
    V2V_TRY(v2v_par_agree(comm, take_memory(made, &light, psf)));
    project_ones(made, light);
    *rld = made;
    made = NULL;
done:
    v2v_mem_free(light);
    v2v_rld_destroy(&made);
    return rc;
}

void v2v_rld_destroy(struct v2v_rld **rld)
{
    struct v2v_rld *old = *rld;
    *rld = NULL;
    if (old != NULL) {
        v2v_projector_destroy(&old->projector);
        v2v_sensitivity_fini(&old->sensitivity);
        v2v_mem_free(old->ratio);
        v2v_mem_free(old->correction);
        v2v_mem_free(old->seen);
        v2v_mem_free(old->blind);
        v2v_mem_free(old);
    }
}

struct v2v_part v2v_rld_slices(const struct v2v_rld *rld)
{
    return rld->slices;
}

/** Local: the mean of the views where they are positive, 0 elsewhere. */
static enum v2v_status mean_of_views(double *mean, const struct v2v_rld *rld, const float *views)
{
    int64_t pixels = rld->height * rld->width, count = rld->views * pixels;
    int64_t bad = v2v_first_not_finite(views, count);
    if (bad >= 0) {
        return V2V_FAIL(V2V_E_NUMERIC, "view %lld, row %lld, column %lld: NaN or Inf",
                        (long long)(bad / pixels), (long long)(bad / rld->width % rld->height),
                        (long long)(bad % rld->width));
    }
    double sum = 0;
    for (int64_t i = 0; i < count; i++) {
        sum += views[i] > 0 ? views[i] : 0;
    }
    *mean = sum / (double)count;
    return V2V_OK;
}

/** Constant start whose projections have mean 1; 0 where no view sees the voxel. */
static void start(const struct v2v_rld *rld, float *volume)
{
    float value = rld->constant_view > 0 ? (float)(1 / rld->constant_view) : 0;
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < rld->slices.count; z++) {
        double *seen = rld->seen + z * rld->width;
        for (int64_t y = 0; y < rld->height; y++) {
            float *row = volume + (z * rld->height + y) * rld->width;
            for (int64_t x = 0; x < rld->width; x++) {
                row[x] = 0;
            }
            for (int64_t v = 0; v < rld->views; v++) {
                double floor = sensitivity_floor * rld->sensitivity.total[v];
                v2v_sensitivity_row(&rld->sensitivity, seen, v, z, y);
                for (int64_t x = 0; x < rld->width; x++) {
                    row[x] = seen[x] > floor ? value : row[x];
                }
            }
        }
    }
}

/** ratio <- recorded / projected, in units of the mean view; 0 where the view is blind. */
static void divide(float *ratio, const float *recorded, const uint8_t *blind, int64_t count,
                   double mean)
{
    float scale = (float)(1 / mean), least = (float)projection_floor;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < count; i++) {
        float above = recorded[i] > 0 && !blind[i] ? recorded[i] * scale : 0;
        ratio[i] = above / (ratio[i] > least ? ratio[i] : least);
    }
}

/** x <- max(x * ((1-w) + w * correction / seen), 0) where the view sees the voxel. */
static void multiply(const struct v2v_rld *rld, float *volume, int64_t v)
{
    double floor = sensitivity_floor * rld->sensitivity.total[v], w = rld->weight;
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < rld->slices.count; z++) {
        double *seen = rld->seen + z * rld->width;
        for (int64_t y = 0; y < rld->height; y++) {
            int64_t row = (z * rld->height + y) * rld->width;
            v2v_sensitivity_row(&rld->sensitivity, seen, v, z, y);
            for (int64_t x = 0; x < rld->width; x++) {
                double factor =
                    seen[x] > floor ? (1 - w) + w * (double)rld->correction[row + x] / seen[x] : 1;
                volume[row + x] = factor < 0 ? 0 : (float)(volume[row + x] * factor);
            }
        }
    }
}

/** Local: NaN, Inf, a fault point or a request to stop, each found by one rank, end all ranks. */
static enum v2v_status look(const struct v2v_rld *rld, const float *volume, int64_t iteration)
{
    enum v2v_status rc = V2V_FAULT_POINT("rld.iteration");
    int64_t pixels = rld->height * rld->width;
    int64_t bad = v2v_first_not_finite(volume, rld->slices.count * pixels);
    if (bad >= 0) {
        rc = V2V_FAIL(V2V_E_NUMERIC,
                      "RLD iteration %lld: NaN or Inf at slice %lld, row %lld, column %lld",
                      (long long)iteration + 1, (long long)(rld->slices.first + bad / pixels),
                      (long long)(bad / rld->width % rld->height), (long long)(bad % rld->width));
    } else if (rc == V2V_OK && v2v_stop_requested()) {
        rc = V2V_FAIL(V2V_STOPPED, "stopped on request in RLD iteration %lld",
                      (long long)iteration + 1);
    }
    return rc;
}

static enum v2v_status iterate(struct v2v_rld *rld, float *volume, const float *views, double mean,
                               int64_t iteration)
{
    int64_t pixels = rld->height * rld->width;
    v2v_watchdog_beat("an RLD iteration");
    for (int32_t v = 0; v < rld->views; v++) {
        v2v_projector_forward(rld->projector, rld->ratio, volume, &v, 1);
        divide(rld->ratio, views + v * pixels, rld->blind + v * pixels, pixels, mean);
        v2v_projector_adjoint(rld->projector, rld->correction, rld->ratio, &v, 1);
        multiply(rld, volume, v);
    }
    return v2v_par_agree(rld->comm, look(rld, volume, iteration));
}

enum v2v_status v2v_rld_run(struct v2v_rld *rld, float *volume, const float *views,
                            int64_t iterations)
{
    enum v2v_status rc = V2V_OK;
    double mean = 0;
    V2V_TRY(v2v_par_agree(rld->comm, mean_of_views(&mean, rld, views)));
    v2v_par_max_f64(rld->comm, &mean, 1); /* the ranks take the same branch whatever they hold */
    start(rld, volume);
    /* A dark frame is a dark volume; and below FLT_MIN 1/mean would overflow. */
    int64_t needed = mean > 1e-37 ? iterations : 0;
    for (int64_t i = 0; i < needed; i++) {
        V2V_TRY(iterate(rld, volume, views, mean, i));
    }
    int64_t count = rld->slices.count * rld->height * rld->width;
    for (int64_t i = 0; i < count; i++) {
        volume[i] = (float)(volume[i] * mean);
    }
    V2V_TRY(v2v_par_agree(rld->comm, look(rld, volume, iterations - 1)));
done:
    return rc;
}
