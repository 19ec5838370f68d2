#include "cli/steps.h"

#include <stdlib.h>

struct arguments {
    struct v2v_common common;
    const char *output;
};

static const struct v2v_option options[] = {{.name = "output",
                                             .letter = 'o',
                                             .kind = V2V_OPTION_TEXT,
                                             .at = offsetof(struct arguments, output),
                                             .value = "FILE",
                                             .help = "YAML to write; default: standard output"},
                                            {0}};

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    char *text = NULL;
    if (given->output != NULL) {
        V2V_TRY(v2v_step_output(session, given->output, &given->common.config, 1));
    }
    V2V_TRY(v2v_config_text(&text, &session->config, NULL, 1));
    if (v2v_step_on_root(session)) {
        if (given->output != NULL) {
            rc = v2v_file_write_text(given->output, text);
        } else {
            printf("%s", text);
        }
    }
done:
    free(text);
    return rc;
}

const struct v2v_command v2v_command_init = {.name = "init",
                                             .summary = "commented configuration",
                                             .options = options,
                                             .bytes = sizeof(struct arguments),
                                             .run = run};
