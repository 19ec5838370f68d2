#include "method/least_squares.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/pi.h"
#include "v2v3d/optics/data_step.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/conjugate_gradients.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

/* Pixels in which a window rises from 0 to 1, inside of what is judged: at most, of its side. */
enum { RISE = 20, RISE_OF_SIDE = 8 };

/* Of conjugate gradients, and the part of the right side's square that ends them. */
enum { MOST_STEPS = 8 };
static const double solved = 1e-7;

/* Of the noise, the length of an image that tells its number. */
static const double least_told = 0.5;

/* What a mode costs beside its differences: none of the frame's own size costs nothing. */
static const double least_cost = 4e-4;

struct v2v_least_squares {
    const struct v2v_comm *comm;
    int64_t views, slices, height, width;
    struct v2v_data_step *step;
    struct v2v_torus torus;
    double mean_of_modes;  /* of 1 / (least_cost + squares of differences) */
    double *down, *across; /* windows [height], [width] */
    double *size;          /* [term,v]: of the images; then work of the iterations .. */
    double *length, *numbers, *rest, *way, *product;
    double squares; /* of all sizes */
    const struct v2v_least_squares_terms *terms;
    int64_t count;       /* of numbers: terms times views */
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
        const double s = sin(0.5 * V2V_PI * fmin(fmax(in, 0.0), 1.0));
        window[i] = s * s;
    }
}

/* 4 sin^2: squares of differences along a side, of its mode k. */
static double squares_of(int64_t k, double side)
{
    const double s = sin(V2V_PI * (double)k / side);
    return 4.0 * s * s;
}

static double mean_of_modes(const struct v2v_least_squares *self)
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
static enum v2v_status take_memory(struct v2v_least_squares *self)
{
    enum v2v_status rc = V2V_OK;
    const int64_t here = self->torus.rows.count, across = self->torus.width;
    V2V_TRY(V2V_ALLOC(self->down, "least_squares.window", self->height));
    V2V_TRY(V2V_ALLOC(self->across, "least_squares.window", self->width));
    V2V_TRY(V2V_ALLOC(self->size, "least_squares", 6 * V2V_LEAST_SQUARES_TERMS * self->views));
    V2V_TRY(
        V2V_ALLOC(self->rows, "least_squares.views", v2v_mem_product(self->views, here, across)));
    V2V_TRY(
        V2V_ALLOC(self->image, "least_squares.views", v2v_mem_product(self->views, here, across)));
    V2V_TRY(V2V_ALLOC(self->whole, "least_squares.views",
                      v2v_mem_product(self->views, self->torus.height, across)));
    V2V_TRY(V2V_ALLOC(self->volume, "least_squares.volume",
                      v2v_mem_product(self->slices, here, across)));
    double **const work[] = {&self->length, &self->numbers, &self->rest, &self->way,
                             &self->product};
    for (size_t k = 0; k < sizeof work / sizeof *work; k++) {
        *work[k] = self->size + (int64_t)(k + 1) * V2V_LEAST_SQUARES_TERMS * self->views;
    }
done:
    return rc;
}

enum v2v_status v2v_least_squares_create(struct v2v_least_squares **least_squares,
                                         const struct v2v_psf_file *psf, int64_t height,
                                         int64_t width, struct v2v_part rows,
                                         struct v2v_part columns, enum v2v_split split,
                                         const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_least_squares *self = NULL;
    const struct v2v_torus torus = v2v_data_step_torus_of(psf, height, width);
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(self, "least_squares", 1)));
    *self = (struct v2v_least_squares){
        .comm = comm, .views = psf->views, .slices = psf->slices, .height = height, .width = width};
    V2V_TRY(v2v_data_step_create(&self->step, psf, height, width, &torus, split, comm));
    self->torus = v2v_data_step_torus(self->step);
    V2V_TRY(v2v_par_agree(comm, take_memory(self)));
    self->mean_of_modes = mean_of_modes(self);
    make_window(self->down, height, rows);
    make_window(self->across, width, columns);
done:
    if (rc != V2V_OK) {
        v2v_least_squares_destroy(&self);
    }
    *least_squares = self;
    return rc;
}

void v2v_least_squares_destroy(struct v2v_least_squares **least_squares)
{
    struct v2v_least_squares *self = *least_squares;
    *least_squares = NULL;
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

int v2v_least_squares_products(void)
{
    return MOST_STEPS + 1;
}

/* All of them, times the window, and 0 where a view is blind. */
static void look_through_window(const struct v2v_least_squares *self, float *missed)
{
    const int64_t samples = self->views * self->height * self->width;
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t v = 0; v < self->views; v++) {
        for (int64_t y = 0; y < self->height; y++) {
            const int64_t at = (v * self->height + y) * self->width;
            for (int64_t x = 0; x < self->width; x++) {
                const int is_seen = missed[at + x] != V2V_BLIND;
                const double part = is_seen ? self->down[y] * self->across[x] : 0.0;
                for (int t = 0; t < self->terms->count; t++) {
                    float *const image = self->terms->images + t * samples + at + x;
                    *image = (float)(part * *image);
                }
                missed[at + x] = is_seen ? (float)(part * missed[at + x]) : 0.0f;
            }
        }
    }
}

/** size[term,v] = |image|, 0 of those that noise hides, and their squares' sum; rank 0's, as steps
 *  go by them and ranks may round another way. Collective(comm). */
static void measure(struct v2v_least_squares *self, double noise)
{
    const int64_t pixels = self->height * self->width;
    for (int64_t i = 0; i < self->count; i++) {
        const double size = sqrt(v2v_sum_of_squares(self->terms->images + i * pixels, pixels));
        self->size[i] = size > least_told * noise ? size : 0.0;
    }
    v2v_par_broadcast(self->comm, self->size, self->count * (int64_t)sizeof *self->size, 0);
    self->squares = v2v_dot(self->size, self->size, self->count);
}

/** of[term,v] = <image, (1 + A P^-1 A^H)^-1 sum of factor[term,v] from[term,v]>; factor NULL: of
 *  one term, 1. Rank 0's. Collective(comm). */
static void multiply(struct v2v_least_squares *self, double *of, const float *from,
                     const double *factor)
{
    const struct v2v_part here = self->torus.rows;
    const int64_t width = self->torus.width, samples = self->views * here.count * width;
    const int terms = factor != NULL ? self->terms->count : 1;
    v2v_watchdog_beat("calibrate: by all views");
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t v = 0; v < self->views; v++) {
        for (int64_t r = 0; r < here.count; r++) {
            const int64_t y = here.first + r;
            float *row = self->rows + (v * here.count + r) * width;
            memset(row, 0, (size_t)width * sizeof *row);
            for (int t = 0; t < (y < self->height ? terms : 0); t++) {
                const int64_t i = t * self->views + v;
                const float by = factor != NULL ? (float)factor[i] : 1.0f;
                const float *image = from + (i * self->height + y) * self->width;
                for (int64_t x = 0; x < self->width; x++) {
                    row[x] += by * image[x];
                }
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
    for (int64_t i = 0; i < self->count; i++) {
        of[i] = 0.0;
        for (int64_t y = 0; y < self->height; y++) {
            const int64_t row = i % self->views * self->torus.height + y;
            of[i] += v2v_sum_of_products(self->terms->images + (i * self->height + y) * self->width,
                                         self->whole + row * width, self->width);
        }
    }
    v2v_par_broadcast(self->comm, of, self->count * (int64_t)sizeof *of, 0);
}

/* From derivatives by numbers to those by what they add to the size of images. */
static void scale(const struct v2v_least_squares *self, double *of)
{
    for (int64_t i = 0; i < self->count; i++) {
        of[i] = self->size[i] > 0.0 ? of[i] / self->size[i] : 0.0;
    }
}

/* Less the part by which all images would grow alike, where that is the volume's. */
static void take_off_common(const struct v2v_least_squares *self, double *of)
{
    const double common = v2v_dot(of, self->size, self->count) / self->squares;
    for (int64_t i = 0; i < (self->terms->is_relative ? self->count : 0); i++) {
        of[i] -= common * self->size[i];
    }
}

/* numbers = lengths, of images */
static void unscale(const struct v2v_least_squares *self, double *numbers, const double *length)
{
    for (int64_t i = 0; i < self->count; i++) {
        numbers[i] = self->size[i] > 0.0 ? length[i] / self->size[i] : 0.0;
    }
}

/** The matrix, each number in units of its image's size. Collective(comm).
 *  @param of a v2v_least_squares */
static void multiply_lengths(void *of, double *product, const double *length)
{
    struct v2v_least_squares *self = of;
    unscale(self, self->numbers, length);
    multiply(self, product, self->terms->images, self->numbers);
    scale(self, product);
    take_off_common(self, product);
}

void v2v_least_squares_solve(struct v2v_least_squares *self, double *numbers, float *missed,
                             const struct v2v_least_squares_terms *terms,
                             const struct v2v_volume_errors *errors)
{
    V2V_ASSERT(terms->count > 0 && terms->count <= V2V_LEAST_SQUARES_TERMS);
    self->terms = terms;
    self->count = terms->count * self->views;
    look_through_window(self, missed);
    measure(self, errors->noise);
    memset(numbers, 0, (size_t)self->count * sizeof *numbers);
    if (!(errors->noise > 0.0 && errors->square > 0.0 && self->squares > 0.0)) {
        return; /* nothing is shown */
    }
    const double unit = errors->noise * errors->noise * self->mean_of_modes / errors->square;
    v2v_data_step_factor(
        self->step,
        &(struct v2v_penalty){.constant = least_cost * unit, .differences = unit, .depth = unit});
    multiply(self, self->rest, missed, NULL);
    scale(self, self->rest);
    take_off_common(self, self->rest);
    v2v_conjugate_gradients_solve(&(struct v2v_conjugate_gradients){.count = self->count,
                                                                    .steps = MOST_STEPS,
                                                                    .enough = solved,
                                                                    .way = self->way,
                                                                    .product = self->product,
                                                                    .multiply = multiply_lengths,
                                                                    .of = self},
                                  self->length, self->rest);
    unscale(self, numbers, self->length);
}
