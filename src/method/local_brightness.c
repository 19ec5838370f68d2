#include "method/local_brightness.h"

#include "method/photons.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/coarse.h"
#include "v2v3d/tensor/smooth.h"

#include <math.h>

/* REFERENCE.md 12. Pixels along a square, and so many others about it twice. */
enum { SIDE = 4, RADIUS = 1 };

/* Standard deviation of what is expected to be more than the factor of all, of that. */
static const double expected = 1.0;

/* What noise makes of chi^2 is 1 in the mean; so much of it is taken for noise. */
static const double by_noise = 3.0;

static const double most = 4.0;

struct v2v_local_brightness {
    int64_t views, height, width;
    int64_t rows, columns; /* of squares */
    double unit, even;
    /* [v,rows,columns] */
    float *frame, *neighbour, *photons;
    float *light, *product; /* b b and b e of two frames, in units of noise */
    float *factor, *scratch;
    float *line; /* [v,columns] */
};

static int64_t squares_of(int64_t height, int64_t width)
{
    return v2v_mem_product(v2v_parts(height, SIDE), v2v_parts(width, SIDE), 1);
}

int64_t v2v_local_brightness_floats(int64_t views, int64_t height, int64_t width)
{
    return v2v_mem_product(views, 7 * squares_of(height, width) + v2v_parts(width, SIDE), 1);
}

enum v2v_status v2v_local_brightness_create(struct v2v_local_brightness **local, int64_t views,
                                            int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_local_brightness *made = NULL;
    const int64_t squares = squares_of(height, width), all = v2v_mem_product(views, squares, 1);
    *local = NULL;
    V2V_TRY(V2V_ALLOC(made, "method.brightness", 1));
    *made = (struct v2v_local_brightness){.views = views,
                                          .height = height,
                                          .width = width,
                                          .rows = v2v_parts(height, SIDE),
                                          .columns = v2v_parts(width, SIDE)};
    V2V_TRY(V2V_ALLOC(made->frame, "method.brightness", all));
    V2V_TRY(V2V_ALLOC(made->neighbour, "method.brightness", all));
    V2V_TRY(V2V_ALLOC(made->photons, "method.brightness", all));
    V2V_TRY(V2V_ALLOC(made->factor, "method.brightness", all));
    V2V_TRY(V2V_ALLOC(made->light, "method.brightness", all));
    V2V_TRY(V2V_ALLOC(made->product, "method.brightness", all));
    V2V_TRY(V2V_ALLOC(made->scratch, "method.brightness", all));
    V2V_TRY(V2V_ALLOC(made->line, "method.brightness", v2v_mem_product(views, made->columns, 1)));
    *local = made;
    made = NULL;
done:
    v2v_local_brightness_destroy(&made);
    return rc;
}

void v2v_local_brightness_destroy(struct v2v_local_brightness **local)
{
    struct v2v_local_brightness *old = *local;
    *local = NULL;
    if (old != NULL) {
        v2v_mem_free(old->line);
        v2v_mem_free(old->scratch);
        v2v_mem_free(old->product);
        v2v_mem_free(old->light);
        v2v_mem_free(old->factor);
        v2v_mem_free(old->photons);
        v2v_mem_free(old->neighbour);
        v2v_mem_free(old->frame);
        v2v_mem_free(old);
    }
}

void v2v_local_brightness_begin(struct v2v_local_brightness *local, const float *views,
                                const float *photons, double unit, double even)
{
    const int64_t height = local->height, width = local->width;
    local->unit = unit;
    local->even = fmax(even, V2V_PHOTONS_LEAST_VARIANCE);
    v2v_coarse_images(local->frame, views, local->views, height, width, SIDE, 1.0f);
    v2v_coarse_images(local->photons, photons, local->views, height, width, SIDE, 1.0f);
}

/* Of a square of a view, of means of its samples: the variance of b, and of a - f b. */
struct variance {
    float of_b, of_both;
};

static inline struct variance variance_of(const struct v2v_local_brightness *local, float photons,
                                          float f)
{
    const float of_mean = (float)(local->unit / (SIDE * SIDE)), even = (float)local->even;
    return (struct variance){of_mean * (photons / f + even),
                             of_mean * ((1.0f + f) * photons + (1.0f + f * f) * even)};
}

/* Of view v: b b less what noise makes of it, and b (a - f b) less that, over the variance of a - f
 * b, means of what is about every square. Below 0 b is no light. */
static void find_moments(const struct v2v_local_brightness *local, int64_t v, double factor)
{
    const int64_t rows = local->rows, columns = local->columns, squares = rows * columns;
    const float *a = local->frame + v * squares, *b = local->neighbour + v * squares;
    const float *photons = local->photons + v * squares, f = (float)factor;
    float *lights = local->light + v * squares, *products = local->product + v * squares;
    float *scratch = local->scratch + v * squares;
    for (int64_t i = 0; i < squares; i++) {
        const struct variance variance = variance_of(local, photons[i], f);
        const float light = b[i] > 0.0f ? b[i] : 0.0f;
        lights[i] = (light * light - variance.of_b) / variance.of_both;
        products[i] = (light * (a[i] - f * b[i]) + f * variance.of_b) / variance.of_both;
    }
    for (int pass = 0; pass < 2; pass++) {
        v2v_smooth_image(lights, scratch, lights, rows, columns, RADIUS);
        v2v_smooth_image(products, scratch, products, rows, columns, RADIUS);
    }
}

/* Least squares, drawn to the factor of all, more where light is noise, and nearer by what noise
 * makes of chi^2. */
static void find_factors(const struct v2v_local_brightness *local, int64_t v, double factor)
{
    const int64_t squares = local->rows * local->columns;
    const double count = v2v_smooth_twice_count(RADIUS);
    for (int64_t i = v * squares; i < (v + 1) * squares; i++) {
        const struct variance variance = variance_of(local, local->photons[i], (float)factor);
        const double noise = (double)(variance.of_b / variance.of_both);
        const double light = (double)local->light[i], product = count * (double)local->product[i];
        const double drawn = (light + noise) / light * pow(expected * factor, -2.0);
        const double more = light > 0.0 ? product / (count * light + drawn) : 0.0;
        const double chi2 = product * more;
        const double found = chi2 > by_noise ? factor + (1.0 - by_noise / chi2) * more : factor;
        local->factor[i] = (float)fmin(fmax(found, factor / most), factor * most);
    }
}

/* Between two rows of squares, then between the squares of that line: to[x] of the four pixels that
 * lie between the centres of two. */
static void factors_of_row(float *to, float *line, const float *above, const float *below,
                           float down, int64_t columns, int64_t width)
{
    for (int64_t x = 0; x < columns; x++) {
        line[x] = above[x] + down * (below[x] - above[x]);
    }
    for (int64_t x = 0; x <= columns; x++) {
        const float left = line[v2v_larger(x - 1, 0)];
        const float more = line[v2v_smaller(x, columns - 1)] - left;
        const int64_t first = x * SIDE - SIDE / 2;
        for (int64_t k = v2v_larger(-first, 0); k < v2v_smaller(SIDE, width - first); k++) {
            to[first + k] = left + ((float)k + 0.5f) / SIDE * more;
        }
    }
}

/* Of view v, from its squares to its pixels. */
static void spread_factors(const struct v2v_local_brightness *local, int64_t v, float *to)
{
    const int64_t rows = local->rows, columns = local->columns;
    const float *factor = local->factor + v * rows * columns;
    for (int64_t y = 0; y < local->height; y++) {
        const int64_t behind = (y + SIDE / 2) / SIDE; /* the square whose centre lies behind it */
        const float down = ((float)(y - behind * SIDE + SIDE / 2) + 0.5f) / SIDE;
        factors_of_row(to + y * local->width, local->line + v * columns,
                       factor + v2v_larger(behind - 1, 0) * columns,
                       factor + v2v_smaller(behind, rows - 1) * columns, down, columns,
                       local->width);
    }
}

void v2v_local_brightness_find(struct v2v_local_brightness *local, float *to,
                               const float *neighbour, double factor)
{
    const int64_t height = local->height, width = local->width;
    v2v_coarse_images(local->neighbour, neighbour, local->views, height, width, SIDE, 1.0f);
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < local->views; v++) {
        find_moments(local, v, factor);
        find_factors(local, v, factor);
        spread_factors(local, v, to + v * height * width);
    }
}
