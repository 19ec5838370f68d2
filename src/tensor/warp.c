#include "v2v3d/tensor/warp.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/clones.h"
#include "v2v3d/tensor/blind.h"

#include <math.h>
#include <string.h>

enum { TAPS = 4 };

/* Where a displaced pixel lies: passes at most, and what ends them, pixels. */
enum { PASSES = 16 };
static const double still = 1e-3;

/* Weights of the pixels -1, 0, 1, 2 for a place at t, 0 .. 1, between 0 and 1. */
static void cubic(double weight[TAPS], double t)
{
    weight[0] = t * (-0.5 + t * (1.0 - 0.5 * t));
    weight[1] = 1.0 + t * t * (-2.5 + 1.5 * t);
    weight[2] = t * (0.5 + t * (2.0 - 1.5 * t));
    weight[3] = t * t * (-0.5 + 0.5 * t);
}

static double sample(const float *image, int64_t height, int64_t width, double y, double x)
{
    const double top = floor(y), left = floor(x);
    const int64_t y0 = (int64_t)top, x0 = (int64_t)left;
    double along_y[TAPS], along_x[TAPS], sum = 0.0;
    cubic(along_y, y - top);
    cubic(along_x, x - left);
    for (int i = 0; i < TAPS; i++) {
        const float *row = image + v2v_within(y0 - 1 + i, 0, height - 1) * width;
        double of_row = 0.0;
        for (int j = 0; j < TAPS; j++) {
            of_row += along_x[j] * (double)row[v2v_within(x0 - 1 + j, 0, width - 1)];
        }
        sum += along_y[i] * of_row;
    }
    return sum;
}

/* Is any that `sample` takes blind? */
static int touches_blind(const float *image, int64_t height, int64_t width, double y, double x)
{
    const int64_t y0 = (int64_t)floor(y), x0 = (int64_t)floor(x);
    int found = 0;
    for (int i = 0; i < TAPS * TAPS; i++) {
        const int64_t row = v2v_within(y0 - 1 + i / TAPS, 0, height - 1);
        found |= image[row * width + v2v_within(x0 - 1 + i % TAPS, 0, width - 1)] == V2V_BLIND;
    }
    return found;
}

/* The transpose: the value goes to the pixels that `sample` takes it from, with their weights. */
static void spread(float *image, int64_t height, int64_t width, double y, double x, double value)
{
    const double top = floor(y), left = floor(x);
    const int64_t y0 = (int64_t)top, x0 = (int64_t)left;
    double along_y[TAPS], along_x[TAPS];
    cubic(along_y, y - top);
    cubic(along_x, x - left);
    for (int i = 0; i < TAPS; i++) {
        float *row = image + v2v_within(y0 - 1 + i, 0, height - 1) * width;
        for (int j = 0; j < TAPS; j++) {
            row[v2v_within(x0 - 1 + j, 0, width - 1)] += (float)(along_y[i] * along_x[j] * value);
        }
    }
}

static inline int clamped(int i, int side)
{
    const int low = i > 0 ? i : 0;
    return low < side ? low : side - 1;
}

/* The cubic weights once more, as values: loops over pixels become vectors. */
static inline float mixed(float t, float a, float b, float c, float d)
{
    return a * (t * (-0.5f + t * (1.0f - 0.5f * t))) + b * (1.0f + t * t * (-2.5f + 1.5f * t)) +
           c * (t * (0.5f + t * (2.0f - 1.5f * t))) + d * (t * t * (-0.5f + 0.5f * t));
}

/* Of the row that begins at `row`. */
static inline float mixed_row(const float *image, int row, int x0, int width, float t)
{
    return mixed(t, image[row + clamped(x0 - 1, width)], image[row + clamped(x0, width)],
                 image[row + clamped(x0 + 1, width)], image[row + clamped(x0 + 2, width)]);
}

static inline float along(const struct v2v_way *way, float way_of_all, float more, int x)
{
    return way->part[x] * (way_of_all + more);
}

/* Pixels of a row that are not where they were. */
V2V_SIMD_CLONES static int count_moved(const struct v2v_way *way, int width)
{
    const float least = way->least * way->least;
    int count = 0;
#pragma omp simd reduction(+ : count)
    for (int x = 0; x < width; x++) {
        const float way_y = along(way, way->y[x], way->more_y, x);
        const float way_x = along(way, way->x[x], way->more_x, x);
        count += way_y * way_y + way_x * way_x >= least;
    }
    return count;
}

V2V_SIMD_CLONES static void warp_row(float *restrict to, const float *from, int height, int width,
                                     int y, struct v2v_way way)
{
    const float least = way.least * way.least;
    const float *here = from + (int64_t)y * width;
#pragma omp simd
    for (int x = 0; x < width; x++) {
        const float way_y = along(&way, way.y[x], way.more_y, x);
        const float way_x = along(&way, way.x[x], way.more_x, x);
        const float down = floorf(way_y), over = floorf(way_x), t = way_x - over;
        const int y0 = y + (int)down, x0 = x + (int)over;
        const float moved =
            mixed(way_y - down, mixed_row(from, clamped(y0 - 1, height) * width, x0, width, t),
                  mixed_row(from, clamped(y0, height) * width, x0, width, t),
                  mixed_row(from, clamped(y0 + 1, height) * width, x0, width, t),
                  mixed_row(from, clamped(y0 + 2, height) * width, x0, width, t));
        to[x] = way_y * way_y + way_x * way_x < least ? here[x] : moved;
    }
}

void v2v_warp_row(float *to, const float *from, int64_t height, int64_t width, int64_t y,
                  const struct v2v_way *way)
{
    if (count_moved(way, (int)width) == 0) {
        memcpy(to, from + y * width, (size_t)width * sizeof *to);
    } else {
        warp_row(to, from, (int)height, (int)width, (int)y, *way);
    }
}

/* What polynomials of x count in row y of a field. */
static void row_of(double row[V2V_FIELD_ORDERS], const double *field, int64_t y, int64_t height)
{
    double of_y[V2V_FIELD_ORDERS];
    v2v_legendre(of_y, V2V_FIELD_ORDERS, v2v_field_place((double)y, height));
    v2v_field_row(row, field, of_y);
}

/* Both fields of a displacement, along y and along x. */
static void rows_of(double rows[2][V2V_FIELD_ORDERS], const double *field_y, const double *field_x,
                    int64_t y, int64_t height)
{
    row_of(rows[0], field_y, y, height);
    row_of(rows[1], field_x, y, height);
}

/* Their values in these rows. */
static void values_at(double value[2], double rows[2][V2V_FIELD_ORDERS], int64_t x, int64_t width)
{
    double of_x[V2V_FIELD_ORDERS];
    v2v_legendre(of_x, V2V_FIELD_ORDERS, v2v_field_place((double)x, width));
    value[0] = v2v_field_value(rows[0], of_x);
    value[1] = v2v_field_value(rows[1], of_x);
}

void v2v_warp_image(float *to, const float *from, int64_t height, int64_t width,
                    const double field_y[V2V_FIELD_TERMS], const double field_x[V2V_FIELD_TERMS])
{
    if (v2v_field_is_zero(field_y) && v2v_field_is_zero(field_x)) {
        memcpy(to, from, (size_t)(height * width) * sizeof *to);
        return;
    }
#pragma omp parallel for schedule(static)
    for (int64_t y = 0; y < height; y++) {
        double rows[2][V2V_FIELD_ORDERS], moved[2];
        rows_of(rows, field_y, field_x, y, height);
        for (int64_t x = 0; x < width; x++) {
            values_at(moved, rows, x, width);
            to[y * width + x] =
                (float)sample(from, height, width, (double)y - moved[0], (double)x - moved[1]);
        }
    }
}

/* On one thread: pixels share those that they go to. */
void v2v_warp_image_transpose(float *to, const float *from, int64_t height, int64_t width,
                              const double field_y[V2V_FIELD_TERMS],
                              const double field_x[V2V_FIELD_TERMS])
{
    if (v2v_field_is_zero(field_y) && v2v_field_is_zero(field_x)) {
        memcpy(to, from, (size_t)(height * width) * sizeof *to);
        return;
    }
    memset(to, 0, (size_t)(height * width) * sizeof *to);
    for (int64_t y = 0; y < height; y++) {
        double rows[2][V2V_FIELD_ORDERS], moved[2];
        rows_of(rows, field_y, field_x, y, height);
        for (int64_t x = 0; x < width; x++) {
            values_at(moved, rows, x, width);
            spread(to, height, width, (double)y - moved[0], (double)x - moved[1],
                   (double)from[y * width + x]);
        }
    }
}

/* Fields at the pixels of an image. */
struct displacement {
    float *y, *x; /* [height,width] */
    int64_t height, width;
};

static void displacement_fill(const struct displacement *displacement, const double *field_y,
                              const double *field_x)
{
    const int64_t height = displacement->height, width = displacement->width;
#pragma omp parallel for schedule(static)
    for (int64_t y = 0; y < height; y++) {
        double rows[2][V2V_FIELD_ORDERS], moved[2];
        rows_of(rows, field_y, field_x, y, height);
        for (int64_t x = 0; x < width; x++) {
            values_at(moved, rows, x, width);
            displacement->y[y * width + x] = (float)moved[0];
            displacement->x[y * width + x] = (float)moved[1];
        }
    }
}

/* Where a pixel was displaced to: at = pixel + field(at), from the pixel on. Between pixels fields
 * are sampled as images are. */
static void displaced(double at[2], const struct displacement *displacement, int64_t y, int64_t x)
{
    const int64_t height = displacement->height, width = displacement->width;
    double change = INFINITY;
    at[0] = (double)y + (double)displacement->y[y * width + x];
    at[1] = (double)x + (double)displacement->x[y * width + x];
    for (int pass = 0; pass < PASSES && change > still; pass++) {
        const double next_y = (double)y + sample(displacement->y, height, width, at[0], at[1]);
        const double next_x = (double)x + sample(displacement->x, height, width, at[0], at[1]);
        change = fmax(fabs(next_y - at[0]), fabs(next_x - at[1]));
        at[0] = next_y;
        at[1] = next_x;
    }
}

void v2v_unwarp_image(float *to, const float *from, float *scratch, int64_t height, int64_t width,
                      const double field_y[V2V_FIELD_TERMS], const double field_x[V2V_FIELD_TERMS])
{
    const struct displacement displacement = {scratch, scratch + height * width, height, width};
    if (v2v_field_is_zero(field_y) && v2v_field_is_zero(field_x)) {
        memcpy(to, from, (size_t)(height * width) * sizeof *to);
        return;
    }
    const int is_blind = v2v_blind_count(from, height * width) > 0;
    displacement_fill(&displacement, field_y, field_x);
#pragma omp parallel for schedule(static)
    for (int64_t y = 0; y < height; y++) {
        for (int64_t x = 0; x < width; x++) {
            double at[2];
            displaced(at, &displacement, y, x);
            to[y * width + x] = is_blind && touches_blind(from, height, width, at[0], at[1])
                                    ? V2V_BLIND
                                    : (float)sample(from, height, width, at[0], at[1]);
        }
    }
}

void v2v_shade_image(float *image, int64_t height, int64_t width,
                     const double field[V2V_FIELD_TERMS], double sign)
{
    if (v2v_field_is_zero(field)) {
        return;
    }
#pragma omp parallel for schedule(static)
    for (int64_t y = 0; y < height; y++) {
        double row[V2V_FIELD_ORDERS], of_x[V2V_FIELD_ORDERS];
        row_of(row, field, y, height);
        for (int64_t x = 0; x < width; x++) {
            v2v_legendre(of_x, V2V_FIELD_ORDERS, v2v_field_place((double)x, width));
            const double factor = exp(sign * v2v_field_value(row, of_x));
            float *const at = &image[y * width + x];
            *at = *at != V2V_BLIND ? (float)(factor * (double)*at) : V2V_BLIND;
        }
    }
}
