#include "optics/tilts.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/pi.h"
#include "v2v3d/base/text.h"
#include <inttypes.h>
#include <math.h>
#include <stdio.h>

static void ring_tilt(double tilt[2], const struct v2v_optics_settings *settings, int64_t v)
{
    tilt[0] = tilt[1] = 0;
    if (v > 0) {
        const int64_t ring = (v - 1) / settings->views_per_ring + 1;
        const int64_t around = (v - 1) % settings->views_per_ring;
        const double outermost = settings->numerical_aperture - settings->needle_aperture;
        const double frequency =
            outermost * (double)ring / (double)settings->rings / settings->wavelength_um;
        const double azimuth = 2 * V2V_PI * (double)around / (double)settings->views_per_ring;
        tilt[0] = frequency * sin(azimuth);
        tilt[1] = frequency * cos(azimuth);
    }
}

static int64_t count_of(const struct v2v_optics_settings *settings)
{
    return settings->tilts[0] == '\0' ? 1 + settings->rings * settings->views_per_ring
                                      : v2v_text_count_listed(settings->tilts);
}

static enum v2v_status parse(struct v2v_tilts *tilts, const struct v2v_optics_settings *settings)
{
    enum v2v_status rc = V2V_OK;
    const double pupil = settings->numerical_aperture / settings->wavelength_um;
    V2V_TRY(v2v_text_to_pairs(tilts->at, settings->tilts, -1, 1, "optics.tilts", "view"));
    for (int64_t v = 0; v < tilts->views; v++) {
        double *at = tilts->at[v];
        if (hypot(at[0], at[1]) > 1) {
            V2V_TRY(V2V_FAIL(V2V_E_CONFIG,
                             "optics.tilts: view %" PRId64 " (%g %g) lies outside the pupil", v,
                             at[0], at[1]));
        }
        at[0] *= pupil;
        at[1] *= pupil;
    }
done:
    return rc;
}

enum v2v_status v2v_tilts_init(struct v2v_tilts *tilts, const struct v2v_optics_settings *settings)
{
    enum v2v_status rc = V2V_OK;
    *tilts = (struct v2v_tilts){.views = count_of(settings)};
    V2V_TRY(V2V_ALLOC(tilts->at, "psf.simulate", tilts->views));
    for (int64_t v = 0; settings->tilts[0] == '\0' && v < tilts->views; v++) {
        ring_tilt(tilts->at[v], settings, v);
    }
    if (settings->tilts[0] != '\0') {
        V2V_TRY(parse(tilts, settings));
    }
done:
    if (rc != V2V_OK) {
        v2v_tilts_fini(tilts);
    }
    return rc;
}

void v2v_tilts_fini(struct v2v_tilts *tilts)
{
    v2v_mem_free(tilts->at);
    *tilts = (struct v2v_tilts){0};
}

enum v2v_status v2v_tilts_print(struct v2v_optics_settings *settings, const struct v2v_tilts *tilts)
{
    const double pupil = settings->numerical_aperture / settings->wavelength_um;
    const double most = 1.0 - 1e-5; /* what is rounded lies inside the pupil, too */
    size_t used = 0;
    for (int64_t v = 0; v < tilts->views; v++) {
        const double y = tilts->at[v][0] / pupil, x = tilts->at[v][1] / pupil;
        const double inwards = fmin(1.0, most / fmax(hypot(y, x), most));
        const int wrote = snprintf(settings->tilts + used, sizeof settings->tilts - used,
                                   "%s%.5f %.5f", v > 0 ? ", " : "", y * inwards, x * inwards);
        used += (size_t)wrote;
        if (used >= sizeof settings->tilts) {
            settings->tilts[0] = '\0';
            return V2V_FAIL(V2V_E_CONFIG,
                            "optics.tilts: %" PRId64 " views do not fit into a setting of %zu "
                            "letters",
                            tilts->views, sizeof settings->tilts - 1);
        }
    }
    return V2V_OK;
}
