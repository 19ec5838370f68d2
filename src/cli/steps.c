#include "cli/steps.h"

#include "cli/threads.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/file_sum.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/optics/calibration.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/optics/psf_figures.h"
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

int v2v_step_on_root(const struct v2v_session *session)
{
    return v2v_comm_rank(session->world) == 0;
}

const char *v2v_step_message(void)
{
    static const char main_rank[] = "rank 0: ";
    const char *message = v2v_status_message();
    return message + (strncmp(message, main_rank, strlen(main_rank)) == 0 ? strlen(main_rank) : 0);
}

/* Frames that an interrupted run finished are not thrown away unasked. Rank-0. */
static enum v2v_status check_left(const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume_left left;
    V2V_TRY(v2v_volume_left(&left, path, NULL));
    if (left.done == 0) {
        return V2V_OK;
    }
    V2V_TRY(v2v_file_check_idle(path));
    rc = V2V_FAIL(V2V_E_USAGE,
                  "%s: an interrupted run left %" PRId64 " of %" PRId64
                  " frames; its command goes on with --resume, --force discards them",
                  path, left.done, left.frames);
done:
    return rc;
}

/* Rank-0. @param settings the file of them, or NULL: an input, too */
static enum v2v_status check_output(const char *path, const char *const *inputs, int64_t count,
                                    const char *settings, int is_replaced)
{
    enum v2v_status rc = V2V_OK;
    const char **given = NULL;
    int64_t n = 0;
    V2V_TRY(V2V_ALLOC(given, "cli.inputs", count + 1));
    for (int64_t i = 0; i < count; i++) {
        if (inputs[i] != NULL) {
            given[n++] = inputs[i];
        }
    }
    if (settings != NULL) {
        given[n++] = settings;
    }
    V2V_TRY(v2v_file_check_output(path, is_replaced, given, n));
    if (!is_replaced) {
        V2V_TRY(check_left(path));
    }
done:
    v2v_mem_free(given);
    return rc;
}

enum v2v_status v2v_step_output(const struct v2v_session *session, const char *path,
                                const char *const *inputs, int64_t count)
{
    return v2v_step_output_or_resume(session, path, inputs, count, 0);
}

enum v2v_status v2v_step_output_or_resume(const struct v2v_session *session, const char *path,
                                          const char *const *inputs, int64_t count, int resume)
{
    return v2v_par_agree(
        session->world,
        v2v_step_on_root(session)
            ? check_output(path, inputs, count, session->common->config, session->force || resume)
            : V2V_OK);
}

/* The number that `text` begins with, up to `end`. */
static enum v2v_status number_before(int64_t *number, const char *text, char end, int64_t least,
                                     int64_t most, const char *what)
{
    enum v2v_status rc = V2V_OK;
    char first[32];
    const size_t bytes = (size_t)(strchrnul(text, end) - text);
    if (bytes >= sizeof first) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s: '%.40s' is too long for a number", what, text));
    }
    memcpy(first, text, bytes);
    first[bytes] = '\0';
    V2V_TRY(v2v_text_to_i64(number, first, least, most, what, V2V_E_USAGE));
done:
    return rc;
}

enum v2v_status v2v_step_frames(struct v2v_part *frames, const char *text)
{
    enum v2v_status rc = V2V_OK;
    static const char what[] = "--frames FIRST:COUNT";
    *frames = (struct v2v_part){0, INT64_MAX};
    if (text != NULL) {
        const char *colon = strchr(text, ':');
        if (colon == NULL) {
            V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s: '%s' is none such as %s:1", what, text, text));
        }
        V2V_TRY(number_before(&frames->first, text, ':', 0, INT64_MAX, what));
        V2V_TRY(v2v_text_to_i64(&frames->count, colon + 1, 1, INT64_MAX, what, V2V_E_USAGE));
    }
done:
    return rc;
}

enum v2v_status v2v_step_calibration(struct v2v_session *session, const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_calibration *calibration = &session->calibration;
    struct v2v_calibration header = {0};
    if (path == NULL) {
        return V2V_OK;
    }
    if (v2v_step_on_root(session)) {
        rc = v2v_calibration_read(calibration, path);
        if (rc == V2V_OK) {
            rc = v2v_calibration_leave(calibration, session->config.input.without_views, path);
        }
        header = *calibration;
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_par_broadcast(session->world, &header, (int64_t)sizeof header, 0);
    if (!v2v_step_on_root(session)) {
        rc = v2v_calibration_init(calibration, header.views, header.height, header.width);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_par_broadcast(session->world, calibration->view,
                      calibration->views * (int64_t)sizeof *calibration->view, 0);
    v2v_par_broadcast(session->world, calibration->number,
                      calibration->views * (int64_t)sizeof *calibration->number, 0);
done:
    return rc;
}

enum v2v_status v2v_step_psf(const struct v2v_session *session, struct v2v_psf_file *psf,
                             const char *path)
{
    enum v2v_status rc = V2V_OK;
    const char *without = session->config.input.without_views;
    V2V_TRY(v2v_psf_read(psf, path, without, session->config.psf.normalize, session->world));
    if (without[0] != '\0' && v2v_step_on_root(session)) {
        v2v_log(V2V_LOG_INFO, "%s: %" PRId64 " views, without %s", path, psf->views, without);
    }
    const double pedestal = v2v_step_on_root(session) ? v2v_psf_pedestal(psf) : 0.0;
    if (pedestal > 0.0) {
        v2v_log(V2V_LOG_WARNING,
                "%s: %.2g of the PSFs' light is a constant background, which spoils volumes: "
                "subtract it",
                path, pedestal);
    }
    if (session->calibration.views > 0) {
        rc = v2v_calibration_apply_to_psf(psf, &session->calibration);
        if (rc == V2V_E_INPUT) {
            rc = V2V_FAIL(rc, "%s: %s", path, v2v_status_message());
        }
        V2V_TRY(v2v_par_agree(session->world, rc));
    }
done:
    return rc;
}

enum v2v_status v2v_step_recording(const struct v2v_session *session,
                                   struct v2v_recording **recording, const char *path,
                                   const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_input_settings settings = session->config.input;
    if (settings.views == 0) {
        settings.views =
            psf->views > 0 ? psf->views + v2v_text_count_listed(settings.without_views) : 0;
    }
    V2V_TRY(v2v_recording_open(recording, path, &settings, session->world));
    const struct v2v_recording_info *info = v2v_recording_info(*recording);
    if (info->is_one_row) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE,
                         "%s: --views V is missing: nothing tells the views of a frame", path));
    }
    const int64_t views = info->views;
    if (psf->views > 0 && views != psf->views) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %" PRId64 " views a frame, but the PSFs have %" PRId64,
                         path, views, psf->views));
    }
    if (v2v_file_is_other_size(info->pixel_size_um, psf->pixel_size_um)) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: says pixels of %g um, but the PSFs are for %g um; if they are the "
                         "same, --pixel-size %g says so",
                         path, info->pixel_size_um, psf->pixel_size_um, psf->pixel_size_um));
    }
    if (psf->data != NULL && settings.hot_pixels == V2V_HOT_PIXELS_MEND) {
        V2V_TRY(
            v2v_par_agree(session->world, v2v_recording_mend(*recording, v2v_psf_sharpness(psf))));
    }
    if (session->calibration.views > 0) {
        V2V_TRY(v2v_par_agree(session->world,
                              v2v_recording_calibrate(*recording, &session->calibration)));
    }
done:
    return rc;
}

enum v2v_status v2v_step_volume(const struct v2v_session *session, struct v2v_volume **volume,
                                const char *path, const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_volume_open(volume, path, &session->config.input, session->world));
    int64_t slices = v2v_volume_info(*volume)->slices;
    if (slices != psf->slices) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %" PRId64 " slices, but the PSFs have %" PRId64 "%s",
                         path, slices, psf->slices,
                         slices % psf->slices == 0 ? "; --slices Z tells frames apart" : ""));
    }
    const struct v2v_volume_info *info = v2v_volume_info(*volume);
    const struct {
        const char *name;
        double of_volume, of_psf;
    } sizes[] = {{"pixels of", info->pixel_size_um, psf->pixel_size_um},
                 {"slices every", info->slice_spacing_um, psf->slice_spacing_um}};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        if (v2v_file_is_other_size(sizes[i].of_volume, sizes[i].of_psf) &&
            v2v_step_on_root(session)) {
            v2v_log(V2V_LOG_WARNING,
                    "%s: says %s %g um, but the PSFs are for %g um, which it is taken for", path,
                    sizes[i].name, sizes[i].of_volume, sizes[i].of_psf);
        }
    }
done:
    return rc;
}

static enum v2v_status read_weights_info(const struct v2v_session *session,
                                         struct v2v_weights_info *info,
                                         const struct v2v_network_ops **ops, const char *path)
{
    enum v2v_status rc = v2v_weights_file_info(info, path);
    if (rc == V2V_OK) {
        rc = v2v_network_of_weights(ops, info, path);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    V2V_TRY(v2v_file_agree(path, session->world));
done:
    return rc;
}

/* Does a setting of the weights go before one that was given: on the command line, or in a file
 * where it isn't the default? Then rank 0 says so. Local. */
static enum v2v_status compare_setting(const struct v2v_session *session, const char *key,
                                       const struct v2v_config *before, const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_config defaults;
    char given[V2V_CONFIG_TEXT_BYTES], usual[V2V_CONFIG_TEXT_BYTES], taken[V2V_CONFIG_TEXT_BYTES];
    v2v_config_defaults(&defaults);
    V2V_TRY(v2v_config_get(given, sizeof given, before, key));
    V2V_TRY(v2v_config_get(usual, sizeof usual, &defaults, key));
    V2V_TRY(v2v_config_get(taken, sizeof taken, &session->config, key));
    const int is_given = strcmp(given, usual) != 0 || v2v_options_set(session->common, key);
    if (is_given && strcmp(given, taken) != 0 && v2v_step_on_root(session)) {
        v2v_log(V2V_LOG_WARNING, "%s: its network is made for %s=%s, which is taken, not %s", path,
                key, taken, given);
    }
done:
    return rc;
}

enum psfs { NOT_KNOWN, THE_SAME, OTHERS }; /* as those of the training */

/* The weights that were chosen for the PSFs of the training, of variation and volume together, are
 * none for others: they stay as they are given here, or are to be chosen. */
static enum v2v_status adopt(struct v2v_session *session, const struct v2v_weights_info *info,
                             const struct v2v_network_ops *ops, const char *path, enum psfs psfs)
{
    static const char variation[] = "deconv.lambda";
    enum v2v_status rc = V2V_OK;
    const struct v2v_config before = session->config;
    struct v2v_number *lambda = &session->config.deconv.lambda;
    V2V_TRY(v2v_network_adopt(&session->config, info, path));
    V2V_TRY(compare_setting(session, "model.method", &before, path));
    for (int i = 0; ops->keys[i] != NULL; i++) {
        const int is_chosen =
            strcmp(ops->keys[i], variation) == 0 && lambda->mode == V2V_NUMBER_GIVEN;
        if (is_chosen && psfs == OTHERS && v2v_step_on_root(session)) {
            v2v_log(V2V_LOG_INFO,
                    "%s: was trained with other PSFs, or another calibration of them: its %s is "
                    "not taken over",
                    path, variation);
        }
        if (is_chosen && psfs != THE_SAME) {
            *lambda = before.deconv.lambda;
            session->config.deconv.sparsity = before.deconv.sparsity;
        }
        V2V_TRY(compare_setting(session, ops->keys[i], &before, path));
    }
done:
    return rc;
}

enum v2v_status v2v_step_adopt(struct v2v_session *session, const struct v2v_weights_info *info,
                               const struct v2v_network_ops *ops, const char *path)
{
    return adopt(session, info, ops, path, THE_SAME);
}

enum v2v_status v2v_step_network(struct v2v_session *session, const struct v2v_network_ops **ops,
                                 const char *path, int of_views)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_weights_info info;
    V2V_TRY(read_weights_info(session, &info, ops, path));
    if (((*ops)->traits & V2V_TRAIT_VIEWS) != 0 && !of_views) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: the network '%s' makes views (v2v3d denoise), no volume",
                         path, (*ops)->name));
    }
    if (!((*ops)->traits & V2V_TRAIT_VIEWS) && of_views) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: the network '%s' makes volumes (v2v3d reconstruct), no views", path,
                         (*ops)->name));
    }
    V2V_TRY(adopt(session, &info, *ops, path, NOT_KNOWN));
done:
    return rc;
}

enum v2v_status v2v_step_weights_info(struct v2v_session *session, struct v2v_weights_info *info,
                                      const char *path, const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_network_ops *ops = NULL;
    V2V_TRY(read_weights_info(session, info, &ops, path));
    const int is_any = (ops->traits & V2V_TRAIT_ANY) != 0;
    if (!is_any && psf->views > 0 && (info->views != psf->views || info->slices != psf->slices)) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: made for %" PRId64 " views and %" PRId64
                         " slices, but the PSFs have %" PRId64 " and %" PRId64,
                         path, info->views, info->slices, psf->views, psf->slices));
    }
    const int is_elsewhere = psf->views > 0 && !v2v_weights_suit(info, v2v_psf_file_sum(psf));
    if (!is_any && v2v_step_on_root(session) && is_elsewhere) {
        v2v_log(V2V_LOG_WARNING,
                "%s: its network was trained with other PSFs than these, or with these calibrated "
                "or normalised otherwise: volumes are wrong where that matters",
                path);
    }
    V2V_TRY(adopt(session, info, ops, path, is_elsewhere ? OTHERS : THE_SAME));
done:
    return rc;
}

enum v2v_status v2v_step_offset(const struct v2v_session *session, struct v2v_scaling *scaling,
                                struct v2v_recording *recording)
{
    struct v2v_input_settings settings = session->config.input;
    settings.gain = (struct v2v_number){.mode = V2V_NUMBER_NONE};
    return v2v_scaling_decide(scaling, recording, &settings, session->world);
}

void v2v_step_announce(const struct v2v_session *session)
{
    char waiting[64];
    v2v_cli_waiting(waiting, sizeof waiting);
    v2v_log(V2V_LOG_INFO, "%d ranks x %d threads%s%s", v2v_comm_size(session->world),
            session->threads, session->threads > 1 ? ", " : "",
            session->threads > 1 ? waiting : "");
}

void v2v_step_communication(const struct v2v_session *session, const struct v2v_par_time *began)
{
    struct v2v_par_shares shares = v2v_par_shares_since(session->world, began);
    v2v_par_log_shares(session->world, &shares);
}

/* The first figure, or the second where that is not stated. */
static double stated(double one, double other)
{
    return one > 0.0 ? one : other;
}

struct v2v_volume_info v2v_step_volume_of(const struct v2v_session *session,
                                          const struct v2v_recording_info *recording,
                                          const struct v2v_psf_file *psf)
{
    return (struct v2v_volume_info){
        .frames = recording->frames,
        .slices = psf->slices,
        .height = recording->height,
        .width = recording->width,
        .pixel_size_um = stated(recording->pixel_size_um, psf->pixel_size_um),
        .slice_spacing_um = stated(session->config.input.slice_spacing_um, psf->slice_spacing_um),
        .frame_interval_s = recording->frame_interval_s};
}

struct v2v_recording_info v2v_step_recording_of(const struct v2v_volume_info *volume,
                                                const struct v2v_psf_file *psf)
{
    return (struct v2v_recording_info){.frames = volume->frames,
                                       .views = psf->views,
                                       .height = volume->height,
                                       .width = volume->width,
                                       .pixel_size_um =
                                           stated(psf->pixel_size_um, volume->pixel_size_um),
                                       .frame_interval_s = volume->frame_interval_s};
}

static enum v2v_status parse_size(int64_t *height, int64_t *width, const char *size)
{
    enum v2v_status rc = V2V_OK;
    static const char what[] = "--size HxW";
    const int64_t most = 65536;
    const char *x = strchr(size, 'x');
    V2V_TRY(number_before(height, size, 'x', 1, most, what));
    V2V_TRY(v2v_text_to_i64(width, x != NULL ? x + 1 : size, 1, most, what, V2V_E_USAGE));
done:
    return rc;
}

enum v2v_status v2v_step_scene(struct v2v_scene *scene, struct v2v_simulation *simulation,
                               const struct v2v_session *session, const struct v2v_psf_file *psf,
                               const char *size)
{
    const struct v2v_input_settings *told = &session->config.input;
    simulation->pixel_size_um = stated(told->pixel_size_um, psf->pixel_size_um);
    simulation->slice_spacing_um = stated(told->slice_spacing_um, psf->slice_spacing_um);
    simulation->frame_interval_s = told->frame_interval_s;
    scene->slices = psf->slices;
    scene->pixel_um = stated(simulation->pixel_size_um, 1.0);
    scene->slice_um = stated(simulation->slice_spacing_um, 1.0);
    return parse_size(&scene->height, &scene->width, size != NULL ? size : "512");
}

enum v2v_status v2v_step_write_slices(const struct v2v_session *session,
                                      struct v2v_volume_writer *writer, const float *slices,
                                      int64_t t, struct v2v_part mine)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_volume_write(writer, V2V_VOLUME_MEAN, slices, t, mine.first, mine.count));
    V2V_TRY(v2v_volume_mark_done(writer, t, session->world));
done:
    return rc;
}
