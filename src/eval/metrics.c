#include "v2v3d/eval/metrics.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>

/* REFERENCE.md 6. */
enum {
    CROP = 10,   /* pixels on each side in y and x */
    WINDOW = 11, /* taps of the Gaussian window on a side */
    BINS = 100,  /* of the background histogram */
    FIELDS = 5   /* filtered images: a, b, aa, bb, ab */
};
static const double window_sigma = 1.5;                 /* pixels */
static const double c1 = 0.01 * 0.01, c2 = 0.03 * 0.03; /* (K * data range)^2, data range 1 */

/** A volume without its border and background: max(x - background, 0) * scale. */
struct signal {
    const float *x; /* [z,y,x], cropped */
    double background, scale;
};

static double signal_at(const struct signal *signal, int64_t i)
{
    double value = (double)signal->x[i] - signal->background;
    return value > 0 ? signal->scale * value : 0;
}

static void window_fill(double window[WINDOW])
{
    double sum = 0;
    for (int k = 0; k < WINDOW; k++) {
        double r = k - (WINDOW - 1) / 2;
        window[k] = exp(-r * r / (2 * window_sigma * window_sigma));
        sum += window[k];
    }
    for (int k = 0; k < WINDOW; k++) {
        window[k] /= sum;
    }
}

/** One row of the five fields, filtered along y: lines[field,x]. */
static void filter_rows(double *lines, const struct signal *a, const struct signal *b,
                        const double window[WINDOW], int64_t start, int64_t width)
{
    for (int64_t i = 0; i < FIELDS * width; i++) {
        lines[i] = 0;
    }
    for (int k = 0; k < WINDOW; k++) {
        for (int64_t x = 0; x < width; x++) {
            double p = signal_at(a, start + k * width + x);
            double q = signal_at(b, start + k * width + x);
            lines[0 * width + x] += window[k] * p;
            lines[1 * width + x] += window[k] * q;
            lines[2 * width + x] += window[k] * p * p;
            lines[3 * width + x] += window[k] * q * q;
            lines[4 * width + x] += window[k] * p * q;
        }
    }
}

/** SSIM of the pixel whose window starts at lines[.,x]. */
static double ssim_at(const double *lines, const double window[WINDOW], int64_t width, int64_t x)
{
    double m[FIELDS] = {0};
    for (int f = 0; f < FIELDS; f++) {
        for (int k = 0; k < WINDOW; k++) {
            m[f] += window[k] * lines[f * width + x + k];
        }
    }
    double aa = m[2] - m[0] * m[0], bb = m[3] - m[1] * m[1], ab = m[4] - m[0] * m[1];
    return (2 * m[0] * m[1] + c1) * (2 * ab + c2) /
           ((m[0] * m[0] + m[1] * m[1] + c1) * (aa + bb + c2));
}

/** Sum of SSIM over the valid region of one slice. @param lines [FIELDS,x] scratch */
static double slice_ssim(double *lines, const struct signal *a, const struct signal *b,
                         const double window[WINDOW], int64_t start, int64_t height, int64_t width)
{
    double sum = 0;
    for (int64_t y = 0; y + WINDOW <= height; y++) {
        filter_rows(lines, a, b, window, start + y * width, width);
        for (int64_t x = 0; x + WINDOW <= width; x++) {
            sum += ssim_at(lines, window, width, x);
        }
    }
    return sum;
}

static double slice_squares(const struct signal *a, const struct signal *b, int64_t start,
                            int64_t count)
{
    double sum = 0;
    for (int64_t i = start; i < start + count; i++) {
        double difference = signal_at(a, i) - signal_at(b, i);
        sum += difference * difference;
    }
    return sum;
}

static void crop(float *out, const float *in, int64_t slices, int64_t height, int64_t width)
{
    for (int64_t z = 0; z < slices; z++) {
        for (int64_t y = CROP; y < height - CROP; y++) {
            for (int64_t x = CROP; x < width - CROP; x++) {
                *out++ = in[(z * height + y) * width + x];
            }
        }
    }
}

/** The factor s that makes |a - s*b| smallest; 1 when b is zero. */
static double best_scale(const struct signal *a, const struct signal *b, int64_t count)
{
    double ab = 0, bb = 0;
    for (int64_t i = 0; i < count; i++) {
        ab += signal_at(a, i) * signal_at(b, i);
        bb += signal_at(b, i) * signal_at(b, i);
    }
    return bb > 0 ? ab / bb : 1;
}

static enum v2v_status check(const float *truth, const float *volume, int64_t slices,
                             int64_t height, int64_t width)
{
    if (slices < 1 || height < 2 * CROP + WINDOW || width < 2 * CROP + WINDOW) {
        return V2V_FAIL(V2V_E_INPUT,
                        "scores need at least %d x %d pixels (crop %d a side, SSIM window %d); the "
                        "volume has %lld slices of %lld x %lld",
                        2 * CROP + WINDOW, 2 * CROP + WINDOW, CROP, WINDOW, (long long)slices,
                        (long long)height, (long long)width);
    }
    const float *const both[2] = {truth, volume};
    static const char *const name[2] = {"truth", "volume"};
    for (int i = 0; i < 2; i++) {
        int64_t bad = v2v_first_not_finite(both[i], slices * height * width);
        if (bad >= 0) {
            return V2V_FAIL(V2V_E_INPUT, "%s: NaN or Inf at slice %lld, row %lld, column %lld",
                            name[i], (long long)(bad / (height * width)),
                            (long long)(bad / width % height), (long long)(bad % width));
        }
    }
    return V2V_OK;
}

/** Fill psnr and ssim: slices side by side, their sums added in order of z.
 *  @param part [2,z] scratch, @param lines [z,FIELDS,x] scratch */
static void score(struct v2v_scores *scores, const struct signal *a, const struct signal *b,
                  int64_t slices, int64_t height, int64_t width, double *part, double *lines)
{
    double window[WINDOW];
    window_fill(window);
#pragma omp parallel for schedule(dynamic)
    for (int64_t z = 0; z < slices; z++) {
        int64_t start = z * height * width;
        part[z] = slice_squares(a, b, start, height * width);
        part[slices + z] =
            slice_ssim(lines + z * FIELDS * width, a, b, window, start, height, width);
    }
    double squares = 0, ssim = 0;
    for (int64_t z = 0; z < slices; z++) {
        squares += part[z];
        ssim += part[slices + z];
    }
    double valid = (double)(height - WINDOW + 1) * (double)(width - WINDOW + 1);
    scores->ssim = ssim / (valid * (double)slices);
    double mse = squares / ((double)slices * (double)(height * width));
    scores->psnr = mse > 0 ? -10 * log10(mse) : INFINITY;
}

enum v2v_status v2v_scores_of(struct v2v_scores *scores, const float *truth, const float *volume,
                              int64_t slices, int64_t height, int64_t width, int fit_scale)
{
    enum v2v_status rc = V2V_OK;
    float *cropped = NULL;
    double *part = NULL, *lines = NULL;
    V2V_TRY(check(truth, volume, slices, height, width));
    int64_t ny = height - 2 * CROP, nx = width - 2 * CROP, count = slices * ny * nx;
    V2V_TRY(V2V_ALLOC(cropped, "eval.cropped", 2 * count));
    V2V_TRY(V2V_ALLOC(part, "eval.sums", 2 * slices));
    V2V_TRY(V2V_ALLOC(lines, "eval.lines", slices * FIELDS * nx));

    crop(cropped, truth, slices, height, width);
    crop(cropped + count, volume, slices, height, width);
    struct signal a = {cropped, v2v_background(cropped, count, BINS, 1), 1};
    struct signal b = {cropped + count, v2v_background(cropped + count, count, BINS, 1), 1};
    b.scale = fit_scale ? best_scale(&a, &b, count) : 1;
    scores->background_truth = a.background;
    scores->background_volume = b.background;
    scores->scale = b.scale;
    score(scores, &a, &b, slices, ny, nx, part, lines);
done:
    v2v_mem_free(lines);
    v2v_mem_free(part);
    v2v_mem_free(cropped);
    return rc;
}
