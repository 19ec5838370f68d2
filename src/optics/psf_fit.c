#include "v2v3d/optics/psf_fit.h"
#include "optics/beam.h"
#include "optics/moments.h"
#include "optics/tilts.h"
#include "optics/zernike.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/pi.h"
#include "v2v3d/optics/calibration.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/par/watchdog.h"
#include <inttypes.h>
#include <math.h>
#include <nlopt.h>
#include <omp.h>

enum {
    SLICES = 13,     /* of a view that are compared */
    JOINT_VIEWS = 4, /* that what all views share is fitted to */
    ROUNDS = 8       /* of the views' tilts and what they share, at most */
};

/* What all views share. The paraxial field depends on spacing / pixel^2 and aperture * pixel, which
 * are therefore varied instead of spacing and aperture. */
enum variable {
    PIXEL,    /* log of its size */
    FRESNEL,  /* log of slice spacing / pixel size^2 */
    APERTURE, /* log of the sub-aperture's * pixel size */
    DEFOCUS,  /* phase at the sub-aperture's edge, in the pinhole, rad */
    FOCUS,    /* slices */
    MODES,    /* the first of the aberrations, waves */
    VARIABLES_MOST = MODES + V2V_ZERNIKE_MOST
};

/* First steps of the optimiser. */
static const double first_step[MODES] = {0.03, 0.1, 0.1, 0.5, 0.3};
static const double mode_step = 0.03, slope_step = 0.02;

/* A variable may not leave its start by more steps than this. */
static const double reach = 30;

/* The fit as it stands. Slopes rather than tilts are kept: they are what a set shows, whatever its
 * pixel size. */
struct fit {
    struct v2v_optics_settings settings; /* but tilts, pinhole, zernike: below */
    const struct v2v_psf_file *psf;
    float *root;           /* [v,z,y,x] of the set: its intensities */
    double (*slope)[2];    /* [views] of the carrier, pixels a slice */
    double pinhole_pixels; /* radius; 0: none */
    struct v2v_zernike zernike;
    const int64_t *modes; /* [mode_count] to fit */
    int64_t mode_count;
    int pixel_held, spacing_held; /* bool: the set states them */
    int64_t evaluations;
    enum v2v_status failed;
};

/* A run of the optimiser over some of it. */
struct search {
    struct fit *fit;
    const int64_t *views; /* [view_count] that are compared */
    int64_t view_count;
    int64_t tilted;                 /* the view whose slope is varied; -1: what all views share */
    double start[VARIABLES_MOST];   /* of what all views share */
    int64_t varied[VARIABLES_MOST]; /* which of them are varied */
    int64_t count;
};

static double frequency_of_slope(const struct v2v_optics_settings *settings, double slope)
{
    const double tangent = slope * settings->pixel_size_um / settings->slice_spacing_um;
    return tangent / sqrt(1 + tangent * tangent) * settings->refractive_index /
           settings->wavelength_um;
}

/* Carrier of a view, 1/um, not beyond the pupil. */
static void tilt_of(double tilt[2], const struct fit *fit, int64_t v)
{
    const struct v2v_optics_settings *settings = &fit->settings;
    const double slope = hypot(fit->slope[v][0], fit->slope[v][1]);
    const double pupil = settings->numerical_aperture / settings->wavelength_um;
    const double frequency = fmin(frequency_of_slope(settings, slope), pupil);
    tilt[0] = slope > 0 ? frequency * fit->slope[v][0] / slope : 0;
    tilt[1] = slope > 0 ? frequency * fit->slope[v][1] / slope : 0;
}

/* The settings with what stands beside them. */
static enum v2v_status complete(struct v2v_optics_settings *settings, const struct fit *fit)
{
    *settings = fit->settings;
    settings->pinhole_um = fit->pinhole_pixels * fit->settings.pixel_size_um;
    return v2v_zernike_print(settings->zernike, sizeof settings->zernike, &fit->zernike);
}

/* Sums of a slice's model times set, model squared, set squared, of intensities. */
static void compare_slice(double sums[3], const float *model, const float *root, int64_t pixels,
                          int64_t photons)
{
    for (int64_t i = 0; i < pixels; i++) {
        const double m = photons == 2 ? sqrt(model[i]) : model[i], r = root[i];
        sums[0] += m * r;
        sums[1] += m * m;
        sums[2] += r * r;
    }
}

/* The sums of every compared slice, view by view. */
static enum v2v_status sum_slices(double (*sums)[3], const struct search *search, int64_t step)
{
    enum v2v_status rc = V2V_OK;
    const struct fit *fit = search->fit;
    const int64_t slices = fit->psf->slices, pixels = fit->psf->height * fit->psf->width;
    const int64_t compared = v2v_parts(slices, step);
    const int threads = omp_get_max_threads();
    struct v2v_optics_settings settings;
    struct v2v_beam *beam = NULL;
    struct v2v_beam_scratch *scratch = NULL;
    float *model = NULL;
    V2V_TRY(complete(&settings, fit));
    V2V_TRY(v2v_beam_create(&beam, &settings));
    V2V_TRY(v2v_beam_scratch_create(&scratch, beam, threads));
    V2V_TRY(V2V_ALLOC(model, "psf.fit", threads * pixels));
#pragma omp parallel for schedule(dynamic) num_threads(threads)
    for (int64_t i = 0; i < search->view_count * compared; i++) {
        const int64_t v = search->views[i / compared], z = i % compared * step;
        float *slice = model + omp_get_thread_num() * pixels;
        double tilt[2];
        tilt_of(tilt, fit, v);
        v2v_beam_slice(slice, beam, scratch, tilt, z);
        compare_slice(sums[i], slice, fit->root + (v * slices + z) * pixels, pixels,
                      settings.photons);
    }
done:
    v2v_mem_free(model);
    v2v_beam_scratch_destroy(&scratch);
    v2v_beam_destroy(&beam);
    return rc;
}

/* Mean over the search's views of 1 - correlation. */
static enum v2v_status unlikeness(double *value, const struct search *search)
{
    enum v2v_status rc = V2V_OK;
    const int64_t slices = search->fit->psf->slices;
    const int64_t step = v2v_parts(slices, SLICES), compared = v2v_parts(slices, step);
    double(*sums)[3] = NULL;
    *value = 0;
    V2V_TRY(V2V_ALLOC(sums, "psf.fit", search->view_count * compared));
    V2V_TRY(sum_slices(sums, search, step));
    for (int64_t i = 0; i < search->view_count; i++) {
        double all[3] = {0};
        for (int64_t z = 0; z < compared; z++) {
            for (int k = 0; k < 3; k++) {
                all[k] += sums[i * compared + z][k];
            }
        }
        const double norm = sqrt(all[1] * all[2]);
        *value += (norm > 0 ? 1 - all[0] / norm : 1) / (double)search->view_count;
    }
    search->fit->evaluations++;
    v2v_watchdog_beat("fitting PSFs");
done:
    v2v_mem_free(sums);
    return rc;
}

/* The phase at the sub-aperture's edge, rad, and the defocus that makes it. */
static double edge_phase(const struct v2v_optics_settings *settings)
{
    const double a = settings->needle_aperture / settings->wavelength_um;
    const double k = settings->refractive_index / settings->wavelength_um;
    return 2 * V2V_PI * settings->pinhole_defocus_um * (sqrt(k * k - a * a) - k);
}

static double defocus_for(const struct v2v_optics_settings *settings, double phase)
{
    const double a = settings->needle_aperture / settings->wavelength_um;
    const double k = settings->refractive_index / settings->wavelength_um;
    return phase / (2 * V2V_PI * (sqrt(k * k - a * a) - k));
}

static void put_beam(double *x, const struct fit *fit)
{
    const struct v2v_optics_settings *settings = &fit->settings;
    const double pixel = settings->pixel_size_um;
    x[PIXEL] = log(pixel);
    x[FRESNEL] = log(settings->slice_spacing_um / (pixel * pixel));
    x[APERTURE] = log(settings->needle_aperture * pixel);
    x[DEFOCUS] = edge_phase(settings);
    x[FOCUS] = settings->focus_slice;
    for (int64_t i = 0; i < fit->mode_count; i++) {
        x[MODES + i] = fit->zernike.waves[fit->modes[i]];
    }
}

static void take_beam(struct fit *fit, const double *x)
{
    struct v2v_optics_settings *settings = &fit->settings;
    const double pixel = exp(x[PIXEL]);
    if (!fit->pixel_held) {
        settings->pixel_size_um = pixel;
    }
    if (!fit->spacing_held) {
        settings->slice_spacing_um = exp(x[FRESNEL]) * pixel * pixel;
    }
    settings->needle_aperture = fmin(exp(x[APERTURE]) / pixel, settings->numerical_aperture);
    settings->pinhole_defocus_um = fit->pinhole_pixels > 0 ? defocus_for(settings, x[DEFOCUS]) : 0;
    settings->focus_slice = x[FOCUS];
    for (int64_t i = 0; i < fit->mode_count; i++) {
        const int64_t mode = fit->modes[i];
        fit->zernike.waves[mode] = x[MODES + i];
        fit->zernike.last = mode > fit->zernike.last ? mode : fit->zernike.last;
    }
}

static void take(const struct search *search, const double *x)
{
    if (search->tilted >= 0) {
        search->fit->slope[search->tilted][0] = x[0];
        search->fit->slope[search->tilted][1] = x[1];
        return;
    }
    double all[VARIABLES_MOST];
    for (int i = 0; i < VARIABLES_MOST; i++) {
        all[i] = search->start[i];
    }
    for (int64_t i = 0; i < search->count; i++) {
        all[search->varied[i]] = x[i];
    }
    take_beam(search->fit, all);
}

static double objective(unsigned count, const double *x, double *gradient, void *context)
{
    const struct search *search = context;
    double value = 1;
    (void)count;
    (void)gradient; /* Sbplx asks for none */
    take(search, x);
    if (search->fit->failed == V2V_OK) {
        search->fit->failed = unlikeness(&value, search);
    }
    return value;
}

/* Sbplx (T. Rowan's Subplex): no gradient, and variables of unlike curvature. */
static enum v2v_status minimise(double *value, struct search *search, double *x,
                                const double *steps, int64_t count, int most)
{
    enum v2v_status rc = V2V_OK;
    double low[VARIABLES_MOST], high[VARIABLES_MOST];
    nlopt_opt optimiser = nlopt_create(NLOPT_LN_SBPLX, (unsigned)count);
    for (int64_t i = 0; i < count; i++) {
        low[i] = x[i] - reach * steps[i];
        high[i] = x[i] + reach * steps[i];
    }
    if (optimiser == NULL || nlopt_set_min_objective(optimiser, objective, search) < 0 ||
        nlopt_set_lower_bounds(optimiser, low) < 0 || nlopt_set_upper_bounds(optimiser, high) < 0 ||
        nlopt_set_initial_step(optimiser, steps) < 0 || nlopt_set_maxeval(optimiser, most) < 0 ||
        nlopt_set_ftol_abs(optimiser, 1e-8) < 0 || nlopt_set_xtol_rel(optimiser, 1e-7) < 0) {
        V2V_TRY(V2V_FAIL(V2V_E_INTERNAL, "the optimiser refuses its settings"));
    }
    const nlopt_result end = nlopt_optimize(optimiser, x, value);
    V2V_TRY(search->fit->failed);
    if (end < 0 && end != NLOPT_ROUNDOFF_LIMITED) {
        V2V_TRY(V2V_FAIL(V2V_E_INTERNAL, "the optimiser fails with %d", (int)end));
    }
    take(search, x); /* whatever else ended it, x is the best that it tried */
done:
    nlopt_destroy(optimiser);
    return rc;
}

/* Vary what all views share, so that `views` become like. */
static enum v2v_status fit_beam(double *value, struct fit *fit, const int64_t *views, int64_t count,
                                int with_pixel, int most)
{
    struct search search = {.fit = fit, .views = views, .view_count = count, .tilted = -1};
    double x[VARIABLES_MOST], steps[VARIABLES_MOST];
    put_beam(search.start, fit);
    for (int64_t i = 0; i < MODES + fit->mode_count; i++) {
        const int held = (i == PIXEL && (fit->pixel_held || !with_pixel)) ||
                         (i == FRESNEL && fit->spacing_held) ||
                         (i == DEFOCUS && !(fit->pinhole_pixels > 0)) ||
                         (i >= MODES && !with_pixel);
        if (!held) {
            search.varied[search.count] = i;
            steps[search.count] = i < MODES ? first_step[i] : mode_step;
            x[search.count++] = search.start[i];
        }
    }
    return minimise(value, &search, x, steps, search.count, most);
}

static enum v2v_status fit_slope(double *value, struct fit *fit, int64_t v, double step)
{
    struct search search = {.fit = fit, .views = &v, .view_count = 1, .tilted = v};
    double x[2] = {fit->slope[v][0], fit->slope[v][1]};
    const double steps[2] = {step, step};
    return minimise(value, &search, x, steps, 2, 60);
}

/* Whole pixels that a view's middle lies off the PSF's centre. */
static int64_t shift_of(const struct v2v_psf_file *psf, int64_t v)
{
    const int64_t pixels = psf->height * psf->width, z = psf->slices / 2;
    double moment[3];
    v2v_slice_moments(moment, psf->data + (v * psf->slices + z) * pixels, psf->height, psf->width);
    const double middle = moment[0] > 0 ? 0.5 * (moment[1] + moment[2]) / moment[0]
                                        : (double)v2v_psf_centre(psf->height);
    return (int64_t)lround(middle) - v2v_psf_centre(psf->height);
}

/* Views from the straightest to the steepest. */
static void order_by_slope(int64_t *order, const struct fit *fit)
{
    for (int64_t v = 0; v < fit->psf->views; v++) {
        int64_t at = v;
        const double steep = hypot(fit->slope[v][0], fit->slope[v][1]);
        for (; at > 0 && hypot(fit->slope[order[at - 1]][0], fit->slope[order[at - 1]][1]) > steep;
             at--) {
            order[at] = order[at - 1];
        }
        order[at] = v;
    }
}

/* "-0.00000 -0.00000, ", as v2v_tilts_print writes them, or more. */
enum { LETTERS_OF_TILT = 19 };

static enum v2v_status prepare(struct fit *fit)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_psf_file *psf = fit->psf;
    const int64_t samples = v2v_mem_product(psf->views * psf->slices, psf->height, psf->width);
    struct v2v_optics_settings *settings = &fit->settings;
    if (psf->height != psf->width) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "slices of %" PRId64 " x %" PRId64
                         " pixels; only square ones are simulated",
                         psf->height, psf->width));
    }
    if (psf->views * LETTERS_OF_TILT > (int64_t)sizeof settings->tilts) { /* before hours of it */
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "the tilts of %" PRId64 " views do not fit into optics.tilts",
                         psf->views));
    }
    V2V_TRY(V2V_ALLOC(fit->slope, "psf.fit", psf->views));
    V2V_TRY(V2V_ALLOC(fit->root, "psf.fit", samples));
    for (int64_t i = 0; i < samples; i++) {
        fit->root[i] = settings->photons == 2 ? sqrtf(fmaxf(psf->data[i], 0)) : psf->data[i];
    }
    v2v_psf_parallax(fit->slope, psf);
    V2V_TRY(v2v_zernike_parse(&fit->zernike, settings->zernike));
    settings->slices = psf->slices;
    settings->size = psf->height;
    fit->pixel_held = psf->pixel_size_um > 0;
    fit->spacing_held = psf->slice_spacing_um > 0;
    settings->pixel_size_um = fit->pixel_held ? psf->pixel_size_um : settings->pixel_size_um;
    settings->slice_spacing_um =
        fit->spacing_held ? psf->slice_spacing_um : settings->slice_spacing_um;
    fit->pinhole_pixels = settings->pinhole_um / settings->pixel_size_um;
done:
    return rc;
}

/* The view nearest to the axis shows the beam. A pinhole's radius and the sign of the focus in it
 * have many minima: several of each are tried, radii up to five pixels at which a disk gains
 * samples. */
static enum v2v_status find_beam(double *value, struct fit *fit, int64_t view)
{
    static const int radii_squared[] = {1, 2, 4, 5, 8, 9, 10, 13, 16, 17, 18, 20, 25};
    static const double phases[] = {-3, 0, 3};
    enum v2v_status rc = V2V_OK;
    const struct fit start = *fit;
    struct fit best = *fit;
    if (!(fit->pinhole_pixels > 0)) {
        return fit_beam(value, fit, &view, 1, 0, 400);
    }
    *value = INFINITY;
    for (size_t r = 0; r < sizeof radii_squared / sizeof *radii_squared; r++) {
        for (size_t p = 0; p < sizeof phases / sizeof *phases; p++) {
            double reached = 0;
            const int64_t evaluations = fit->evaluations;
            *fit = start;
            fit->evaluations = evaluations;
            fit->pinhole_pixels = 1.005 * sqrt(radii_squared[r]);
            fit->settings.pinhole_defocus_um = defocus_for(&fit->settings, phases[p]);
            V2V_TRY(fit_beam(&reached, fit, &view, 1, 0, 150));
            v2v_log(V2V_LOG_DEBUG, "psf fit: pinhole of %.3f pixels, from %g rad: 1 - %.5f",
                    fit->pinhole_pixels, phases[p], reached);
            if (reached < *value) {
                *value = reached;
                best = *fit;
            }
        }
    }
    best.evaluations = fit->evaluations;
    *fit = best;
    V2V_TRY(fit_beam(value, fit, &view, 1, 0, 400));
done:
    return rc;
}

/* Tilts and what all views share in turn. */
static enum v2v_status polish(struct fit *fit, const int64_t *order)
{
    enum v2v_status rc = V2V_OK;
    const int64_t views = fit->psf->views;
    const int64_t count = views < JOINT_VIEWS ? views : JOINT_VIEWS;
    int64_t joint[JOINT_VIEWS];
    double before = INFINITY;
    for (int64_t i = 0; i < count; i++) {
        joint[i] = order[count > 1 ? i * (views - 1) / (count - 1) : 0];
    }
    for (int round = 0; round < ROUNDS; round++) {
        double tilted = 0, value = 0, one = 0;
        for (int64_t v = 0; v < views; v++) {
            V2V_TRY(fit_slope(&one, fit, v, round == 0 ? slope_step : slope_step / 10));
            tilted += one / (double)views;
        }
        V2V_TRY(fit_beam(&value, fit, joint, count, 1, 300));
        v2v_log(V2V_LOG_INFO, "psf fit: round %d: correlation of intensities %.6f, then %.6f",
                round + 1, 1 - tilted, 1 - value);
        if (before - value < 1e-6) {
            break;
        }
        before = value;
    }
done:
    return rc;
}

static enum v2v_status give_back(struct v2v_optics_settings *settings, const struct fit *fit)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tilts tilts = {.views = fit->psf->views};
    V2V_TRY(V2V_ALLOC(tilts.at, "psf.fit", tilts.views));
    V2V_TRY(complete(settings, fit));
    for (int64_t v = 0; v < tilts.views; v++) {
        tilt_of(tilts.at[v], fit, v);
    }
    V2V_TRY(v2v_tilts_print(settings, &tilts));
done:
    v2v_tilts_fini(&tilts);
    return rc;
}

enum v2v_status v2v_psf_fit(struct v2v_optics_settings *settings, const struct v2v_psf_file *psf,
                            const int64_t *modes, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    struct fit fit = {.settings = *settings, .psf = psf, .modes = modes, .mode_count = count};
    int64_t *order = NULL;
    double value = 0;
    V2V_ASSERT(count <= V2V_ZERNIKE_MOST);
    for (int64_t i = 0; i < count; i++) {
        V2V_ASSERT(modes[i] >= 1 && modes[i] <= V2V_ZERNIKE_MOST);
    }
    V2V_TRY(prepare(&fit));
    V2V_TRY(V2V_ALLOC(order, "psf.fit", psf->views));
    order_by_slope(order, &fit);
    fit.settings.shift = shift_of(psf, order[0]);
    V2V_TRY(find_beam(&value, &fit, order[0]));
    v2v_log(V2V_LOG_INFO, "psf fit: view %" PRId64 ": correlation of intensities %.6f", order[0],
            1 - value);
    V2V_TRY(polish(&fit, order));
    V2V_TRY(give_back(settings, &fit));
    v2v_log(V2V_LOG_INFO, "psf fit: %" PRId64 " models", fit.evaluations);
done:
    v2v_mem_free(order);
    v2v_mem_free(fit.slope);
    v2v_mem_free(fit.root);
    return rc;
}
