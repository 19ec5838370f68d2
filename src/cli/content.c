#include "cli/content.h"

#include "cli/steps.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/arrays.h"
#include "v2v3d/io/bdv.h"
#include "v2v3d/io/tiff.h"
#include "v2v3d/method/weights.h"

static enum v2v_status open_weights(const char *path, const struct v2v_session *session)
{
    struct v2v_weights_info info;
    enum v2v_status rc = V2V_OK;
    if (v2v_step_on_root(session)) {
        rc = v2v_weights_file_info(&info, path);
    }
    return v2v_par_agree(session->world, rc);
}

/* Of other programs: names alone tell. */
static enum v2v_status open_arrays(const char *path, const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    if (v2v_step_on_root(session) && v2v_weights_method(path, &session->config) == NULL) {
        rc = V2V_FAIL(V2V_E_INPUT, "%s: has no array of a network", path);
    }
    return v2v_par_agree(session->world, rc);
}

static enum v2v_status open_volume(const char *path, const struct v2v_session *session)
{
    struct v2v_volume *volume = NULL;
    enum v2v_status rc = v2v_volume_open(&volume, path, &session->config.input, session->world);
    v2v_volume_close(&volume);
    return rc;
}

static enum v2v_status open_recording(const char *path, const struct v2v_session *session)
{
    struct v2v_recording *recording = NULL;
    enum v2v_status rc =
        v2v_recording_open(&recording, path, &session->config.input, session->world);
    v2v_recording_close(&recording);
    return rc;
}

static enum v2v_status open_psf(const char *path, const struct v2v_session *session)
{
    struct v2v_psf_file psf = {0};
    enum v2v_status rc =
        v2v_psf_file_read(&psf, path, session->config.input.without_views, session->world);
    v2v_psf_file_fini(&psf);
    return rc;
}

static const struct {
    enum v2v_content content;
    enum v2v_status (*open)(const char *path, const struct v2v_session *session);
    const char *name; /* what HDF5 has of it */
} kinds[] = {{V2V_CONTENT_VOLUME, open_volume, "volume"},
             {V2V_CONTENT_RECORDING, open_recording, "views"},
             {V2V_CONTENT_WEIGHTS, open_weights, "weights"},
             {V2V_CONTENT_PSF, open_psf, "psf"},
             {V2V_CONTENT_WEIGHTS, open_arrays, NULL}};
enum { KINDS = sizeof kinds / sizeof kinds[0] };

/* Folders of trainings begin with their settings. */
static int is_run(const char *folder)
{
    char path[V2V_PATH_BYTES];
    return v2v_text_format(path, sizeof path, "%s/config.yaml", folder) == V2V_OK &&
           v2v_file_exists(path);
}

/* Rank 0: what the first bytes and the file system say. */
static enum v2v_status look(enum v2v_content *content, const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff *tiff = NULL;
    char data[V2V_PATH_BYTES];
    if (v2v_file_is_folder(path)) {
        *content = v2v_psf_file_is_folder(path) ? V2V_CONTENT_PSF
                   : is_run(path)               ? V2V_CONTENT_RUN
                                                : V2V_CONTENT_RECORDING;
        return V2V_OK;
    }
    V2V_TRY(v2v_file_check_input(path));
    if (v2v_bdv_is_name(path) && v2v_bdv_data_name(data, path) == V2V_OK && v2v_file_exists(data)) {
        V2V_TRY(
            V2V_FAIL(V2V_E_INPUT,
                     "%s: is for BigDataViewer and not read; the voxels that it shows are in %s",
                     path, data));
    }
    const int is_yaml = v2v_file_kind_of_name(path) == V2V_FILE_YAML;
    if (is_yaml || v2v_file_is_safetensors(path)) {
        *content = is_yaml ? V2V_CONTENT_YAML : V2V_CONTENT_WEIGHTS;
        return V2V_OK;
    }
    if (!v2v_file_is_hdf5(path)) {
        V2V_TRY(v2v_tiff_open(&tiff, path));
        *content = V2V_CONTENT_TIFF;
    }
done:
    v2v_tiff_close(&tiff);
    return rc;
}

/* Why an HDF5 file is none of the kinds. Rank-0. */
static enum v2v_status refuse(const char *path)
{
    enum v2v_status rc = V2V_OK;
    char names[V2V_MESSAGE_BYTES / 2];
    V2V_TRY(v2v_file_hdf5_names(names, sizeof names, path));
    rc = V2V_FAIL(V2V_E_INPUT,
                  "%s: HDF5 without a readable /volume, /views, /weights or /psf; it %s", path,
                  names);
done:
    return rc;
}

/* Why a file that is none of the kinds is not what its dataset says, if it has one of theirs.
 * Collective(world), never V2V_OK. */
static enum v2v_status explain(const char *path, const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    int64_t kind = -1;
    for (int i = 0; v2v_step_on_root(session) && kind < 0 && i < KINDS; i++) {
        kind = kinds[i].name != NULL && v2v_weights_file_has(path, kinds[i].name) ? i : -1;
    }
    v2v_par_max_i64(session->world, &kind, 1);
    if (kind >= 0) {
        V2V_TRY(kinds[kind].open(path, session));
    }
    rc = v2v_par_agree(session->world, v2v_step_on_root(session) ? refuse(path) : V2V_OK);
done:
    return rc;
}

enum v2v_status v2v_content_of(enum v2v_content *content, const char *path,
                               const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    int64_t found = V2V_CONTENT_AUTO;
    if (v2v_step_on_root(session)) {
        enum v2v_content seen = V2V_CONTENT_AUTO;
        rc = look(&seen, path);
        found = seen;
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_par_max_i64(session->world, &found, 1);
    *content = (enum v2v_content)found;
    for (int i = 0; i < KINDS && *content == V2V_CONTENT_AUTO; i++) {
        if (kinds[i].open(path, session) == V2V_OK) {
            *content = kinds[i].content;
        }
    }
    if (*content == V2V_CONTENT_AUTO) {
        V2V_TRY(explain(path, session));
    }
done:
    return rc;
}
