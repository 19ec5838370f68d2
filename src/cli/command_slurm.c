#include "cli/steps.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include <inttypes.h>
#include <string.h>

/* Longest time from the warning to the end of an attempt, s: a checkpoint takes less, and Slurm
 * sends the signal up to a minute early. */
#define WARNING_SECONDS 180.0

struct arguments {
    struct v2v_common common;
    const char *kind, *partition, *account, *array, *list, *home;
    struct v2v_rest words;
    int64_t nodes, ranks, each;
    int launcher; /* index into launchers */
    double time_s, memory_gb;
};

static const char *const launchers[] = {"srun", "mpirun"};

#define TEXT(field, word, values, text)                                                            \
    {                                                                                              \
        .name = (word), .kind = V2V_OPTION_TEXT, .at = offsetof(struct arguments, field),          \
        .value = (values), .help = (text)                                                          \
    }

static const struct v2v_option options[] = {
    V2V_OPTION_NAMELESS(struct arguments, kind, "train|reconstruct|array",
                        "the command; array: reconstruct as many tasks"),
    {.name = "arguments",
     .kind = V2V_OPTION_REST,
     .at = offsetof(struct arguments, words),
     .value = "ARGUMENT...",
     .help = "of that command, checked before they are printed",
     .required = 1},
    {.name = "nodes",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, nodes),
     .value = "N",
     .help = "of the job, or of each task",
     .initial = "1",
     .least = 1,
     .most = 1e6},
    {.name = "ranks",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, ranks),
     .value = "N",
     .help = "on each node, --threads of each rank",
     .initial = "1",
     .least = 1,
     .most = 1e6},
    {.name = "time",
     .kind = V2V_OPTION_DURATION,
     .at = offsetof(struct arguments, time_s),
     .value = "TIME",
     .help = "limit of an attempt; the job is requeued until it is done",
     .initial = "4h"},
    {.name = "mem",
     .kind = V2V_OPTION_NUMBER,
     .at = offsetof(struct arguments, memory_gb),
     .value = "GB",
     .help = "of a node; 0: from --max-mem of the command, else the cluster's default",
     .least = 0,
     .most = 1e6},
    TEXT(partition, "partition", "NAME", "where to run"),
    TEXT(account, "account", "NAME", "who pays"),
    {.name = "launcher",
     .kind = V2V_OPTION_CHOICE,
     .at = offsetof(struct arguments, launcher),
     .value = "srun|mpirun",
     .help = "what starts the ranks"},
    TEXT(array, "array", "TASKS", "array: numbers of the tasks, such as 0-9 or 0-99%8"),
    {.name = "each",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, each),
     .value = "N",
     .help = "array: task k takes frames k N .. k N + N - 1",
     .least = 1,
     .most = 1e12},
    TEXT(list, "list", "FILE", "array: task k takes the recording in line k + 1"),
    TEXT(home, "home", "FOLDER", "that holds jobs/; default: where sbatch is called"),
    {0}};

static int is_array(const struct arguments *given)
{
    return strcmp(given->kind, "array") == 0;
}

/* A word for a line #SBATCH, where nothing can be quoted. */
static enum v2v_status check_plain(const char *option, const char *text)
{
    static const char fine[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                               "_.,:@%+-";
    if (text != NULL && text[strspn(text, fine)] != '\0') {
        return V2V_FAIL(V2V_E_USAGE,
                        "--%s: '%s' holds other characters than letters, digits and %s", option,
                        text, strchr(fine, '_'));
    }
    return V2V_OK;
}

/* A number at *text, which goes on behind it; -1: there is none. */
static int64_t read_number(const char **text)
{
    enum { MOST_DIGITS = 9 };
    const size_t digits = strspn(*text, "0123456789");
    int64_t number = digits > 0 && digits <= MOST_DIGITS ? 0 : -1;
    for (size_t i = 0; number >= 0 && i < digits; i++) {
        number = 10 * number + ((*text)[i] - '0');
    }
    *text += digits;
    return number;
}

/* N, N-M or N-M:STEP, such as are between commas; *text goes on behind it. */
static int is_range(const char **text)
{
    const int64_t first = read_number(text);
    int64_t last = first, step = 1;
    if (**text == '-') {
        *text += 1;
        last = read_number(text);
        if (**text == ':') {
            *text += 1;
            step = read_number(text);
        }
    }
    return first >= 0 && last >= first && step > 0;
}

/* Ranges, and %MOST of them at a time. */
static int is_task_list(const char *text)
{
    int is_one = is_range(&text);
    while (is_one && *text == ',') {
        text++;
        is_one = is_range(&text);
    }
    if (is_one && *text == '%') {
        text++;
        is_one = read_number(&text) > 0;
    }
    return is_one && *text == '\0';
}

static enum v2v_status check_array(const struct arguments *given)
{
    for (int i = 0; i < given->words.count; i++) {
        if (strpbrk(given->words.item[i], "\r\n") != NULL) {
            return V2V_FAIL(V2V_E_USAGE,
                            "an argument holds a line break, which no script can hand on");
        }
    }
    if (!is_array(given)) {
        return given->array != NULL || given->each > 0 || given->list != NULL
                   ? V2V_FAIL(V2V_E_USAGE, "--array, --each and --list are for an array")
                   : V2V_OK;
    }
    if (given->array == NULL) {
        return V2V_FAIL(V2V_E_USAGE, "an array needs --array TASKS");
    }
    if (!is_task_list(given->array)) {
        return V2V_FAIL(V2V_E_USAGE, "--array TASKS: '%s' is none such as 0-9 or 0-99%%4",
                        given->array);
    }
    if ((given->each > 0) == (given->list != NULL)) {
        return V2V_FAIL(V2V_E_USAGE, "an array needs --each N or --list FILE, one of them");
    }
    return V2V_OK;
}

static enum v2v_status check(const struct arguments *given)
{
    enum v2v_status rc = V2V_OK;
    if (strcmp(given->kind, "train") != 0 && strcmp(given->kind, "reconstruct") != 0 &&
        !is_array(given)) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "'%s' is none of train|reconstruct|array", given->kind));
    }
    V2V_TRY(check_plain("partition", given->partition));
    V2V_TRY(check_plain("account", given->account));
    V2V_TRY(check_array(given));
    if (given->time_s < 60.0) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--time: Slurm's shortest is a minute"));
    }
done:
    return rc;
}

/* Where `command` keeps an option of these arguments, or NULL. */
static const void *value_of(const struct v2v_command *command, const struct v2v_common *parsed,
                            const char *name)
{
    for (const struct v2v_option *o = command->options; o->kind != V2V_OPTION_END; o++) {
        if (o->name != NULL && strcmp(o->name, name) == 0) {
            return (const char *)parsed + o->at;
        }
    }
    return NULL;
}

static const char *text_of(const struct v2v_command *command, const struct v2v_common *parsed,
                           const char *name)
{
    const void *value = value_of(command, parsed, name);
    return value != NULL ? *(const char *const *)value : NULL;
}

/* What a task is told last would be all that counts of frames, and is added to inputs. */
static enum v2v_status check_tasks(const struct arguments *given, const struct v2v_command *command,
                                   const struct v2v_common *parsed)
{
    const char *output = text_of(command, parsed, "output");
    const struct v2v_words *inputs = value_of(command, parsed, "input");
    if (!is_array(given)) {
        return V2V_OK;
    }
    if (strstr(output, "%a") == NULL && (given->list == NULL || strstr(output, "%n") == NULL)) {
        return V2V_FAIL(V2V_E_USAGE,
                        "%s: all tasks would write one file: the output's name needs %%a "
                        "(the task's number) or %%n (of --list: the recording's name)",
                        output);
    }
    if (given->each > 0 && text_of(command, parsed, "frames") != NULL) {
        return V2V_FAIL(V2V_E_USAGE, "--frames: each task has its own, by --each");
    }
    if (given->list != NULL && inputs->count > 1) {
        return V2V_FAIL(V2V_E_USAGE, "--input: each task has its own, by --list");
    }
    return V2V_OK;
}

/* What the job would say to its arguments, before it waits in a queue. Rank 0.
 *  @param of_job its settings */
static enum v2v_status check_words(const struct arguments *given, struct v2v_config *of_job)
{
    enum v2v_status rc = V2V_OK;
    static char input[] = "--input=recording";
    const struct v2v_command *command =
        strcmp(given->kind, "train") == 0 ? &v2v_command_train : &v2v_command_reconstruct;
    struct v2v_common *parsed = NULL;
    char **words = NULL;
    int count = given->words.count;
    V2V_TRY(V2V_ALLOC(words, "cli.words", count + 1));
    for (int i = 0; i < count; i++) {
        words[i] = given->words.item[i];
    }
    if (given->list != NULL) {
        words[count++] = input; /* each task has its own */
    }
    parsed = v2v_mem_alloc("cli.arguments", 1, command->bytes);
    if (parsed == NULL) {
        V2V_TRY(V2V_E_MEMORY);
    }
    V2V_TRY(v2v_options_parse(parsed, command->options, count, words));
    v2v_config_defaults(of_job);
    if (parsed->config != NULL) {
        V2V_TRY(v2v_config_load(of_job, parsed->config));
    }
    V2V_TRY(v2v_options_apply(parsed, of_job));
    V2V_TRY(check_tasks(given, command, parsed));
    const char *output = text_of(command, parsed, "output");
    if (output != NULL && v2v_file_kind_of_name(output) == V2V_FILE_TIFF) {
        V2V_TRY(
            V2V_FAIL(V2V_E_USAGE,
                     "%s: a job that its time limit ends goes on with an .h5, but begins a TIFF "
                     "anew: name an .h5, of which convert makes a TIFF",
                     output));
    }
done:
    if (parsed != NULL) {
        v2v_options_fini(parsed, command->options);
    }
    v2v_mem_free(parsed);
    v2v_mem_free(words);
    return rc;
}

/* A word as the shell reads it back. */
static void print_word(const char *word)
{
    static const char safe[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                               "_./:=,%+@-";
    if (word[0] != '\0' && word[strspn(word, safe)] == '\0') {
        printf("%s", word);
        return;
    }
    putchar('\'');
    for (; *word != '\0'; word++) {
        if (*word == '\'') {
            printf("'\\''");
        } else {
            putchar(*word);
        }
    }
    putchar('\'');
}

static void print_request(const struct arguments *given, int64_t threads, double memory_gb)
{
    const int64_t minutes = (int64_t)(given->time_s / 60.0);
    const double margin =
        given->time_s / 4.0 < WARNING_SECONDS ? given->time_s / 4.0 : WARNING_SECONDS;
    printf("#!/bin/bash\n"
           "#SBATCH --job-name=v2v3d-%s\n"
           "#SBATCH --nodes=%" PRId64 "\n"
           "#SBATCH --ntasks-per-node=%" PRId64 "\n"
           "#SBATCH --cpus-per-task=%" PRId64 "\n"
           "#SBATCH --time=%" PRId64 "-%02d:%02d\n",
           given->kind, given->nodes, given->ranks, threads, minutes / 1440,
           (int)(minutes / 60 % 24), (int)(minutes % 60));
    if (memory_gb > 0.0) {
        printf("#SBATCH --mem=%.0fM\n", 1e9 * memory_gb / (1 << 20));
    }
    if (given->partition != NULL) {
        printf("#SBATCH --partition=%s\n", given->partition);
    }
    if (given->account != NULL) {
        printf("#SBATCH --account=%s\n", given->account);
    }
    if (given->array != NULL) {
        printf("#SBATCH --array=%s\n", given->array);
    }
    printf("#SBATCH --signal=B:USR1@%.0f\n"
           "#SBATCH --requeue\n"
           "#SBATCH --open-mode=append\n",
           margin);
}

static void print_start(const struct arguments *given)
{
    printf("V2V3D_HOME=${V2V3D_HOME:-");
    if (given->home != NULL) {
        print_word(given->home);
    } else {
        printf("${SLURM_SUBMIT_DIR:-$PWD}");
    }
    printf("}\n"
           "V2V3D_LAUNCHER=${V2V3D_LAUNCHER:-%s}\n"
           "# shellcheck source=/dev/null\n"
           ". \"$V2V3D_HOME/jobs/common.sh\" || exit 78\n",
           launchers[given->launcher]);
    if (!is_array(given)) {
        printf("run_job %s --", given->kind);
    } else if (given->list == NULL) {
        printf("run_array --each %" PRId64 " --", given->each);
    } else {
        printf("run_array --list ");
        print_word(given->list);
        printf(" --");
    }
    for (int i = 0; i < given->words.count; i++) {
        putchar(' ');
        print_word(given->words.item[i]);
    }
    putchar('\n');
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_config of_job;
    V2V_TRY(check(given));
    if (v2v_step_on_root(session)) {
        rc = check_words(given, &of_job);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    if (v2v_step_on_root(session)) {
        /* its threads' cores; what the program counts, and a tenth for libraries */
        const int64_t threads =
            v2v_larger(session->config.parallel.threads, of_job.parallel.threads);
        const double memory_gb = given->memory_gb > 0.0
                                     ? given->memory_gb
                                     : 1.1 * of_job.parallel.max_mem_gb * (double)given->ranks;
        print_request(given, v2v_larger(threads, 1), memory_gb);
        print_start(given);
    }
done:
    return rc;
}

const struct v2v_command v2v_command_slurm = {
    .name = "slurm",
    .summary = "job script that trains or reconstructs on a Slurm cluster",
    .options = options,
    .bytes = sizeof(struct arguments),
    .run = run};
