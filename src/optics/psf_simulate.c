#include "optics/beam.h"
#include "optics/tilts.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/par/watchdog.h"
#include <omp.h>

/* What one sample a pixel leaves unresolved is said, not refused: a given set may be made so. */
static void warn_of_folding(const struct v2v_optics_settings *settings)
{
    const double resolved = 0.5 / settings->pixel_size_um;
    const double pupil = settings->numerical_aperture / settings->wavelength_um;
    if (settings->sampling == V2V_OPTICS_SAMPLING_PIXEL && pupil > resolved) {
        v2v_log(V2V_LOG_WARNING,
                "optics: the pupil passes up to %.3g cycles/um, one sample a pixel of %.3g um "
                "resolves %.3g: finer structure folds (optics.sampling: band does not)",
                pupil, settings->pixel_size_um, resolved);
    }
}

enum v2v_status v2v_psf_simulate(struct v2v_psf_file *psf,
                                 const struct v2v_optics_settings *settings)
{
    enum v2v_status rc = V2V_OK;
    const int threads = omp_get_max_threads();
    const int64_t size = settings->size, slices = settings->slices;
    struct v2v_tilts tilts = {0};
    struct v2v_beam *beam = NULL;
    struct v2v_beam_scratch *scratch = NULL;

    *psf = (struct v2v_psf_file){.slices = slices,
                                 .height = size,
                                 .width = size,
                                 .pixel_size_um = settings->pixel_size_um,
                                 .slice_spacing_um = settings->slice_spacing_um};
    V2V_TRY(v2v_tilts_init(&tilts, settings));
    V2V_TRY(v2v_beam_create(&beam, settings));
    V2V_TRY(v2v_beam_scratch_create(&scratch, beam, threads));
    psf->views = tilts.views;
    V2V_TRY(V2V_ALLOC(psf->data, "psf", v2v_mem_product(tilts.views * slices, size, size)));
    warn_of_folding(settings);
    for (int64_t v = 0; v < tilts.views; v++) {
        float *view = psf->data + v * slices * size * size;
        v2v_watchdog_beat("simulating the PSFs of a view");
#pragma omp parallel for schedule(dynamic) num_threads(threads)
        for (int64_t z = 0; z < slices; z++) {
            v2v_beam_slice(view + z * size * size, beam, scratch, tilts.at[v], z);
        }
    }
    if (settings->normalize == V2V_OPTICS_NORMALIZE_VIEW) {
        v2v_psf_normalize_views(psf);
    } else if (settings->normalize == V2V_OPTICS_NORMALIZE_SLICE) {
        v2v_psf_normalize_slices(psf);
    }
done:
    v2v_beam_scratch_destroy(&scratch);
    v2v_beam_destroy(&beam);
    v2v_tilts_fini(&tilts);
    if (rc != V2V_OK) {
        v2v_psf_file_fini(psf);
    }
    return rc;
}
