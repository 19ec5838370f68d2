#include "conf/table.h"
#include "conf/text_file.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"

#include <string.h>
#include <yaml.h>

enum { WHERE_BYTES = 320 };

struct reader {
    yaml_parser_t parser;
    yaml_event_t event; /**< the current one, owned */
    const char *path;
    const char *text;
    int64_t bytes;
    struct v2v_config *config;
    int64_t line[V2V_KEY_MOST]; /**< where each key was given, 0: not yet */
    char section[V2V_KEY_NAME_BYTES];
    char where[WHERE_BYTES]; /**< "file:line" of the current event */
};

static void set_where(struct reader *reader, int64_t line)
{
    snprintf(reader->where, sizeof reader->where, "%.256s:%lld", reader->path, (long long)line);
}

/** Does this line (from 1) have a tab before its first word? */
static int tab_indents(const struct reader *reader, int64_t line)
{
    const char *c = reader->text, *end = reader->text + reader->bytes;
    for (int64_t l = 1; l < line && c < end; c++) {
        l += *c == '\n';
    }
    while (c < end && *c == ' ') {
        c++;
    }
    return c < end && *c == '\t';
}

static enum v2v_status syntax_error(struct reader *reader)
{
    const yaml_parser_t *parser = &reader->parser;
    if (parser->error == YAML_MEMORY_ERROR) {
        return V2V_FAIL(V2V_E_MEMORY, "%s: out of memory", reader->path);
    }
    int64_t line = parser->error == YAML_READER_ERROR
                       ? v2v_text_line(reader->text, (int64_t)parser->problem_offset)
                       : (int64_t)parser->problem_mark.line + 1;
    set_where(reader, line);
    return V2V_FAIL(V2V_E_CONFIG, "%s: %s%s%s%s", reader->where,
                    parser->problem != NULL ? parser->problem : "not YAML",
                    parser->context != NULL ? " " : "",
                    parser->context != NULL ? parser->context : "",
                    tab_indents(reader, line) ? " (a tab can't indent)" : "");
}

/** Go to the next event. */
static enum v2v_status advance(struct reader *reader)
{
    yaml_event_delete(&reader->event);
    if (!yaml_parser_parse(&reader->parser, &reader->event)) {
        return syntax_error(reader);
    }
    set_where(reader, (int64_t)reader->event.start_mark.line + 1);
    return V2V_OK;
}

/** The text of the current event, which must be a plain word; `what` names what is wanted. */
static enum v2v_status scalar(struct reader *reader, const char **text, const char *what)
{
    const yaml_event_t *event = &reader->event;
    if (event->type != YAML_SCALAR_EVENT) {
        return V2V_FAIL(V2V_E_CONFIG, "%s: %s wants one word or number, not a list or a block",
                        reader->where, what);
    }
    *text = (const char *)event->data.scalar.value;
    if (event->data.scalar.anchor != NULL || event->data.scalar.tag != NULL) {
        return V2V_FAIL(V2V_E_CONFIG, "%s: %s: anchors and tags are not understood", reader->where,
                        what);
    }
    if (strlen(*text) != event->data.scalar.length) {
        return V2V_FAIL(V2V_E_CONFIG, "%s: %s holds a NUL byte", reader->where, what);
    }
    return V2V_OK;
}

/** "key: value", the current event being the key. */
static enum v2v_status read_key(struct reader *reader)
{
    enum v2v_status rc = V2V_OK;
    const char *text = NULL;
    char what[2 * V2V_KEY_NAME_BYTES];
    int64_t index = -1;
    V2V_TRY(scalar(reader, &text, "a key"));
    V2V_TRY(v2v_key_find(&index, reader->section, text, reader->where));
    snprintf(what, sizeof what, "%s.%s", reader->section, v2v_key_table[index].name);
    if (reader->line[index] > 0) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s: duplicate key '%s', given on line %lld already",
                         reader->where, what, (long long)reader->line[index]));
    }
    reader->line[index] = (int64_t)reader->event.start_mark.line + 1;
    V2V_TRY(advance(reader));
    V2V_TRY(scalar(reader, &text, what));
    V2V_TRY(v2v_key_assign(reader->config, index, text, reader->where));
done:
    return rc;
}

/** "section:" and what is below it, the current event being the section's name. */
static enum v2v_status read_section(struct reader *reader)
{
    enum v2v_status rc = V2V_OK;
    const char *text = NULL;
    V2V_TRY(scalar(reader, &text, "a section's name"));
    V2V_TRY(v2v_key_find_section(text, reader->where));
    snprintf(reader->section, sizeof reader->section, "%s", text);
    V2V_TRY(advance(reader));
    if (reader->event.type == YAML_SCALAR_EVENT && reader->event.data.scalar.length == 0) {
        goto done; /* all keys below it are commented out */
    }
    if (reader->event.type != YAML_MAPPING_START_EVENT) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s: section '%s' wants 'key: value' lines below it",
                         reader->where, reader->section));
    }
    V2V_TRY(advance(reader));
    while (reader->event.type != YAML_MAPPING_END_EVENT) {
        V2V_TRY(read_key(reader));
        V2V_TRY(advance(reader));
    }
done:
    return rc;
}

/** Has the section of the current event been read before? */
static enum v2v_status refuse_second_section(struct reader *reader, const char *names[],
                                             int64_t *count)
{
    const char *text = NULL;
    enum v2v_status rc = scalar(reader, &text, "a section's name");
    if (rc != V2V_OK) {
        return rc;
    }
    for (int64_t i = 0; i < *count; i++) {
        if (strcmp(names[i], text) == 0) {
            return V2V_FAIL(V2V_E_CONFIG, "%s: duplicate section '%s'", reader->where, text);
        }
    }
    for (int64_t i = 0; i < v2v_key_count; i++) {
        if (strcmp(v2v_key_table[i].section, text) == 0) {
            names[(*count)++] = v2v_key_table[i].section;
            break;
        }
    }
    return V2V_OK;
}

static enum v2v_status read_document(struct reader *reader)
{
    enum v2v_status rc = V2V_OK;
    const char *section[V2V_KEY_MOST];
    int64_t sections = 0;
    V2V_TRY(advance(reader)); /* the stream's start */
    V2V_TRY(advance(reader));
    if (reader->event.type == YAML_STREAM_END_EVENT) {
        goto done; /* nothing but comments */
    }
    V2V_TRY(advance(reader));
    if (reader->event.type != YAML_MAPPING_START_EVENT) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s: a configuration is made of sections with keys",
                         reader->where));
    }
    V2V_TRY(advance(reader));
    while (reader->event.type != YAML_MAPPING_END_EVENT) {
        V2V_TRY(refuse_second_section(reader, section, &sections));
        V2V_TRY(read_section(reader));
        V2V_TRY(advance(reader));
    }
    V2V_TRY(advance(reader)); /* the document's end */
    V2V_TRY(advance(reader));
    if (reader->event.type != YAML_STREAM_END_EVENT) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s: only one YAML document is allowed", reader->where));
    }
done:
    return rc;
}

static enum v2v_status check_rules(struct reader *reader)
{
    char why[256];
    int64_t index = v2v_key_conflict(reader->config, why, sizeof why);
    if (index < 0) {
        return V2V_OK;
    }
    if (reader->line[index] > 0) {
        return V2V_FAIL(V2V_E_CONFIG, "%s:%lld: %s", reader->path, (long long)reader->line[index],
                        why);
    }
    return V2V_FAIL(V2V_E_CONFIG, "%s: %s", reader->path, why);
}

enum v2v_status v2v_config_load(struct v2v_config *config, const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_config changed = *config;
    struct reader reader = {.path = path, .config = &changed};
    char *text = NULL;
    int started = 0;
    V2V_TRY(v2v_text_file_read(&text, &reader.bytes, path));
    reader.text = text;
    started = yaml_parser_initialize(&reader.parser);
    if (!started) {
        V2V_TRY(V2V_FAIL(V2V_E_MEMORY, "%s: out of memory", path));
    }
    yaml_parser_set_input_string(&reader.parser, (const unsigned char *)text, (size_t)reader.bytes);
    V2V_TRY(read_document(&reader));
    V2V_TRY(check_rules(&reader));
    *config = changed;
done:
    if (started) {
        yaml_event_delete(&reader.event);
        yaml_parser_delete(&reader.parser);
    }
    v2v_mem_free(text);
    return rc;
}
