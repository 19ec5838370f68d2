#include "cli/provenance.h"

#include "cli/steps.h"
#include "cli/versions.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/random.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file_sum.h"
#include "v2v3d/optics/calibration.h"
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void add_text(struct v2v_provenance *provenance, const char *name, const char *text)
{
    V2V_ASSERT(provenance->count < V2V_PROVENANCE_MOST);
    provenance->item[provenance->count++] = (struct v2v_attribute){.name = name, .text = text};
}

static void add_number(struct v2v_provenance *provenance, const char *name, double number)
{
    V2V_ASSERT(provenance->count < V2V_PROVENANCE_MOST);
    provenance->item[provenance->count++] = (struct v2v_attribute){.name = name, .number = number};
}

enum v2v_status v2v_provenance_init(struct v2v_provenance *provenance,
                                    const struct v2v_session *session,
                                    const struct v2v_psf_file *psf, const char *weights,
                                    const struct v2v_scaling *scaling)
{
    enum v2v_status rc = V2V_OK;
    uint32_t crc = 0;
    *provenance = (struct v2v_provenance){0};
    rc = v2v_config_text(&provenance->config, &session->config, NULL, 0);
    if (rc == V2V_OK && weights != NULL && v2v_step_on_root(session)) {
        rc = v2v_file_crc32c_of(&crc, weights);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_par_broadcast(session->world, &crc, (int64_t)sizeof crc, 0);
    v2v_clock_iso8601(provenance->written, sizeof provenance->written);
    v2v_par_broadcast(session->world, provenance->written, (int64_t)sizeof provenance->written, 0);
    snprintf(provenance->weights_crc32c, sizeof provenance->weights_crc32c, "%08" PRIx32, crc);
    snprintf(provenance->psf_crc32c, sizeof provenance->psf_crc32c, "%08" PRIx32,
             v2v_psf_file_sum(psf));

    add_text(provenance, "program", "v2v3d " V2V_VERSION);
    add_text(provenance, "command_line", session->command_line);
    add_text(provenance, "configuration", provenance->config);
    add_text(provenance, "libraries", V2V_LIBRARY_VERSIONS);
    add_text(provenance, "written", provenance->written);
    add_number(provenance, "ranks", v2v_comm_size(session->world));
    add_number(provenance, "threads", session->threads);
    add_text(provenance, V2V_VOLUME_PSF, provenance->psf_crc32c);
    if (weights != NULL) {
        add_text(provenance, "weights_crc32c", provenance->weights_crc32c);
    }
    add_number(provenance, V2V_VOLUME_OFFSET, scaling->offset);
    add_number(provenance, "gain", scaling->gain);
done:
    return rc;
}

enum v2v_status v2v_provenance_origin(struct v2v_provenance *provenance,
                                      const struct v2v_session *session, const char *recording,
                                      int64_t first_frame)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_origin_of(&provenance->origin, recording, first_frame, session));
    V2V_ASSERT(provenance->count + V2V_ORIGIN_ATTRIBUTES <= V2V_PROVENANCE_MOST);
    provenance->count +=
        v2v_origin_attributes(provenance->item + provenance->count, &provenance->origin);
done:
    return rc;
}

/* Everything the output depends on, as text; to be freed with free(). */
static enum v2v_status task_text(char **text, const struct v2v_provenance *provenance,
                                 const struct v2v_session *session, int64_t frames,
                                 unsigned datasets)
{
    static const char what[] = "the task's text";
    enum v2v_status rc = V2V_OK;
    struct v2v_config config, defaults;
    FILE *stream = NULL;
    size_t bytes = 0;
    V2V_TRY(v2v_text_open(&stream, text, &bytes, what));
    v2v_config_defaults(&defaults);
    config = session->config;
    config.parallel = defaults.parallel;
    v2v_config_print(&config, stream, NULL, 0);
    fprintf(stream, "%" PRId64 " frames, datasets %x\n", frames, datasets);
    for (int64_t i = 0; i < provenance->count; i++) {
        static const char *const by_run[] = {"command_line", "configuration", "written", "ranks",
                                             "threads"};
        const struct v2v_attribute *item = &provenance->item[i];
        int skipped = 0;
        for (size_t k = 0; k < sizeof by_run / sizeof by_run[0]; k++) {
            skipped |= strcmp(item->name, by_run[k]) == 0;
        }
        if (!skipped) {
            fprintf(stream, "%s %s %a\n", item->name, item->text != NULL ? item->text : "",
                    item->number);
        }
    }
    if (session->calibration.views > 0) {
        v2v_calibration_print(&session->calibration, stream);
    }
    V2V_TRY(v2v_text_close(V2V_OK, stream, text, what));
done:
    return rc;
}

enum v2v_status v2v_provenance_task(struct v2v_provenance *provenance,
                                    const struct v2v_session *session, int64_t frames,
                                    unsigned datasets)
{
    enum v2v_status rc = V2V_OK;
    char *text = NULL;
    if (v2v_step_on_root(session)) { /* the other ranks' attributes are not written */
        rc = task_text(&text, provenance, session, frames, datasets);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    snprintf(provenance->task, sizeof provenance->task, "%016" PRIx64,
             v2v_random_fnv1a64(text != NULL ? text : ""));
    add_text(provenance, V2V_VOLUME_TASK, provenance->task);
done:
    free(text);
    return rc;
}

void v2v_provenance_fini(struct v2v_provenance *provenance)
{
    free(provenance->config);
    provenance->config = NULL;
}
