#include "cli/options.h"

#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include <string.h>

#define COMMON(field) offsetof(struct v2v_common, field)

static const struct v2v_option common_options[] = {
    {.name = "config",
     .letter = 'c',
     .kind = V2V_OPTION_TEXT,
     .at = COMMON(config),
     .value = "FILE",
     .help = "settings in YAML; see v2v3d init"},
    {.name = "set",
     .kind = V2V_OPTION_SETTING,
     .value = "SECTION.KEY=VALUE",
     .help = "one setting, after the file; repeatable"},
    {.name = "threads",
     .kind = V2V_OPTION_SETTING,
     .key = "parallel.threads",
     .value = "N",
     .help = "threads of each rank; 0: cores / ranks of this host"},
    {.name = "max-mem",
     .kind = V2V_OPTION_SETTING,
     .key = "parallel.max_mem_gb",
     .value = "GB",
     .help = "memory that a rank may hold; 0: no limit"},
    {.name = "force",
     .kind = V2V_OPTION_FLAG,
     .at = COMMON(force),
     .help = "overwrite an existing output"},
    {.name = "quiet",
     .kind = V2V_OPTION_FLAG,
     .at = COMMON(quiet),
     .help = "errors and warnings only, and none on the quality of volumes"},
    {.name = "verbose", .kind = V2V_OPTION_FLAG, .at = COMMON(verbose), .help = "debug lines too"},
    {.name = "proof",
     .kind = V2V_OPTION_TEXT,
     .at = COMMON(proof),
     .value = "FILE",
     .help = "make this file once the command has succeeded, and take an older one away "
             "when it starts; for job scripts"},
    {.name = "mem-report",
     .kind = V2V_OPTION_FLAG,
     .at = COMMON(mem_report),
     .help = "peak memory by label at the end, unless quiet"},
    {.name = "help",
     .letter = 'h',
     .kind = V2V_OPTION_FLAG,
     .at = COMMON(help),
     .help = "this text"},
    {0}};

/* The state of one pass over the words. */
struct parser {
    char *arguments;
    const struct v2v_option *table;
    int argc;
    char *const *argv;
    int next;                        /* the next word to look at */
    const struct v2v_option *list;   /* the LIST that free words go to, NULL: none is open */
    const struct v2v_option **given; /* in their order */
    int given_count;
    int options_ended; /* after "--" */
};

/* Operands have a name for the table only. */
static int is_named(const struct v2v_option *option)
{
    return option->kind != V2V_OPTION_OPERAND && option->kind != V2V_OPTION_REST;
}

/* The option of both tables for which the test holds. */
static const struct v2v_option *find(const struct v2v_option *table, const char *name,
                                     size_t length, char letter)
{
    const struct v2v_option *const tables[] = {table, common_options};
    for (int i = 0; i < 2; i++) {
        for (const struct v2v_option *o = tables[i]; o->kind != V2V_OPTION_END; o++) {
            int named = name != NULL && is_named(o) && strlen(o->name) == length &&
                        memcmp(o->name, name, length) == 0;
            if (named || (letter != 0 && o->letter == letter)) {
                return o;
            }
        }
    }
    return NULL;
}

static enum v2v_status unknown_option(const struct v2v_option *table, const char *name,
                                      size_t length)
{
    enum { MOST = 64, WORD = 64 };
    const char *names[MOST];
    int64_t count = 0;
    char word[WORD];
    const struct v2v_option *const tables[] = {table, common_options};
    for (int i = 0; i < 2; i++) {
        for (const struct v2v_option *o = tables[i]; o->kind != V2V_OPTION_END; o++) {
            if (is_named(o) && count < MOST) {
                names[count++] = o->name;
            }
        }
    }
    const char *nearest = NULL;
    if (length < WORD) {
        memcpy(word, name, length);
        word[length] = '\0';
        nearest = v2v_text_nearest(word, names, count);
    }
    if (nearest != NULL) {
        return V2V_FAIL(V2V_E_USAGE, "unknown option --%.*s; did you mean --%s?", (int)length, name,
                        nearest);
    }
    return V2V_FAIL(V2V_E_USAGE, "unknown option --%.*s", (int)length, name);
}

static enum v2v_status parse_choice(int *index, const struct v2v_option *option, const char *text)
{
    size_t length = strlen(text);
    int i = 0;
    for (const char *word = option->value; word != NULL; i++) {
        const char *bar = strchr(word, '|');
        size_t n = bar != NULL ? (size_t)(bar - word) : strlen(word);
        if (n == length && memcmp(word, text, n) == 0) {
            *index = i;
            return V2V_OK;
        }
        word = bar != NULL ? bar + 1 : NULL;
    }
    return V2V_FAIL(V2V_E_USAGE, "--%s: '%s' is none of %s", option->name, text, option->value);
}

static enum v2v_status append_word(struct parser *parser, const struct v2v_option *option,
                                   const char *text)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_words *words = (void *)(parser->arguments + option->at);
    if (words->item == NULL) {
        V2V_TRY(V2V_ALLOC(words->item, "cli.words", parser->argc));
    }
    words->item[words->count++] = text;
    parser->list = option;
done:
    return rc;
}

static enum v2v_status append_assignment(struct parser *parser, const struct v2v_option *option,
                                         const char *text)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_common *common = (void *)parser->arguments;
    if (common->assignments == NULL) {
        V2V_TRY(V2V_ALLOC(common->assignments, "cli.settings", parser->argc));
    }
    common->assignments[common->assignment_count++] =
        (struct v2v_assignment){.option = option->name, .key = option->key, .text = text};
done:
    return rc;
}

static enum v2v_status check_filled(const char *text, const char *what)
{
    return text[0] != '\0' ? V2V_OK : V2V_FAIL(V2V_E_USAGE, "%s: empty value", what);
}

static enum v2v_status store(struct parser *parser, const struct v2v_option *option,
                             const char *text)
{
    char what[64];
    enum v2v_status rc = V2V_OK;
    void *to = parser->arguments + option->at;
    V2V_TRY(v2v_text_format(what, sizeof what, "--%s", option->name));
    switch (option->kind) {
    case V2V_OPTION_FLAG:
        *(int *)to = 1;
        break;
    case V2V_OPTION_TEXT:
    case V2V_OPTION_OPERAND:
        V2V_TRY(check_filled(text, what));
        *(const char **)to = text;
        break;
    case V2V_OPTION_INTEGER:
        V2V_TRY(v2v_text_to_i64(to, text, (int64_t)option->least, (int64_t)option->most, what,
                                V2V_E_USAGE));
        break;
    case V2V_OPTION_NUMBER:
        V2V_TRY(v2v_text_to_f64(to, text, option->least, option->most, what, V2V_E_USAGE));
        break;
    case V2V_OPTION_DURATION:
        *(double *)to = v2v_clock_parse_duration(text);
        if (*(double *)to < 0.0) {
            V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s: '%s' is no duration such as 90s, 20m or 3h", what,
                             text));
        }
        break;
    case V2V_OPTION_CHOICE:
        V2V_TRY(parse_choice(to, option, text));
        break;
    case V2V_OPTION_LIST:
        V2V_TRY(check_filled(text, what));
        V2V_TRY(append_word(parser, option, text));
        break;
    case V2V_OPTION_SETTING:
        V2V_TRY(append_assignment(parser, option, text));
        break;
    case V2V_OPTION_REST: /* taken whole */
    case V2V_OPTION_END:
        break;
    }
done:
    return rc;
}

static enum v2v_status free_word(struct parser *parser, const char *word)
{
    if (parser->list != NULL) {
        return store(parser, parser->list, word);
    }
    for (const struct v2v_option *o = parser->table; o->kind != V2V_OPTION_END; o++) {
        const char **to = (void *)(parser->arguments + o->at);
        if (o->kind == V2V_OPTION_OPERAND && *to == NULL) {
            return store(parser, o, word);
        }
    }
    return V2V_FAIL(V2V_E_USAGE, "'%s' is one word too many", word);
}

/* Where an option's name ends, and its value on the same word: --name=value, -ovalue. */
static enum v2v_status find_option(const struct v2v_option **option, const char **value,
                                   const struct parser *parser, const char *word)
{
    const int is_long = word[1] == '-';
    const char *name = word + 2;
    const char *rest = is_long ? strchr(name, '=') : word[2] != '\0' ? word + 2 : NULL;
    const size_t length = rest != NULL && is_long ? (size_t)(rest - name) : strlen(name);
    *value = rest != NULL && is_long ? rest + 1 : rest;
    *option =
        is_long ? find(parser->table, name, length, 0) : find(parser->table, NULL, 0, word[1]);
    if (*option == NULL) {
        return is_long ? unknown_option(parser->table, name, length)
                       : V2V_FAIL(V2V_E_USAGE, "unknown option -%c", word[1]);
    }
    return V2V_OK;
}

/* One option with its value, which may be the next word. */
static enum v2v_status option_word(struct parser *parser, const char *word)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_option *option = NULL;
    const char *value = NULL;
    parser->list = NULL;
    V2V_TRY(find_option(&option, &value, parser, word));
    if (option->kind == V2V_OPTION_FLAG || option->value == NULL) {
        if (value != NULL) {
            V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--%s takes no value", option->name));
        }
        value = "true";
    } else if (value == NULL) {
        if (parser->next >= parser->argc || strncmp(parser->argv[parser->next], "--", 2) == 0) {
            V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--%s needs a value: %s", option->name, option->value));
        }
        value = parser->argv[parser->next++];
    }
    V2V_TRY(store(parser, option, value));
    parser->given[parser->given_count++] = option;
done:
    return rc;
}

/* Required options are numbers above 0, pointers, or what starts with a pointer. */
static int is_missing(const struct v2v_option *option, const void *destination)
{
    return option->kind == V2V_OPTION_INTEGER ? *(const int64_t *)destination == 0
                                              : *(const char *const *)destination == NULL;
}

static enum v2v_status check_required(const struct parser *parser)
{
    for (const struct v2v_option *o = parser->table; o->kind != V2V_OPTION_END; o++) {
        if (o->required && is_missing(o, parser->arguments + o->at)) {
            return is_named(o) ? V2V_FAIL(V2V_E_USAGE, "--%s %s is missing", o->name, o->value)
                               : V2V_FAIL(V2V_E_USAGE, "%s%s is missing",
                                          o->kind == V2V_OPTION_REST ? "-- " : "", o->value);
        }
    }
    return V2V_OK;
}

static int is_given(const struct parser *parser, const char *name)
{
    int i = 0;
    while (i < parser->given_count && strcmp(parser->given[i]->name, name) != 0) {
        i++;
    }
    return i < parser->given_count;
}

static enum v2v_status check_needs(const struct parser *parser)
{
    for (int i = 0; i < parser->given_count; i++) {
        const struct v2v_option *o = parser->given[i];
        if (o->needs != NULL && !is_given(parser, o->needs)) {
            return V2V_FAIL(V2V_E_USAGE, "--%s needs --%s", o->name, o->needs);
        }
    }
    return V2V_OK;
}

/* Where the table has a REST, nothing is left to read. */
static void take_rest(struct parser *parser)
{
    for (const struct v2v_option *o = parser->table; o->kind != V2V_OPTION_END; o++) {
        if (o->kind == V2V_OPTION_REST && parser->next < parser->argc) {
            *(struct v2v_rest *)(void *)(parser->arguments + o->at) =
                (struct v2v_rest){parser->argv + parser->next, parser->argc - parser->next};
            parser->next = parser->argc;
        }
    }
}

enum v2v_status v2v_options_parse(void *arguments, const struct v2v_option *table, int argc,
                                  char *const *argv)
{
    enum v2v_status rc = V2V_OK;
    struct parser parser = {.arguments = arguments, .table = table, .argc = argc, .argv = argv};
    const struct v2v_common *common = arguments;
    V2V_TRY(V2V_ALLOC(parser.given, "cli.words", argc));
    for (const struct v2v_option *o = table; o->kind != V2V_OPTION_END; o++) {
        if (o->initial != NULL) {
            V2V_TRY(store(&parser, o, o->initial));
        }
    }
    while (parser.next < argc) {
        const char *word = argv[parser.next++];
        if (!parser.options_ended && strcmp(word, "--") == 0) {
            parser.options_ended = 1;
            take_rest(&parser);
        } else if (!parser.options_ended && word[0] == '-' && word[1] != '\0') {
            V2V_TRY(option_word(&parser, word));
        } else {
            V2V_TRY(free_word(&parser, word));
        }
    }
    if (!common->help) {
        V2V_TRY(check_required(&parser));
        V2V_TRY(check_needs(&parser));
    }
done:
    v2v_mem_free(parser.given);
    return rc;
}

/* The configuration's message with the option's name instead of the key's. */
static enum v2v_status setting_failure(const struct v2v_assignment *assignment)
{
    char reason[V2V_MESSAGE_BYTES / 2];
    snprintf(reason, sizeof reason, "%s", v2v_status_message());
    const char *key = strstr(reason, assignment->key);
    const char *colon = key != NULL ? strstr(key, ": ") : NULL;
    return V2V_FAIL(V2V_E_USAGE, "--%s: %s", assignment->option,
                    colon != NULL ? colon + 2 : reason);
}

enum v2v_status v2v_options_apply(const struct v2v_common *common, struct v2v_config *config)
{
    enum v2v_status rc = V2V_OK;
    for (int64_t i = 0; i < common->assignment_count; i++) {
        const struct v2v_assignment *assignment = &common->assignments[i];
        if (assignment->key == NULL) {
            V2V_TRY(v2v_config_set(config, assignment->text));
            continue;
        }
        char text[2 * V2V_CONFIG_TEXT_BYTES];
        rc = v2v_text_format(text, sizeof text, "%s=%s", assignment->key, assignment->text);
        if (rc != V2V_OK || v2v_config_set(config, text) != V2V_OK) {
            V2V_TRY(setting_failure(assignment));
        }
    }
    V2V_TRY(v2v_config_check(config));
done:
    return rc;
}

int v2v_options_set(const struct v2v_common *common, const char *key)
{
    const size_t length = strlen(key);
    for (int64_t i = 0; i < common->assignment_count; i++) {
        const struct v2v_assignment *assignment = &common->assignments[i];
        if (assignment->key != NULL
                ? strcmp(assignment->key, key) == 0
                : strncmp(assignment->text, key, length) == 0 && assignment->text[length] == '=') {
            return 1;
        }
    }
    return 0;
}

const char *v2v_options_of(const struct v2v_common *common, const char *prefix)
{
    for (int64_t i = 0; i < common->assignment_count; i++) {
        const struct v2v_assignment *assignment = &common->assignments[i];
        const char *key = assignment->key != NULL ? assignment->key : assignment->text;
        if (strncmp(key, prefix, strlen(prefix)) == 0) {
            return assignment->option;
        }
    }
    return NULL;
}

static void print_table(FILE *stream, const struct v2v_option *table)
{
    enum { COLUMN = 30 };
    for (const struct v2v_option *o = table; o->kind != V2V_OPTION_END; o++) {
        int width = o->kind == V2V_OPTION_REST ? fprintf(stream, "  -- %s", o->value)
                    : !is_named(o)             ? fprintf(stream, "  %s", o->value)
                    : o->letter != 0           ? fprintf(stream, "  -%c, --%s", o->letter, o->name)
                                               : fprintf(stream, "      --%s", o->name);
        if (o->value != NULL && is_named(o)) {
            width += fprintf(stream, " %s", o->value);
        }
        if (width >= COLUMN) {
            fprintf(stream, "\n");
            width = 0;
        }
        fprintf(stream, "%*s%s", COLUMN - width, "", o->help);
        if (o->initial != NULL) {
            fprintf(stream, " (default %s)", o->initial);
        }
        fprintf(stream, "%s\n", o->required ? " (required)" : "");
    }
}

void v2v_options_help(FILE *stream, const struct v2v_option *table)
{
    print_table(stream, table);
    fprintf(stream, "%sOptions of every command:\n", table->kind != V2V_OPTION_END ? "\n" : "");
    print_table(stream, common_options);
}

void v2v_options_fini(void *arguments, const struct v2v_option *table)
{
    for (const struct v2v_option *o = table; o->kind != V2V_OPTION_END; o++) {
        if (o->kind == V2V_OPTION_LIST) {
            struct v2v_words *words = (void *)((char *)arguments + o->at);
            v2v_mem_free(words->item);
            words->item = NULL;
        }
    }
    struct v2v_common *common = arguments;
    v2v_mem_free(common->assignments);
    common->assignments = NULL;
}
