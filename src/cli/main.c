#include "cli/command.h"
#include "cli/paths.h"
#include "cli/steps.h"
#include "cli/threads.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"
#include "v2v3d/op/gemm.h"
#include "v2v3d/par/watchdog.h"
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static const struct v2v_command *const commands[] = {
    &v2v_command_demo,       &v2v_command_psf_simulate, &v2v_command_psf_fit,
    &v2v_command_psf_info,   &v2v_command_simulate,     &v2v_command_dataset,
    &v2v_command_project,    &v2v_command_weights_init, &v2v_command_weights_info,
    &v2v_command_train,      &v2v_command_reconstruct,  &v2v_command_calibrate,
    &v2v_command_deconvolve, &v2v_command_denoise,      &v2v_command_evaluate,
    &v2v_command_bench,      &v2v_command_convert,      &v2v_command_preview,
    &v2v_command_info,       &v2v_command_check,        &v2v_command_init,
    &v2v_command_slurm};
enum { COMMANDS = sizeof commands / sizeof commands[0], LONGEST_NAME = 32 };

/* For MPI to start and the configuration to be read, which then decides: its own default. */
#define START_SECONDS 600.0

static void print_usage(void)
{
    printf("v2v3d %s: 3-D volumes from noisy multi-view light-field recordings\n\n"
           "Usage: v2v3d COMMAND [options], alone or under mpirun / srun\n\n",
           V2V_VERSION);
    for (int i = 0; i < COMMANDS; i++) {
        printf("  %-14s  %s\n", commands[i]->name, commands[i]->summary);
    }
    printf("\nv2v3d COMMAND --help tells a command's options, v2v3d --version the version.\n");
}

static void print_help(const struct v2v_command *command)
{
    const char *operand = "", *rest = "";
    for (const struct v2v_option *o = command->options; o->kind != V2V_OPTION_END; o++) {
        operand = o->kind == V2V_OPTION_OPERAND ? o->value : operand;
        rest = o->kind == V2V_OPTION_REST ? " -- ARGUMENT..." : rest;
    }
    printf("v2v3d %s: %s\n\nUsage: v2v3d %s [options] %s%s\n\n", command->name, command->summary,
           command->name, operand, rest);
    v2v_options_help(stdout, command->options);
}

/* How many words of argv name the command: 1, 2, or 0 for no match. */
static int match(const struct v2v_command *command, int argc, char *const *argv)
{
    const char *space = strchr(command->name, ' ');
    if (space == NULL) {
        return strcmp(argv[0], command->name) == 0;
    }
    size_t first = (size_t)(space - command->name);
    int same = strlen(argv[0]) == first && memcmp(argv[0], command->name, first) == 0 && argc > 1 &&
               strcmp(argv[1], space + 1) == 0;
    return 2 * same;
}

/* "psf" alone, or "psf nonsense". */
static int is_first_word(const char *word)
{
    size_t length = strlen(word);
    for (int i = 0; i < COMMANDS; i++) {
        if (strncmp(commands[i]->name, word, length) == 0 && commands[i]->name[length] == ' ') {
            return 1;
        }
    }
    return 0;
}

static enum v2v_status unknown_command(int argc, char *const *argv)
{
    const char *names[COMMANDS];
    char typed[LONGEST_NAME];
    for (int i = 0; i < COMMANDS; i++) {
        names[i] = commands[i]->name;
    }
    if (is_first_word(argv[0])) {
        return argc > 1 ? V2V_FAIL(V2V_E_USAGE, "v2v3d: unknown command '%s %s' (see v2v3d --help)",
                                   argv[0], argv[1])
                        : V2V_FAIL(V2V_E_USAGE, "v2v3d: %s needs one more word (see v2v3d --help)",
                                   argv[0]);
    }
    snprintf(typed, sizeof typed, "%s", argv[0]);
    const char *nearest = v2v_text_nearest(typed, names, COMMANDS);
    return V2V_FAIL(V2V_E_USAGE, "v2v3d: unknown command '%s'%s%s%s (see v2v3d --help)", argv[0],
                    nearest != NULL ? "; did you mean '" : "", nearest != NULL ? nearest : "",
                    nearest != NULL ? "'?" : "");
}

/* The command's own file, where none is given: ranks are those of now. Rank-0. */
static enum v2v_status load_usual(struct v2v_config *config, const struct v2v_command *command,
                                  const struct v2v_common *common)
{
    enum v2v_status rc = V2V_OK;
    char path[V2V_PATH_BYTES];
    const struct v2v_config before = *config;
    if (command->usual_config != NULL && command->usual_config(path, sizeof path, common)) {
        V2V_TRY(v2v_config_load(config, path));
        config->parallel = before.parallel;
        v2v_log(V2V_LOG_INFO, "settings: %s, and the command line", path);
    }
done:
    return rc;
}

/* Settings in their order: defaults, the command's preset, the file, the command line. Rank 0
 * reads, so that all ranks hold the same even when the file changes meanwhile. */
static enum v2v_status settle_config(struct v2v_session *session, const struct v2v_command *command,
                                     const struct v2v_common *common)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_config *config = &session->config;
    v2v_config_defaults(config);
    for (const char *const *line = command->preset; line != NULL && *line != NULL; line++) {
        V2V_TRY(v2v_config_set(config, *line));
    }
    if (v2v_comm_rank(session->world) == 0) {
        rc = common->config != NULL ? v2v_config_load(config, common->config)
                                    : load_usual(config, command, common);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_par_broadcast(session->world, config, (int64_t)sizeof *config, 0);
    V2V_TRY(v2v_options_apply(common, config));
done:
    return rc;
}

static enum v2v_status prepare(struct v2v_session *session, const struct v2v_command *command,
                               const struct v2v_common *common)
{
    enum v2v_status rc = V2V_OK;
    v2v_log_configure(common->quiet     ? V2V_LOG_WARNING
                      : common->verbose ? V2V_LOG_DEBUG
                                        : V2V_LOG_INFO,
                      v2v_comm_rank(session->world));
    session->common = common;
    session->force = common->force;
    session->quiet = common->quiet;
    V2V_TRY(settle_config(session, command, common));
    v2v_mem_set_limit((size_t)(1e9 * session->config.parallel.max_mem_gb));
    int64_t threads = session->config.parallel.threads;
    if (threads == 0 && session->config.parallel.reproducible) {
        threads = 1; /* cores / ranks would be another number at another rank count */
    }
    session->threads = v2v_cli_threads(threads, session->world);
    v2v_op_set_threads(session->threads);
    v2v_log(V2V_LOG_DEBUG, "%s: %d ranks x %d threads", command->name,
            v2v_comm_size(session->world), session->threads);
done:
    return rc;
}

/* Of a pipe. An earlier write may have failed for that, and its errno is gone. */
static int reader_is_gone(void)
{
    struct pollfd out = {.fd = STDOUT_FILENO, .events = POLLOUT};
    return poll(&out, 1, 0) == 1 && (out.revents & (POLLERR | POLLHUP)) != 0;
}

/* What is left in stdout's buffer must arrive; a reader that went away (| head) is fine. */
static enum v2v_status flush_results(void)
{
    errno = 0;
    if (fflush(stdout) == 0 && !ferror(stdout)) {
        return V2V_OK;
    }
    const int reason = errno;
    return reason == EPIPE || reader_is_gone()
               ? V2V_OK
               : V2V_FAIL(V2V_E_IO, "standard output: %s",
                          reason != 0 ? strerror(reason) : "not all could be written");
}

/* A proof is an empty file: one that is there already, of an earlier run, is none of a user's, and
 * proves nothing of this one. Rank-0. */
static enum v2v_status clear_proof(const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct stat state;
    if (stat(path, &state) == 0 && (!S_ISREG(state.st_mode) || state.st_size > 0)) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--proof %s: exists, and is no proof", path));
    }
    V2V_TRY(v2v_file_check_output(path, 1, NULL, 0));
    if (unlink(path) != 0 && errno != ENOENT) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "--proof %s: %s", path, strerror(errno)));
    }
done:
    return rc;
}

static enum v2v_status run_parsed(const struct v2v_command *command,
                                  const struct v2v_common *arguments, struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    if (arguments->help) {
        if (v2v_comm_rank(session->world) == 0) {
            print_help(command);
        }
    } else {
        const int proves = arguments->proof != NULL && v2v_comm_rank(session->world) == 0;
        V2V_TRY(v2v_par_agree(session->world, proves ? clear_proof(arguments->proof) : V2V_OK));
        V2V_TRY(prepare(session, command, arguments));
        /* a rank alone waits for nobody, and may take as long as it wants for a large frame */
        v2v_watchdog_set_period(
            v2v_comm_size(session->world) > 1 ? session->config.parallel.watchdog_s : 0.0);
        v2v_watchdog_disarm(); /* the start is over, and the period may be off */
        v2v_watchdog_beat(command->name);
        rc = command->run(arguments, session);
        v2v_calibration_fini(&session->calibration);
        /* agreement and MPI's end wait for the others, too */
        v2v_watchdog_beat("the end of a command");
        V2V_TRY(v2v_par_agree(session->world, rc)); /* nothing is proved by one rank */
        if (arguments->mem_report) {
            v2v_mem_report();
        }
    }
    V2V_TRY(v2v_par_agree(session->world, flush_results()));
    if (arguments->proof != NULL && v2v_comm_rank(session->world) == 0) {
        V2V_TRY(clear_proof(arguments->proof)); /* it may be what the command wrote */
        V2V_TRY(v2v_file_write_text(arguments->proof, ""));
    }
done:
    return rc;
}

/* The command line as one line of text, for provenance. */
static enum v2v_status join_words(char **line, int argc, char *const *argv)
{
    enum v2v_status rc = V2V_OK;
    static const char program[] = "v2v3d";
    int64_t bytes = sizeof program;
    for (int i = 0; i < argc; i++) {
        bytes += 1 + (int64_t)strlen(argv[i]);
    }
    V2V_TRY(V2V_ALLOC(*line, "cli.command_line", bytes));
    int64_t end = (int64_t)sizeof program - 1;
    memcpy(*line, program, (size_t)end);
    for (int i = 0; i < argc; i++) {
        size_t length = strlen(argv[i]);
        (*line)[end] = ' ';
        memcpy(*line + end + 1, argv[i], length);
        end += 1 + (int64_t)length;
    }
done:
    return rc;
}

/* Put the command's name before the message, and the way to its help behind a usage error. */
static enum v2v_status name_failure(enum v2v_status rc, const char *name)
{
    char message[V2V_MESSAGE_BYTES], hint[64] = "";
    const char *old = v2v_step_message();
    if (rc == V2V_E_USAGE) {
        snprintf(hint, sizeof hint, " (see v2v3d %s --help)", name);
    }
    snprintf(message, sizeof message, "v2v3d %s: %.800s%s", name,
             old[0] != '\0' ? old : v2v_status_name(rc), hint);
    v2v_status_set_message(message, v2v_status_place());
    return rc;
}

enum v2v_status v2v_cli_run(int argc, char *const *argv, struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_command *command = NULL;
    struct v2v_common *arguments = NULL;
    struct v2v_session session = {.world = world};
    char *command_line = NULL;
    int words = 0;
    for (int i = 0; i < COMMANDS && words == 0; i++) {
        words = match(commands[i], argc, argv);
        command = words > 0 ? commands[i] : NULL;
    }
    if (command == NULL) {
        return unknown_command(argc, argv); /* the same on all ranks */
    }
    rc = join_words(&command_line, argc, argv);
    session.command_line = command_line;
    if (rc == V2V_OK) {
        arguments = v2v_mem_alloc("cli.arguments", 1, command->bytes);
        rc = arguments == NULL
                 ? V2V_E_MEMORY
                 : v2v_options_parse(arguments, command->options, argc - words, argv + words);
    }
    V2V_TRY(v2v_par_agree(world, rc));
    V2V_ASSERT(arguments != NULL); /* agreement is never better than this rank's own code */
    rc = run_parsed(command, arguments, &session);
    V2V_TRY(v2v_par_agree(world, rc));
done:
    if (arguments != NULL) {
        v2v_options_fini(arguments, command->options);
    }
    v2v_mem_free(arguments);
    v2v_mem_free(command_line);
    return rc == V2V_OK ? rc : name_failure(rc, command->name);
}

static enum v2v_status run_program(int argc, char *const *argv, struct v2v_comm *world)
{
    int on_root = v2v_comm_rank(world) == 0;
    if (argc < 2) {
        return V2V_FAIL(V2V_E_USAGE, "v2v3d: a command is missing (see v2v3d --help)");
    }
    if (strcmp(argv[1], "--version") == 0) {
        if (on_root) {
            printf("v2v3d %s\n", V2V_VERSION);
        }
        return v2v_par_agree(world, flush_results());
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0 ||
        (argc == 3 && is_first_word(argv[1]) && strcmp(argv[2], "--help") == 0)) {
        if (on_root) {
            print_usage();
        }
        return v2v_par_agree(world, flush_results());
    }
    return v2v_cli_run(argc - 1, argv + 1, world);
}

/* HDF5 1.10 closes what a failed close has left, here or on another rank, once more when MPI or the
 * process ends, and then can crash or wait for ever. */
static _Noreturn void leave_without_end(enum v2v_status rc, const struct v2v_comm *world)
{
    if (v2v_comm_size(world) > 1) {
        if (rc == V2V_E_IO) { /* then all ranks are here; rank 0 has said why */
            v2v_par_barrier(world);
        }
        v2v_par_abort(v2v_status_exit_code(rc));
    }
    (void)fflush(stdout);
    _exit(v2v_status_exit_code(rc));
}

int v2v_cli_main(int argc, char **argv)
{
    struct v2v_comm *world = NULL;
    if (argc == 3 && strcmp(argv[1], V2V_CLI_TRY_PATH) == 0) {
        return v2v_cli_try_path(argv[2]);
    }
    v2v_file_guard_start();
    v2v_watchdog_arm(START_SECONDS, "the start");
    enum v2v_status rc = v2v_par_init(&world, &argc, &argv);
    int on_root = v2v_comm_rank(world) == 0;
    if (rc == V2V_OK) {
        signal(SIGPIPE, SIG_IGN); /* a closed pipe is a failed write, not the end of the job, .. */
        signal(SIGXFSZ, SIG_IGN); /* .. nor is a file that may not get longer (ulimit -f) */
        v2v_stop_install();
        rc = run_program(argc, argv, world);
    }
    if (rc != V2V_OK && on_root) {
        fprintf(stderr, "%s\n", v2v_status_message());
    }
    if (rc == V2V_STOPPED) {
        /* All ranks have agreed on it. srun and mpirun end the others when the first has left with
         * 85: that shall not look like a crash. */
        signal(SIGTERM, SIG_IGN);
    }
    if (rc != V2V_OK && ((rc == V2V_E_IO && v2v_comm_size(world) > 1) || v2v_file_left_open())) {
        leave_without_end(rc, world);
    }
    if (world != NULL) { /* where it could not start, v2v_par_init has ended MPI */
        v2v_par_finalize(&world);
    }
    v2v_watchdog_disarm();
    v2v_file_guard_stop();
    if (v2v_mem_held() != 0) {
        v2v_log(V2V_LOG_WARNING, "%zu bytes are still held at the end", v2v_mem_held());
    }
    return v2v_status_exit_code(rc);
}
