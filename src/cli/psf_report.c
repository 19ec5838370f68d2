#include "cli/psf_report.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/optics/psf_figures.h"
#include <inttypes.h>
#include <math.h>

static void print_views(FILE *stream, const struct v2v_slice_figures *figures, int64_t views,
                        int64_t slices, const struct v2v_shifts *shifts)
{
    fprintf(stream, "\nview     sum  support, pixels   centroid y, first to last slice   centroid x"
                    "            shifts dy, dx\n");
    for (int64_t v = 0; v < views; v++) {
        const struct v2v_slice_figures *row = figures + v * slices;
        const int32_t *dy = shifts->dy + v * slices, *dx = shifts->dx + v * slices;
        double sum = 0.0;
        int64_t least = INT64_MAX, most = 0;
        for (int64_t z = 0; z < slices; z++) {
            sum += row[z].energy;
            least = row[z].support < least ? row[z].support : least;
            most = row[z].support > most ? row[z].support : most;
        }
        fprintf(stream,
                "%4" PRId64 " %8.4g  %6" PRId64 " .. %-6" PRId64 "  %+8.2f .. %+8.2f             "
                "%+8.2f .. %+8.2f   %+d .. %+d, %+d .. %+d\n",
                v, sum, least, most, row[0].y, row[slices - 1].y, row[0].x, row[slices - 1].x,
                dy[0], dy[slices - 1], dx[0], dx[slices - 1]);
    }
}

static void print_slices(FILE *stream, const struct v2v_slice_figures *figures, int64_t views,
                         int64_t slices)
{
    fprintf(stream, "\nslice  mean energy  largest support\n");
    for (int64_t z = 0; z < slices; z++) {
        double energy = 0.0;
        int64_t most = 0;
        for (int64_t v = 0; v < views; v++) {
            const struct v2v_slice_figures *f = &figures[v * slices + z];
            energy += f->energy / (double)views;
            most = f->support > most ? f->support : most;
        }
        fprintf(stream, "%5" PRId64 "  %11.4g  %15" PRId64 "\n", z, energy, most);
    }
}

/* Do the centroids of two views lie together in all slices? */
static int lie_together(const struct v2v_slice_figures *one, const struct v2v_slice_figures *other,
                        int64_t slices)
{
    const double most = 0.5; /* pixels */
    for (int64_t z = 0; z < slices; z++) {
        if (fabs(one[z].y - other[z].y) > most || fabs(one[z].x - other[z].x) > most) {
            return 0;
        }
    }
    return 1;
}

/* Views of which one may be there twice. Few pairs lie together, and only those are correlated. */
static void print_views_alike(FILE *stream, const struct v2v_slice_figures *figures,
                              const struct v2v_psf_file *psf)
{
    const double alike = 0.999;
    const int64_t slices = psf->slices, count = slices * psf->height * psf->width;
    for (int64_t v = 0; v < psf->views; v++) {
        for (int64_t w = v + 1; w < psf->views; w++) {
            if (!lie_together(figures + v * slices, figures + w * slices, slices)) {
                continue;
            }
            const double c =
                v2v_psf_correlation(psf->data + v * count, psf->data + w * count, count);
            if (c > alike) {
                fprintf(stream,
                        "warning: views %" PRId64 " and %" PRId64
                        " are alike (correlation %.4f): is one there twice?\n",
                        v, w, c);
            }
        }
    }
}

/* Light that is centred elsewhere than the PSFs displaces the volume. */
static void print_centre(FILE *stream, const struct v2v_slice_figures *figures, int64_t count)
{
    const double least = 0.5; /* pixels */
    double energy = 0.0, y = 0.0, x = 0.0;
    for (int64_t i = 0; i < count; i++) {
        energy += figures[i].energy;
        y += figures[i].energy * figures[i].y;
        x += figures[i].energy * figures[i].x;
    }
    if (fabs(y) > least * energy || fabs(x) > least * energy) {
        fprintf(stream,
                "warning: off-centre: the light of all views is centred %+.2f, %+.2f pixels (y, x) "
                "from the PSFs' centre; volumes will lie as far the other way\n",
                y / energy, x / energy);
    }
}

static void print_warnings(FILE *stream, const struct v2v_slice_figures *figures,
                           const struct v2v_psf_file *psf)
{
    double border = 0.0, energy = 0.0;
    int64_t dark = 0, count = psf->views * psf->slices;
    for (int64_t i = 0; i < count; i++) {
        border += figures[i].border;
        energy += figures[i].energy;
        dark += figures[i].energy <= 0.0;
    }
    print_centre(stream, figures, count);
    print_views_alike(stream, figures, psf);
    if (dark > 0) {
        fprintf(stream, "warning: %" PRId64 " of %" PRId64 " slices are without energy\n", dark,
                count);
    }
    if (border > 1e-3 * energy && v2v_psf_pedestal(psf) == 0.0) {
        fprintf(stream, "warning: %.2g of the energy lies on the border: the PSFs are cut off\n",
                border / energy);
    }
}

static void print_notes(FILE *stream, const struct v2v_psf_file *psf)
{
    if (psf->height % 2 == 0 || psf->width % 2 == 0) {
        fprintf(stream, "note: an even side; its centre is pixel ceil(K/2)-1\n");
    }
    if (psf->pixel_size_um <= 0.0 || psf->slice_spacing_um <= 0.0) {
        fprintf(stream, "note: pixel size or slice spacing is not stated in the file\n");
    }
}

/* 0: the file doesn't state it. */
static void print_length(FILE *stream, const char *name, double length_um, const char *end)
{
    if (length_um > 0.0) {
        fprintf(stream, "%s %g um%s", name, length_um, end);
    } else {
        fprintf(stream, "%s not stated%s", name, end);
    }
}

static enum v2v_status make_figures(struct v2v_slice_figures **figures,
                                    const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = psf->height * psf->width;
    V2V_TRY(V2V_ALLOC(*figures, "psf.figures", psf->views * psf->slices));
    for (int64_t i = 0; i < psf->views * psf->slices; i++) {
        (*figures)[i] = v2v_slice_figures_of(psf->data + i * pixels, psf->height, psf->width);
    }
done:
    return rc;
}

enum v2v_status v2v_psf_report_warnings(FILE *stream, const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_slice_figures *figures = NULL;
    V2V_TRY(make_figures(&figures, psf));
    print_warnings(stream, figures, psf);
done:
    v2v_mem_free(figures);
    return rc;
}

enum v2v_status v2v_psf_report(FILE *stream, const char *name, const struct v2v_psf_file *psf,
                               const struct v2v_shifts *shifts)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_slice_figures *figures = NULL;
    V2V_TRY(make_figures(&figures, psf));
    fprintf(stream,
            "%s: %" PRId64 " views, %" PRId64 " slices of %" PRId64 " x %" PRId64 " pixels\n", name,
            psf->views, psf->slices, psf->height, psf->width);
    print_length(stream, "pixel size", psf->pixel_size_um, ", ");
    print_length(stream, "slice spacing", psf->slice_spacing_um, "\n");
    fprintf(stream, "mean slice energy of view 0: %.6g, largest shift %" PRId64 " pixels\n",
            v2v_psf_energy_mean(psf), v2v_shifts_reach(shifts));
    print_views(stream, figures, psf->views, psf->slices, shifts);
    print_slices(stream, figures, psf->views, psf->slices);
    print_warnings(stream, figures, psf);
    print_notes(stream, psf);
done:
    v2v_mem_free(figures);
    return rc;
}
