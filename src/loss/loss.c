#include "v2v3d/loss/loss.h"

#include "loss/terms.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/tensor/statistics.h"

#include <string.h>

enum { BRANCHES = 2, BACKGROUND_BINS = 256 };

struct v2v_loss {
    struct v2v_loss_settings settings;
    double weight[V2V_LOSS_TERMS];
    int64_t views, slices, height, width;
    struct v2v_window window;
    double energy; /* a constant volume 1 projects to this */
    struct v2v_projector *projector;
    struct v2v_fft2 *fft;    /* of the window */
    int32_t *seen[BRANCHES]; /* views that branch b is compared with */
    int64_t seen_count[BRANCHES];
    float *projection;            /* [views,y,x]: projection, then its gradient */
    float *difference;            /* [views, window] */
    float *gradient;              /* [views, window] */
    struct v2v_complex *spectrum; /* [views, window's half spectrum], each aligned */
    float *scratch;               /* [views, window] */
    float *mean_view;             /* [y,x] */
    double *value;                /* [views] */
};

/* What "auto" means, by profile (REFERENCE.md 5). */
static const double auto_weight[][V2V_LOSS_TERMS] = {
    [V2V_LOSS_REFERENCE] = {[V2V_LOSS_MSE] = 1.0,
                            [V2V_LOSS_FFT] = 0.5,
                            [V2V_LOSS_POS] = 1e-3,
                            [V2V_LOSS_DC] = 1e-2,
                            [V2V_LOSS_TV] = 1e-3,
                            [V2V_LOSS_TOTAL] = 1.0},
    [V2V_LOSS_PAPER] =
        {[V2V_LOSS_MSE] = 1.0, [V2V_LOSS_FFT] = 0.1, [V2V_LOSS_DC] = 1.0, [V2V_LOSS_TOTAL] = 1.0},
};

static double resolve(const struct v2v_number *number, double automatic)
{
    return number->mode == V2V_NUMBER_AUTO    ? automatic
           : number->mode == V2V_NUMBER_GIVEN ? number->value
                                              : 0.0;
}

void v2v_loss_weights(double *weights, const struct v2v_loss_settings *settings)
{
    const struct v2v_number *given[] = {[V2V_LOSS_MSE] = &settings->mse,
                                        [V2V_LOSS_FFT] = &settings->fft,
                                        [V2V_LOSS_POS] = &settings->pos,
                                        [V2V_LOSS_DC] = &settings->dc,
                                        [V2V_LOSS_TV] = &settings->tv};
    for (int i = 0; i < V2V_LOSS_TOTAL; i++) {
        weights[i] = resolve(given[i], auto_weight[settings->profile][i]);
    }
    weights[V2V_LOSS_TOTAL] = 1.0;
}

/* Room for n numbers such that the next view's starts on a 64-byte boundary, as transforms ask. */
static int64_t aligned(int64_t n)
{
    return (n + 15) / 16 * 16;
}

static enum v2v_status take_memory(struct v2v_loss *loss)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_window *w = &loss->window;
    int64_t ny = w->y1 - w->y0, nx = w->x1 - w->x0, views = loss->views;
    V2V_TRY(V2V_ALLOC(loss->projection, "loss", views * loss->height * loss->width));
    V2V_TRY(V2V_ALLOC(loss->difference, "loss", views * ny * nx));
    V2V_TRY(V2V_ALLOC(loss->gradient, "loss", views * ny * nx));
    V2V_TRY(V2V_ALLOC(loss->scratch, "loss", views * aligned(ny * nx)));
    V2V_TRY(V2V_ALLOC(loss->spectrum, "loss", views * aligned(ny * (nx / 2 + 1))));
    V2V_TRY(V2V_ALLOC(loss->mean_view, "loss", loss->height * loss->width));
    V2V_TRY(V2V_ALLOC(loss->value, "loss", views));
    for (int b = 0; b < BRANCHES; b++) {
        V2V_TRY(V2V_ALLOC(loss->seen[b], "loss", views));
        for (int64_t v = 1 - b; v < views; v += BRANCHES) {
            loss->seen[b][loss->seen_count[b]++] = (int32_t)v;
        }
    }
    V2V_TRY(v2v_fft2_create(&loss->fft, ny, nx));
done:
    return rc;
}

enum v2v_status v2v_loss_create(struct v2v_loss **loss, const struct v2v_loss_setup *setup)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_loss *self = NULL;
    const struct v2v_psf_file *psf = setup->psf;
    const struct v2v_window *w = &setup->window;
    double factor = setup->reduce == V2V_REDUCE_MEAN ? 1.0 / (double)psf->slices : 1.0;
    V2V_ASSERT(0 <= w->y0 && w->y0 < w->y1 && w->y1 <= setup->height);
    V2V_ASSERT(0 <= w->x0 && w->x0 < w->x1 && w->x1 <= setup->width);
    V2V_TRY(V2V_ALLOC(self, "loss", 1));
    self->settings = *setup->settings;
    v2v_loss_weights(self->weight, setup->settings);
    self->views = psf->views;
    self->slices = psf->slices;
    self->height = setup->height;
    self->width = setup->width;
    self->window = setup->window;
    self->energy = v2v_psf_energy_mean(psf) * (double)psf->slices * factor;
    V2V_TRY(take_memory(self));
    V2V_TRY(v2v_projector_create(&self->projector, psf, setup->height, setup->width,
                                 V2V_SPLIT_SLICES, NULL));
    v2v_projector_set_scale(self->projector, (float)factor);
done:
    if (rc != V2V_OK) {
        v2v_loss_destroy(&self);
    }
    *loss = self;
    return rc;
}

void v2v_loss_destroy(struct v2v_loss **loss)
{
    struct v2v_loss *self = *loss;
    if (self == NULL) {
        return;
    }
    void *memory[] = {self->projection, self->difference, self->gradient,
                      self->scratch,    self->spectrum,   self->mean_view,
                      self->value,      self->seen[0],    self->seen[1]};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
    v2v_projector_destroy(&self->projector);
    v2v_fft2_destroy(&self->fft);
    v2v_mem_free(self);
    *loss = NULL;
}

/* Copy the window of every seen view's difference out of, or its gradient back into, the frames. */
static void take_differences(struct v2v_loss *loss, int b, const float *views)
{
    const struct v2v_window *w = &loss->window;
    int64_t ny = w->y1 - w->y0, nx = w->x1 - w->x0, pixels = loss->height * loss->width;
#pragma omp parallel for schedule(static)
    for (int64_t row = 0; row < loss->seen_count[b] * ny; row++) {
        int64_t i = row / ny, at = (w->y0 + row % ny) * loss->width + w->x0;
        const float *projected = loss->projection + i * pixels + at;
        const float *seen = views + loss->seen[b][i] * pixels + at;
        for (int64_t x = 0; x < nx; x++) {
            loss->difference[row * nx + x] = projected[x] - seen[x];
        }
    }
}

static void put_gradients(struct v2v_loss *loss, int b)
{
    const struct v2v_window *w = &loss->window;
    int64_t ny = w->y1 - w->y0, nx = w->x1 - w->x0, pixels = loss->height * loss->width;
    memset(loss->projection, 0, (size_t)(loss->seen_count[b] * pixels) * sizeof *loss->projection);
#pragma omp parallel for schedule(static)
    for (int64_t row = 0; row < loss->seen_count[b] * ny; row++) {
        int64_t i = row / ny, at = (w->y0 + row % ny) * loss->width + w->x0;
        memcpy(loss->projection + i * pixels + at, loss->gradient + row * nx,
               (size_t)nx * sizeof *loss->projection);
    }
}

/* The Fourier term's weight on the sum of moduli: a mean over all seen frequencies in the
 * reference, the sum over the number of pixels in the paper. */
static void fourier_term(struct v2v_loss *loss, int b, double *terms)
{
    const struct v2v_window *w = &loss->window;
    struct v2v_term_fft term = {.fft = loss->fft,
                                .ny = w->y1 - w->y0,
                                .nx = w->x1 - w->x0,
                                .squared = loss->settings.profile == V2V_LOSS_PAPER};
    int64_t pixels = term.ny * term.nx, count = loss->seen_count[b];
    int64_t spectrum = aligned(term.ny * (term.nx / 2 + 1));
    double mean = 1.0 / (double)(count * pixels), sum = 0.0;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < count; i++) {
        loss->value[i] =
            v2v_term_fourier(&term, loss->gradient + i * pixels, loss->difference + i * pixels,
                             loss->spectrum + i * spectrum, loss->scratch + i * aligned(pixels),
                             loss->weight[V2V_LOSS_FFT] * mean);
    }
    for (int64_t i = 0; i < count; i++) {
        sum += loss->value[i];
    }
    terms[V2V_LOSS_FFT] += sum * mean;
}

/* Terms that compare branch b's projection with the views it has not seen. */
static void view_terms(struct v2v_loss *loss, int b, double *terms, float *dvolume,
                       const float *volume, const float *views)
{
    const struct v2v_window *w = &loss->window;
    int64_t count = loss->seen_count[b] * (w->y1 - w->y0) * (w->x1 - w->x0);
    v2v_projector_forward(loss->projector, loss->projection, volume, loss->seen[b],
                          loss->seen_count[b]);
    take_differences(loss, b, views);
    terms[V2V_LOSS_MSE] +=
        v2v_term_mse(loss->gradient, loss->difference, count, loss->weight[V2V_LOSS_MSE]);
    fourier_term(loss, b, terms);
    put_gradients(loss, b);
    v2v_projector_adjoint(loss->projector, dvolume, loss->projection, loss->seen[b],
                          loss->seen_count[b]);
}

/* Histogram mode of the mean view, in units of the volume. */
static double background(struct v2v_loss *loss, const float *views)
{
    int64_t pixels = loss->height * loss->width;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < pixels; i++) {
        double sum = 0.0;
        for (int64_t v = 0; v < loss->views; v++) {
            sum += views[v * pixels + i];
        }
        loss->mean_view[i] = (float)(sum / (double)loss->views);
    }
    return v2v_background(loss->mean_view, pixels, BACKGROUND_BINS, 0) / loss->energy;
}

/* Terms of the volumes themselves. */
static void volume_terms(struct v2v_loss *loss, double *terms, float *dvolume, const float *own,
                         const float *other, double floor)
{
    int64_t pixels = loss->height * loss->width, voxels = loss->slices * pixels;
    int64_t inner = loss->slices > 2 ? (loss->slices - 2) * pixels : 1;
    int mean = loss->settings.profile == V2V_LOSS_REFERENCE;
    double dc = mean ? 1.0 / (double)voxels : 1.0, tv = 1.0 / (double)inner;
    terms[V2V_LOSS_POS] += v2v_term_positivity(dvolume, own, voxels, loss->weight[V2V_LOSS_POS]);
    terms[V2V_LOSS_DC] +=
        0.5 * dc *
        v2v_term_crosstalk(dvolume, own, other, voxels, floor, loss->weight[V2V_LOSS_DC] * dc);
    terms[V2V_LOSS_TV] += 0.5 * tv *
                          v2v_term_smoothness(dvolume, own, other, loss->slices, pixels,
                                              loss->weight[V2V_LOSS_TV] * tv);
}

void v2v_loss_evaluate(struct v2v_loss *loss, double *terms, unsigned branches,
                       float *const *dvolume, const float *const *volume, const float *views)
{
    memset(terms, 0, V2V_LOSS_TERMS * sizeof *terms);
    double floor = background(loss, views);
    for (int b = 0; b < BRANCHES; b++) {
        if (branches >> b & 1) {
            view_terms(loss, b, terms, dvolume[b], volume[b], views);
            volume_terms(loss, terms, dvolume[b], volume[b], volume[1 - b], floor);
        }
    }
    for (int i = 0; i < V2V_LOSS_TOTAL; i++) {
        terms[V2V_LOSS_TOTAL] += loss->weight[i] * terms[i];
    }
}
