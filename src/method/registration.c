#include "method/registration.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"

#include <math.h>
#include <string.h>

/* Terms of fine fields look alike; each is held where it is by so much of its own diagonal element
 * (D. W. Marquardt, J. SIAM 11, 431 (1963)), or rounds overshoot. */
static const double ridge = 0.3;

/* Of the largest diagonal element, what a pivot must have. */
static const double least_pivot = 1e-10;

enum { UNKNOWNS = V2V_REGISTER_UNKNOWNS, ROW = UNKNOWNS * (UNKNOWNS + 1) };

/* Which of a view's unknowns are wanted, in order. */
struct unknowns {
    int list[UNKNOWNS], count;
};

/* Term k of a field, 0 its constant: the flag that asks for it. */
static unsigned term_flag(int k)
{
    if (k == 0) {
        return V2V_REGISTER_SHIFT;
    }
    return k <= V2V_FIELD_COARSE_TERMS ? V2V_REGISTER_FIELDS : V2V_REGISTER_FINE_FIELDS;
}

static unsigned flag_of(int unknown)
{
    return unknown >= V2V_REGISTER_SLOPES ? V2V_REGISTER_SLOPE
                                          : term_flag(unknown % V2V_REGISTER_FIELD);
}

static struct unknowns unknowns_of(unsigned terms)
{
    struct unknowns wanted = {.count = 0};
    for (int i = 0; i < UNKNOWNS; i++) {
        if ((flag_of(i) & (terms | V2V_REGISTER_SHIFT)) != 0) {
            wanted.list[wanted.count++] = i;
        }
    }
    return wanted;
}

enum v2v_status v2v_registration_images_init(struct v2v_registration_images *images, int64_t height,
                                             int64_t width)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = v2v_mem_product(height, width, 1);
    *images = (struct v2v_registration_images){.height = height, .width = width};
    V2V_TRY(V2V_ALLOC(images->missed, "register.images", pixels));
    V2V_TRY(V2V_ALLOC(images->prediction, "register.images", pixels));
    V2V_TRY(V2V_ALLOC(images->deep, "register.images", pixels));
    V2V_TRY(V2V_ALLOC(images->scratch, "register.images", pixels));
    V2V_TRY(V2V_ALLOC(images->of_row, "register.rows", v2v_mem_product(height, ROW, 1)));
done:
    return rc;
}

void v2v_registration_images_fini(struct v2v_registration_images *images)
{
    v2v_mem_free(images->of_row);
    v2v_mem_free(images->scratch);
    v2v_mem_free(images->deep);
    v2v_mem_free(images->prediction);
    v2v_mem_free(images->missed);
    *images = (struct v2v_registration_images){0};
}

struct v2v_part v2v_registration_judged(int64_t side)
{
    const int64_t margin = v2v_field_margin(side);
    return (struct v2v_part){margin, side - 2 * margin};
}

struct v2v_missed v2v_registration_missed(const float *recorded, const float *prediction,
                                          int64_t width, struct v2v_part rows,
                                          struct v2v_part columns)
{
    struct v2v_missed missed = {0.0, 0.0};
    for (int64_t y = rows.first; y < rows.first + rows.count; y++) {
        for (int64_t x = columns.first; x < columns.first + columns.count; x++) {
            const double a = (double)recorded[y * width + x];
            const double d = a - (double)prediction[y * width + x];
            missed.squares += d * d;
            missed.of += a * a;
        }
    }
    return missed;
}

/* Sums over 2 * radius + 1 pixels of a line, beyond it as at its ends, by their mean. */
static void smooth_line(float *to, const float *from, int64_t size, int64_t stride, int radius)
{
    double sum = 0.0;
    for (int64_t i = -radius; i <= radius; i++) {
        sum += (double)from[v2v_within(i, 0, size - 1) * stride];
    }
    for (int64_t i = 0; i < size; i++) {
        to[i * stride] = (float)(sum / (2.0 * radius + 1.0));
        sum += (double)from[v2v_within(i + radius + 1, 0, size - 1) * stride] -
               (double)from[v2v_within(i - radius, 0, size - 1) * stride];
    }
}

/* image: mean over the square of this radius; in place. */
static void smooth(float *image, float *scratch, int64_t height, int64_t width, int radius)
{
#pragma omp parallel for schedule(static)
    for (int64_t y = 0; y < height; y++) {
        smooth_line(scratch + y * width, image + y * width, width, 1, radius);
    }
#pragma omp parallel for schedule(static)
    for (int64_t x = 0; x < width; x++) {
        smooth_line(image + x, scratch + x, height, width, radius);
    }
}

/* What a pixel would miss by one unit of each unknown: derivatives of the prediction. */
static void derivatives(double unknown[UNKNOWNS], const struct v2v_registration_images *images,
                        int64_t y, int64_t x, int64_t reach)
{
    const int64_t width = images->width;
    const int64_t above = v2v_larger(y - reach, 0) * width + x;
    const int64_t below = v2v_smaller(y + reach, images->height - 1) * width + x;
    const int64_t left = y * width + v2v_larger(x - reach, 0);
    const int64_t right = y * width + v2v_smaller(x + reach, width - 1);
    const float *p = images->prediction, *q = images->deep;
    const double across = 2.0 * (double)reach;
    double terms[V2V_REGISTER_FIELD] = {1.0};
    v2v_field_terms(terms + 1, v2v_field_place(y, images->height), v2v_field_place(x, width));
    const double value = (double)p[y * width + x];
    const double along_y = ((double)p[above] - (double)p[below]) / across;
    const double along_x = ((double)p[left] - (double)p[right]) / across;
    for (int k = 0; k < V2V_REGISTER_FIELD; k++) {
        unknown[V2V_REGISTER_GAIN + k] = value * terms[k];
        unknown[V2V_REGISTER_Y + k] = along_y * terms[k];
        unknown[V2V_REGISTER_X + k] = along_x * terms[k];
    }
    unknown[V2V_REGISTER_SLOPES] = ((double)q[above] - (double)q[below]) / across;
    unknown[V2V_REGISTER_SLOPES + 1] = ((double)q[left] - (double)q[right]) / across;
}

/* A row's part of the equations: the lower triangle line by line, and behind each line its right
 * side. */
static void add_row(double *sum, const struct v2v_registration_images *images, int64_t y,
                    struct v2v_part columns, const struct unknowns *wanted, int64_t reach)
{
    double unknown[UNKNOWNS];
    memset(sum, 0, ROW * sizeof *sum);
    for (int64_t x = columns.first; x < columns.first + columns.count; x++) {
        const double missed = (double)images->missed[y * images->width + x];
        derivatives(unknown, images, y, x, reach);
        for (int i = 0; i < wanted->count; i++) {
            const int row = wanted->list[i];
            double *line = sum + (int64_t)row * (UNKNOWNS + 1);
            for (int j = 0; j <= i; j++) {
                line[wanted->list[j]] += unknown[row] * unknown[wanted->list[j]];
            }
            line[UNKNOWNS] += unknown[row] * missed;
        }
    }
}

void v2v_registration_compare(struct v2v_registration *registration,
                              struct v2v_registration_images *images, const float *recorded,
                              const float *prediction, const float *deep, unsigned terms,
                              int smoothing, struct v2v_part rows, struct v2v_part columns)
{
    const int64_t height = images->height, width = images->width, pixels = height * width;
    const struct unknowns wanted = unknowns_of(terms);
    memset(registration, 0, sizeof *registration);
    registration->in_frame = v2v_registration_missed(recorded, prediction, width, rows, columns);
    for (int64_t i = 0; i < pixels; i++) {
        images->missed[i] = recorded[i] - prediction[i];
    }
    memcpy(images->prediction, prediction, (size_t)pixels * sizeof *prediction);
    memcpy(images->deep, deep, (size_t)pixels * sizeof *deep);
    if (smoothing > 1) {
        smooth(images->missed, images->scratch, height, width, smoothing);
        smooth(images->prediction, images->scratch, height, width, smoothing);
        smooth(images->deep, images->scratch, height, width, smoothing);
    }
#pragma omp parallel for schedule(static)
    for (int64_t y = rows.first; y < rows.first + rows.count; y++) {
        add_row(images->of_row + y * ROW, images, y, columns, &wanted, smoothing);
    }
    for (int64_t y = rows.first; y < rows.first + rows.count; y++) {
        for (int i = 0; i < UNKNOWNS; i++) {
            const double *line = images->of_row + y * ROW + (int64_t)i * (UNKNOWNS + 1);
            for (int j = 0; j <= i; j++) {
                registration->matrix[i][j] += line[j];
            }
            registration->right[i] += line[UNKNOWNS];
        }
    }
}

double v2v_registration_brightness(const float *recorded, const float *prediction, int64_t width,
                                   struct v2v_part rows, struct v2v_part columns)
{
    double product = 0.0, squares = 0.0;
    for (int64_t y = rows.first; y < rows.first + rows.count; y++) {
        for (int64_t x = columns.first; x < columns.first + columns.count; x++) {
            const double p = (double)prediction[y * width + x];
            product += p * (double)recorded[y * width + x];
            squares += p * p;
        }
    }
    return product > 0.0 ? product / squares : 1.0;
}

/* What is added to an unknown's diagonal element. */
static double held(const struct v2v_registration *registration, int unknown)
{
    return flag_of(unknown) == V2V_REGISTER_FINE_FIELDS
               ? ridge * registration->matrix[unknown][unknown]
               : 0.0;
}

/* x = matrix^-1 right by Cholesky's factors; all 0 where the view shows too little to tell. */
static void solve(double x[UNKNOWNS], const struct v2v_registration *registration,
                  const struct unknowns *wanted)
{
    const int *list = wanted->list, count = wanted->count;
    double factor[UNKNOWNS][UNKNOWNS], y[UNKNOWNS];
    double largest = 0.0;
    memset(x, 0, UNKNOWNS * sizeof *x);
    for (int i = 0; i < count; i++) {
        largest = fmax(largest, registration->matrix[list[i]][list[i]]);
    }
    for (int i = 0; i < count; i++) {
        y[i] = registration->right[list[i]];
        for (int j = 0; j <= i; j++) {
            double sum = registration->matrix[list[i]][list[j]];
            sum += i == j ? held(registration, list[i]) : 0.0;
            for (int k = 0; k < j; k++) {
                sum -= factor[i][k] * factor[j][k];
            }
            if (i == j && !(sum > least_pivot * largest)) {
                return;
            }
            factor[i][j] = i == j ? sqrt(sum) : sum / factor[j][j];
        }
        for (int k = 0; k < i; k++) {
            y[i] -= factor[i][k] * y[k];
        }
        y[i] /= factor[i][i];
    }
    for (int i = count - 1; i >= 0; i--) {
        double sum = y[i];
        for (int k = i + 1; k < count; k++) {
            sum -= factor[k][i] * x[list[k]];
        }
        x[list[i]] = sum / factor[i][i];
    }
}

/* Go by x. @return the way, pixels */
static double move(struct v2v_view_calibration *view, const double x[UNKNOWNS])
{
    const double *const field_y = x + V2V_REGISTER_Y + 1, *const field_x = x + V2V_REGISTER_X + 1;
    view->gain *= exp(x[V2V_REGISTER_GAIN]);
    view->shift[0] += x[V2V_REGISTER_Y];
    view->shift[1] += x[V2V_REGISTER_X];
    view->slope[0] += x[V2V_REGISTER_SLOPES];
    view->slope[1] += x[V2V_REGISTER_SLOPES + 1];
    for (int k = 0; k < V2V_FIELD_TERMS; k++) {
        view->shading[k] += x[V2V_REGISTER_GAIN + 1 + k];
        view->distortion_y[k] += field_y[k];
        view->distortion_x[k] += field_x[k];
    }
    return fmax(fabs(x[V2V_REGISTER_Y]), fabs(x[V2V_REGISTER_X]));
}

double v2v_registration_step(struct v2v_calibration *calibration,
                             const struct v2v_registration *registration, unsigned terms,
                             int smoothing)
{
    const struct unknowns wanted = unknowns_of(terms);
    double farthest = 0.0;
    for (int64_t v = 0; v < calibration->views; v++) {
        double x[UNKNOWNS], part = 1.0;
        solve(x, &registration[v], &wanted);
        for (int i = 0; i < UNKNOWNS; i++) {
            /* gains by a factor of two, displacements as far as differences reach */
            const double most = i < V2V_REGISTER_Y ? log(2.0) : (double)smoothing + 1.0;
            part = fmin(part, most / fmax(fabs(x[i]), 1e-30));
        }
        for (int i = 0; i < UNKNOWNS; i++) {
            x[i] *= part;
        }
        farthest = fmax(farthest, move(&calibration->view[v], x));
    }
    return farthest;
}

void v2v_registration_to_numbers(double *numbers, const struct v2v_calibration *calibration)
{
    for (int64_t v = 0; v < calibration->views; v++) {
        struct v2v_view_calibration view = calibration->view[v];
        view.gain = log(view.gain);
        memcpy(numbers + v * V2V_REGISTER_NUMBERS, &view, sizeof view);
    }
}

void v2v_registration_from_numbers(struct v2v_calibration *calibration, const double *numbers)
{
    for (int64_t v = 0; v < calibration->views; v++) {
        struct v2v_view_calibration *view = &calibration->view[v];
        memcpy(view, numbers + v * V2V_REGISTER_NUMBERS, sizeof *view);
        view->gain = fmin(fmax(exp(view->gain), V2V_LEAST_GAIN), V2V_MOST_GAIN);
    }
}

/* What is `of_first` in the first view, in view v. */
static double *at(struct v2v_calibration *calibration, int64_t v, const double *of_first)
{
    return (double *)(void *)((char *)&calibration->view[v] +
                              ((const char *)of_first - (const char *)&calibration->view[0]));
}

/* Less its mean over the views. */
static void less_mean(struct v2v_calibration *calibration, const double *of_first)
{
    double mean = 0.0;
    for (int64_t v = 0; v < calibration->views; v++) {
        mean += *at(calibration, v, of_first) / (double)calibration->views;
    }
    for (int64_t v = 0; v < calibration->views; v++) {
        *at(calibration, v, of_first) -= mean;
    }
}

/* A displacement less its mean and its part in proportion to the parallax less its own mean.
 * `y` and `x` are the first view's. */
static void fix_displacement(struct v2v_calibration *calibration, const double *y, const double *x,
                             double (*parallax)[2])
{
    const double *const along[2] = {y, x};
    const int64_t views = calibration->views;
    double mean[2] = {0.0, 0.0}, product = 0.0, squares = 0.0;
    for (int axis = 0; axis < 2; axis++) {
        less_mean(calibration, along[axis]);
        for (int64_t v = 0; v < views; v++) {
            mean[axis] += parallax[v][axis] / (double)views;
        }
        for (int64_t v = 0; v < views; v++) {
            const double p = parallax[v][axis] - mean[axis];
            product += p * *at(calibration, v, along[axis]);
            squares += p * p;
        }
    }
    for (int64_t i = 0; i < 2 * views && squares > 0.0; i++) {
        const double p = parallax[i / 2][i % 2] - mean[i % 2];
        *at(calibration, i / 2, along[i % 2]) -= product / squares * p;
    }
}

void v2v_registration_fix_modes(struct v2v_calibration *calibration, double (*parallax)[2])
{
    const struct v2v_view_calibration *first = &calibration->view[0];
    double mean = 0.0;
    for (int64_t v = 0; v < calibration->views; v++) {
        mean += log(calibration->view[v].gain) / (double)calibration->views;
    }
    for (int64_t v = 0; v < calibration->views; v++) {
        calibration->view[v].gain /= exp(mean);
    }
    fix_displacement(calibration, &first->shift[0], &first->shift[1], parallax);
    fix_displacement(calibration, &first->slope[0], &first->slope[1], parallax);
    for (int k = 0; k < V2V_FIELD_TERMS; k++) {
        less_mean(calibration, &first->shading[k]);
        fix_displacement(calibration, &first->distortion_y[k], &first->distortion_x[k], parallax);
    }
}
