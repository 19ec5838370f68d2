#include "cli/volumes_quality.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/eval/quality.h"
#include "v2v3d/io/volume.h"
#include <math.h>
#include <stdio.h>

/* How the finished volumes' first frame meets its views, and the saturated part of these.
 * Collective. */
static enum v2v_status match_first(struct v2v_match *match, struct v2v_match *of_view,
                                   double *saturated, const struct v2v_volumes_made *made,
                                   const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_psf_file *psf = made->psf;
    const struct v2v_recording_info *info = v2v_recording_info(made->recording);
    const int64_t height = info->height, width = info->width;
    const int64_t samples = v2v_mem_product(psf->views, height, width);
    const int by_mean = made->ops->has_gain && session->config.psf.reduce == V2V_REDUCE_MEAN;
    const struct v2v_part mine =
        v2v_par_part(psf->slices, v2v_comm_size(session->world), v2v_comm_rank(session->world));
    struct v2v_scaling offset = *made->scaling; /* with the shading of a calibration */
    struct v2v_volume *volume = NULL;
    float *views = NULL, *slices = NULL;
    V2V_TRY(v2v_volume_open(&volume, made->output,
                            &(struct v2v_input_settings){.slices = psf->slices}, session->world));
    rc = V2V_ALLOC(views, "cli.quality", samples);
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(slices, "cli.quality", v2v_mem_product(mine.count, height, width));
    }
    if (rc == V2V_OK) {
        rc = v2v_recording_read(made->recording, views, 0);
    }
    if (rc == V2V_OK) {
        rc = v2v_volume_read(volume, slices, 0, mine.first, mine.count);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    *saturated = (double)v2v_saturated_pixels(views, samples) / (double)samples;
    offset.gain = 1.0;
    v2v_scaling_apply(&offset, views, samples);
    V2V_TRY(v2v_match_frame(match, of_view, psf, slices, views, height, width,
                            by_mean ? 1.0f / (float)psf->slices : 1.0f, session->world));
done:
    v2v_mem_free(slices);
    v2v_mem_free(views);
    v2v_volume_close(&volume);
    return rc;
}

/* Views that a volume misses by more than this part of them, and by so many times their noise where
 * they have any, are not what the PSFs make of any volume. vessels9, total variation and
 * Richardson-Lucy: out of register 0.34 to 0.40, calibrated 0.25 to 0.29; in another order or
 * mirrored 0.44 to 0.55, 36 times the noise and more, where noise alone leaves 1. */
static const double much_missed = 0.3, noises_missed = 5.0;

/* What is known of it: views may be dark, without noise, or of a sum below zero. */
static void log_match(const struct v2v_match *match, int64_t frame)
{
    char noise[64] = "", flux[64] = "";
    const double scale = v2v_match_scale(match), residual = v2v_match_residual(match, scale);
    if (match->yy == 0.0) {
        v2v_log(V2V_LOG_INFO, "frame %lld: the views are dark", (long long)frame);
        return;
    }
    if (!isfinite(residual)) {
        v2v_log(V2V_LOG_INFO, "frame %lld: the volume's views are too bright for float32",
                (long long)frame);
        return;
    }
    if (match->noise > 0.0) {
        snprintf(noise, sizeof noise, ", %.3g of their noise", v2v_match_sigmas(match, scale));
    }
    if (match->y > 0.0) {
        snprintf(flux, sizeof flux, "; flux %.4g of theirs", v2v_match_flux(match));
    }
    v2v_log(V2V_LOG_INFO, "frame %lld: residual of the views %.3g%s%s", (long long)frame, residual,
            noise, flux);
    if (residual > much_missed && !(v2v_match_sigmas(match, scale) < noises_missed)) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: the volume leaves much of the views unexplained; do they belong to "
                "these PSFs, in their order, and in register (v2v3d calibrate)?",
                (long long)frame);
    }
}

static void warn_of_odd_view(const struct v2v_match *of_view, int64_t views, int64_t frame)
{
    double light = 0.0;
    const int64_t odd = v2v_match_odd_view(&light, of_view, views);
    if (odd >= 0) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: view %lld holds %.2g times the light that the volume gives it, beside "
                "the other views: was it blocked, or is its gain another (v2v3d calibrate)?",
                (long long)frame, (long long)odd, light);
    }
}

/* Of the views' pixels. 3 % of fibres cost total variation 3 dB; some 10 pixels, as of vessels9,
 * nothing. */
static const double much_saturated = 1e-3;

static void warn_of_saturation(double part, int64_t frame)
{
    if (part > much_saturated) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: %.2g %% of the views' pixels are saturated: what they lack, the "
                "volume lacks",
                (long long)frame, 100.0 * part);
    }
}

void v2v_volumes_report_quality(const struct v2v_volumes_made *made,
                                const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_match match, *of_view = NULL;
    double saturated = 0.0;
    rc = v2v_par_agree(session->world, V2V_ALLOC(of_view, "cli.quality", made->psf->views));
    if (rc == V2V_OK) {
        rc = match_first(&match, of_view, &saturated, made, session);
    }
    if (rc == V2V_OK) {
        log_match(&match, made->first);
        warn_of_odd_view(of_view, made->psf->views, made->first);
        warn_of_saturation(saturated, made->first);
    } else {
        v2v_log(V2V_LOG_WARNING, "quality not known: %s", v2v_status_message());
    }
    v2v_mem_free(of_view);
}
