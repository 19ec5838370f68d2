#include "optics/beam.h"
#include "optics/zernike.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/pi.h"
#include "v2v3d/fft/fft2.h"
#include "v2v3d/optics/psf.h"
#include <math.h>
#include <omp.h>
#include <string.h>

/* Samples of a side that are still reasonable: 300 MB a thread. */
enum { GRID_LIMIT = 4096 };

struct v2v_beam {
    struct v2v_optics_settings settings;
    int64_t n;         /* samples of a side */
    int64_t per_pixel; /* samples of a pixel's side */
    double frequency;  /* step between spatial frequencies, 1/um */
    double band;       /* radius of the field's band about its carrier, 1/um */
    double pupil;      /* radius of the objective's pupil, 1/um */
    double fold;       /* frequencies repeat with this period, 1/um; 0: they don't */
    struct v2v_zernike zernike;
    struct v2v_complex *aperture; /* [n,n], by frequency from the carrier; in focus, unaberrated */
    struct v2v_fft2 *fft;         /* n x n */
};

/* Working memory of all threads, with the strides between them. */
struct v2v_beam_scratch {
    int64_t spectrum_stride, image_stride;
    struct v2v_complex *spectra; /* [2,n,n/2+1]: of its real and imaginary part */
    float *part;                 /* [n,n]: real or imaginary part of the field */
    float *intensity;            /* [n,n] */
};

static enum v2v_status check(const struct v2v_optics_settings *settings)
{
    if (!(settings->needle_aperture > 0) ||
        settings->needle_aperture > settings->numerical_aperture) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "optics: needle_aperture %g must be above 0 and inside the pupil "
                        "(numerical_aperture %g)",
                        settings->needle_aperture, settings->numerical_aperture);
    }
    if (!(settings->numerical_aperture < settings->refractive_index)) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "optics: numerical_aperture %g must be below refractive_index %g",
                        settings->numerical_aperture, settings->refractive_index);
    }
    if (settings->immersion_index > 0 &&
        !(settings->numerical_aperture < settings->immersion_index)) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "optics: numerical_aperture %g must be below immersion_index %g",
                        settings->numerical_aperture, settings->immersion_index);
    }
    const int64_t centre = v2v_psf_centre(settings->size) + settings->shift;
    if (centre < 0 || centre >= settings->size) {
        return V2V_FAIL(V2V_E_CONFIG, "optics: shift %lld leaves a PSF of %lld pixels",
                        (long long)settings->shift, (long long)settings->size);
    }
    return V2V_OK;
}

/* A sub-aperture's field has its radius as band. A pinhole's edge has none: its spectrum is
 * followed to twice its inverse radius beyond (the fourth ring of its Airy pattern), and not
 * farther than the pupil reaches from a carrier at its edge. */
static double band_of(const struct v2v_optics_settings *settings)
{
    const double aperture = settings->needle_aperture / settings->wavelength_um;
    const double pupil = settings->numerical_aperture / settings->wavelength_um;
    return settings->pinhole_um > 0 ? fmin(2 * pupil, aperture + 2 / settings->pinhole_um)
                                    : aperture;
}

/* The field's band has radius r, the intensity's 2r, its square's 4r: samples lie at most 1/(8r)
 * apart, or 1/(4r). The grid is periodic: it is as wide as what is cut out of it, plus what the
 * steepest ray walks off axis up to the last slice, plus diffraction's tails (4 wavelengths over
 * the needle aperture: the squared Airy pattern is below 1e-7 of its peak there). */
static enum v2v_status choose_grid(struct v2v_beam *beam)
{
    const struct v2v_optics_settings *settings = &beam->settings;
    const double wavelength = settings->wavelength_um, pixel = settings->pixel_size_um;
    const double per_pixel = ceil(4 * (double)settings->photons * beam->band * pixel);
    const double steepest = settings->numerical_aperture / settings->refractive_index;
    const double slices = 0.5 * (double)(settings->slices - 1) + fabs(settings->focus_slice);
    const double walk =
        slices * settings->slice_spacing_um * steepest / sqrt(1 - steepest * steepest);
    const double tails = 4 * wavelength / settings->needle_aperture;
    const double half =
        (0.5 * (double)(settings->size + 1) + fabs((double)settings->shift)) * pixel;
    const double n = ceil((half + fmax(half, walk + tails)) * per_pixel / pixel);
    if (settings->sampling == V2V_OPTICS_SAMPLING_PIXEL) {
        beam->per_pixel = 1;
        beam->n = v2v_fft_good_size(settings->size);
        beam->fold = 1 / pixel;
    } else if (!(n <= GRID_LIMIT)) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "optics: sampling too coarse for this aperture: %g samples a side are "
                        "needed, %d are the limit; reduce pixel_size_um, size, slice_spacing_um "
                        "or slices",
                        n, GRID_LIMIT);
    } else {
        beam->per_pixel = (int64_t)per_pixel;
        beam->n = v2v_fft_good_size((int64_t)n);
    }
    beam->frequency = (double)beam->per_pixel / (pixel * (double)beam->n);
    return V2V_OK;
}

/* Frequency of index k of n, 1/um. */
static double frequency_of(const struct v2v_beam *beam, int64_t k)
{
    return (double)(k <= beam->n / 2 ? k : k - beam->n) * beam->frequency;
}

/* Amplitude of the light in the sub-aperture, `rho` of its radius off its middle. */
static double illumination(const struct v2v_optics_settings *settings, double rho)
{
    const double of_beam = rho / settings->beam_radius;
    return settings->beam_radius > 0 ? exp(-of_beam * of_beam) : 1;
}

/* A disk of frequencies without a pinhole: its edge is one frequency step wide about the radius,
 * which softens the staircase of a disk on a grid. The peak of a uniform one's field is 1. */
static void open_aperture(struct v2v_beam *beam)
{
    const double radius = beam->band;
    const double height = beam->frequency * beam->frequency / (V2V_PI * radius * radius);
    for (int64_t ky = 0; ky < beam->n; ky++) {
        for (int64_t kx = 0; kx < beam->n; kx++) {
            const double q = hypot(frequency_of(beam, ky), frequency_of(beam, kx));
            const double inside = (radius - q) / beam->frequency + 0.5;
            beam->aperture[ky * beam->n + kx].re =
                (float)(height * fmax(0, fmin(inside, 1)) *
                        illumination(&beam->settings, q / radius));
        }
    }
}

/* Field [re,im] of the sub-aperture's disk, r um off axis and `pinhole_defocus_um` from its focus:
 * u(r) = 2 * integral over rho = 0..1 of J0(2 pi a r rho) exp(2 pi i d sqrt(k^2 - (a rho)^2)) rho,
 * by the midpoint rule. The phase of its middle ray is left out. */
static void field_in_pinhole(double field[2], const struct v2v_optics_settings *settings, double r)
{
    enum { STEPS = 200 };
    const double a = settings->needle_aperture / settings->wavelength_um;
    const double k = settings->refractive_index / settings->wavelength_um;
    field[0] = field[1] = 0;
    for (int step = 0; step < STEPS; step++) {
        const double rho = (step + 0.5) / STEPS;
        const double phase =
            2 * V2V_PI * settings->pinhole_defocus_um * (sqrt(k * k - a * a * rho * rho) - k);
        const double weight =
            2 * j0(2 * V2V_PI * a * r * rho) * illumination(settings, rho) * rho / STEPS;
        field[0] += weight * cos(phase);
        field[1] += weight * sin(phase);
    }
}

/* Both parts of the field in the pinhole, and zero outside: a sample is inside or outside. */
static void draw_pinhole(float *const parts[2], const struct v2v_beam *beam)
{
    const double pitch = beam->settings.pixel_size_um / (double)beam->per_pixel;
    for (int64_t y = 0; y < beam->n; y++) {
        for (int64_t x = 0; x < beam->n; x++) {
            const double r = pitch * hypot((double)(y <= beam->n / 2 ? y : y - beam->n),
                                           (double)(x <= beam->n / 2 ? x : x - beam->n));
            double field[2] = {0, 0};
            if (r <= beam->settings.pinhole_um) {
                field_in_pinhole(field, &beam->settings, r);
            }
            parts[0][y * beam->n + x] = (float)field[0];
            parts[1][y * beam->n + x] = (float)field[1];
        }
    }
}

/* aperture = the spectrum of the field in the pinhole, as far as the band goes. */
static enum v2v_status pinhole_aperture(struct v2v_beam *beam)
{
    enum v2v_status rc = V2V_OK;
    const int64_t n = beam->n, row = n / 2 + 1;
    const float scale = 1.0f / (float)(n * n);
    float *parts[2] = {NULL, NULL};
    struct v2v_complex *half = NULL;
    V2V_TRY(V2V_ALLOC(parts[0], "psf.simulate", n * n));
    V2V_TRY(V2V_ALLOC(parts[1], "psf.simulate", n * n));
    V2V_TRY(V2V_ALLOC(half, "psf.simulate", n * row));
    draw_pinhole(parts, beam);
    for (int imaginary = 0; imaginary <= 1; imaginary++) {
        v2v_fft2_forward(beam->fft, half, parts[imaginary]);
        for (int64_t i = 0; i < n * n; i++) {
            const int64_t ky = i / n, kx = i % n;
            const int mirrored = kx >= row;
            const struct v2v_complex *from =
                half + (mirrored ? (n - ky) % n * row + n - kx : ky * row + kx);
            const float re = scale * from->re, im = scale * (mirrored ? -from->im : from->im);
            beam->aperture[i].re += imaginary ? -im : re;
            beam->aperture[i].im += imaginary ? re : im;
        }
    }
    for (int64_t i = 0; beam->fold == 0 && i < n * n; i++) {
        if (hypot(frequency_of(beam, i / n), frequency_of(beam, i % n)) > beam->band) {
            beam->aperture[i] = (struct v2v_complex){0, 0};
        }
    }
done:
    v2v_mem_free(half);
    v2v_mem_free(parts[1]);
    v2v_mem_free(parts[0]);
    return rc;
}

/* The origin moves to the middle of the centre pixel's samples. */
static void move_origin(struct v2v_beam *beam)
{
    const double offset = -0.5 * (1 - 1 / (double)beam->per_pixel) * beam->settings.pixel_size_um;
    for (int64_t i = 0; beam->per_pixel > 1 && i < beam->n * beam->n; i++) {
        const double angle = 2 * V2V_PI * offset *
                             (frequency_of(beam, i / beam->n) + frequency_of(beam, i % beam->n));
        const struct v2v_complex a = beam->aperture[i];
        beam->aperture[i].re = (float)(a.re * cos(angle) - a.im * sin(angle));
        beam->aperture[i].im = (float)(a.re * sin(angle) + a.im * cos(angle));
    }
}

enum v2v_status v2v_beam_create(struct v2v_beam **beam, const struct v2v_optics_settings *settings)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_beam *made = NULL;
    *beam = NULL;
    V2V_TRY(check(settings));
    V2V_TRY(V2V_ALLOC(made, "psf.simulate", 1));
    made->settings = *settings;
    made->band = band_of(settings);
    made->pupil = settings->numerical_aperture / settings->wavelength_um;
    V2V_TRY(v2v_zernike_parse(&made->zernike, settings->zernike));
    V2V_TRY(choose_grid(made));
    V2V_TRY(v2v_fft2_create(&made->fft, made->n, made->n));
    V2V_TRY(V2V_ALLOC(made->aperture, "psf.simulate", made->n * made->n));
    if (settings->pinhole_um > 0) {
        V2V_TRY(pinhole_aperture(made));
    } else {
        open_aperture(made);
    }
    move_origin(made);
    *beam = made;
    made = NULL;
done:
    v2v_beam_destroy(&made);
    return rc;
}

void v2v_beam_destroy(struct v2v_beam **beam)
{
    if (*beam != NULL) {
        v2v_fft2_destroy(&(*beam)->fft);
        v2v_mem_free((*beam)->aperture);
        v2v_mem_free(*beam);
        *beam = NULL;
    }
}

/* aperture[q] times what the way through pupil and sample does to the frequency tilt + q. The phase
 * (in turns) is reduced in double precision, for it reaches hundreds of turns; the transforms that
 * follow are in single precision (about 1e-6 of the peak field). */
static struct v2v_complex propagated(const struct v2v_beam *beam, struct v2v_complex a,
                                     const double tilt[2], double qy, double qx, double z)
{
    const struct v2v_optics_settings *settings = &beam->settings;
    if (a.re == 0 && a.im == 0) {
        return a;
    }
    double fy = tilt[0] + qy, fx = tilt[1] + qx;
    if (beam->fold > 0) {
        fy -= beam->fold * floor(fy / beam->fold + 0.5);
        fx -= beam->fold * floor(fx / beam->fold + 0.5);
    }
    const double across = fy * fy + fx * fx;
    const double k = settings->refractive_index / settings->wavelength_um;
    const double edge = beam->pupil + 0.5 * beam->frequency; /* a disk that fills it is soft */
    const double outside = settings->immersion_index / settings->wavelength_um;
    const int is_immersed = settings->immersion_index > 0;
    if (across > edge * edge || across >= k * k || (is_immersed && across >= outside * outside)) {
        return (struct v2v_complex){0, 0};
    }
    double turns = z * sqrt(k * k - across);
    if (is_immersed) {
        turns += settings->depth_um * (sqrt(k * k - across) - sqrt(outside * outside - across));
    }
    if (beam->zernike.last > 0) {
        turns += v2v_zernike_at(&beam->zernike, fy / beam->pupil, fx / beam->pupil);
    }
    const double angle = 2 * V2V_PI * (turns - floor(turns));
    const double c = cos(angle), s = sin(angle);
    return (struct v2v_complex){(float)(a.re * c - a.im * s), (float)(a.re * s + a.im * c)};
}

/* The half spectra whose real inverse transforms are the field's real (parts[0]) and imaginary
 * part: (A(q) + conj A(-q)) / 2 and (A(q) - conj A(-q)) / 2i. */
static void fill_spectra(struct v2v_complex *const parts[2], const struct v2v_beam *beam,
                         const double tilt[2], double z)
{
    const int64_t n = beam->n, row = n / 2 + 1;
    for (int64_t ky = 0; ky < n; ky++) {
        const int64_t minus_ky = (n - ky) % n;
        for (int64_t kx = 0; kx < row; kx++) {
            const int64_t minus_kx = (n - kx) % n;
            const struct v2v_complex a =
                propagated(beam, beam->aperture[ky * n + kx], tilt, frequency_of(beam, ky),
                           frequency_of(beam, kx), z);
            const struct v2v_complex b =
                propagated(beam, beam->aperture[minus_ky * n + minus_kx], tilt,
                           frequency_of(beam, minus_ky), frequency_of(beam, minus_kx), z);
            const int64_t at = ky * row + kx;
            parts[0][at] = (struct v2v_complex){0.5f * (a.re + b.re), 0.5f * (a.im - b.im)};
            parts[1][at] = (struct v2v_complex){0.5f * (a.im + b.im), 0.5f * (b.re - a.re)};
        }
    }
}

/* slice[y,x] = mean over the pixel of the intensity to the power of the photons. */
static void bin(float *slice, const struct v2v_beam *beam, const float *intensity)
{
    const int64_t n = beam->n, per_pixel = beam->per_pixel, size = beam->settings.size;
    const int64_t centre = v2v_psf_centre(size) + beam->settings.shift;
    for (int64_t y = 0; y < size; y++) {
        for (int64_t x = 0; x < size; x++) {
            double sum = 0;
            for (int64_t sub = 0; sub < per_pixel * per_pixel; sub++) {
                const int64_t fine_y = (y - centre) * per_pixel + sub / per_pixel + n;
                const int64_t fine_x = (x - centre) * per_pixel + sub % per_pixel + n;
                const double value = intensity[fine_y % n * n + fine_x % n];
                sum += beam->settings.photons == 2 ? value * value : value;
            }
            slice[y * size + x] = (float)(sum / (double)(per_pixel * per_pixel));
        }
    }
}

void v2v_beam_slice(float *slice, const struct v2v_beam *beam,
                    const struct v2v_beam_scratch *scratch, const double tilt[2], int64_t z)
{
    const struct v2v_optics_settings *settings = &beam->settings;
    const double middle = 0.5 * (double)(settings->slices - 1) + settings->focus_slice;
    const int64_t thread = omp_get_thread_num(), samples = beam->n * beam->n;
    struct v2v_complex *first = scratch->spectra + 2 * thread * scratch->spectrum_stride;
    struct v2v_complex *const parts[2] = {first, first + scratch->spectrum_stride};
    float *part = scratch->part + thread * scratch->image_stride;
    float *intensity = scratch->intensity + thread * scratch->image_stride;
    memset(intensity, 0, (size_t)samples * sizeof *intensity);
    fill_spectra(parts, beam, tilt, ((double)z - middle) * settings->slice_spacing_um);
    for (int which = 0; which < 2; which++) {
        v2v_fft2_inverse(beam->fft, part, parts[which]);
        for (int64_t i = 0; i < samples; i++) {
            intensity[i] += part[i] * part[i];
        }
    }
    bin(slice, beam, intensity);
}

enum v2v_status v2v_beam_scratch_create(struct v2v_beam_scratch **scratch,
                                        const struct v2v_beam *beam, int threads)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_beam_scratch *made = NULL;
    *scratch = NULL;
    V2V_TRY(V2V_ALLOC(made, "psf.simulate", 1));
    made->spectrum_stride = v2v_round_up(beam->n * (beam->n / 2 + 1), 8);
    made->image_stride = v2v_round_up(beam->n * beam->n, 16);
    V2V_TRY(V2V_ALLOC(made->spectra, "psf.simulate", 2 * threads * made->spectrum_stride));
    V2V_TRY(V2V_ALLOC(made->part, "psf.simulate", threads * made->image_stride));
    V2V_TRY(V2V_ALLOC(made->intensity, "psf.simulate", threads * made->image_stride));
    *scratch = made;
    made = NULL;
done:
    v2v_beam_scratch_destroy(&made);
    return rc;
}

void v2v_beam_scratch_destroy(struct v2v_beam_scratch **scratch)
{
    if (*scratch != NULL) {
        v2v_mem_free((*scratch)->spectra);
        v2v_mem_free((*scratch)->part);
        v2v_mem_free((*scratch)->intensity);
        v2v_mem_free(*scratch);
        *scratch = NULL;
    }
}
