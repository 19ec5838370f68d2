#include "cli/storage.h"

#include "cli/steps.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/bdv.h"
#include <string.h>

/* Higher ones take much longer and save little: tests/bench/speed.md. */
enum { USUAL_LEVEL = 2 };

static enum v2v_status parse_compression(int *level, const char *text)
{
    enum v2v_status rc = V2V_OK;
    static const char what[] = "--compression gzip:LEVEL";
    int64_t given = USUAL_LEVEL;
    if (text == NULL || strcmp(text, "none") == 0) {
        given = 0;
    } else if (strncmp(text, "gzip:", 5) == 0) {
        V2V_TRY(v2v_text_to_i64(&given, text + 5, 1, 9, what, V2V_E_USAGE));
    } else if (strcmp(text, "gzip") != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--compression %s: none, gzip or gzip:LEVEL is meant", text));
    }
    *level = (int)given;
done:
    return rc;
}

/* What the voxels are. */
static enum v2v_sample sample_of(int type, int is_bdv)
{
    return type != V2V_STORAGE_AUTO ? (enum v2v_sample)(type - 1)
           : is_bdv                 ? V2V_SAMPLE_UINT16
                                    : V2V_SAMPLE_FLOAT32;
}

enum v2v_status v2v_storage_settle(struct v2v_volume_storage *storage,
                                   const struct v2v_storage_options *given, const char *output)
{
    enum v2v_status rc = V2V_OK;
    const int is_bdv = v2v_bdv_is_name(output);
    *storage =
        (struct v2v_volume_storage){.sample = sample_of(given->type, is_bdv), .peak = given->peak};
    V2V_TRY(parse_compression(&storage->deflate, given->compression));
    if (is_bdv && storage->sample != V2V_SAMPLE_UINT16) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--output-type float32: BigDataViewer (%s) reads uint16",
                         output));
    }
    if (storage->peak > 0.0 && storage->sample != V2V_SAMPLE_UINT16) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--output-peak needs --output-type uint16"));
    }
    if (storage->deflate > 0 && !is_bdv && v2v_file_kind_of_name(output) != V2V_FILE_HDF5) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--compression needs an HDF5 output (.h5), not %s", output));
    }
done:
    return rc;
}

enum v2v_status v2v_storage_refuse(const struct v2v_storage_options *given, const char *input)
{
    enum v2v_status rc = V2V_OK;
    int level = 0;
    V2V_TRY(parse_compression(&level, given->compression));
    const struct {
        int is_asked;
        const char *option;
    } options[] = {{sample_of(given->type, 0) == V2V_SAMPLE_UINT16, "--output-type uint16"},
                   {given->peak > 0.0, "--output-peak"},
                   {level > 0, "--compression"}};
    for (size_t i = 0; i < sizeof options / sizeof *options; i++) {
        if (options[i].is_asked) {
            V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s: only volumes are stored so, which %s is not",
                             options[i].option, input));
        }
    }
done:
    return rc;
}
