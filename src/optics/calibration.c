#include "v2v3d/optics/calibration.h"

#include "optics/moments.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/pi.h"
#include "v2v3d/fft/fft2.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/tensor/warp.h"

#include <math.h>
#include <omp.h>
#include <string.h>

/* Pixels about what is displaced, for the side lobes that displacement in frequency gives a kernel
 * that its window cut off. */
enum { SIDE_LOBES = 2 };

/* Of 64 bytes, in complex numbers too. */
enum { ALIGNED_FLOATS = 32 };

/* How far the window must grow on every side. */
static int64_t margin_of(const struct v2v_calibration *calibration)
{
    double farthest = 0.0;
    for (int64_t v = 0; v < calibration->views; v++) {
        const struct v2v_view_calibration *view = &calibration->view[v];
        for (int axis = 0; axis < 2; axis++) {
            farthest = fmax(farthest, fabs(view->shift[axis]) + fabs(view->slope[axis]));
        }
    }
    return farthest > 0.0 ? (int64_t)ceil(farthest) + SIDE_LOBES : 0;
}

/* What displaces kernels, one set of buffers a thread. */
struct shifter {
    struct v2v_fft2 *fft;
    int64_t ny, nx;   /* of the transforms */
    int64_t of_image; /* floats from a thread's buffer to the next, aligned */
    float *image;     /* [threads,ny,nx] */
    struct v2v_complex *spectrum;
};

static enum v2v_status shifter_init(struct shifter *shifter, int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    const int64_t threads = omp_get_max_threads();
    *shifter = (struct shifter){.ny = v2v_fft_good_size(height), .nx = v2v_fft_good_size(width)};
    shifter->of_image = v2v_round_up(shifter->ny * (shifter->nx + 2), ALIGNED_FLOATS);
    V2V_TRY(v2v_fft2_create(&shifter->fft, shifter->ny, shifter->nx));
    V2V_TRY(V2V_ALLOC(shifter->image, "optics.calibration",
                      v2v_mem_product(threads, shifter->of_image, 1)));
    V2V_TRY(V2V_ALLOC(shifter->spectrum, "optics.calibration",
                      v2v_mem_product(threads, shifter->of_image / 2, 1)));
done:
    return rc;
}

static void shifter_fini(struct shifter *shifter)
{
    v2v_fft2_destroy(&shifter->fft);
    v2v_mem_free(shifter->image);
    v2v_mem_free(shifter->spectrum);
}

/* spectrum *= scale * exp(-2 pi i (f_y shift_y + f_x shift_x)), f in cycles a pixel. The frequency
 * at half the sampling rate stands for both its signs: the mean of the two. */
static void turn(struct v2v_complex *spectrum, const struct shifter *shifter, const double shift[2],
                 double scale)
{
    const int64_t ny = shifter->ny, nx = shifter->nx, columns = nx / 2 + 1;
    const double turn_of = -2.0 * V2V_PI;
    for (int64_t ky = 0; ky < ny; ky++) {
        const double fy = (double)(2 * ky < ny ? ky : ky - ny) / (double)ny;
        for (int64_t kx = 0; kx < columns; kx++) {
            const double fx = (double)kx / (double)nx;
            double by_y = turn_of * fy * shift[0], by_x = turn_of * fx * shift[1];
            double size = scale;
            if (2 * ky == ny) {
                size *= cos(by_y);
                by_y = 0.0;
            }
            if (2 * kx == nx) {
                size *= cos(by_x);
                by_x = 0.0;
            }
            const double re = size * cos(by_y + by_x), im = size * sin(by_y + by_x);
            struct v2v_complex *s = &spectrum[ky * columns + kx];
            *s = (struct v2v_complex){(float)(re * (double)s->re - im * (double)s->im),
                                      (float)(re * (double)s->im + im * (double)s->re)};
        }
    }
}

/* One kernel [height,width] into the middle of a window that is `margin` larger on every side. */
static void displace(float *to, const float *from, const struct v2v_psf_file *psf, int64_t margin,
                     const struct shifter *shifter, const double shift[2], double gain)
{
    const int64_t ny = shifter->ny, nx = shifter->nx, thread = omp_get_thread_num();
    const int64_t height = psf->height + 2 * margin, width = psf->width + 2 * margin;
    float *image = shifter->image + thread * shifter->of_image;
    struct v2v_complex *spectrum = shifter->spectrum + thread * shifter->of_image / 2;
    memset(image, 0, (size_t)(ny * nx) * sizeof *image);
    for (int64_t y = 0; y < psf->height; y++) {
        memcpy(image + (y + margin) * nx + margin, from + y * psf->width,
               (size_t)psf->width * sizeof *image);
    }
    v2v_fft2_forward(shifter->fft, spectrum, image);
    turn(spectrum, shifter, shift, gain / (double)(ny * nx));
    v2v_fft2_inverse(shifter->fft, image, spectrum);
    for (int64_t y = 0; y < height; y++) {
        memcpy(to + y * width, image + y * nx, (size_t)width * sizeof *image);
    }
}

static void scale_views(struct v2v_psf_file *psf, const struct v2v_calibration *calibration)
{
    const int64_t one_view = psf->slices * psf->height * psf->width;
    for (int64_t i = 0; i < psf->views * one_view; i++) {
        psf->data[i] = (float)(calibration->view[i / one_view].gain * (double)psf->data[i]);
    }
}

enum v2v_status v2v_calibration_apply_to_psf(struct v2v_psf_file *psf,
                                             const struct v2v_calibration *calibration)
{
    enum v2v_status rc = V2V_OK;
    const int64_t margin = margin_of(calibration);
    const int64_t height = psf->height + 2 * margin, width = psf->width + 2 * margin;
    const int64_t from_size = psf->height * psf->width, to_size = height * width;
    const int64_t kernels = v2v_mem_product(psf->views, psf->slices, 1);
    struct shifter shifter = {0};
    float *data = NULL;
    if (calibration->views != psf->views) {
        return V2V_FAIL(V2V_E_INPUT, "a calibration of %lld views, but the PSFs have %lld",
                        (long long)calibration->views, (long long)psf->views);
    }
    if (margin == 0) {
        scale_views(psf, calibration);
        return V2V_OK;
    }
    V2V_TRY(shifter_init(&shifter, height, width));
    V2V_TRY(V2V_ALLOC(data, "optics.psf", v2v_mem_product(kernels, height, width)));
#pragma omp parallel for schedule(static)
    for (int64_t k = 0; k < kernels; k++) {
        const struct v2v_view_calibration *view = &calibration->view[k / psf->slices];
        const double depth = v2v_line_place(k % psf->slices, psf->slices);
        const double shift[2] = {view->shift[0] + view->slope[0] * depth,
                                 view->shift[1] + view->slope[1] * depth};
        displace(data + k * to_size, psf->data + k * from_size, psf, margin, &shifter, shift,
                 view->gain);
    }
    v2v_mem_free(psf->data);
    psf->data = data;
    psf->height = height;
    psf->width = width;
done:
    shifter_fini(&shifter);
    return rc;
}

void v2v_calibration_distort_view(float *image, float *scratch,
                                  const struct v2v_view_calibration *view, int64_t height,
                                  int64_t width)
{
    v2v_shade_image(image, height, width, view->shading, 1.0);
    memcpy(scratch, image, (size_t)(height * width) * sizeof *image);
    v2v_warp_image(image, scratch, height, width, view->distortion_y, view->distortion_x);
}

void v2v_calibration_distort(float *views, float *scratch,
                             const struct v2v_calibration *calibration, int64_t height,
                             int64_t width)
{
    for (int64_t v = 0; v < calibration->views; v++) {
        v2v_calibration_distort_view(views + v * height * width, scratch, &calibration->view[v],
                                     height, width);
    }
}

void v2v_calibration_distort_transpose(float *views, float *scratch,
                                       const struct v2v_calibration *calibration, int64_t height,
                                       int64_t width)
{
    for (int64_t v = 0; v < calibration->views; v++) {
        const struct v2v_view_calibration *view = &calibration->view[v];
        float *image = views + v * height * width;
        memcpy(scratch, image, (size_t)(height * width) * sizeof *image);
        v2v_warp_image_transpose(image, scratch, height, width, view->distortion_y,
                                 view->distortion_x);
        v2v_shade_image(image, height, width, view->shading, 1.0);
    }
}

void v2v_calibration_undistort(float *to, const float *views, float *scratch,
                               const struct v2v_calibration *calibration)
{
    const int64_t height = calibration->height, width = calibration->width;
    for (int64_t v = 0; v < calibration->views; v++) {
        const struct v2v_view_calibration *view = &calibration->view[v];
        float *image = to + v * height * width;
        v2v_unwarp_image(image, views + v * height * width, scratch, height, width,
                         view->distortion_y, view->distortion_x);
        v2v_shade_image(image, height, width, view->shading, -1.0);
    }
}

void v2v_psf_parallax(double (*parallax)[2], const struct v2v_psf_file *psf)
{
    const int64_t pixels = psf->height * psf->width;
    for (int64_t v = 0; v < psf->views; v++) {
        double light = 0.0, z1 = 0.0, z2 = 0.0, c1[2] = {0.0}, cz[2] = {0.0};
        for (int64_t z = 0; z < psf->slices; z++) {
            double moment[3];
            v2v_slice_moments(moment, psf->data + (v * psf->slices + z) * pixels, psf->height,
                              psf->width);
            light += moment[0];
            z1 += moment[0] * (double)z;
            z2 += moment[0] * (double)(z * z);
            for (int axis = 0; axis < 2; axis++) {
                c1[axis] += moment[1 + axis];
                cz[axis] += moment[1 + axis] * (double)z;
            }
        }
        const double spread = light * z2 - z1 * z1;
        for (int axis = 0; axis < 2; axis++) {
            parallax[v][axis] = spread > 0.0 ? (light * cz[axis] - z1 * c1[axis]) / spread : 0.0;
        }
    }
}
