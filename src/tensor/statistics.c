#include "v2v3d/tensor/statistics.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"

#include <math.h>
#include <string.h>

enum { LANES = 8, RUNS = 256, SCAN = 4096, MOST_BINS = 1024 };

static double minimum(const float *x, int64_t count)
{
    double least = (double)x[0];
    for (int64_t i = 1; i < count; i++) {
        least = (double)x[i] < least ? (double)x[i] : least;
    }
    return least;
}

static double mean(const float *x, int64_t count)
{
    double sum = 0.0;
    for (int64_t i = 0; i < count; i++) {
        sum += (double)x[i];
    }
    return sum / (double)count;
}

/** The bin of value, as numpy.histogram decides: by its offset, then corrected against the bin's
 * edges, with the last bin closed on the right. */
static int bin_of(double value, double low, double width, int bins)
{
    int bin = (int)((value - low) / width);
    bin = bin < bins ? bin : bins - 1;
    if (bin > 0 && value < low + width * bin) {
        bin--;
    } else if (bin < bins - 1 && value >= low + width * (bin + 1)) {
        bin++;
    }
    return bin;
}

double v2v_background(const float *x, int64_t count, int bins, int right)
{
    int64_t height[MOST_BINS] = {0};
    int fullest = 0;
    V2V_ASSERT(bins >= 1 && bins <= MOST_BINS);
    if (count == 0) {
        return 0.0;
    }
    double high = mean(x, count);
    if (!isfinite(high)) {
        return high;
    }
    double low = minimum(x, count);
    double width = (high - low) / bins;
    if (!(width > 0.0)) {
        return low; /* a constant image is its own background */
    }
    for (int64_t i = 0; i < count; i++) {
        if ((double)x[i] <= high) {
            height[bin_of((double)x[i], low, width, bins)]++;
        }
    }
    for (int b = 1; b < bins; b++) {
        fullest = height[b] > height[fullest] ? b : fullest;
    }
    return low + width * (fullest + (right ? 1 : 0));
}

static void swap(float *a, float *b)
{
    float t = *a;
    *a = *b;
    *b = t;
}

/* Of more values than this a sample about k is parted first, so that its k-th value, as a pivot,
 * leaves little of the rest (Floyd and Rivest, Commun. ACM 18, 165 (1975)). */
enum { SAMPLED = 600 };

static void select_in_sample(float *x, int64_t count, int64_t k)
{
    const double n = (double)count, place = (double)(k + 1), z = log(n), s = 0.5 * exp(2 * z / 3);
    const double spread = 0.5 * sqrt(z * s * (n - s) / n) * (place < 0.5 * n ? -1.0 : 1.0);
    const double start = (double)k - place * s / n + spread; /* <= k <= start + s */
    const int64_t first = (int64_t)fmax(0.0, start);
    const int64_t last = (int64_t)fmin(n - 1.0, start + s);
    v2v_select(x + first, last - first + 1, k - first);
}

static int64_t middle_of_three(float *x, int64_t first, int64_t last)
{
    const int64_t middle = first + (last - first) / 2;
    if (x[middle] < x[first]) {
        swap(&x[middle], &x[first]);
    }
    if (x[last] < x[first]) {
        swap(&x[last], &x[first]);
    }
    if (x[last] < x[middle]) {
        swap(&x[last], &x[middle]);
    }
    return middle;
}

/** Hoare's selection. */
float v2v_select(float *x, int64_t count, int64_t k)
{
    int64_t first = 0, last = count - 1;
    while (first < last) {
        int64_t place = k;
        if (last - first > SAMPLED) {
            select_in_sample(x + first, last - first + 1, k - first);
        } else {
            place = middle_of_three(x, first, last);
        }
        float pivot = x[place];
        int64_t i = first, j = last;
        while (i <= j) {
            while (x[i] < pivot) {
                i++;
            }
            while (pivot < x[j]) {
                j--;
            }
            if (i <= j) {
                swap(&x[i++], &x[j--]);
            }
        }
        if (k <= j) {
            last = j;
        } else if (k >= i) {
            first = i;
        } else {
            break;
        }
    }
    return x[k];
}

enum v2v_status v2v_percentile(double *value, const float *x, int64_t count, double p)
{
    enum v2v_status rc = V2V_OK;
    float *sorted = NULL;
    V2V_ASSERT(count > 0 && p >= 0.0 && p <= 100.0);
    for (int64_t i = 0; i < count; i++) {
        if (isnan(x[i])) {
            *value = NAN;
            return V2V_OK;
        }
    }
    V2V_TRY(V2V_ALLOC(sorted, "tensor.percentile", count));
    memcpy(sorted, x, (size_t)count * sizeof *x);
    double place = p / 100.0 * (double)(count - 1);
    int64_t below = (int64_t)place;
    double share = place - (double)below;
    double a = (double)v2v_select(sorted, count, below);
    if (share > 0.0) {
        double b = minimum(sorted + below + 1, count - below - 1);
        a = share < 0.5 ? a + (b - a) * share : b - (b - a) * (1.0 - share);
    }
    *value = a;
done:
    v2v_mem_free(sorted);
    return rc;
}

/** Lanes are fixed here, not by the processor's vector width, and a product of two floats is exact
 * in double precision: every machine gets the same bits, with fused multiply-adds or without. */
static double sum_of_squares(const float *x, int64_t count)
{
    double lane[LANES] = {0};
    int64_t i = 0;
    for (; i + LANES <= count; i += LANES) {
        for (int l = 0; l < LANES; l++) {
            lane[l] += (double)x[i + l] * (double)x[i + l];
        }
    }
    for (int l = 0; i < count; i++, l++) {
        lane[l] += (double)x[i] * (double)x[i];
    }
    return ((lane[0] + lane[4]) + (lane[1] + lane[5])) +
           ((lane[2] + lane[6]) + (lane[3] + lane[7]));
}

double v2v_sum_of_squares(const float *x, int64_t count)
{
    /* The runs depend on the count alone: the number of threads doesn't change the bits. */
    double partial[RUNS];
    double sum = 0.0;
    int64_t run = (count + RUNS - 1) / RUNS;
#pragma omp parallel for schedule(static) if (count > RUNS * SCAN)
    for (int r = 0; r < RUNS; r++) {
        int64_t first = r * run < count ? r * run : count;
        int64_t rest = count - first;
        partial[r] = sum_of_squares(x + first, rest < run ? rest : run);
    }
    for (int r = 0; r < RUNS; r++) {
        sum += partial[r];
    }
    return sum;
}

/** NaN and Inf have all bits of the exponent set. */
static int is_special(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return (bits & 0x7f800000u) == 0x7f800000u;
}

void v2v_figures_add(struct v2v_figures *figures, const float *x, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        const double value = (double)x[i];
        const int is_first = figures->count + i == 0;
        figures->least = is_first || value < figures->least ? value : figures->least;
        figures->most = is_first || value > figures->most ? value : figures->most;
        figures->sum += value;
        figures->squares += value * value;
    }
    figures->count += count;
}

double v2v_figures_mean(const struct v2v_figures *figures)
{
    return figures->count > 0 ? figures->sum / (double)figures->count : 0.0;
}

double v2v_figures_deviation(const struct v2v_figures *figures)
{
    const double mean = v2v_figures_mean(figures);
    return figures->count > 0
               ? sqrt(fmax(figures->squares / (double)figures->count - mean * mean, 0.0))
               : 0.0;
}

int64_t v2v_first_not_finite(const float *x, int64_t count)
{
    int64_t found = count;
#pragma omp parallel for schedule(static) reduction(min : found)
    for (int64_t first = 0; first < count; first += SCAN) {
        int64_t end = count - first < SCAN ? count : first + SCAN;
        int special = 0;
        for (int64_t i = first; i < end; i++) {
            special |= is_special(x[i]);
        }
        for (int64_t i = end - 1; special && i >= first; i--) {
            found = is_special(x[i]) && i < found ? i : found;
        }
    }
    return found < count ? found : -1;
}

/* Of a line of noise: its points are means of levels; the weighted fit is repeated; variances below
 * this part of their mean weigh as that. */
enum { NOISE_LEVELS = 128, NOISE_FITS = 8 };
static const double noise_least = 0.05;

struct noise_level {
    double count, level, squares; /* sums */
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

/* One image into its levels. @param coarse += squares of the 2 x 2 differences, over 4 */
static void sort_noise(struct noise_level levels[NOISE_LEVELS], double *coarse, const float *image,
                       int64_t height, int64_t width, double most)
{
    const double of_bent = 1.0 / 36.0, of_step = 0.25; /* over the sums of their taps' squares */
    /* counts of photons and 0 lie on no border: round-off would move many at once */
    const double end = 1.0123 * most, per_level = NOISE_LEVELS / (2.0317 * most);
    for (int64_t y = 0; y + 2 < height; y++) {
        const float *a = image + y * width, *b = a + width, *c = b + width;
        for (int64_t x = 0; x + 2 < width; x++) {
            double d[3], m[3];
            for (int i = 0; i < 3; i++) {
                const double p = (double)a[x + i], q = (double)b[x + i], r = (double)c[x + i];
                d[i] = bent(p, q, r);
                m[i] = mean_of(p, q, r);
            }
            const double twice = bent(d[0], d[1], d[2]), level = mean_of(m[0], m[1], m[2]);
            const double step =
                ((double)a[x] - (double)a[x + 1]) - ((double)b[x] - (double)b[x + 1]);
            if (fabs(level) < end) {
                struct noise_level *to = &levels[(int)((level + end) * per_level)];
                to->count += 1.0;
                to->level += level;
                to->squares += of_bent * twice * twice;
                *coarse += of_step * step * step;
            }
        }
    }
}

/* Of a square of normal noise the variance is twice its own square; neighbours' differences share
 * samples: (1, -4, 6, -4, 1) / 6 of them, squared and summed, in both directions. */
static const double noise_neighbours = 2.0 * (70.0 / 36.0) * (70.0 / 36.0);

/* The line through the levels' means, each weighted by its count over the line's own square. */
static struct v2v_noise_line fit_noise(const struct noise_level levels[NOISE_LEVELS], double mean)
{
    struct v2v_noise_line line = {.variance = mean};
    for (int fit = 0; fit < NOISE_FITS; fit++) {
        double sum[5] = {0}; /* of 1, level, variance, level^2, level * variance */
        for (int i = 0; i < NOISE_LEVELS; i++) {
            const double count = levels[i].count;
            if (count > 0.0) {
                const double level = levels[i].level / count, found = levels[i].squares / count;
                const double size =
                    fmax(line.gain * level + line.variance, noise_least * mean) / mean;
                const double weight = count / (size * size);
                sum[0] += weight;
                sum[1] += weight * level;
                sum[2] += weight * found;
                sum[3] += weight * level * level;
                sum[4] += weight * level * found;
            }
        }
        const double spread = sum[3] - sum[1] * sum[1] / sum[0];
        line.gain = spread > 0.0 ? (sum[4] - sum[1] * sum[2] / sum[0]) / spread : 0.0;
        line.variance = (sum[2] - line.gain * sum[1]) / sum[0];
        line.gain_error = spread > 0.0 ? mean * sqrt(noise_neighbours / spread) : 0.0;
    }
    return line;
}

struct v2v_noise_line v2v_noise_line_of_images(const float *images, int64_t count, int64_t height,
                                               int64_t width, double most)
{
    struct noise_level levels[NOISE_LEVELS] = {0};
    double coarse = 0.0, squares = 0.0, blocks = 0.0;
    for (int64_t i = 0; i < count; i++) {
        sort_noise(levels, &coarse, images + i * height * width, height, width, most);
    }
    for (int i = 0; i < NOISE_LEVELS; i++) {
        blocks += levels[i].count;
        squares += levels[i].squares;
    }
    if (!(squares > 0.0)) {
        return (struct v2v_noise_line){0};
    }
    struct v2v_noise_line line = fit_noise(levels, squares / blocks);
    line.colour = coarse / squares;
    return line;
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
                to[x] = fabsf((here[x] - here[x + 1]) - (below[x] - below[x + 1]));
            }
        }
    }
    const double noise = v2v_noise_of_differences(scratch, count * inside);
    return noise > 0.0 ? noise
                       : sqrt(v2v_sum_of_squares(scratch, count * inside) /
                              (double)(PIXELS * count * inside));
}

/* Means of squares of an image, from its first row and column on. @return how many */
static int64_t means_of_squares(float *means, const float *image, int64_t height, int64_t width,
                                int64_t side)
{
    const int64_t across = width / side, down = height / side;
    for (int64_t i = 0; i < down * across; i++) {
        const float *square = image + i / across * side * width + i % across * side;
        double sum = 0.0;
        for (int64_t k = 0; k < side * side; k++) {
            sum += (double)square[k / side * width + k % side];
        }
        means[i] = (float)(sum / (double)(side * side));
    }
    return down * across;
}

double v2v_pedestal_of_images(float *scratch, const float *images, int64_t count, int64_t height,
                              int64_t width)
{
    enum { SIDE = 16, OF_LEAST = 100, DARK = 100, CERTAIN = 5, BELOW = 2 };
    const int64_t side = v2v_smaller(SIDE, v2v_smaller(height, width));
    int64_t squares = 0;
    for (int64_t i = 0; i < count; i++) {
        squares +=
            means_of_squares(scratch + squares, images + i * height * width, height, width, side);
    }
    const double bright = (double)v2v_select(scratch, squares, squares - 1);
    const double least = (double)v2v_select(scratch, squares, squares / OF_LEAST);
    if (!(least > 0.0 && DARK * least > bright)) {
        return 0.0;
    }
    const double error = v2v_noise_of_images(scratch, images, count, height, width) / (double)side;
    return least > CERTAIN * error ? least + BELOW * error : 0.0;
}
