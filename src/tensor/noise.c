/* Noise and pedestal of images, estimated from differences of neighbours. */
#include "v2v3d/tensor/statistics.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/tensor/blind.h"

#include <math.h>
#include <string.h>

/* Of a line of noise: its points are means of levels; the weighted fit is repeated; variances below
 * this part of their mean weigh as that. */
enum { NOISE_LEVELS = 128, NOISE_FITS = 8 };
static const double noise_least = 0.05;

struct noise_level {
    double count, level, fine, coarse; /* sums; squares of 3 x 3 and of 2 x 2 differences */
};

/* a - 2 b + c of three rows or numbers; and their 1 : 2 : 1 mean. */
static double bent(double a, double b, double c)
{
    return (a - b) - (b - c);
}

static double mean_of(double a, double b, double c)
{
    return 0.25 * (a + c) + 0.5 * b;
}

/* What 3 x 3 samples say, from `a` on, of white noise's variance. */
static struct noise_level block_of(const float *a, int64_t width)
{
    const double of_bent = 1.0 / 36.0, of_step = 0.25; /* over the sums of their taps' squares */
    const float *b = a + width, *c = b + width;
    double d[3], m[3];
    for (int i = 0; i < 3; i++) {
        const double p = (double)a[i], q = (double)b[i], r = (double)c[i];
        d[i] = bent(p, q, r);
        m[i] = mean_of(p, q, r);
    }
    const double twice = bent(d[0], d[1], d[2]);
    const double step = ((double)a[0] - (double)a[1]) - ((double)b[0] - (double)b[1]);
    return (struct noise_level){.count = 1.0,
                                .level = mean_of(m[0], m[1], m[2]),
                                .fine = of_bent * twice * twice,
                                .coarse = of_step * step * step};
}

static void add_level(struct noise_level *to, const struct noise_level *from)
{
    to->count += from->count;
    to->level += from->level;
    to->fine += from->fine;
    to->coarse += from->coarse;
}

/* One image into its levels: each block into that of another, whose samples aren't its own. By its
 * own level, noise alone would spread the dark over many levels of one variance. Blind samples put
 * a block's level beyond all. */
static void sort_noise(struct noise_level levels[NOISE_LEVELS], const float *image, int64_t height,
                       int64_t width, double most)
{
    enum { APART = 3 };
    /* counts of photons and 0 lie on no border: round-off would move many at once */
    const double end = 1.0123 * most, per_level = NOISE_LEVELS / (2.0317 * most);
    struct noise_level last[APART];
    for (int64_t y = 0; y + 2 < height; y++) {
        for (int64_t x = 0; x + 2 < width; x++) {
            const struct noise_level block = block_of(image + y * width + x, width);
            const struct noise_level *before = &last[x % APART];
            if (x >= APART && fabs(block.level) < end && fabs(before->level) < end) {
                add_level(&levels[(int)((block.level + end) * per_level)], before);
            }
            last[x % APART] = block;
        }
    }
}

/* Of a square of normal noise the variance is twice its own square; neighbours' differences share
 * samples: (1, -4, 6, -4, 1) / 6 of them, squared and summed, in both directions. */
static const double noise_neighbours = 2.0 * (70.0 / 36.0) * (70.0 / 36.0);

/* The line through the levels' means, each weighted by its count over the line's own square; and
 * the slope of one through those of the coarse differences, over its own. */
static struct v2v_noise_line fit_noise(const struct noise_level levels[NOISE_LEVELS], double mean)
{
    struct v2v_noise_line line = {.variance = mean};
    for (int fit = 0; fit < NOISE_FITS; fit++) {
        double sum[5] = {0};    /* of 1, level, variance, level^2, level * variance */
        double coarse[2] = {0}; /* of variance, level * variance */
        for (int i = 0; i < NOISE_LEVELS; i++) {
            const double count = levels[i].count;
            if (count > 0.0) {
                const double level = levels[i].level / count, found = levels[i].fine / count;
                const double size =
                    fmax(line.gain * level + line.variance, noise_least * mean) / mean;
                const double weight = count / (size * size);
                sum[0] += weight;
                sum[1] += weight * level;
                sum[2] += weight * found;
                sum[3] += weight * level * level;
                sum[4] += weight * level * found;
                coarse[0] += weight * levels[i].coarse / count;
                coarse[1] += weight * levels[i].coarse / count * level;
            }
        }
        const double spread = sum[3] - sum[1] * sum[1] / sum[0];
        const double rise = sum[4] - sum[1] * sum[2] / sum[0];
        line.gain = spread > 0.0 ? rise / spread : 0.0;
        line.variance = (sum[2] - line.gain * sum[1]) / sum[0];
        line.gain_error = spread > 0.0 ? mean * sqrt(noise_neighbours / spread) : 0.0;
        line.colour = rise > 0.0 ? (coarse[1] - sum[1] * coarse[0] / sum[0]) / rise : 0.0;
    }
    return line;
}

struct v2v_noise_line v2v_noise_line_of_images(const float *images, int64_t count, int64_t height,
                                               int64_t width, double most)
{
    enum { TOGETHER = 16 };
    struct noise_level levels[NOISE_LEVELS] = {0}, all = {0};
    struct noise_level of_image[TOGETHER][NOISE_LEVELS];
    for (int64_t first = 0; first < count; first += TOGETHER) {
        const int64_t some = v2v_smaller(TOGETHER, count - first);
        memset(of_image, 0, sizeof of_image);
#pragma omp parallel for schedule(dynamic)
        for (int64_t i = 0; i < some; i++) {
            sort_noise(of_image[i], images + (first + i) * height * width, height, width, most);
        }
        for (int64_t i = 0; i < some * NOISE_LEVELS; i++) { /* one order for any threads */
            add_level(&levels[i % NOISE_LEVELS], &of_image[i / NOISE_LEVELS][i % NOISE_LEVELS]);
        }
    }
    for (int i = 0; i < NOISE_LEVELS; i++) {
        add_level(&all, &levels[i]);
    }
    return all.fine > 0.0 ? fit_noise(levels, all.fine / all.count) : (struct v2v_noise_line){0};
}

double v2v_noise_of_differences(float *differences, int64_t count)
{
    const double of_normal = 0.67448975019608171; /* median of |x|, x standard normal */
    return (double)v2v_select(differences, count, count / 2) / (2.0 * of_normal);
}

double v2v_noise_of_images(float *scratch, const float *images, int64_t count, int64_t height,
                           int64_t width)
{
    enum { PIXELS = 4 };
    const int64_t inside = (height - 1) * (width - 1);
    if (height < 2 || width < 2) {
        return 0.0;
    }
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t i = 0; i < count; i++) {
        for (int64_t y = 0; y < height - 1; y++) {
            const float *here = images + (i * height + y) * width, *below = here + width;
            float *to = scratch + i * inside + y * (width - 1);
            for (int64_t x = 0; x < width - 1; x++) {
                const float difference = fabsf((here[x] - here[x + 1]) - (below[x] - below[x + 1]));
                const int is_seen = (here[x] != V2V_BLIND) & (here[x + 1] != V2V_BLIND) &
                                    (below[x] != V2V_BLIND) & (below[x + 1] != V2V_BLIND);
                to[x] = is_seen ? difference : V2V_BLIND;
            }
        }
    }
    const int64_t seen = v2v_blind_gather_seen(scratch, scratch, count * inside);
    if (seen == 0) {
        return 0.0;
    }
    const double noise = v2v_noise_of_differences(scratch, seen);
    return noise > 0.0 ? noise : sqrt(v2v_sum_of_squares(scratch, seen) / (double)(PIXELS * seen));
}

double v2v_mean_of_square(const float *at, int64_t width, int64_t side)
{
    double sum = 0.0;
    for (int64_t y = 0; y < side; y++) {
        for (int64_t x = 0; x < side; x++) {
            sum += (double)at[y * width + x];
        }
    }
    return sum / (double)(side * side);
}

static int is_seen(const float *at, int64_t width, int64_t side)
{
    int blind = 0;
    for (int64_t y = 0; y < side; y++) {
        for (int64_t x = 0; x < side; x++) {
            blind |= at[y * width + x] == V2V_BLIND;
        }
    }
    return !blind;
}

/* Means of squares of an image, from its first row and column on, but of those with blind samples.
 * @return how many */
static int64_t means_of_squares(float *means, const float *image, int64_t height, int64_t width,
                                int64_t side)
{
    const int64_t across = width / side, down = height / side;
    int64_t seen = 0;
    for (int64_t i = 0; i < down * across; i++) {
        const float *square = image + i / across * side * width + i % across * side;
        if (is_seen(square, width, side)) {
            means[seen++] = (float)v2v_mean_of_square(square, width, side);
        }
    }
    return seen;
}

/* Of squares of 16 x 16 pixels, or what fits. */
struct darkness {
    double least;  /* mean that a hundredth of them stays below */
    double bright; /* mean of the brightest */
    double error;  /* standard deviation of a mean, by noise */
};

/* Squares of a grid whose means are at most so: of their quarters' means, the squares about their
 * own mean, and how many are free. */
static void add_quarters(double *squares, double *count, const float *image, int64_t height,
                         int64_t width, int64_t side, double most)
{
    enum { QUARTERS = 4 };
    const int64_t across = width / side, down = height / side, half = side / 2;
    for (int64_t i = 0; i < down * across; i++) {
        const float *at = image + i / across * side * width + i % across * side;
        double mean = 0.0, of[QUARTERS];
        if (v2v_mean_of_square(at, width, side) > most || !is_seen(at, width, side)) {
            continue;
        }
        for (int64_t q = 0; q < QUARTERS; q++) {
            of[q] = v2v_mean_of_square(at + q / 2 * half * width + q % 2 * half, width, half);
            mean += of[q] / QUARTERS;
        }
        for (int64_t q = 0; q < QUARTERS; q++) {
            *squares += (of[q] - mean) * (of[q] - mean);
        }
        *count += QUARTERS - 1;
    }
}

/* A mean's error is that of white noise, or what the quarters of the darkest tenth of the squares
 * differ by, where neighbouring pixels share their noise, as in views that were resampled. */
static struct darkness darkness_of(float *scratch, const float *images, int64_t count,
                                   int64_t height, int64_t width)
{
    enum { SIDE = 16, OF_LEAST = 100, OF_DARK = 10 };
    const int64_t side = v2v_smaller(SIDE, v2v_smaller(height, width)), pixels = height * width;
    int64_t n = 0;
    double squares = 0.0, free = 0.0;
    for (int64_t i = 0; i < count; i++) {
        n += means_of_squares(scratch + n, images + i * pixels, height, width, side);
    }
    if (n == 0) {
        return (struct darkness){0};
    }
    struct darkness dark = {.bright = (double)v2v_select(scratch, n, n - 1)};
    const double tenth = (double)v2v_select(scratch, n, n / OF_DARK);
    dark.least = (double)v2v_select(scratch, n, n / OF_LEAST);
    for (int64_t i = 0; i < count && side > 1; i++) {
        add_quarters(&squares, &free, images + i * pixels, height, width, side, tenth);
    }
    const double white = v2v_noise_of_images(scratch, images, count, height, width) / (double)side;
    dark.error = fmax(white, free > 0.0 ? sqrt(squares / free) / 2.0 : 0.0);
    return dark;
}

/* Means that stray so many of their standard deviations are no noise; the least of many strays by
 * two. */
enum { CERTAIN = 5, STRAYS = 2, OF_BRIGHT = 100 };

struct v2v_dark v2v_dark_of_images(float *scratch, const float *images, int64_t count,
                                   int64_t height, int64_t width)
{
    const struct darkness dark = darkness_of(scratch, images, count, height, width);
    const double above = dark.least, below = -dark.least - STRAYS * dark.error;
    const int is_above = above > CERTAIN * dark.error && OF_BRIGHT * above > dark.bright;
    const int is_below = below > CERTAIN * dark.error && OF_BRIGHT * below > dark.bright;
    return (struct v2v_dark){.above = is_above ? above + STRAYS * dark.error : 0.0,
                             .below = is_below ? below : 0.0};
}
