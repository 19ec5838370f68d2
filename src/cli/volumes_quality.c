#include "cli/volumes_quality.h"

#include "cli/steps.h"
#include "cli/volumes_frames.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/conf/kept_views.h"
#include "v2v3d/eval/as_recorded.h"
#include "v2v3d/eval/first_seen.h"
#include "v2v3d/eval/quality.h"
#include "v2v3d/eval/unlike.h"
#include "v2v3d/io/volume.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/saturation.h"
#include <math.h>
#include <stdio.h>
#include <string.h>

/* What a frame of the volumes and its views have in common. */
struct found {
    float *projected;                 /* [v,y,x]: what the volume gives */
    float *recorded;                  /* likewise, less the offset; V2V_BLIND: nothing is seen */
    int64_t blind;                    /* how many are */
    struct v2v_match match, *of_view; /* [v] */
    double *displaced;                /* [v], pixels */
    double saturated;                 /* part of the views' pixels */
    int64_t views;
    int64_t shown, frame; /* of the volumes, and before the cut */
    const char *without;  /* views that are not used (conf/kept_views.h) */
    int is_seen;          /* it shows something above its noise */
};

/* What the files call a view. */
static long long number_of(const struct found *found, int64_t view)
{
    return (long long)v2v_kept_views_number(found->without, view);
}

/* Of the views that lack some. */
static void tell_of_blind(const struct found *found, const struct v2v_volumes_made *made)
{
    const struct v2v_recording_info *info = v2v_recording_info(made->recording);
    const int64_t pixels = info->height * info->width;
    const int is_left = made->ops->leaves_blind;
    char list[256] = "";
    int64_t lacking = 0, dead = 0;
    for (int64_t v = 0; found->blind > 0 && v < found->views; v++) {
        const int64_t here = v2v_blind_count(found->recorded + v * pixels, pixels);
        const size_t length = strlen(list);
        if (here > 0) {
            snprintf(list + length, sizeof list - length, "%s%lld", lacking > 0 ? ", " : " ",
                     number_of(found, v));
        }
        lacking += here > 0;
        dead += here == pixels;
    }
    if (found->blind > 0) {
        v2v_log(dead > 0 || !is_left ? V2V_LOG_WARNING : V2V_LOG_INFO,
                "frame %lld: %s%s: %lld samples of one value see nothing and are %s",
                (long long)found->frame,
                lacking == found->views ? "all views"
                : lacking > 1           ? "views"
                                        : "view",
                lacking == found->views ? "" : list, (long long)found->blind,
                is_left ? "left out" : "taken for dark by this method");
    }
}

/* May the method make views of a volume, with room beside it on all ranks for two sets of them?
 * Else its memory is given back. Collective. */
static void keep_method(const struct v2v_volumes_made *made, int64_t samples,
                        const struct v2v_session *session)
{
    const size_t wanted = 2 * (size_t)v2v_mem_bytes(samples, 0);
    int64_t is_short = made->ops->project == NULL || v2v_mem_room() < wanted;
    v2v_par_max_i64(session->world, &is_short, 1);
    if (is_short) {
        v2v_recon_destroy(made->recon);
    }
}

/* The shown frame's views, by ranks that share its slices. Collective. */
static enum v2v_status project_slices(struct found *found, struct v2v_volume *volume,
                                      const struct v2v_volumes_made *made,
                                      const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(made->recording);
    const struct v2v_psf_file *psf = made->psf;
    const int by_mean = made->ops->has_gain && session->config.psf.reduce == V2V_REDUCE_MEAN;
    const struct v2v_part mine =
        v2v_par_part(psf->slices, v2v_comm_size(session->world), v2v_comm_rank(session->world));
    float *slices = NULL;
    rc = V2V_ALLOC(slices, "cli.quality", v2v_mem_product(mine.count, info->height, info->width));
    if (rc == V2V_OK) {
        rc = v2v_volume_read(volume, slices, found->shown, mine.first, mine.count);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    V2V_TRY(v2v_match_project(found->projected, psf, slices, info->height, info->width,
                              by_mean ? 1.0f / (float)psf->slices : 1.0f, session->world));
done:
    v2v_mem_free(slices);
    return rc;
}

/* The shown frame's views, by the method where it is kept. Collective. */
static enum v2v_status project(struct found *found, const struct v2v_volumes_made *made,
                               const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(made->recording);
    const struct v2v_input_settings input = {.slices = made->psf->slices};
    const int64_t samples = v2v_mem_product(found->views, info->height, info->width);
    struct v2v_volume *volume = NULL;
    V2V_TRY(v2v_par_agree(session->world, V2V_ALLOC(found->projected, "cli.quality", samples)));
    V2V_TRY(v2v_volume_open(&volume, made->output, &input, session->world));
    if (*made->recon != NULL) {
        V2V_TRY(v2v_recon_project(*made->recon, found->projected, volume, found->shown));
        v2v_recon_destroy(made->recon);
    } else {
        V2V_TRY(project_slices(found, volume, made, session));
    }
done:
    v2v_volume_close(&volume);
    return rc;
}

/* The shown frame's views, as recorded. Local. */
static enum v2v_status read_views(struct found *found, const struct v2v_volumes_made *made)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(made->recording);
    const int64_t samples = v2v_mem_product(found->views, info->height, info->width);
    V2V_TRY(V2V_ALLOC(found->of_view, "cli.quality", found->views));
    V2V_TRY(V2V_ALLOC(found->displaced, "cli.quality", found->views));
    V2V_TRY(V2V_ALLOC(found->recorded, "cli.quality", samples));
    V2V_TRY(v2v_unlike_read(found->recorded, &found->blind, &found->saturated, made->recording,
                            made->scaling, found->shown));
done:
    return rc;
}

/* Views and their projections, which are 0 then where nothing is seen. Local. */
static enum v2v_status match_views(struct found *found, const struct v2v_recording *recording)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    const int64_t samples = v2v_mem_product(found->views, info->height, info->width);
    float *views = NULL;
    V2V_TRY(V2V_ALLOC(views, "cli.quality", samples));
    v2v_as_recorded_predict(found->projected, views, recording, 0, found->views);
    memcpy(views, found->recorded, (size_t)samples * sizeof *views);
    v2v_saturated_cap(found->projected, views, found->views, info->height * info->width);
    V2V_TRY(v2v_match_frame(&found->match, found->of_view, found->displaced, views,
                            found->projected, found->views, info->height, info->width));
done:
    v2v_mem_free(views);
    return rc;
}

/* How the first frame that shows something meets its views. Collective. */
static enum v2v_status match_frame(struct found *found, const struct v2v_volumes_made *made,
                                   const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(made->recording);
    keep_method(made, v2v_mem_product(found->views, info->height, info->width), session);
    V2V_TRY(v2v_first_seen(&found->shown, &found->is_seen, made->recording, made->scaling,
                           session->world));
    found->shown = found->is_seen ? found->shown : 0;
    found->frame = made->first + found->shown;
    V2V_TRY(project(found, made, session));
    rc = read_views(found, made);
    if (rc == V2V_OK) {
        rc = match_views(found, made->recording);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
done:
    return rc;
}

/* Of the views' structure, that a volume misses: more is not what the PSFs make of any volume. A
 * real recording: 0.33 as it came, 0.19 calibrated, 0.36 to 0.6 in another order or mirrored. */
static const double much_missed = 0.3;

/* Pixels that the views lie from those of the volume, in the root mean square: where structure is
 * missed, 0.02 to 0.2 of views in register, 0.28 to 3 of others. */
static const double displaced = 0.25;

/* Of a view's structure, beside half of the views: two neighbours of 13 in each other's place miss
 * 0.06 to 0.6, the others 0 to 0.1; of views in register the worst misses up to 0.008, of a real
 * recording as much as the others. */
static const double much_of_one = 0.1, times_others = 3.0;

/* What is known of it: views may be dark, without noise, or of a sum below zero. */
static void log_match(const struct v2v_match *match, int64_t frame)
{
    char noise[64] = "", structure[64] = "", flux[64] = "";
    const double missed = v2v_structure_missed(&match->structure);
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
    if (isfinite(missed)) {
        snprintf(structure, sizeof structure, ", %.2g of their structure", missed);
    }
    if (match->y > 0.0) {
        snprintf(flux, sizeof flux, "; flux %.4g of theirs", v2v_match_flux(match));
    }
    v2v_log(V2V_LOG_INFO, "frame %lld: residual of the views %.3g%s%s%s", (long long)frame,
            residual, noise, structure, flux);
}

/* Methods of total variation go on until their volume stands still, and know what they miss of the
 * views. What others leave of them may be what the next iterations would explain. */
static int knows_misfit(const struct v2v_volumes_made *made)
{
    return made->ops->inherit != NULL;
}

static const char *first_doubt(const struct v2v_volumes_made *made)
{
    return knows_misfit(made) ? "" : "did it iterate or train enough; ";
}

/* The view that is explained worst, by so much that it may not be its PSF's; -1: none is. */
static int64_t least_explained(const struct found *found)
{
    double most = much_of_one;
    int64_t worst = -1, better = 0;
    for (int64_t v = 0; v < found->views; v++) {
        const double missed = v2v_structure_missed(&found->of_view[v].structure);
        worst = missed > most ? v : worst;
        most = fmax(most, missed);
    }
    for (int64_t v = 0; v < found->views; v++) {
        better += v2v_structure_missed(&found->of_view[v].structure) * times_others < most;
    }
    return 2 * better > found->views ? worst : -1;
}

static void warn_of_misfit(const struct found *found, const struct v2v_volumes_made *made)
{
    const char *doubt = first_doubt(made);
    const int64_t worst = knows_misfit(made) ? least_explained(found) : -1;
    double squares = 0.0, known = 0.0, most = 0.0;
    int64_t farthest = 0;
    for (int64_t v = 0; v < found->views; v++) {
        if (isfinite(found->displaced[v])) {
            squares += found->displaced[v] * found->displaced[v];
            known += 1.0;
            farthest = found->displaced[v] > most ? v : farthest;
            most = fmax(most, found->displaced[v]);
        }
    }
    if (squares > displaced * displaced * known) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: the views lie %.1f pixels from where the volume has them, view %lld "
                "%.1f: %sare they those of these PSFs, in their order, not mirrored, in register "
                "(v2v3d calibrate)?",
                (long long)found->frame, sqrt(squares / known), number_of(found, farthest), most,
                doubt);
    } else if (v2v_structure_missed(&found->match.structure) > much_missed) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: the volume leaves much of the views unexplained: %sdo they belong to "
                "these PSFs, in their order, and in register (v2v3d calibrate)?",
                (long long)found->frame, doubt);
    } else if (worst >= 0) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: the volume leaves more of view %lld unexplained than of the others: "
                "is it that of its PSF, or in the place of a neighbour?",
                (long long)found->frame, number_of(found, worst));
    }
}

/* Light is not below zero, noise is: what is left of it in the dark is above. So is light that
 * iterations of a given number may have left too much of. A network's volumes have the light that
 * it was taught. */
static void warn_of_light(const struct found *found, const struct v2v_volumes_made *made,
                          const struct v2v_session *session)
{
    const double flux = v2v_match_flux(&found->match);
    const int is_bright = flux > V2V_MATCH_MUCH_LIGHT;
    if (!found->is_seen) {
        return;
    }
    if (made->ops->has_gain && (is_bright || flux < 1.0 / V2V_MATCH_MUCH_LIGHT)) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: the volume has %.3g times the light of its views: %sis psf.reduce "
                "what the network was trained with?",
                (long long)found->frame, flux, first_doubt(made));
    } else if (knows_misfit(made) && session->config.deconv.iterations == 0 && is_bright) {
        v2v_log(
            V2V_LOG_WARNING,
            "frame %lld: the volume has %.3g times the light of its views, by noise where it is "
            "dark; more weight of the variation (--lambda) leaves less of that",
            (long long)found->frame, flux);
    }
}

static void warn_of_odd_view(const struct found *found, const struct v2v_volumes_made *made)
{
    double times = 0.0;
    const int64_t odd = v2v_match_odd_view(&times, found->of_view, found->views);
    if (odd >= 0) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: view %lld is %.2f times as bright as the volume has it, beside the "
                "other views: %swas it blocked, or is its gain another (v2v3d calibrate)?",
                (long long)found->frame, number_of(found, odd), times, first_doubt(made));
    }
}

/* Where fields of a calibration make other values of them, no method knows that they are the least
 * that the light may be. */
static void warn_of_saturation(const struct found *found, const struct v2v_volumes_made *made)
{
    const struct v2v_calibration *calibration = made->scaling->calibration;
    const int is_light = calibration != NULL && v2v_calibration_has_fields(calibration);
    if (found->saturated > V2V_MUCH_SATURATED) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: %.2g %% of the views' pixels are saturated: how bright the volume is "
                "there they don't tell%s",
                (long long)found->frame, 100.0 * found->saturated,
                is_light ? ", and with the calibration's shading or distortion they count as they "
                           "are: the volume is darker than the scene"
                         : "");
    }
}

/* Of the noise that the camera's data sheet gives; by the right one 0.96 to 1.03 is missed. */
static const double too_little_missed = 0.8;

static void warn_of_camera(const struct found *found, const struct v2v_volumes_made *made,
                           const struct v2v_session *session)
{
    const struct v2v_number *electrons = &session->config.deconv.electrons_per_count;
    const double missed = made->misfit[found->shown].missed;
    if (electrons->mode == V2V_NUMBER_GIVEN && missed > 0.0 && missed < too_little_missed) {
        v2v_log(V2V_LOG_WARNING,
                "frame %lld: views and volume differ by %.2g of the camera's noise, which is more "
                "than there is: are --electrons-per-count and --read-noise of these counts?",
                (long long)found->frame, missed);
    }
}

static void warn_of_darkness(const struct found *found, const struct v2v_recording_info *info)
{
    if (!found->is_seen && v2v_structure_can_be_seen(info->height, info->width)) {
        v2v_log(
            V2V_LOG_WARNING,
            "no frame of %lld shows anything above its noise in means of 8 x 8 pixels: what the "
            "volumes show may be of noise alone",
            (long long)info->frames);
    }
}

/* Collective. */
static enum v2v_status report(struct found *found, const struct v2v_volumes_made *made,
                              const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    int is_zero_odd = 0;
    const struct v2v_recording_info *info = v2v_recording_info(made->recording);
    V2V_TRY(match_frame(found, made, session));
    if (v2v_step_on_root(session)) { /* all ranks know it */
        tell_of_blind(found, made);
        log_match(&found->match, found->frame);
        warn_of_light(found, made, session);
        warn_of_odd_view(found, made);
        warn_of_misfit(found, made);
        warn_of_saturation(found, made);
        warn_of_camera(found, made, session);
        warn_of_darkness(found, info);
    }
    V2V_TRY(v2v_volumes_judge_offset(&is_zero_odd, found->recorded, found->shown, made, session));
    if (found->is_seen) { /* on all ranks alike */
        v2v_blind_fill(found->recorded, found->views, info->height * info->width);
        V2V_TRY(
            v2v_volumes_judge_frames(found->recorded, found->shown, !is_zero_odd, made, session));
    }
done:
    return rc;
}

void v2v_volumes_report_quality(const struct v2v_volumes_made *made,
                                const struct v2v_session *session)
{
    struct found found = {.views = made->psf->views,
                          .without = session->config.input.without_views};
    if (report(&found, made, session) != V2V_OK && v2v_step_on_root(session)) {
        v2v_log(V2V_LOG_WARNING, "quality not known: %s", v2v_status_message());
    }
    v2v_mem_free(found.recorded);
    v2v_mem_free(found.projected);
    v2v_mem_free(found.displaced);
    v2v_mem_free(found.of_view);
}
