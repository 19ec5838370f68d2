#include "method/registration.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/smooth.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Of fine fields, each number is held where it is by so much of its own diagonal element
 * (D. W. Marquardt, J. SIAM 11, 431 (1963)), and drawn to 0 by this: where a view shows nothing,
 * as beyond a round field of view, fields would drift. */
static const double ridge = 0.1, drawn = 0.05;

/* Of the largest diagonal element, what a pivot must have. */
static const double least_pivot = 1e-10;

enum {
    UNKNOWNS = V2V_REGISTER_UNKNOWNS,
    IMAGES = V2V_REGISTER_IMAGES,
    PAIRS = V2V_REGISTER_PAIRS,
    ORDERS = V2V_REGISTER_ORDERS,
    ROW = PAIRS * ORDERS
};

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

/* The highest degree of a field among them. */
static int degree_of(unsigned terms)
{
    if ((terms & V2V_REGISTER_FINE_FIELDS) != 0) {
        return V2V_FIELD_DEGREE;
    }
    return (terms & V2V_REGISTER_FIELDS) != 0 ? V2V_FIELD_COARSE_DEGREE : 0;
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

int v2v_registration_unknowns(unsigned terms)
{
    return unknowns_of(terms).count;
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
    V2V_TRY(V2V_ALLOC(images->unseen, "register.images", pixels));
    V2V_TRY(V2V_ALLOC(images->of_row, "register.rows", v2v_mem_product(height, ROW, 1)));
done:
    return rc;
}

void v2v_registration_images_fini(struct v2v_registration_images *images)
{
    v2v_mem_free(images->of_row);
    v2v_mem_free(images->unseen);
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
    struct v2v_missed missed = {0.0, 0.0, 0.0};
    for (int64_t y = rows.first; y < rows.first + rows.count; y++) {
        for (int64_t x = columns.first; x < columns.first + columns.count; x++) {
            const int64_t i = y * width + x;
            const int is_seen = recorded[i] != V2V_BLIND;
            const double a = is_seen ? (double)recorded[i] : 0.0;
            const double d = is_seen ? a - (double)prediction[i] : 0.0;
            missed.squares += d * d;
            missed.of += a * a;
            missed.seen += (double)is_seen;
        }
    }
    return missed;
}

/* What a pixel misses, 0 of a blind one; and which pixels have a blind one in their means. */
static void take_missed(struct v2v_registration_images *images, const float *recorded,
                        const float *prediction, int smoothing)
{
    const int64_t height = images->height, width = images->width;
    const int64_t reach = smoothing > 1 ? smoothing : 0;
    memset(images->unseen, 0, (size_t)(height * width));
    for (int64_t i = 0; i < height * width; i++) {
        const int is_seen = recorded[i] != V2V_BLIND;
        const int64_t top = v2v_larger(i / width - reach, 0);
        const int64_t bottom = v2v_smaller(i / width + reach, height - 1);
        const int64_t left = v2v_larger(i % width - reach, 0);
        const int64_t right = v2v_smaller(i % width + reach, width - 1);
        images->missed[i] = is_seen ? recorded[i] - prediction[i] : 0.0f;
        for (int64_t y = top; !is_seen && y <= bottom; y++) {
            memset(images->unseen + y * width + left, 1, (size_t)(right - left + 1));
        }
    }
}

static void look_at(double image[IMAGES], const struct v2v_registration_images *images, int64_t y,
                    int64_t x, int64_t reach)
{
    const int64_t width = images->width;
    const int64_t above = v2v_larger(y - reach, 0) * width + x;
    const int64_t below = v2v_smaller(y + reach, images->height - 1) * width + x;
    const int64_t left = y * width + v2v_larger(x - reach, 0);
    const int64_t right = y * width + v2v_smaller(x + reach, width - 1);
    const float *p = images->prediction, *q = images->deep;
    const double across = 2.0 * (double)reach;
    image[V2V_REGISTER_BY_GAIN] = (double)p[y * width + x];
    image[V2V_REGISTER_BY_Y] = ((double)p[above] - (double)p[below]) / across;
    image[V2V_REGISTER_BY_X] = ((double)p[left] - (double)p[right]) / across;
    image[V2V_REGISTER_BY_SLOPE_Y] = ((double)q[above] - (double)q[below]) / across;
    image[V2V_REGISTER_BY_SLOPE_X] = ((double)q[left] - (double)q[right]) / across;
    image[V2V_REGISTER_MISSED] = (double)images->missed[y * width + x];
}

/* The place of a pair of images. */
static int pair_of(int a, int b)
{
    return a > b ? a * (a + 1) / 2 + b : b * (b + 1) / 2 + a;
}

/* Of a row, sums [pairs,orders] of products times P_i(x). */
static void sum_row(double *sums, const struct v2v_registration_images *images, int64_t y,
                    struct v2v_part columns, int orders, int64_t reach)
{
    double image[IMAGES], of_x[ORDERS];
    memset(sums, 0, ROW * sizeof *sums);
    for (int64_t x = columns.first; x < columns.first + columns.count; x++) {
        double *sum = sums;
        if (images->unseen[y * images->width + x]) {
            continue;
        }
        look_at(image, images, y, x, reach);
        v2v_legendre(of_x, orders, v2v_field_place((double)x, images->width));
        for (int b = 0; b < IMAGES; b++) {
            for (int a = 0; a <= b; a++, sum += ORDERS) {
                for (int i = 0; i < orders; i++) {
                    sum[i] += image[a] * image[b] * of_x[i];
                }
            }
        }
    }
}

/* A row's sums times P_j(y). */
static void add_row(struct v2v_registration *registration, const double *sums, double y, int orders)
{
    double of_y[ORDERS];
    v2v_legendre(of_y, orders, y);
    for (int pair = 0; pair < PAIRS; pair++) {
        for (int j = 0; j < orders; j++) {
            for (int i = 0; i < orders; i++) {
                registration->moments[pair][j][i] += of_y[j] * sums[pair * ORDERS + i];
            }
        }
    }
}

void v2v_registration_compare(struct v2v_registration *registration,
                              struct v2v_registration_images *images, const float *recorded,
                              const float *prediction, const float *deep, unsigned terms,
                              int smoothing, struct v2v_part rows, struct v2v_part columns)
{
    const int64_t height = images->height, width = images->width, pixels = height * width;
    const int orders = 2 * degree_of(terms) + 1;
    memset(registration, 0, sizeof *registration);
    registration->in_frame = v2v_registration_missed(recorded, prediction, width, rows, columns);
    take_missed(images, recorded, prediction, smoothing);
    memcpy(images->prediction, prediction, (size_t)pixels * sizeof *prediction);
    memcpy(images->deep, deep, (size_t)pixels * sizeof *deep);
    if (smoothing > 1) {
        v2v_smooth_image(images->missed, images->scratch, images->missed, height, width, smoothing);
        v2v_smooth_image(images->prediction, images->scratch, images->prediction, height, width,
                         smoothing);
        v2v_smooth_image(images->deep, images->scratch, images->deep, height, width, smoothing);
    }
#pragma omp parallel for schedule(static)
    for (int64_t y = rows.first; y < rows.first + rows.count; y++) {
        sum_row(images->of_row + y * ROW, images, y, columns, orders, smoothing);
    }
    for (int64_t y = rows.first; y < rows.first + rows.count; y++) {
        add_row(registration, images->of_row + y * ROW, v2v_field_place((double)y, height), orders);
    }
}

/* P_i P_k as a sum of polynomials. */
struct products {
    double of[V2V_FIELD_ORDERS][V2V_FIELD_ORDERS][ORDERS]; /* [i][k] */
};

/* (n + 1) P_{n+1} = (2 n + 1) x P_n - n P_{n-1}, for each as for x P_i. */
static void find_products(struct products *products)
{
    memset(products, 0, sizeof *products);
    for (int k = 0; k < V2V_FIELD_ORDERS; k++) {
        double(*const of)[ORDERS] = products->of[k]; /* the same with i and k exchanged */
        of[0][k] = 1.0;
        for (int n = 0; n + 1 < V2V_FIELD_ORDERS; n++) {
            for (int l = 0; l <= n + k; l++) {
                const double part = (2 * n + 1) * of[n][l] / ((n + 1) * (2 * l + 1.0));
                of[n + 1][l + 1] += part * (l + 1);
                of[n + 1][l > 0 ? l - 1 : 0] += part * l;
            }
            for (int l = 0; n > 0 && l < n + k; l++) {
                of[n + 1][l] -= n * of[n - 1][l] / (n + 1);
            }
        }
    }
}

/* What an unknown is a factor of: an image times P_x(x) P_y(y). */
struct factor_of {
    int image, y, x;
};

static struct factor_of factor_of(int unknown)
{
    if (unknown >= V2V_REGISTER_SLOPES) {
        return (struct factor_of){V2V_REGISTER_BY_SLOPE_Y + unknown - V2V_REGISTER_SLOPES, 0, 0};
    }
    int degree = 0, j = unknown % V2V_REGISTER_FIELD;
    while (j > degree) {
        j -= ++degree;
    }
    return (struct factor_of){unknown / V2V_REGISTER_FIELD, j, degree - j};
}

/* An element of the normal matrix. */
static double element(const struct v2v_registration *registration, const struct products *products,
                      int row, int column)
{
    const struct factor_of a = factor_of(row), b = factor_of(column);
    const double(*moments)[ORDERS] = registration->moments[pair_of(a.image, b.image)];
    const double *of_y = products->of[a.y][b.y], *of_x = products->of[a.x][b.x];
    double sum = 0.0;
    for (int j = abs(a.y - b.y); j <= a.y + b.y; j += 2) {
        for (int i = abs(a.x - b.x); i <= a.x + b.x; i += 2) {
            sum += of_y[j] * of_x[i] * moments[j][i];
        }
    }
    return sum;
}

/* .. and of its right side. */
static double missed_by(const struct v2v_registration *registration, int unknown)
{
    const struct factor_of a = factor_of(unknown);
    return registration->moments[pair_of(a.image, V2V_REGISTER_MISSED)][a.y][a.x];
}

static int is_fine(int unknown)
{
    return flag_of(unknown) == V2V_REGISTER_FINE_FIELDS;
}

/* A term of a field, as it is. */
static double term_of(const struct v2v_view_calibration *view, int unknown)
{
    const double *const fields[] = {view->shading, view->distortion_y, view->distortion_x};
    return fields[unknown / V2V_REGISTER_FIELD][unknown % V2V_REGISTER_FIELD - 1];
}

/* x = matrix^-1 right by Cholesky's factors; all 0 where the view shows too little to tell. */
static void solve(double x[UNKNOWNS], const struct v2v_registration *registration,
                  const struct products *products, const struct unknowns *wanted,
                  const struct v2v_view_calibration *view)
{
    const int *list = wanted->list, count = wanted->count;
    double factor[UNKNOWNS][UNKNOWNS], y[UNKNOWNS];
    double largest = 0.0;
    memset(x, 0, UNKNOWNS * sizeof *x);
    for (int i = 0; i < count; i++) {
        largest = fmax(largest, element(registration, products, list[i], list[i]));
    }
    for (int i = 0; i < count; i++) {
        const double own =
            is_fine(list[i]) ? element(registration, products, list[i], list[i]) : 0.0;
        y[i] = missed_by(registration, list[i]);
        y[i] -= own > 0.0 ? drawn * own * term_of(view, list[i]) : 0.0;
        for (int j = 0; j <= i; j++) {
            double sum = element(registration, products, list[i], list[j]);
            sum += i == j ? (ridge + drawn) * own : 0.0;
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
    struct products products;
    double farthest = 0.0;
    find_products(&products);
    for (int64_t v = 0; v < calibration->views; v++) {
        double x[UNKNOWNS], part = 1.0;
        solve(x, &registration[v], &products, &wanted, &calibration->view[v]);
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
        for (int axis = 0; axis < 2; axis++) {
            view->shift[axis] = fmin(fmax(view->shift[axis], -V2V_MOST_PIXELS), V2V_MOST_PIXELS);
        }
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
