#include "cli/processor.h"

#include <stdio.h>
#include <string.h>

static void add_sets(char *text, size_t bytes, const char *line)
{
    static const char *const sets[] = {"avx2", "fma", "avx512f", "avx512_bf16", "amx_bf16", "sve"};
    size_t length = 0;
    for (size_t i = 0; i < sizeof sets / sizeof sets[0]; i++) {
        const char *found = strstr(line, sets[i]);
        if (found != NULL && strchr(" \n", found[strlen(sets[i])]) != NULL && length < bytes) {
            length += (size_t)snprintf(text + length, bytes - length, "%s%s", length > 0 ? " " : "",
                                       sets[i]);
        }
    }
}

void v2v_cli_processor(struct v2v_processor *processor)
{
    char line[8192];
    FILE *file = fopen("/proc/cpuinfo", "r");
    *processor = (struct v2v_processor){.model = "unknown processor"};
    while (file != NULL && processor->instructions[0] == '\0' &&
           fgets(line, sizeof line, file) != NULL) {
        const char *value = strchr(line, ':');
        if (value != NULL && strncmp(line, "model name", 10) == 0) {
            snprintf(processor->model, sizeof processor->model, "%.*s",
                     (int)strcspn(value + 2, "\n"), value + 2);
        } else if (strncmp(line, "flags", 5) == 0 || strncmp(line, "Features", 8) == 0) {
            add_sets(processor->instructions, sizeof processor->instructions, line);
        }
    }
    if (file != NULL) {
        fclose(file);
    }
}
