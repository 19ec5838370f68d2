/* A rank that is killed or stopped at any moment of training or reconstruction: the job ends within
 * the watchdog's time. */
#include "program.h"

#include <dirent.h>
#include <fcntl.h>
#include <signal.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>

/* Longer than any step here on a busy machine with a core for two ranks. */
#define WATCHDOG "--set parallel.watchdog_s=8 "
#define FOR_EVER "--steps 1000000 --set train.checkpoint_every_s=1000 "

static void own_path(char path[PATH])
{
    ssize_t length = readlink("/proc/self/exe", path, PATH - 1);
    assert_true(length > 0);
    path[length] = '\0';
}

/* `mpirun .. v2v3d COMMAND` in the scene's folder, all that it says in the file `said`. */
static pid_t spawn(const struct scene *scene, int ranks, const char *command)
{
    char self[PATH], line[3 * PATH];
    own_path(self);
    snprintf(line, sizeof line,
             "exec mpirun --allow-run-as-root --oversubscribe --bind-to none -n %d '%s' %s "
             ">said 2>&1",
             ranks, self, command);
    fflush(NULL);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        if (chdir(scene->folder) == 0) {
            execl("/bin/sh", "sh", "-c", line, (char *)NULL);
        }
        _exit(127);
    }
    return child;
}

/* Does the file hold this text? Zeros end environment variables. */
static int holds(const char *path, const char *text)
{
    static char content[1 << 16];
    FILE *file = fopen(path, "re");
    size_t got = file != NULL ? fread(content, 1, sizeof content - 1, file) : 0;
    if (file != NULL) {
        fclose(file);
    }
    return memmem(content, got, text, strlen(text)) != NULL;
}

/* The process of a rank of the job that mpirun `launcher` started; 0 when there is none (yet). */
static pid_t find_rank(pid_t launcher, int rank)
{
    char path[PATH], parent[32], variable[64];
    struct dirent *entry = NULL;
    pid_t found = 0;
    DIR *folder = opendir("/proc");
    assert_non_null(folder);
    snprintf(parent, sizeof parent, "PPid:\t%d\n", (int)launcher);
    snprintf(variable, sizeof variable, "OMPI_COMM_WORLD_RANK=%d", rank);
    while (found == 0 && (entry = readdir(folder)) != NULL) {
        long process = strtol(entry->d_name, NULL, 10);
        if (process <= 0) {
            continue;
        }
        snprintf(path, sizeof path, "/proc/%ld/status", process);
        int is_child = holds(path, parent);
        snprintf(path, sizeof path, "/proc/%ld/environ", process);
        found = is_child && holds(path, variable) ? (pid_t)process : 0;
    }
    closedir(folder);
    return found;
}

/* A job under way, as a file in the scene's folder tells, that loses a rank some time later. */
static void lose(const struct scene *scene, int ranks, const char *command, const char *sign,
                 int rank, int number, int64_t microseconds, char text[TEXT])
{
    struct stat state;
    int status = 0;
    pid_t child = spawn(scene, ranks, command);
    while (stat(program_file(scene, sign), &state) != 0 || state.st_size == 0) {
        assert_int_equal(waitpid(child, &status, WNOHANG), 0);
        usleep(2000);
    }
    usleep((useconds_t)microseconds);
    pid_t lost = find_rank(child, rank);
    assert_true(lost > 0);
    assert_int_equal(kill(lost, number), 0);
    assert_int_equal(waitpid(child, &status, 0), child);
    FILE *said = fopen(program_file(scene, "said"), "re");
    assert_non_null(said);
    text[fread(text, 1, TEXT - 1, said)] = '\0';
    fclose(said);
    assert_true(!WIFEXITED(status) || WEXITSTATUS(status) != 0);
}

/* mpirun tells of a rank that was killed, and stops the others at once; a stopped one is missed by
 * the ranks that wait for it, of which one is the first to say so. */
static void check_lost(const struct scene *scene, int ranks, const char *command, const char *sign,
                       uint64_t draw)
{
    static char text[TEXT];
    char killed[64], missed[64];
    int rank = (int)v2v_random_below(61, 0, draw, (uint64_t)ranks);
    snprintf(killed, sizeof killed, "process rank %d with PID", rank);
    snprintf(missed, sizeof missed, "error (rank %d)", rank);
    for (int is_stop = 0; is_stop < 2; is_stop++) {
        uint64_t at = v2v_random_below(62, (uint64_t)is_stop, draw, 400000);
        char clean[PATH + 64];
        snprintf(clean, sizeof clean, "cd '%s' && rm -rf run long.h5*", scene->folder);
        assert_int_equal(system(clean), 0);
        lose(scene, ranks, command, sign, rank, is_stop ? SIGSTOP : SIGKILL, (int64_t)at, text);
        const char *first = strstr(text, "error (rank ");
        if (is_stop ? first == NULL || strncmp(first, missed, strlen(missed)) == 0 ||
                          strstr(first, "the watchdog ends the job") == NULL
                    : strstr(text, killed) == NULL) {
            fail_msg("%d ranks, rank %d %s after %d us: %s", ranks, rank,
                     is_stop ? "stopped" : "killed", (int)at, text);
        }
    }
}

static void training_without_a_rank_ends(void **state)
{
    (void)state;
    struct scene scene;
    program_init(&scene);
    check_lost(&scene, 2, TRAIN "run " FOR_EVER WATCHDOG, "run/metrics.jsonl", 2);
    check_lost(&scene, 3, TRAIN "run " FOR_EVER WATCHDOG "--set parallel.branches=1",
               "run/metrics.jsonl", 9);
    scene_fini(&scene);
}

/* A recording long enough to be still under way when the rank goes: one frame over and over. */
static void reconstruction_without_a_rank_ends(void **state)
{
    (void)state;
    static char text[TEXT];
    static const char *const steps[] = {
        TRAIN "base --steps 1", RECONSTRUCT "--weights base/weights.h5 -o short.h5",
        "simulate --psf psf.h5 --volume short.h5 -o long_recording.h5 --frames 4000"};
    struct scene scene;
    program_init(&scene);
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++) {
        if (program_run(&scene, 1, steps[i], text) != 0) {
            fail_msg("%s: %s", steps[i], text);
        }
    }
    check_lost(&scene, 3,
               "reconstruct --psf psf.h5 --input long_recording.h5 --weights base/weights.h5 "
               "-o long.h5 " WATCHDOG,
               "long.h5.v2v3d-part", 13);
    scene_fini(&scene);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(training_without_a_rank_ends),
        cmocka_unit_test(reconstruction_without_a_rank_ends),
    };
    return PROGRAM_OR_TESTS(tests, argc, argv);
}
