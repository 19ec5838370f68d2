#include "v2v3d/optics/shifts.h"
#include "optics/moments.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/psf.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Centroids this near to the middle of two pixels lie there, as those of symmetric slices of even
 * sides do: what samples are rounded by, or scaled, decides nothing then. */
static const double rounding = 1e-5;

/* One axis: the pixel nearest to the flipped slice's centroid, seen from the centre pixel. A
 * flipped slice is convolved, hence the sign: feat is read where the PSF puts the light. For even
 * sides the flip moves the centre pixel by one, which the reference doesn't undo
 * (golden/alignment.h5). Halfway, the even one. */
static int32_t shift_of(double moment, double energy, int64_t side)
{
    const double flipped = (double)(side - 1) - moment / energy;
    const double halves = nearbyint(2.0 * flipped) / 2.0;
    const double place = fabs(flipped - halves) < rounding ? halves : flipped;
    return (int32_t)(v2v_psf_centre(side) - (int64_t)nearbyint(place));
}

enum v2v_status v2v_shifts_from_psf(struct v2v_shifts *shifts, const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    const int64_t count = psf->views * psf->slices;

    *shifts = (struct v2v_shifts){.views = psf->views, .slices = psf->slices};
    V2V_TRY(V2V_ALLOC(shifts->dy, "shifts", count));
    V2V_TRY(V2V_ALLOC(shifts->dx, "shifts", count));
    for (int64_t i = 0; i < count; i++) {
        double moment[3];
        v2v_slice_moments(moment, psf->data + i * psf->height * psf->width, psf->height,
                          psf->width);
        if (moment[0] > 0) {
            shifts->dy[i] = shift_of(moment[1], moment[0], psf->height);
            shifts->dx[i] = shift_of(moment[2], moment[0], psf->width);
        }
    }
done:
    if (rc != V2V_OK) {
        v2v_shifts_fini(shifts);
    }
    return rc;
}

enum v2v_status v2v_shifts_copy(struct v2v_shifts *copy, const struct v2v_shifts *shifts)
{
    enum v2v_status rc = V2V_OK;
    const int64_t count = shifts->views * shifts->slices;
    *copy = (struct v2v_shifts){.views = shifts->views, .slices = shifts->slices};
    V2V_TRY(V2V_ALLOC(copy->dy, "shifts", count));
    V2V_TRY(V2V_ALLOC(copy->dx, "shifts", count));
    memcpy(copy->dy, shifts->dy, (size_t)count * sizeof *copy->dy);
    memcpy(copy->dx, shifts->dx, (size_t)count * sizeof *copy->dx);
done:
    if (rc != V2V_OK) {
        v2v_shifts_fini(copy);
    }
    return rc;
}

void v2v_shifts_fini(struct v2v_shifts *shifts)
{
    v2v_mem_free(shifts->dy);
    v2v_mem_free(shifts->dx);
    *shifts = (struct v2v_shifts){0};
}

int64_t v2v_shifts_reach(const struct v2v_shifts *shifts)
{
    int64_t reach = 0;
    for (int64_t i = 0; i < shifts->views * shifts->slices; i++) {
        const int64_t dy = labs(shifts->dy[i]), dx = labs(shifts->dx[i]);
        reach = dy > reach ? dy : reach;
        reach = dx > reach ? dx : reach;
    }
    return reach;
}

/* Twice the coordinate about which a set must be mirrored along an axis to become itself: that of
 * its whole centroid, to half a pixel. It need not be the centre pixel: a set that lies d pixels
 * off is mirrored to one that lies 2d pixels elsewhere, the same for all views, which is but a
 * displacement of the unseen volume. (psf/2psam is exact about pixel 64 of 128, its centre is 63.)
 */
static int64_t mirror_of(const struct v2v_psf_file *psf, int axis)
{
    double total = 0, total_moment = 0;
    for (int64_t i = 0; i < psf->views * psf->slices; i++) {
        double moment[3];
        v2v_slice_moments(moment, psf->data + i * psf->height * psf->width, psf->height,
                          psf->width);
        total += moment[0];
        total_moment += moment[1 + axis];
    }
    return total > 0 ? (int64_t)nearbyint(2 * total_moment / total) : 0;
}

/* ||flip(a) - b|| / ||b|| of two PSFs [z,y,x], pixel k becoming mirror - k. A pixel whose partner
 * lies outside is compared with 0. */
static double flipped_distance(const float *a, const float *b, const struct v2v_psf_file *psf,
                               int axis, int64_t mirror)
{
    const int64_t height = psf->height, width = psf->width;
    double difference = 0, norm = 0;
    for (int64_t z = 0; z < psf->slices; z++) {
        const float *slice_a = a + z * height * width, *slice_b = b + z * height * width;
        for (int64_t y = 0; y < height; y++) {
            for (int64_t x = 0; x < width; x++) {
                const int64_t from_y = axis == 0 ? mirror - y : y;
                const int64_t from_x = axis == 1 ? mirror - x : x;
                const int inside = from_y >= 0 && from_y < height && from_x >= 0 && from_x < width;
                const double flipped = inside ? slice_a[from_y * width + from_x] : 0.0;
                const double value = slice_b[y * width + x];
                difference += (flipped - value) * (flipped - value);
                norm += value * value;
            }
        }
    }
    return norm > 0 ? sqrt(difference / norm) : (difference > 0 ? INFINITY : 0.0);
}

static int is_taken(const int32_t *partner, int64_t count, int64_t w)
{
    for (int64_t v = 0; v < count; v++) {
        if (partner[v] == w) {
            return 1;
        }
    }
    return 0;
}

int v2v_shifts_flip_partner(int32_t *partner, const struct v2v_psf_file *psf, int axis,
                            double tolerance)
{
    const int64_t one_view = psf->slices * psf->height * psf->width;

    V2V_ASSERT(axis == 0 || axis == 1);
    const int64_t mirror = mirror_of(psf, axis);
    for (int64_t v = 0; v < psf->views; v++) {
        double least = INFINITY;
        for (int64_t w = 0; w < psf->views; w++) {
            if (is_taken(partner, v, w)) {
                continue;
            }
            const double distance = flipped_distance(psf->data + v * one_view,
                                                     psf->data + w * one_view, psf, axis, mirror);
            if (distance < least) {
                least = distance;
                partner[v] = (int32_t)w;
            }
        }
        if (!(least <= tolerance)) {
            return 0;
        }
    }
    return 1;
}

/* y[p] = sum over q of x[q] h[p - q + c], of n pixels, and h'[k] = h[m - k]: with x'[q] = x[n-1-q],
 * y[n-1-p] = sum over q of x'[q] h'[p - (q + 2c - m) + c]. */
int64_t v2v_shifts_flip_moves(const struct v2v_psf_file *psf, int axis)
{
    const int64_t side = axis == 0 ? psf->height : psf->width;
    return 2 * v2v_psf_centre(side) - mirror_of(psf, axis);
}
