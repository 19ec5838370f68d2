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
    struct v2v_projector_share share; /* of this rank */
    int64_t views, height, width;
    double weight;
    double constant_view; /* mean over views and pixels of the projection of a volume of ones */
    float *volume;        /* [slices,rows,x] where that is not what the caller holds, else NULL */
    float *ratio;         /* [view_rows,x]: projection, then recorded / projected */
    float *correction;    /* [slices,rows,x]: A_v^T ratio */
    double *seen;         /* [slices,x]: a row of A_v^T 1 for each slice */
    uint8_t *blind;       /* [v,view_rows,x]: no voxel of the frame lights this pixel */
};

/* Pixels of a view that this rank holds. */
static int64_t pixels_here(const struct v2v_rld *rld)
{
    return rld->share.view_rows.count * rld->width;
}

/* What only the creation needs. */
struct scratch {
    double *light;  /* [view_rows,x] */
    double *table;  /* [ky 0..K, kx 0..K] */
    double *of_row; /* [v,y]: a row's light */
};

/** Project a volume of ones: its mean, and the pixels that stay dark. Collective(comm). The mean's
 *  terms are added in one order for any number of ranks. */
static void project_ones(struct v2v_rld *rld, const struct v2v_psf_file *psf,
                         struct scratch *scratch)
{
    double sum = 0;
    int64_t pixels = pixels_here(rld), all_rows = rld->views * rld->height;
    for (int64_t v = 0; v < rld->views; v++) {
        double *of_row = scratch->of_row + v * rld->height + rld->share.view_rows.first;
        double floor = sensitivity_floor * rld->sensitivity.total[v];
        v2v_sensitivity_light(&rld->sensitivity, scratch->light, psf, v, rld->share.view_rows,
                              scratch->table);
        for (int64_t i = 0; i < pixels; i++) {
            of_row[i / rld->width] += scratch->light[i];
            rld->blind[v * pixels + i] = !(scratch->light[i] > floor);
        }
    }
    v2v_par_sum_f64(rld->comm, scratch->of_row, all_rows);
    for (int64_t i = 0; i < all_rows; i++) {
        sum += scratch->of_row[i];
    }
    rld->constant_view = sum / (double)(all_rows * rld->width);
}

/** Local: what the run needs beside the projector, and what only its creation needs. */
static enum v2v_status take_memory(struct v2v_rld *rld, struct scratch *scratch,
                                   const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_projector_share *share = &rld->share;
    int64_t voxels = v2v_mem_product(share->slices.count, share->rows.count, rld->width);
    int64_t pixels = v2v_mem_product(share->view_rows.count, rld->width, 1);
    V2V_TRY(v2v_sensitivity_init(&rld->sensitivity, psf, share->slices, rld->height, rld->width));
    V2V_TRY(V2V_ALLOC(rld->ratio, "rld.ratio", pixels));
    V2V_TRY(V2V_ALLOC(rld->correction, "rld.correction", voxels));
    V2V_TRY(V2V_ALLOC(rld->seen, "rld.seen", share->slices.count * rld->width));
    V2V_TRY(V2V_ALLOC(rld->blind, "rld.blind", v2v_mem_product(rld->views, pixels, 1)));
    if (share->rows.count < rld->height) {
        V2V_TRY(V2V_ALLOC(rld->volume, "rld.volume", voxels));
    }
    V2V_TRY(V2V_ALLOC(scratch->light, "rld.light", pixels));
    V2V_TRY(V2V_ALLOC(scratch->table, "rld.light",
                      v2v_mem_product(psf->height + 1, psf->width + 1, 1)));
    V2V_TRY(V2V_ALLOC(scratch->of_row, "rld.light", v2v_mem_product(rld->views, rld->height, 1)));
done:
    return rc;
}

enum v2v_status v2v_rld_create(struct v2v_rld **rld, const struct v2v_psf_file *psf, int64_t height,
                               int64_t width, double weight, enum v2v_split split,
                               const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_rld *made = NULL;
    struct scratch scratch = {0};
    *rld = NULL;
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(made, "rld", 1)));
    made->comm = comm;
    made->views = psf->views;
    made->height = height;
    made->width = width;
    made->weight = weight;
    V2V_TRY(v2v_projector_create(&made->projector, psf, height, width, split, comm));
    made->share = v2v_projector_share(made->projector);
    V2V_TRY(v2v_par_agree(comm, take_memory(made, &scratch, psf)));
    project_ones(made, psf, &scratch);
    *rld = made;
    made = NULL;
done:
    v2v_mem_free(scratch.of_row);
    v2v_mem_free(scratch.table);
    v2v_mem_free(scratch.light);
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
        v2v_mem_free(old->volume);
        v2v_mem_free(old->ratio);
        v2v_mem_free(old->correction);
        v2v_mem_free(old->seen);
        v2v_mem_free(old->blind);
        v2v_mem_free(old);
    }
}

struct v2v_part v2v_rld_slices(const struct v2v_rld *rld)
{
    return v2v_projector_slices(rld->projector);
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
    for (int64_t z = 0; z < rld->share.slices.count; z++) {
        double *seen = rld->seen + z * rld->width;
        for (int64_t y = 0; y < rld->share.rows.count; y++) {
            float *row = volume + (z * rld->share.rows.count + y) * rld->width;
            for (int64_t x = 0; x < rld->width; x++) {
                row[x] = 0;
            }
            for (int64_t v = 0; v < rld->views; v++) {
                double floor = sensitivity_floor * rld->sensitivity.total[v];
                v2v_sensitivity_row(&rld->sensitivity, seen, v, z, rld->share.rows.first + y);
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
    for (int64_t z = 0; z < rld->share.slices.count; z++) {
        double *seen = rld->seen + z * rld->width;
        for (int64_t y = 0; y < rld->share.rows.count; y++) {
            int64_t row = (z * rld->share.rows.count + y) * rld->width;
            v2v_sensitivity_row(&rld->sensitivity, seen, v, z, rld->share.rows.first + y);
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
    int64_t rows = rld->share.rows.count, width = rld->width;
    int64_t bad = v2v_first_not_finite(volume, rld->share.slices.count * rows * width);
    if (bad >= 0) {
        rc = V2V_FAIL(
            V2V_E_NUMERIC, "RLD iteration %lld: NaN or Inf at slice %lld, row %lld, column %lld",
            (long long)iteration + 1, (long long)(rld->share.slices.first + bad / (rows * width)),
            (long long)(rld->share.rows.first + bad / width % rows), (long long)(bad % width));
    } else if (rc == V2V_OK && v2v_stop_requested()) {
        rc = V2V_FAIL(V2V_STOPPED, "stopped on request in RLD iteration %lld",
                      (long long)iteration + 1);
    }
    return rc;
}

static enum v2v_status iterate(struct v2v_rld *rld, float *volume, const float *views, double mean,
                               int64_t iteration)
{
    int64_t pixels = rld->height * rld->width, here = pixels_here(rld);
    const float *rows = views + rld->share.view_rows.first * rld->width;
    v2v_watchdog_beat("an RLD iteration");
    for (int32_t v = 0; v < rld->views; v++) {
        v2v_projector_forward(rld->projector, rld->ratio, volume, &v, 1, 1.0f);
        divide(rld->ratio, rows + v * pixels, rld->blind + v * here, here, mean);
        v2v_projector_adjoint(rld->projector, rld->correction, rld->ratio, &v, 1, 1.0f);
        multiply(rld, volume, v);
    }
    return v2v_par_agree(rld->comm, look(rld, volume, iteration));
}

enum v2v_status v2v_rld_run(struct v2v_rld *rld, float *volume, const float *views,
                            int64_t iterations)
{
    enum v2v_status rc = V2V_OK;
    float *own = rld->volume != NULL ? rld->volume : volume;
    double mean = 0;
    V2V_TRY(v2v_par_agree(rld->comm, mean_of_views(&mean, rld, views)));
    v2v_par_max_f64(rld->comm, &mean, 1); /* the ranks take the same branch whatever they hold */
    start(rld, own);
    /* A dark frame is a dark volume; and below FLT_MIN 1/mean would overflow. */
    int64_t needed = mean > 1e-37 ? iterations : 0;
    for (int64_t i = 0; i < needed; i++) {
        V2V_TRY(iterate(rld, own, views, mean, i));
    }
    int64_t count = rld->share.slices.count * rld->share.rows.count * rld->width;
    for (int64_t i = 0; i < count; i++) {
        own[i] = (float)(own[i] * mean);
    }
    V2V_TRY(v2v_par_agree(rld->comm, look(rld, own, iterations - 1)));
    v2v_projector_to_slices(rld->projector, volume, own);
done:
    return rc;
}
