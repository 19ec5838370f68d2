#include "optics/sizes.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/fft/fft2.h"
#include "v2v3d/optics/psf.h"
#include <math.h>
#include <omp.h>
#include <string.h>

static const double PI = 3.14159265358979323846;

/* Samples of a side that are still reasonable: 200 MB a thread. */
enum { GRID_LIMIT = 4096 };

/* The grid on which a beam is propagated. Frequencies are counted from the tilt's: a common carrier
 * drops out of the intensity, so all views share the band |q| <= radius. */
struct grid {
    int64_t n;            /* samples of a side */
    int64_t per_pixel;    /* samples of a pixel's side */
    double offset;        /* of a pixel's first sample from the pixel's middle, um */
    double radius;        /* of the sub-aperture, 1/um */
    double wave_number;   /* refractive index / wavelength, 1/um */
    double frequency;     /* step between spatial frequencies, 1/um */
    struct v2v_fft2 *fft; /* n x n */
};

/* Working memory of one thread, or the start of all threads' with the strides between them. */
struct scratch {
    int64_t spectrum_stride, image_stride;
    struct v2v_complex *spectrum; /* [n,n/2+1] */
    float *part;                  /* [n,n]: real or imaginary part of the field */
    float *intensity;             /* [n,n] */
};

static enum v2v_status check_apertures(const struct v2v_optics_settings *settings)
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
    return V2V_OK;
}

/* The field's band has radius r, the intensity's 2r, the squared intensity's 4r: samples lie at
 * most 1/(8r) apart. The grid is periodic: it is as wide as what is cut out of it, plus what the
 * steepest ray walks off axis up to the last slice, plus diffraction's tails (4 wavelengths over
 * the needle aperture: the squared Airy pattern is below 1e-7 of its peak there). */
static enum v2v_status grid_init(struct grid *grid, const struct v2v_optics_settings *settings)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(check_apertures(settings));

    const double wavelength = settings->wavelength_um, pixel = settings->pixel_size_um;
    *grid = (struct grid){.radius = settings->needle_aperture / wavelength,
                          .wave_number = settings->refractive_index / wavelength};
    const double per_pixel = ceil(8 * grid->radius * pixel);
    const double steepest = settings->numerical_aperture / settings->refractive_index;
    const double depth = 0.5 * (double)(settings->slices - 1) * settings->slice_spacing_um;
    const double walk = depth * steepest / sqrt(1 - steepest * steepest);
    const double tails = 4 * wavelength / settings->needle_aperture;
    const double half = 0.5 * (double)(settings->size + 1) * pixel;
    const double n = ceil((half + fmax(half, walk + tails)) * per_pixel / pixel);
    if (!(n <= GRID_LIMIT)) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG,
                         "optics: sampling too coarse for this aperture: %g samples a side are "
                         "needed, %d are the limit; reduce pixel_size_um, size, slice_spacing_um "
                         "or slices",
                         n, GRID_LIMIT));
    }
    grid->per_pixel = (int64_t)per_pixel;
    grid->offset = -0.5 * (1 - 1 / per_pixel) * pixel;
    grid->n = v2v_fft_good_size((int64_t)n);
    grid->frequency = per_pixel / (pixel * (double)grid->n);
    V2V_TRY(v2v_fft2_create(&grid->fft, grid->n, grid->n));
done:
    return rc;
}

/* The pupil function at offset q from the tilt, propagated to depth z, 1 at focus in sum over q,
 * with the origin moved to the middle of the centre pixel's samples. Its edge is one frequency step
 * wide about the radius, which softens the staircase of a disk on a grid. The phase (in turns) is
 * reduced in double precision, for it reaches hundreds of turns; the transforms that follow are in
 * single precision (about 1e-6 of the peak field). */
static void pupil_at(double *re, double *im, const struct grid *grid, const double tilt[2],
                     const double q[2], double z)
{
    const double inside = (grid->radius - hypot(q[0], q[1])) / grid->frequency + 0.5;
    const double fy = tilt[0] + q[0], fx = tilt[1] + q[1];
    const double axial = grid->wave_number * grid->wave_number - fy * fy - fx * fx;
    *re = *im = 0;
    if (inside > 0 && axial > 0) {
        const double turns = z * sqrt(axial) + (q[0] + q[1]) * grid->offset;
        const double angle = 2 * PI * (turns - floor(turns));
        const double amplitude = fmin(inside, 1) * (grid->frequency * grid->frequency) /
                                 (PI * grid->radius * grid->radius);
        *re = amplitude * cos(angle);
        *im = amplitude * sin(angle);
    }
}

/* The half spectra whose real inverse transforms are the field's real (imaginary = 0) and imaginary
 * (1) part: (A(q) + conj A(-q)) / 2 and (A(q) - conj A(-q)) / 2i. */
static void fill_spectrum(struct v2v_complex *spectrum, const struct grid *grid,
                          const double tilt[2], double z, int imaginary)
{
    const int64_t row = grid->n / 2 + 1;
    const int64_t reach = (int64_t)(grid->radius / grid->frequency) + 1;
    memset(spectrum, 0, (size_t)(grid->n * row) * sizeof *spectrum);
    for (int64_t ky = -reach; ky <= reach; ky++) {
        for (int64_t kx = 0; kx <= reach; kx++) {
            const double q[2] = {(double)ky * grid->frequency, (double)kx * grid->frequency};
            double a_re = 0, a_im = 0, b_re = 0, b_im = 0;
            pupil_at(&a_re, &a_im, grid, tilt, q, z);
            pupil_at(&b_re, &b_im, grid, tilt, (const double[2]){-q[0], -q[1]}, z);
            struct v2v_complex *to = spectrum + (ky < 0 ? ky + grid->n : ky) * row + kx;
            to->re = (float)(0.5 * (imaginary ? a_im + b_im : a_re + b_re));
            to->im = (float)(0.5 * (imaginary ? b_re - a_re : a_im - b_im));
        }
    }
}

/* slice[y,x] = mean over the pixel of the squared intensity: two-photon excitation. */
static void bin_squared(float *slice, const struct grid *grid, const float *intensity, int64_t size)
{
    const int64_t n = grid->n, per_pixel = grid->per_pixel;
    const int64_t centre = v2v_psf_centre(size);
    for (int64_t y = 0; y < size; y++) {
        for (int64_t x = 0; x < size; x++) {
            double sum = 0;
            for (int64_t sub = 0; sub < per_pixel * per_pixel; sub++) {
                const int64_t fine_y = (y - centre) * per_pixel + sub / per_pixel + n;
                const int64_t fine_x = (x - centre) * per_pixel + sub % per_pixel + n;
                const double value = intensity[fine_y % n * n + fine_x % n];
                sum += value * value;
            }
            slice[y * size + x] = (float)(sum / (double)(per_pixel * per_pixel));
        }
    }
}

static void simulate_slice(float *slice, const struct grid *grid, const struct scratch *scratch,
                           const double tilt[2], double z, int64_t size)
{
    const int64_t samples = grid->n * grid->n;
    memset(scratch->intensity, 0, (size_t)samples * sizeof *scratch->intensity);
    for (int imaginary = 0; imaginary <= 1; imaginary++) {
        fill_spectrum(scratch->spectrum, grid, tilt, z, imaginary);
        v2v_fft2_inverse(grid->fft, scratch->part, scratch->spectrum);
        for (int64_t i = 0; i < samples; i++) {
            scratch->intensity[i] += scratch->part[i] * scratch->part[i];
        }
    }
    bin_squared(slice, grid, scratch->intensity, size);
}

/* Spatial frequency [y,x] of a view's tilt: view 0 on axis, then ring by ring; the outermost
 * sub-aperture touches the pupil's edge. */
static void tilt_of(double tilt[2], const struct v2v_optics_settings *settings, int64_t v)
{
    tilt[0] = tilt[1] = 0;
    if (v > 0) {
        const int64_t ring = (v - 1) / settings->views_per_ring + 1;
        const int64_t around = (v - 1) % settings->views_per_ring;
        const double outermost = settings->numerical_aperture - settings->needle_aperture;
        const double frequency =
            outermost * (double)ring / (double)settings->rings / settings->wavelength_um;
        const double azimuth = 2 * PI * (double)around / (double)settings->views_per_ring;
        tilt[0] = frequency * sin(azimuth);
        tilt[1] = frequency * cos(azimuth);
    }
}

static enum v2v_status scratch_init(struct scratch *scratch, int64_t n, int threads)
{
    enum v2v_status rc = V2V_OK;
    scratch->spectrum_stride = v2v_round_up(n * (n / 2 + 1), 8);
    scratch->image_stride = v2v_round_up(n * n, 16);
    V2V_TRY(V2V_ALLOC(scratch->spectrum, "psf.simulate", threads * scratch->spectrum_stride));
    V2V_TRY(V2V_ALLOC(scratch->part, "psf.simulate", threads * scratch->image_stride));
    V2V_TRY(V2V_ALLOC(scratch->intensity, "psf.simulate", threads * scratch->image_stride));
done:
    return rc;
}

static void scratch_fini(struct scratch *scratch)
{
    v2v_mem_free(scratch->spectrum);
    v2v_mem_free(scratch->part);
    v2v_mem_free(scratch->intensity);
}

static struct scratch scratch_of_thread(const struct scratch *all)
{
    struct scratch mine = *all;
    mine.spectrum += omp_get_thread_num() * all->spectrum_stride;
    mine.part += omp_get_thread_num() * all->image_stride;
    mine.intensity += omp_get_thread_num() * all->image_stride;
    return mine;
}

enum v2v_status v2v_psf_simulate(struct v2v_psf_file *psf,
                                 const struct v2v_optics_settings *settings)
{
    enum v2v_status rc = V2V_OK;
    const int threads = omp_get_max_threads();
    const int64_t size = settings->size, slices = settings->slices;
    const int64_t views = 1 + settings->rings * settings->views_per_ring;
    struct grid grid = {0};
    struct scratch all = {0};

    *psf = (struct v2v_psf_file){.views = views,
                                 .slices = slices,
                                 .height = size,
                                 .width = size,
                                 .pixel_size_um = settings->pixel_size_um,
                                 .slice_spacing_um = settings->slice_spacing_um};
    V2V_TRY(grid_init(&grid, settings));
    V2V_TRY(scratch_init(&all, grid.n, threads));
    V2V_TRY(V2V_ALLOC(psf->data, "psf", v2v_mem_product(views * slices, size, size)));
#pragma omp parallel for schedule(dynamic) num_threads(threads)
    for (int64_t i = 0; i < views * slices; i++) {
        const struct scratch mine = scratch_of_thread(&all);
        const double middle = 0.5 * (double)(slices - 1);
        double tilt[2];
        tilt_of(tilt, settings, i / slices);
        simulate_slice(psf->data + i * size * size, &grid, &mine, tilt,
                       ((double)(i % slices) - middle) * settings->slice_spacing_um, size);
    }
    v2v_psf_normalize_views(psf);
done:
    scratch_fini(&all);
    v2v_fft2_destroy(&grid.fft);
    if (rc != V2V_OK) {
        v2v_psf_file_fini(psf);
    }
    return rc;
}
