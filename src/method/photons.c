#include "method/photons.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>

/* Samples that are brighter than `bright`. */
static const double brighter_part = 1e-3;

/* The variance is four times as large in the light as in the dark: below, weights by it gained
 * nothing. It grows by five times what its growth is known to. What grows is white: else it isn't
 * noise. And so many samples are brighter than the percentile: else it may be a hot pixel. */
static const double least_contrast = 3.0, least_certain = 5.0, most_colour = 2.0,
                    least_brighter = 4.0;

struct v2v_camera v2v_camera_of(const struct v2v_config *config)
{
    const struct v2v_number *electrons = &config->deconv.electrons_per_count;
    const struct v2v_number *read = &config->deconv.read_noise;
    struct v2v_camera camera = {0.0, -1.0};
    if (electrons->mode == V2V_NUMBER_GIVEN) {
        camera.gain = 1.0 / electrons->value;
        if (read->mode == V2V_NUMBER_GIVEN) {
            camera.variance = read->value * read->value * camera.gain * camera.gain;
        }
    }
    return camera;
}

enum v2v_status v2v_camera_check(const struct v2v_problem *problem)
{
    const struct v2v_deconv_settings *deconv = &problem->config->deconv;
    if (deconv->electrons_per_count.mode != V2V_NUMBER_GIVEN) {
        return deconv->read_noise.mode != V2V_NUMBER_GIVEN
                   ? V2V_OK
                   : V2V_FAIL(V2V_E_CONFIG, "deconv.read_noise is in electrons: it wants "
                                            "deconv.electrons_per_count");
    }
    if (deconv->noise == V2V_NOISE_MODEL_GAUSSIAN) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "deconv.electrons_per_count is of the noise of photons, which "
                        "deconv.noise gaussian leaves out");
    }
    if (problem->config->recon.neighbours > 0 || problem->skip > 0.0) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "deconv.electrons_per_count is of single frames, which %s averages",
                        problem->skip > 0.0 ? "recon.skip" : "recon.neighbours");
    }
    return V2V_OK;
}

double v2v_photons_bright(float *scratch, const float *views, int64_t samples)
{
    const int64_t seen = v2v_blind_gather_seen(scratch, views, samples);
    const double brighter = (double)seen * brighter_part;
    return seen > 0 ? (double)v2v_select(scratch, seen, seen - 1 - (int64_t)brighter) : 0.0;
}

struct v2v_photons v2v_photons_find(float *scratch, const float *views, int64_t count,
                                    int64_t height, int64_t width, const struct v2v_camera *camera)
{
    const int64_t samples = count * height * width;
    const double brighter = (double)(samples - v2v_blind_count(views, samples)) * brighter_part;
    const int is_known = camera != NULL && camera->gain > 0.0;
    struct v2v_photons found = {.bright = v2v_photons_bright(scratch, views, samples)};
    if (found.bright > 0.0) {
        const struct v2v_noise_line line =
            v2v_noise_line_of_images(views, count, height, width, found.bright);
        found.gain = is_known ? camera->gain : line.gain;
        found.variance =
            is_known && camera->variance >= 0.0 ? camera->variance : fmax(line.variance, 0.0);
        found.is_clear = is_known || (line.gain * found.bright > least_contrast * found.variance &&
                                      line.gain > least_certain * line.gain_error &&
                                      line.colour < most_colour && brighter >= least_brighter);
    }
    return found;
}

struct v2v_photons v2v_photons_averaged(float *scratch, const float *views, int64_t samples,
                                        const struct v2v_averaging *averaging)
{
    return (struct v2v_photons){.bright = v2v_photons_bright(scratch, views, samples),
                                .gain = averaging->gain,
                                .variance = averaging->variance,
                                .is_clear = averaging->is_of_photons};
}

enum v2v_status v2v_photons_settle(struct v2v_config *config, const struct v2v_problem *problem,
                                   const float *views, const struct v2v_averaging *averaging)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_camera camera = v2v_camera_of(config);
    const int64_t count = problem->psf->views;
    float *scratch = NULL;
    if (config->deconv.noise != V2V_NOISE_MODEL_AUTO) {
        return V2V_OK;
    }
    V2V_TRY(V2V_ALLOC(scratch, "photons.settle",
                      v2v_mem_product(count, problem->height, problem->width)));
    const struct v2v_photons found =
        averaging != NULL
            ? v2v_photons_averaged(scratch, views, count * problem->height * problem->width,
                                   averaging)
            : v2v_photons_find(scratch, views, count, problem->height, problem->width, &camera);
    const int is_known = camera.gain > 0.0; /* whether or not the frame has light */
    const int is_of_photons = is_known || found.is_clear;
    config->deconv.noise = is_of_photons ? V2V_NOISE_MODEL_POISSON : V2V_NOISE_MODEL_GAUSSIAN;
    if (is_of_photons) {
        v2v_log(V2V_LOG_DEBUG, "noise poisson, by a frame: %.3g counts an electron%s",
                is_known ? camera.gain : found.gain, is_known ? ", as given" : "");
    } else {
        v2v_log(V2V_LOG_DEBUG, "noise gaussian, by a frame: it shows no photons");
    }
done:
    v2v_mem_free(scratch);
    return rc;
}
