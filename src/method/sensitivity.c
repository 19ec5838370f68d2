#include "method/sensitivity.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/tensor/statistics.h"

#include <string.h>

/** Kernel taps [first, end) that meet the frame of n pixels from voxel i: projection pixel
 *  i + k - c lies in [0, n), c = v2v_psf_centre(K). */
struct taps {
    int64_t first, end;
};

static struct taps taps_inside(int64_t i, int64_t n, int64_t kernel)
{
    const int64_t centre = v2v_psf_centre(kernel);
    int64_t first = centre - i, end = n - i + centre;
    return (struct taps){first > 0 ? first : 0, end < kernel ? end : kernel};
}

/** The same from pixel i: voxel i - k + c lies in [0, n). */
static struct taps taps_of_pixel(int64_t i, int64_t n, int64_t kernel)
{
    const int64_t centre = v2v_psf_centre(kernel);
    int64_t first = i + centre - n + 1, end = i + centre + 1;
    return (struct taps){first > 0 ? first : 0, end < kernel ? end : kernel};
}

/** Summed-area table of one PSF slice. @param table [ky 0..K, kx 0..K] out, zeroed */
static void tabulate(double *table, const float *psf, int64_t height, int64_t width)
{
    int64_t stride = width + 1;
    for (int64_t y = 0; y < height; y++) {
        double row = 0;
        for (int64_t x = 0; x < width; x++) {
            row += psf[y * width + x];
            table[(y + 1) * stride + x + 1] = table[y * stride + x + 1] + row;
        }
    }
}

enum v2v_status v2v_sensitivity_init(struct v2v_sensitivity *sensitivity,
                                     const struct v2v_psf_file *psf, struct v2v_part slices,
                                     int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    int64_t pixels = psf->height * psf->width;
    int64_t cells = v2v_mem_product(psf->height + 1, psf->width + 1, 1);
    *sensitivity = (struct v2v_sensitivity){.views = psf->views,
                                            .height = height,
                                            .width = width,
                                            .kernel_height = psf->height,
                                            .kernel_width = psf->width,
                                            .slices = slices};
    V2V_TRY(V2V_ALLOC(sensitivity->table, "rld.sensitivity",
                      v2v_mem_product(psf->views, slices.count, cells)));
    V2V_TRY(V2V_ALLOC(sensitivity->total, "rld.sensitivity", psf->views));
    for (int64_t v = 0; v < psf->views; v++) {
        const float *view = psf->data + v * psf->slices * pixels;
        sensitivity->total[v] = v2v_sum(view, psf->slices * pixels);
        for (int64_t z = 0; z < slices.count; z++) {
            tabulate(sensitivity->table + (v * slices.count + z) * cells,
                     view + (slices.first + z) * pixels, psf->height, psf->width);
        }
    }
done:
    return rc;
}

void v2v_sensitivity_fini(struct v2v_sensitivity *sensitivity)
{
    v2v_mem_free(sensitivity->table);
    v2v_mem_free(sensitivity->total);
    *sensitivity = (struct v2v_sensitivity){0};
}

/* Voxels first .. end of a row of `width`; low, high: the rows of a table between which their taps
 * lie. */
static void look_up(double *row, const double *low, const double *high, int64_t first, int64_t end,
                    int64_t width, int64_t kernel)
{
    for (int64_t x = first; x < end; x++) {
        struct taps kx = taps_inside(x, width, kernel);
        row[x] = (high[kx.end] - low[kx.end]) - (high[kx.first] - low[kx.first]);
    }
}

void v2v_sensitivity_row(const struct v2v_sensitivity *sensitivity, double *row, int64_t v,
                         int64_t z, int64_t y)
{
    const int64_t width = sensitivity->width, kernel = sensitivity->kernel_width;
    const int64_t stride = kernel + 1, cells = (sensitivity->kernel_height + 1) * stride;
    const double *table = sensitivity->table + (v * sensitivity->slices.count + z) * cells;
    const struct taps ky = taps_inside(y, sensitivity->height, sensitivity->kernel_height);
    const double *low = table + ky.first * stride, *high = table + ky.end * stride;
    /* Between them voxels have all columns of the kernel. */
    const int64_t centre = v2v_psf_centre(kernel), first = v2v_smaller(centre, width);
    const int64_t end = v2v_within(width + centre + 1 - kernel, first, width);
    const double whole = (high[kernel] - low[kernel]) - (high[0] - low[0]);
    look_up(row, low, high, 0, first, width, kernel);
    for (int64_t x = first; x < end; x++) {
        row[x] = whole;
    }
    look_up(row, low, high, end, width, width, kernel);
}

void v2v_sensitivity_light(const struct v2v_sensitivity *sensitivity, double *light,
                           const struct v2v_psf_file *psf, int64_t v, struct v2v_part rows,
                           double *table)
{
    int64_t width = sensitivity->width, stride = psf->width + 1, pixels = psf->height * psf->width;
    memset(light, 0, (size_t)(rows.count * width) * sizeof *light);
    for (int64_t z = 0; z < psf->slices; z++) {
        tabulate(table, psf->data + (v * psf->slices + z) * pixels, psf->height, psf->width);
#pragma omp parallel for schedule(static)
        for (int64_t y = 0; y < rows.count; y++) {
            struct taps ky = taps_of_pixel(rows.first + y, sensitivity->height, psf->height);
            const double *low = table + ky.first * stride, *high = table + ky.end * stride;
            for (int64_t x = 0; x < width; x++) {
                struct taps kx = taps_of_pixel(x, width, psf->width);
                light[y * width + x] +=
                    (high[kx.end] - low[kx.end]) - (high[kx.first] - low[kx.first]);
            }
        }
    }
}
