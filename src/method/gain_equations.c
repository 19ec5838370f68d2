#include "method/gain_equations.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/data_step.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

static const double pi = 3.14159265358979323846;

/* Pixels in which a window rises from 0 to 1, inside of what is judged: at most, of its side. */
enum { RISE = 20, RISE_OF_SIDE = 8 };

/* Of conjugate gradients, and the part of the right side's square that ends them. */
enum { MOST_STEPS = 8 };
static const double solved = 1e-7;

/* What a mode costs beside its differences: none of the frame's own size costs nothing. */
static const double least_cost = 4e-4;

/* Noise, of the root mean square of projections: below it single precision would decide. */
static const double least_noise = 3e-2;

/* How large the volume's errors may be: their mean square, of the volume's own
 * (tests/bench/views.md). */
static const double largest_errors = 2.0;

struct v2v_gain_equations {
    const struct v2v_comm *comm;
    int64_t views, slices, height, width;
    struct v2v_data_step *step;
    struct v2v_torus torus;
    double mean_of_modes;  /* of 1 / (least_cost + squares of differences) */
    double *down, *across; /* windows [height], [width] */
    double *size;          /* [v]: of the projections; then work of the iterations .. */
    double *length, *rest, *way, *product;
    double squares;      /* of all sizes */
    float *rows, *image; /* [v, torus rows of this rank, its width] */
    float *whole;        /* [v,torus] */
    float *volume;       /* [slices, torus rows of this rank, its width] */
};

/* 0 outside of the part, 1 inside, a sine's square between. */
static void make_window(double *window, int64_t side, struct v2v_part part)
{
    const double rise = (double)v2v_smaller(RISE, part.count / RISE_OF_SIDE + 1);
    for (int64_t i = 0; i < side; i++) {
        const int64_t first = i - part.first, last = part.first + part.count - 1 - i;
        const double in = ((double)v2v_smaller(first, last) + 0.5) / rise;
        const double s = sin(0.5 * pi * fmin(fmax(in, 0.0), 1.0));
        window[i] = s * s;
    }
}

/* 4 sin^2: squares of differences along a side, of its mode k. */
static double squares_of(int64_t k, double side)
{
    const double s = sin(pi * (double)k / side);
    return 4.0 * s * s;
}

static double mean_of_modes(const struct v2v_gain_equations *self)
{
    const int64_t height = self->torus.height, width = self->torus.width;
    double sum = 0.0;
#pragma omp parallel for schedule(static, 1) ordered
    for (int64_t z = 0; z < self->slices; z++) {
        double of_slice = 0.0;
        for (int64_t y = 0; y < height; y++) {
            const double other = least_cost + squares_of(z, 2.0 * (double)self->slices) +
                                 squares_of(y, (double)height);
            for (int64_t x = 0; x < width; x++) {
                of_slice += 1.0 / (other + squares_of(x, (double)width));
            }
        }
#pragma omp ordered
        sum += of_slice;
    }
    return sum / ((double)(height * width) * (double)self->slices);
}

/** Local. */
static enum v2v_status take_memory(struct v2v_gain_equations *self)
{
    enum v2v_status rc = V2V_OK;
    const int64_t here = self->torus.rows.count, across = self->torus.width;
    V2V_TRY(V2V_ALLOC(self->down, "gains.window", self->height));
    V2V_TRY(V2V_ALLOC(self->across, "gains.window", self->width));
    V2V_TRY(V2V_ALLOC(self->size, "gains.equations", 5 * self->views));
    V2V_TRY(V2V_ALLOC(self->rows, "gains.views", v2v_mem_product(self->views, here, across)));
    V2V_TRY(V2V_ALLOC(self->image, "gains.views", v2v_mem_product(self->views, here, across)));
    V2V_TRY(V2V_ALLOC(self->whole, "gains.views",
                      v2v_mem_product(self->views, self->torus.height, across)));
    V2V_TRY(V2V_ALLOC(self->volume, "gains.volume", v2v_mem_product(self->slices, here, across)));
    self->length = self->size + self->views;
    self->rest = self->length + self->views;
    self->way = self->rest + self->views;
    self->product = self->way + self->views;
done:
    return rc;
}

enum v2v_status v2v_gain_equations_create(struct v2v_gain_equations **equations,
                                          const struct v2v_psf_file *psf, int64_t height,
                                          int64_t width, struct v2v_part rows,
                                          struct v2v_part columns, enum v2v_split split,
                                          const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_gain_equations *self = NULL;
    const struct v2v_torus torus = v2v_data_step_torus_of(psf, height, width);
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(self, "gains", 1)));
    *self = (struct v2v_gain_equations){
        .comm = comm, .views = psf->views, .slices = psf->slices, .height = height, .width = width};
    V2V_TRY(v2v_data_step_create(&self->step, psf, height, width, &torus, split, comm));
    self->torus = v2v_data_step_torus(self->step);
    V2V_TRY(v2v_par_agree(comm, take_memory(self)));
    self->mean_of_modes = mean_of_modes(self);
    make_window(self->down, height, rows);
    make_window(self->across, width, columns);
done:
    if (rc != V2V_OK) {
        v2v_gain_equations_destroy(&self);
    }
    *equations = self;
    return rc;
}

void v2v_gain_equations_destroy(struct v2v_gain_equations **equations)
{
    struct v2v_gain_equations *self = *equations;
    *equations = NULL;
    if (self != NULL) {
        v2v_data_step_destroy(&self->step);
        v2v_mem_free(self->volume);
        v2v_mem_free(self->whole);
        v2v_mem_free(self->image);
        v2v_mem_free(self->rows);
        v2v_mem_free(self->size);
        v2v_mem_free(self->across);
        v2v_mem_free(self->down);
        v2v_mem_free(self);
    }
}

int v2v_gain_equations_products(void)
{
    return MOST_STEPS + 1;
}

/* Both, times the window, and 0 where a view is blind. */
static void look_through_window(const struct v2v_gain_equations *self, float *missed,
                                float *predicted)
{
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t v = 0; v < self->views; v++) {
        for (int64_t y = 0; y < self->height; y++) {
            const int64_t at = (v * self->height + y) * self->width;
            for (int64_t x = 0; x < self->width; x++) {
                const int is_seen = missed[at + x] != V2V_BLIND;
                const double part = is_seen ? self->down[y] * self->across[x] : 0.0;
                predicted[at + x] = (float)(part * predicted[at + x]);
                missed[at + x] = is_seen ? (float)(part * missed[at + x]) : 0.0f;
            }
        }
    }
}

/** size[v] = |predicted_v|, and their squares' sum; rank 0's, as steps go by them and ranks may
 *  round another way. Collective(comm). */
static void measure(struct v2v_gain_equations *self, const float *predicted)
{
    const int64_t pixels = self->height * self->width;
    for (int64_t v = 0; v < self->views; v++) {
        self->size[v] = sqrt(v2v_sum_of_squares(predicted + v * pixels, pixels));
    }
    v2v_par_broadcast(self->comm, self->size, self->views * (int64_t)sizeof *self->size, 0);
    self->squares = v2v_dot(self->size, self->size, self->views);
}

/** of_view[v] = <predicted_v, (1 + A P^-1 A^H)^-1 factor_v image_v>; factor NULL: 1.
 *  Rank 0's. Collective(comm). */
static void multiply(struct v2v_gain_equations *self, double *of_view, const float *image,
                     const double *factor, const float *predicted)
{
    const struct v2v_part here = self->torus.rows;
    const int64_t width = self->torus.width, samples = self->views * here.count * width;
    v2v_watchdog_beat("calibrate: gains by all views");
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t v = 0; v < self->views; v++) {
        for (int64_t r = 0; r < here.count; r++) {
            const int64_t y = here.first + r;
            const float by = factor != NULL ? (float)factor[v] : 1.0f;
            const float *from = image + (v * self->height + y) * self->width;
            float *row = self->rows + (v * here.count + r) * width;
            memset(row, 0, (size_t)width * sizeof *row);
            for (int64_t x = 0; x < (y < self->height ? self->width : 0); x++) {
                row[x] = by * from[x];
            }
        }
    }
    v2v_data_step_begin_torus(self->step, self->rows);
    memset(self->volume, 0, (size_t)(self->slices * here.count * width) * sizeof *self->volume);
    v2v_data_step_run(self->step, self->volume);
    v2v_data_step_project(self->step, self->image, self->volume);
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < samples; i++) {
        self->image[i] = self->rows[i] - self->image[i];
    }
    v2v_data_step_gather(self->step, self->whole, self->image, self->views);
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < self->views; v++) {
        double sum = 0.0;
        for (int64_t y = 0; y < self->height; y++) {
            const float *a = predicted + (v * self->height + y) * self->width;
            const float *b = self->whole + (v * self->torus.height + y) * width;
            for (int64_t x = 0; x < self->width; x++) {
                sum += (double)a[x] * b[x];
            }
        }
        of_view[v] = sum;
    }
    v2v_par_broadcast(self->comm, of_view, self->views * (int64_t)sizeof *of_view, 0);
}

/* From derivatives by gains to those by what gains add to the size of projections, less the part
 * by which all would grow alike. */
static void scale(const struct v2v_gain_equations *self, double *of_view)
{
    double alike = 0.0;
    for (int64_t v = 0; v < self->views; v++) {
        of_view[v] = self->size[v] > 0.0 ? of_view[v] / self->size[v] : 0.0;
        alike += of_view[v] * self->size[v];
    }
    for (int64_t v = 0; v < self->views; v++) {
        of_view[v] -= alike / self->squares * self->size[v];
    }
}

/* gain = lengths, of projections */
static void unscale(const struct v2v_gain_equations *self, double *gain, const double *length)
{
    for (int64_t v = 0; v < self->views; v++) {
        gain[v] = self->size[v] > 0.0 ? length[v] / self->size[v] : 0.0;
    }
}

/* Conjugate gradients, each gain in units of its projection's size. Sizes that grow alike are the
 * volume's, which is too dim as a whole: gains whose sum were 0 would make dim views dimmer. */
static void solve(struct v2v_gain_equations *self, double *gain, const float *predicted)
{
    const int64_t views = self->views;
    double squares = v2v_dot(self->rest, self->rest, views);
    const double enough = solved * squares;
    memset(self->length, 0, (size_t)views * sizeof *gain);
    memcpy(self->way, self->rest, (size_t)views * sizeof *gain);
    for (int k = 0; k < MOST_STEPS && squares > enough; k++) {
        unscale(self, gain, self->way);
        multiply(self, self->product, predicted, gain, predicted);
        scale(self, self->product);
        const double curvature = v2v_dot(self->way, self->product, views);
        if (!(curvature > 0.0)) {
            break;
        }
        const double before = squares, step = before / curvature;
        for (int64_t v = 0; v < views; v++) {
            self->length[v] += step * self->way[v];
            self->rest[v] -= step * self->product[v];
        }
        squares = v2v_dot(self->rest, self->rest, views);
        for (int64_t v = 0; v < views; v++) {
            self->way[v] = self->rest[v] + squares / before * self->way[v];
        }
    }
    unscale(self, gain, self->length);
}

void v2v_gain_equations_solve(struct v2v_gain_equations *self, double *gain, float *missed,
                              float *predicted, const struct v2v_gain_knowledge *knowledge)
{
    look_through_window(self, missed, predicted);
    measure(self, predicted);
    memset(gain, 0, (size_t)self->views * sizeof *gain);
    if (!(knowledge->light > 0.0 && self->squares > 0.0)) {
        return; /* nothing is shown */
    }
    const double samples = (double)(self->views * self->height * self->width);
    const double noise = fmax(knowledge->noise, least_noise * sqrt(self->squares / samples));
    const double unit = noise * noise * self->mean_of_modes / (largest_errors * knowledge->light);
    v2v_data_step_factor(
        self->step,
        &(struct v2v_penalty){.constant = least_cost * unit, .differences = unit, .depth = unit});
    multiply(self, self->rest, missed, NULL, predicted);
    scale(self, self->rest);
    solve(self, gain, predicted);
}
