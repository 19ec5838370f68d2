#include "twin_data_step.h"

#include <complex.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef double complex number;

enum { MOST = 8, MOST_SIDE = 256 }; /* views, slices; pixels */

static void *take(int64_t count, size_t size)
{
    void *memory = calloc((size_t)count, size);
    if (memory == NULL) {
        abort();
    }
    return memory;
}

static int64_t pixels_of(const struct twin_data_step *step)
{
    return step->torus_height * step->torus_width;
}

/* ---- transforms ---- */

/* `count` numbers, `stride` apart, times exp(sign 2 pi i j k / count). */
static void transform_line(number *x, int64_t count, int64_t stride, double sign)
{
    number out[MOST_SIDE], wave[MOST_SIDE];
    for (int64_t k = 0; k < count; k++) {
        wave[k] = cexp(I * sign * 2.0 * acos(-1.0) * (double)k / (double)count);
    }
    for (int64_t k = 0; k < count; k++) {
        out[k] = 0.0;
        for (int64_t j = 0; j < count; j++) {
            out[k] += x[j * stride] * wave[j * k % count];
        }
    }
    for (int64_t k = 0; k < count; k++) {
        x[k * stride] = out[k];
    }
}

static void transform(const struct twin_data_step *step, number *x, double sign)
{
    for (int64_t y = 0; y < step->torus_height; y++) {
        transform_line(x + y * step->torus_width, step->torus_width, 1, sign);
    }
    for (int64_t c = 0; c < step->torus_width; c++) {
        transform_line(x + c, step->torus_height, step->torus_width, sign);
    }
}

static void to_spectra(const struct twin_data_step *step, double *spectra, const double *images,
                       int64_t count)
{
    number *x = (number *)(void *)spectra;
    for (int64_t i = 0; i < count * pixels_of(step); i++) {
        x[i] = images[i];
    }
    for (int64_t i = 0; i < count; i++) {
        transform(step, x + i * pixels_of(step), -1.0);
    }
}

static number otf_at(const struct twin_data_step *step, int64_t v, int64_t z, int64_t f)
{
    return ((const number *)(const void *)step->otf)[(v * step->slices + z) * pixels_of(step) + f];
}

/* ---- creation ---- */

static void kernel_to_torus(const struct twin_data_step *step, double *image, const float *kernel)
{
    const int64_t height = step->kernel_height, width = step->kernel_width;
    memset(image, 0, (size_t)pixels_of(step) * sizeof *image);
    for (int64_t k = 0; k < height * width; k++) {
        const int64_t y = k / width - ((height + 1) / 2 - 1) + step->torus_height;
        const int64_t x = k % width - ((width + 1) / 2 - 1) + step->torus_width;
        image[y % step->torus_height * step->torus_width + x % step->torus_width] +=
            (double)kernel[k];
    }
}

void twin_data_step_init(struct twin_data_step *step)
{
    const int64_t pixels = pixels_of(step), kernels = step->views * step->slices;
    if (step->views > MOST || step->slices > MOST || step->torus_height > MOST_SIDE ||
        step->torus_width > MOST_SIDE) {
        abort();
    }
    double *image = take(pixels, sizeof *image);
    step->otf = take(kernels * pixels, sizeof(number));
    step->recorded = take(step->views * pixels, sizeof(double));
    step->spectra = take(step->views * pixels, sizeof(number));
    step->slice_spectra = take(step->slices * pixels, sizeof(number));
    step->gradient_spectra = take(step->slices * pixels, sizeof(number));
    for (int64_t i = 0; i < kernels; i++) {
        kernel_to_torus(step, image, step->psf + i * step->kernel_height * step->kernel_width);
        to_spectra(step, step->otf + 2 * i * pixels, image, 1);
    }
    free(image);
}

void twin_data_step_fini(struct twin_data_step *step)
{
    free(step->otf);
    free(step->recorded);
    free(step->spectra);
    free(step->slice_spectra);
    free(step->gradient_spectra);
}

/* ---- views ---- */

static double between(double here, double there, int64_t place, int64_t size, int64_t torus)
{
    const double part = fmax(0.0, (double)(place - size + 1)) / (double)(torus - size + 1);
    return (1.0 - part) * here + part * there;
}

void twin_data_step_begin(struct twin_data_step *step, const float *views, double scale)
{
    const int64_t height = step->height, width = step->width;
    for (int64_t i = 0; i < step->views * pixels_of(step); i++) {
        const int64_t y = i % pixels_of(step) / step->torus_width, x = i % step->torus_width;
        const float *view = views + i / pixels_of(step) * height * width;
        const int64_t r = y < height ? y : height - 1, c = x < width ? x : width - 1;
        const double left =
            between((double)view[r * width + c], (double)view[c], y, height, step->torus_height);
        const double right =
            between((double)view[r * width], (double)view[0], y, height, step->torus_height);
        step->recorded[i] = scale * between(left, right, x, width, step->torus_width);
    }
    to_spectra(step, step->spectra, step->recorded, step->views);
}

/* ---- the step ---- */

static void multiply(number *y, number a[MOST][MOST], const number *x, int64_t n)
{
    for (int64_t i = 0; i < n; i++) {
        y[i] = 0.0;
        for (int64_t j = 0; j < n; j++) {
            y[i] += a[i][j] * x[j];
        }
    }
}

/* a x = b of a positive definite matrix; x replaces b. */
static void solve(number a[MOST][MOST], number *b, int64_t n)
{
    for (int64_t k = 0; k < n; k++) {
        for (int64_t i = k + 1; i < n; i++) {
            const number factor = a[i][k] / a[k][k];
            for (int64_t j = k; j < n; j++) {
                a[i][j] -= factor * a[k][j];
            }
            b[i] -= factor * b[k];
        }
    }
    for (int64_t i = n - 1; i >= 0; i--) {
        for (int64_t j = i + 1; j < n; j++) {
            b[i] -= a[i][j] * b[j];
        }
        b[i] /= a[i][i];
    }
}

/* What a frequency of the plane counts by, and P of it. */
static double penalty_of(const struct twin_data_step *step, const struct twin_penalty *penalty,
                         int64_t f)
{
    const double y = 2.0 * acos(-1.0) * (double)(f / step->torus_width);
    const double x = 2.0 * acos(-1.0) * (double)(f % step->torus_width);
    const double cos_y = cos(y / (double)step->torus_height);
    const double cos_x = cos(x / (double)step->torus_width);
    const double bent = (1.0 + cos_y) * (1.0 + cos_x) - 4.0; /* (1 2 1) x (1 2 1) / 4, less 4 */
    return penalty->constant + penalty->differences * (4.0 - 2.0 * cos_y - 2.0 * cos_x) +
           penalty->curvature * bent * bent;
}

static void penalty_matrix(const struct twin_data_step *step, number p[MOST][MOST],
                           const struct twin_penalty *penalty, int64_t f)
{
    memset(p, 0, MOST * sizeof p[0]);
    for (int64_t z = 0; z < step->slices; z++) {
        p[z][z] += penalty_of(step, penalty, f);
    }
    for (int64_t z = 0; z + 1 < step->slices; z++) {
        p[z][z] += penalty->depth;
        p[z + 1][z + 1] += penalty->depth;
        p[z][z + 1] -= penalty->depth;
        p[z + 1][z] -= penalty->depth;
    }
}

/* x <- P^-1 x. */
static void divide(const struct twin_data_step *step, number *x, const struct twin_penalty *penalty,
                   int64_t f)
{
    number p[MOST][MOST];
    penalty_matrix(step, p, penalty, f);
    solve(p, x, step->slices);
}

/* pulled[v] = P^-1 A^H of a view, and a = 1 + A P^-1 A^H. */
static void square(const struct twin_data_step *step, number a[MOST][MOST],
                   number pulled[MOST][MOST], const struct twin_penalty *penalty, int64_t f)
{
    for (int64_t j = 0; j < step->views; j++) {
        for (int64_t z = 0; z < step->slices; z++) {
            pulled[j][z] = conj(otf_at(step, j, z, f));
        }
        divide(step, pulled[j], penalty, f);
        for (int64_t i = 0; i < step->views; i++) {
            a[i][j] = i == j ? 1.0 : 0.0;
            for (int64_t z = 0; z < step->slices; z++) {
                a[i][j] += otf_at(step, i, z, f) * pulled[j][z];
            }
        }
    }
}

static void step_of_frequency(const struct twin_data_step *step, number *slices,
                              const struct twin_penalty *penalty, int64_t f)
{
    const int64_t pixels = pixels_of(step);
    const number *views = (const number *)(const void *)step->spectra;
    number a[MOST][MOST], pulled[MOST][MOST], s[MOST];
    square(step, a, pulled, penalty, f);
    for (int64_t v = 0; v < step->views; v++) {
        s[v] = views[v * pixels + f];
        for (int64_t z = 0; z < step->slices; z++) {
            s[v] -= otf_at(step, v, z, f) * slices[z * pixels + f];
        }
    }
    solve(a, s, step->views);
    for (int64_t z = 0; z < step->slices; z++) {
        for (int64_t v = 0; v < step->views; v++) {
            slices[z * pixels + f] += pulled[v][z] * s[v];
        }
    }
}

void twin_data_step_run(const struct twin_data_step *step, double *volume, const double *gradient,
                        const struct twin_penalty *penalty)
{
    const int64_t pixels = pixels_of(step);
    number *slices = (number *)(void *)step->slice_spectra;
    const number *pull = (const number *)(const void *)step->gradient_spectra;
    to_spectra(step, step->slice_spectra, volume, step->slices);
    if (gradient != NULL) {
        to_spectra(step, step->gradient_spectra, gradient, step->slices);
    }
    for (int64_t f = 0; f < pixels; f++) {
        number moved[MOST] = {0.0};
        for (int64_t z = 0; z < step->slices && gradient != NULL; z++) {
            moved[z] = pull[z * pixels + f];
        }
        divide(step, moved, penalty, f);
        for (int64_t z = 0; z < step->slices; z++) {
            slices[z * pixels + f] -= moved[z];
        }
        step_of_frequency(step, slices, penalty, f);
    }
    for (int64_t z = 0; z < step->slices; z++) {
        transform(step, slices + z * pixels, 1.0);
    }
    for (int64_t i = 0; i < step->slices * pixels; i++) {
        volume[i] = creal(slices[i]) / (double)pixels;
    }
}

void twin_data_step_extend(struct twin_data_step *step, const double *volume)
{
    const int64_t pixels = pixels_of(step);
    const number *slices = (const number *)(void *)step->slice_spectra;
    number *views = (number *)(void *)step->spectra;
    to_spectra(step, step->slice_spectra, volume, step->slices);
    for (int64_t i = 0; i < step->views * pixels; i++) {
        const int64_t v = i / pixels, f = i % pixels;
        views[i] = 0.0;
        for (int64_t z = 0; z < step->slices; z++) {
            views[i] += otf_at(step, v, z, f) * slices[z * pixels + f];
        }
    }
    for (int64_t v = 0; v < step->views; v++) {
        transform(step, views + v * pixels, 1.0);
    }
    for (int64_t i = 0; i < step->views * pixels; i++) {
        const int64_t y = i % pixels / step->torus_width, x = i % step->torus_width;
        if (y >= step->height || x >= step->width) {
            step->recorded[i] = creal(views[i]) / (double)pixels;
        }
    }
    to_spectra(step, step->spectra, step->recorded, step->views);
}

/* ---- condition ---- */

/* The largest eigenvalue of a Hermitian matrix, or of its inverse, by powers of it. */
static double largest_eigenvalue(number a[MOST][MOST], int64_t n, int is_inverse)
{
    enum { POWERS = 200 };
    number x[MOST], y[MOST], copy[MOST][MOST];
    double length = 0.0;
    for (int64_t i = 0; i < n; i++) {
        x[i] = 1.0 + 0.3 * (double)i; /* of no symmetry */
    }
    for (int power = 0; power < POWERS; power++) {
        memcpy(copy, a, sizeof copy);
        memcpy(y, x, sizeof y);
        if (is_inverse) {
            solve(copy, y, n);
        } else {
            multiply(y, copy, x, n);
        }
        length = 0.0;
        for (int64_t i = 0; i < n; i++) {
            length = hypot(length, cabs(y[i]));
        }
        for (int64_t i = 0; i < n; i++) {
            x[i] = y[i] / length;
        }
    }
    return length;
}

double twin_data_step_condition(const struct twin_data_step *step,
                                const struct twin_penalty *penalty)
{
    number a[MOST][MOST], pulled[MOST][MOST];
    double worst = 1.0;
    for (int64_t f = 0; f < pixels_of(step); f++) {
        square(step, a, pulled, penalty, f);
        worst = fmax(worst,
                     largest_eigenvalue(a, step->views, 0) * largest_eigenvalue(a, step->views, 1));
    }
    return worst;
}
