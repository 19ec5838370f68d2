#include "v2v3d/tensor/statistics.h"

#include "v2v3d/base/clones.h"
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

/** Values below the pivot, or not above it, go before the others, without a branch that nothing
 *  foresees. @return the first of the others */
static inline __attribute__((always_inline)) int64_t part(float *x, int64_t first, int64_t last,
                                                          float pivot, int equal)
{
    int64_t end = first;
    for (int64_t i = first; i <= last; i++) {
        const float value = x[i];
        x[i] = x[end];
        x[end] = value;
        end += equal ? value <= pivot : value < pivot;
    }
    return end;
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
        const float pivot = x[place];
        const int64_t above = part(x, first, last, pivot, 0);
        if (k < above) {
            last = above - 1;
            continue;
        }
        first = part(x, above, last, pivot, 1);
        if (k < first || isnan(pivot)) {
            break; /* it is the pivot */
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
static inline double sum_lanes(const float *x, const float *by, int64_t count)
{
    double lane[LANES] = {0};
    int64_t i = 0;
    for (; i + LANES <= count; i += LANES) {
        for (int l = 0; l < LANES; l++) {
            lane[l] += (double)x[i + l] * (by != NULL ? (double)by[i + l] : 1.0);
        }
    }
    for (int l = 0; i < count; i++, l++) {
        lane[l] += (double)x[i] * (by != NULL ? (double)by[i] : 1.0);
    }
    return ((lane[0] + lane[4]) + (lane[1] + lane[5])) +
           ((lane[2] + lane[6]) + (lane[3] + lane[7]));
}

V2V_SIMD_CLONES
static double sum(const float *x, int64_t count)
{
    return sum_lanes(x, NULL, count);
}

V2V_SIMD_CLONES
static double sum_of_squares(const float *x, int64_t count)
{
    return sum_lanes(x, x, count);
}

static double sum_runs(const float *x, int64_t count, double (*of_run)(const float *, int64_t))
{
    /* The runs depend on the count alone: the number of threads doesn't change the bits. */
    double partial[RUNS];
    double all = 0.0;
    int64_t run = (count + RUNS - 1) / RUNS;
#pragma omp parallel for schedule(static) if (count > RUNS * SCAN)
    for (int r = 0; r < RUNS; r++) {
        int64_t first = r * run < count ? r * run : count;
        int64_t rest = count - first;
        partial[r] = of_run(x + first, rest < run ? rest : run);
    }
    for (int r = 0; r < RUNS; r++) {
        all += partial[r];
    }
    return all;
}

double v2v_sum(const float *x, int64_t count)
{
    return sum_runs(x, count, sum);
}

double v2v_sum_of_squares(const float *x, int64_t count)
{
    return sum_runs(x, count, sum_of_squares);
}

double v2v_sum_of_products(const float *a, const float *b, int64_t count)
{
    return sum_lanes(a, b, count);
}

double v2v_dot(const double *a, const double *b, int64_t count)
{
    double sum = 0.0;
    for (int64_t i = 0; i < count; i++) {
        sum += a[i] * b[i];
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

int v2v_is_of_one_value(const float *x, int64_t count)
{
    int64_t i = 1;
    while (i < count && x[i] == x[0]) {
        i++;
    }
    return i >= count;
}
