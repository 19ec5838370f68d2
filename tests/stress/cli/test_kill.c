/* kill -9 at any moment: training goes on from the last checkpoint, to the same bits as a run that
 * nobody touched. */
#include "program.h"

#include <signal.h>
#include <string.h>
#include <sys/wait.h>

enum { STEPS = 20, KILLS = 5 };

static void own_path(char path[PATH])
{
    ssize_t length = readlink("/proc/self/exe", path, PATH - 1);
    assert_true(length > 0);
    path[length] = '\0';
}

/* `v2v3d train .. -o NAME --resume` in the scene's folder. */
static pid_t spawn(const struct scene *scene, const char *name)
{
    char self[PATH];
    own_path(self);
    fflush(NULL);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        if (chdir(scene->folder) == 0) {
            execl(self, "v2v3d", "train", "--quiet", "-c", "config.yaml", "--psf", "psf.h5",
                  "--input", "recording.h5", "-o", name, "--resume", "--steps", "20", (char *)NULL);
        }
        _exit(127);
    }
    return child;
}

static int64_t lines_of(const char *path)
{
    int64_t lines = 0;
    FILE *file = fopen(path, "re");
    for (int c = file != NULL ? fgetc(file) : EOF; c != EOF; c = fgetc(file)) {
        lines += c == '\n';
    }
    if (file != NULL) {
        fclose(file);
    }
    return lines;
}

/* Kill a run once its log has `lines` lines and some microseconds have gone by. */
static void kill_after(const struct scene *scene, int64_t lines, int64_t microseconds)
{
    int status = 0, ended = 0;
    pid_t child = spawn(scene, "killed");
    while (!ended && lines_of(program_file(scene, "killed/metrics.jsonl")) < lines) {
        usleep(500);
        ended = waitpid(child, &status, WNOHANG) == child;
    }
    assert_false(ended); /* there are steps left to do */
    usleep((useconds_t)microseconds);
    kill(child, SIGKILL);
    assert_int_equal(waitpid(child, &status, 0), child);
}

static void finish(const struct scene *scene, const char *name)
{
    int status = 0;
    pid_t child = spawn(scene, name);
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

static void killed_runs_end_with_the_bits_of_an_untouched_one(void **state)
{
    (void)state;
    struct scene scene;
    float *whole = NULL, *killed = NULL;
    int64_t count = 0;
    program_init(&scene);
    finish(&scene, "whole");
    for (int i = 0; i < KILLS; i++) {
        /* a step with its checkpoint takes a few milliseconds: anywhere within it */
        kill_after(&scene, 3 * (i + 1), v2v_random_below(77, 0, (uint64_t)i, 10000));
    }
    finish(&scene, "killed");
    assert_ok(scene_arenas(&scene, program_file(&scene, "whole/weights.h5"), &whole, &count));
    assert_ok(scene_arenas(&scene, program_file(&scene, "killed/weights.h5"), &killed, &count));
    assert_memory_equal(whole, killed, (size_t)count * sizeof *whole);
    assert_int_equal(lines_of(program_file(&scene, "killed/metrics.jsonl")), STEPS);
    v2v_mem_free(whole);
    v2v_mem_free(killed);
    scene_fini(&scene);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(killed_runs_end_with_the_bits_of_an_untouched_one),
    };
    return PROGRAM_OR_TESTS(tests, argc, argv);
}
