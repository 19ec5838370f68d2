#include "cli/steps.h"

#include "v2v3d/base/text.h"
#include "v2v3d/io/json.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/optics/psf_fit.h"
#include "v2v3d/par/agreement.h"
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>

struct arguments {
    struct v2v_common common;
    const char *psf, *output;
    struct v2v_words modes;
    int json;
};

static const struct v2v_option options[] = {
    V2V_OPTION_PSF(struct arguments, psf, 1),
    V2V_OPTION_OUTPUT(struct arguments, output, "section optics to write, YAML"),
    {.name = "modes",
     .kind = V2V_OPTION_LIST,
     .at = offsetof(struct arguments, modes),
     .value = "J..",
     .help = "aberrations to fit too, by Noll's index: 4 5 6 .."},
    V2V_OPTION_SWITCH(struct arguments, json, "json", "one JSON object instead of text"),
    {0}};

/* The set as it is. */
static const char *const preset[] = {"psf.normalize=none", NULL};

/* The set, the model fitted to it, and how near they are. */
struct fitted {
    const struct arguments *given;
    struct v2v_config *config;
    struct v2v_psf_file psf, model;
    struct v2v_psf_likeness likeness;
    double least, farthest; /* correlation, distance of centroids, of any view */
};

static enum v2v_status read_modes(int64_t *modes, const struct v2v_words *words)
{
    enum v2v_status rc = V2V_OK;
    if (words->count > V2V_ZERNIKE_MOST) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--modes: %" PRId64 " aberrations, %d are the most",
                         (int64_t)words->count, V2V_ZERNIKE_MOST));
    }
    for (int64_t i = 0; i < words->count; i++) {
        V2V_TRY(v2v_text_to_i64(&modes[i], words->item[i], 2, V2V_ZERNIKE_MOST, "--modes",
                                V2V_E_USAGE));
    }
done:
    return rc;
}

/* The work of rank 0. */
static enum v2v_status fit(void *context)
{
    enum v2v_status rc = V2V_OK;
    struct fitted *fitted = context;
    struct v2v_optics_settings *optics = &fitted->config->optics;
    int64_t modes[V2V_ZERNIKE_MOST];
    V2V_TRY(read_modes(modes, &fitted->given->modes));
    V2V_TRY(v2v_psf_fit(optics, &fitted->psf, modes, fitted->given->modes.count));
    V2V_TRY(v2v_psf_simulate(&fitted->model, optics));
    V2V_TRY(v2v_psf_compare(&fitted->likeness, &fitted->model, &fitted->psf));
    fitted->least = 1;
    for (int64_t v = 0; v < fitted->psf.views; v++) {
        fitted->least = fmin(fitted->least, fitted->likeness.correlation[v]);
        fitted->farthest = fmax(fitted->farthest, fitted->likeness.centroid[v]);
    }
done:
    return rc;
}

static enum v2v_status write_section(const struct v2v_config *config, const char *path)
{
    enum v2v_status rc = V2V_OK;
    char *text = NULL;
    V2V_TRY(v2v_config_text(&text, config, "optics", 0));
    V2V_TRY(v2v_file_write_text(path, text));
done:
    free(text);
    return rc;
}

static enum v2v_status print_json(const struct fitted *fitted, const struct v2v_config *config)
{
    const struct v2v_optics_settings *optics = &config->optics;
    const struct v2v_json_item items[] = {
        v2v_json_number("least_correlation", fitted->least),
        v2v_json_number("largest_centroid_distance", fitted->farthest),
        {.name = "correlation",
         .values = fitted->likeness.correlation,
         .count = fitted->likeness.views},
        {.name = "centroid_distance",
         .values = fitted->likeness.centroid,
         .count = fitted->likeness.views},
        v2v_json_number("pixel_size_um", optics->pixel_size_um),
        v2v_json_number("slice_spacing_um", optics->slice_spacing_um),
        v2v_json_number("needle_aperture", optics->needle_aperture),
        v2v_json_number("pinhole_um", optics->pinhole_um),
        v2v_json_number("pinhole_defocus_um", optics->pinhole_defocus_um),
        v2v_json_number("focus_slice", optics->focus_slice),
        {.name = "tilts", .text = optics->tilts},
        {.name = "zernike", .text = optics->zernike}};
    return v2v_json_print(stdout, items, sizeof items / sizeof *items);
}

static void print_text(const struct fitted *fitted, const struct v2v_config *config)
{
    printf("view  correlation  largest distance of centroids, pixels\n");
    for (int64_t v = 0; v < fitted->likeness.views; v++) {
        printf("%4" PRId64 "  %11.6f  %.3f\n", v, fitted->likeness.correlation[v],
               fitted->likeness.centroid[v]);
    }
    printf("pixels of %.5g um, slices of %.5g um, sub-aperture %.5g, pinhole %.5g um and %.5g um "
           "out of focus, focus %.4g slices from the middle one\n",
           config->optics.pixel_size_um, config->optics.slice_spacing_um,
           config->optics.needle_aperture, config->optics.pinhole_um,
           config->optics.pinhole_defocus_um, config->optics.focus_slice);
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct fitted fitted = {.given = given, .config = &session->config};
    V2V_TRY(v2v_step_output(session, given->output, &given->psf, 1));
    V2V_TRY(v2v_step_psf(session, &fitted.psf, given->psf));
    V2V_TRY(v2v_agreement_alone(session->world, fit, &fitted));
    if (v2v_step_on_root(session)) {
        rc = write_section(&session->config, given->output);
        if (rc == V2V_OK && given->json) {
            rc = print_json(&fitted, &session->config);
        } else if (rc == V2V_OK) {
            print_text(&fitted, &session->config);
        }
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
done:
    v2v_psf_likeness_fini(&fitted.likeness);
    v2v_psf_file_fini(&fitted.model);
    v2v_psf_file_fini(&fitted.psf);
    return rc;
}

const struct v2v_command v2v_command_psf_fit = {
    .name = "psf fit",
    .summary = "settings of psf simulate (section optics) that give a PSF set",
    .options = options,
    .bytes = sizeof(struct arguments),
    .preset = preset,
    .run = run};
