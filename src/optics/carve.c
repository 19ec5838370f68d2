#include "v2v3d/optics/carve.h"
#include "v2v3d/base/bounds.h"

#include "v2v3d/base/clones.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/statistics.h"

#include <float.h>
#include <math.h>
#include <omp.h>
#include <string.h>

enum { TILE = V2V_CARVE_TILE, BOX = V2V_CARVE_BOX, HALF = BOX / 2 };

/* Pixels of a vector; pixels of a row at a time: those of all views stay in the first-level cache.
 */
enum { LANES = 16, STRETCH = 256 };

/* The brightest views / CUT of a place are left out, but not more than MOST_CUT. */
enum { CUT = 2, MOST_CUT = 32 };

/* Of 13 views, whose loops the compiler unrolls. */
enum { USUAL_CUT = 13 / CUT };

/* A view's noise and background come from so many pixels. */
enum { PROBES = 8192 };

struct v2v_carve {
    struct v2v_shifts shifts; /* a copy */
    int64_t height, width, ring;
    int64_t cut;
    int threads;        /* as many as there is scratch for */
    float *smooth;      /* [v,y+2*ring,x+2*ring], and a vector that reaches beyond */
    float *light;       /* of a thread: [STRETCH] */
    const float **view; /* of a thread: [v] rows of a slice */
    float *probes;      /* of a thread */
    float *noise;       /* [v] */
};

enum v2v_status v2v_carve_create(struct v2v_carve **carve, const struct v2v_shifts *shifts,
                                 int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_carve *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "carve", 1));
    self->threads = omp_get_max_threads();
    self->height = height;
    self->width = width;
    self->ring = v2v_shifts_reach(shifts);
    self->cut = v2v_smaller(shifts->views / CUT, MOST_CUT);
    V2V_TRY(v2v_shifts_copy(&self->shifts, shifts));
    int64_t smooth =
        v2v_mem_product(shifts->views, height + 2 * self->ring, width + 2 * self->ring);
    V2V_TRY(V2V_ALLOC(self->smooth, "carve", smooth < 0 ? smooth : smooth + LANES));
    V2V_TRY(V2V_ALLOC(self->light, "carve", (int64_t)self->threads * STRETCH));
    V2V_TRY(V2V_ALLOC(self->view, "carve", self->threads * shifts->views));
    V2V_TRY(V2V_ALLOC(self->probes, "carve", self->threads * PROBES));
    V2V_TRY(V2V_ALLOC(self->noise, "carve", shifts->views));
done:
    if (rc != V2V_OK) {
        v2v_carve_destroy(&self);
    }
    *carve = self;
    return rc;
}

void v2v_carve_destroy(struct v2v_carve **carve)
{
    struct v2v_carve *self = *carve;
    if (self == NULL) {
        return;
    }
    v2v_shifts_fini(&self->shifts);
    v2v_mem_free(self->smooth);
    v2v_mem_free(self->light);
    v2v_mem_free((void *)self->view);
    v2v_mem_free(self->probes);
    v2v_mem_free(self->noise);
    v2v_mem_free(self);
    *carve = NULL;
}

/* ---- one view: noise, smoothing, background ---- */

/* The value below which `share` of the probes lie. */
static double quantile(float *probes, int64_t count, double share)
{
    if (count == 0) {
        return 0.0; /* a frame of two columns has no second differences */
    }
    return (double)v2v_select(probes, count, (int64_t)(share * (double)(count - 1)));
}

/* From pixel to pixel of the probes: odd, so that they do not share columns. */
static int64_t probe_step(const struct v2v_carve *carve)
{
    int64_t step = (carve->height * carve->width + PROBES - 1) / PROBES;
    return step | 1;
}

/* Standard deviation of white noise in a view, by the median of second differences along x, to
 * which smooth structures add nothing. */
static double noise_of(const struct v2v_carve *carve, float *probes, const float *view)
{
    int64_t pixels = carve->height * carve->width, step = probe_step(carve), count = 0;
    for (int64_t i = 0; i < pixels; i += step) {
        int64_t x = i % carve->width;
        if (x > 0 && x < carve->width - 1) {
            probes[count++] = fabsf(2.0f * view[i] - view[i - 1] - view[i + 1]);
        }
    }
    const double median_to_deviation = 1.4826, gain = sqrt(6.0);
    return median_to_deviation / gain * quantile(probes, count, 0.5);
}

V2V_SIMD_CLONES
static void add_row(float *restrict sum, const float *restrict row, int64_t count)
{
    for (int64_t x = 0; x < count; x++) {
        sum[x] += row[x];
    }
}

V2V_SIMD_CLONES
static void subtract(float *row, int64_t count, float value)
{
    for (int64_t x = 0; x < count; x++) {
        row[x] -= value;
    }
}

static float *smooth_row(const struct v2v_carve *carve, int64_t v, int64_t y)
{
    int64_t pitch = carve->width + 2 * carve->ring, rows = carve->height + 2 * carve->ring;
    return carve->smooth + (v * rows + carve->ring + y) * pitch + carve->ring;
}

/* Mean over the box; beyond the frame its edge goes on. */
static void smooth_line(const struct v2v_carve *carve, float *to, const float *view, int64_t y)
{
    int64_t width = carve->width;
    float column[STRETCH + 2 * HALF];
    for (int64_t x0 = 0; x0 < width; x0 += STRETCH) {
        int64_t count = v2v_within(STRETCH, 0, width - x0);
        int64_t left = v2v_within(HALF, 0, x0), right = v2v_within(HALF, 0, width - x0 - count);
        float *middle = column + HALF;
        memset(column, 0, sizeof column);
        for (int64_t i = -HALF; i <= HALF; i++) {
            const float *row = view + v2v_within(y + i, 0, carve->height - 1) * width + x0;
            add_row(middle - left, row - left, count + left + right);
        }
        for (int64_t i = left; i < HALF; i++) {
            middle[-1 - i] = middle[0];
        }
        for (int64_t i = right; i < HALF; i++) {
            middle[count + i] = middle[count + right - 1];
        }
        for (int64_t x = 0; x < count; x++) {
            float box = 0.0f;
            for (int64_t i = -HALF; i <= HALF; i++) {
                box += middle[x + i];
            }
            to[x0 + x] = box / (BOX * BOX);
        }
    }
}

/* The tenth of the smoothed pixels that is darkest lies in the background; how far below its mean
 * follows from the noise. */
static double background_of(const struct v2v_carve *carve, float *probes, int64_t v)
{
    const double tenth = 0.1, deviations = 1.2816;
    int64_t pixels = carve->height * carve->width, step = probe_step(carve), count = 0;
    for (int64_t i = 0; i < pixels; i += step) {
        probes[count++] = smooth_row(carve, v, i / carve->width)[i % carve->width];
    }
    return quantile(probes, count, tenth) + deviations * (double)carve->noise[v] / BOX;
}

static void fill_ring(const struct v2v_carve *carve, int64_t v)
{
    int64_t ring = carve->ring, width = carve->width;
    size_t pitch = (size_t)(width + 2 * ring) * sizeof(float);
    for (int64_t y = 0; y < carve->height; y++) {
        float *row = smooth_row(carve, v, y);
        for (int64_t i = 1; i <= ring; i++) {
            row[-i] = row[0];
            row[width - 1 + i] = row[width - 1];
        }
    }
    for (int64_t i = 1; i <= ring; i++) {
        memcpy(smooth_row(carve, v, -i) - ring, smooth_row(carve, v, 0) - ring, pitch);
        memcpy(smooth_row(carve, v, carve->height - 1 + i) - ring,
               smooth_row(carve, v, carve->height - 1) - ring, pitch);
    }
}

static void prepare_view(struct v2v_carve *carve, int64_t v, const float *view, int has_background)
{
    float *probes = carve->probes + omp_get_thread_num() * PROBES;
    carve->noise[v] = (float)noise_of(carve, probes, view);
    for (int64_t y = 0; y < carve->height; y++) {
        smooth_line(carve, smooth_row(carve, v, y), view, y);
    }
    double background = has_background ? background_of(carve, probes, v) : 0.0;
    for (int64_t y = 0; y < carve->height; y++) {
        subtract(smooth_row(carve, v, y), carve->width, (float)background);
    }
    fill_ring(carve, v);
}

/* ---- the light of a range of pixels ---- */

typedef float lanes __attribute__((vector_size(LANES * 4), aligned(4), may_alias));
typedef int32_t places __attribute__((vector_size(LANES * 4)));

/* light becomes at least the mean of the views without the `cut` brightest of each pixel: one step
 * of an insertion sort a view. Inline, so that with a constant `cut` all of it stays in registers.
 */
static inline __attribute__((always_inline)) void
keep_most(float *light, const float *const *view, int64_t views, int64_t cut, int64_t count)
{
    float share = 1.0f / (float)(views - cut);
    for (int64_t x = 0; x < count; x += LANES) {
        lanes rest = {0}, brightest[MOST_CUT], *most = (lanes *)(light + x);
        for (int64_t k = 0; k < cut; k++) {
            brightest[k] = (lanes){0} - FLT_MAX;
        }
        for (int64_t v = 0; v < views; v++) {
            lanes value = *(const lanes *)(view[v] + x);
            rest += value;
            for (int64_t k = 0; k < cut; k++) {
                places best = (places)brightest[k], other = (places)value;
                places is_best = brightest[k] > value;
                brightest[k] = (lanes)((best & is_best) | (other & ~is_best));
                value = (lanes)((other & is_best) | (best & ~is_best));
            }
        }
        for (int64_t k = 0; k < cut; k++) {
            rest -= brightest[k];
        }
        rest *= share;
        places is_most = rest > *most;
        *most = (lanes)(((places)rest & is_most) | ((places)*most & ~is_most));
    }
}

V2V_SIMD_CLONES
static void keep_most_of_all(float *light, const float *const *view, int64_t views, int64_t cut,
                             int64_t count)
{
    if (cut == USUAL_CUT) {
        keep_most(light, view, views, USUAL_CUT, count);
    } else {
        keep_most(light, view, views, cut, count);
    }
}

/* light[0 .. count) becomes at least the light of pixels (y, x0 ..) in any slice. */
static void carve_range(const struct v2v_carve *carve, float *light, int64_t y, int64_t x0,
                        int64_t count)
{
    const struct v2v_shifts *shifts = &carve->shifts;
    const float **view = carve->view + omp_get_thread_num() * shifts->views;
    for (int64_t z = 0; z < shifts->slices; z++) {
        for (int64_t v = 0; v < shifts->views; v++) {
            int64_t i = v * shifts->slices + z;
            view[v] = smooth_row(carve, v, y + shifts->dy[i]) + x0 + shifts->dx[i];
        }
        keep_most_of_all(light, view, shifts->views, carve->cut, count);
    }
}

static void carve_tiles(const struct v2v_carve *carve, float *tiles, int64_t row)
{
    float *light = carve->light + (int64_t)omp_get_thread_num() * STRETCH;
    int64_t end = v2v_within((row + 1) * TILE, 0, carve->height);
    for (int64_t x0 = 0; x0 < carve->width; x0 += STRETCH) {
        int64_t count = v2v_within(STRETCH, 0, carve->width - x0);
        for (int64_t x = 0; x < STRETCH; x++) {
            light[x] = -FLT_MAX;
        }
        for (int64_t y = row * TILE; y < end; y++) {
            carve_range(carve, light, y, x0, count);
        }
        for (int64_t x = 0; x < count; x += TILE) {
            float most = light[x];
            for (int64_t i = x + 1; i < v2v_within(x + TILE, 0, count); i++) {
                most = light[i] > most ? light[i] : most;
            }
            tiles[(x0 + x) / TILE] = most;
        }
    }
}

static double carve_views(struct v2v_carve *carve, float *light, const float *views,
                          int has_background)
{
    int64_t pixels = carve->height * carve->width, count = carve->shifts.views;
    int64_t rows = v2v_parts(carve->height, TILE), columns = v2v_parts(carve->width, TILE);
    double squares = 0.0;
#pragma omp parallel for schedule(dynamic) num_threads(carve->threads)
    for (int64_t v = 0; v < count; v++) {
        prepare_view(carve, v, views + v * pixels, has_background);
    }
#pragma omp parallel for schedule(dynamic) num_threads(carve->threads)
    for (int64_t row = 0; row < rows; row++) {
        carve_tiles(carve, light + row * columns, row);
    }
    for (int64_t v = 0; v < count; v++) {
        squares += (double)carve->noise[v] * (double)carve->noise[v];
    }
    return sqrt(squares) / (double)count / BOX;
}

double v2v_carve_light(struct v2v_carve *carve, float *light, const float *views)
{
    return carve_views(carve, light, views, 1);
}

double v2v_carve_gain(struct v2v_carve *carve, float *light, const float *difference)
{
    return carve_views(carve, light, difference, 0);
}
