/** These tests are the program, too: with arguments they are `v2v3d`, under a time limit. */
#ifndef TEST_PROGRAM_H
#define TEST_PROGRAM_H

#include "small_run.h"

#include "capture.h"
#include "cli/command.h"
#include "v2v3d/io/file.h"

#include <limits.h>
#include <stdlib.h>
#include <unistd.h>

/** A job that takes longer hangs: SIGALRM ends it. The slowest here takes a second on an idle core.
 */
enum { LIMIT_SECONDS = V2V_TEST_SECONDS / 5, TEXT = 1 << 14 };

/** The main() of these tests: the program when there are arguments. */
#define PROGRAM_OR_TESTS(tests, argc, argv)                                                        \
    ((argc) > 1 ? (alarm(LIMIT_SECONDS), v2v_cli_main(argc, argv))                                 \
                : cmocka_run_group_tests(tests, NULL, NULL))

/** Optics, recording and configuration as files of the scene's folder. */
static inline void program_init(struct scene *scene)
{
    char path[PATH];
    scene_init(scene, test_folder(NULL), 1, NULL);
    scene->config.train.checkpoint_every_s = 0.0;
    scene_record(scene, "recording.h5", scene_wave);
    snprintf(path, sizeof path, "%s/psf.h5", scene->folder);
    assert_ok(v2v_psf_file_write(&scene->psf, path));
    snprintf(path, sizeof path, "%s/config.yaml", scene->folder);
    FILE *config = fopen(path, "we");
    assert_non_null(config);
    v2v_config_print(&scene->config, config, NULL, 0);
    assert_int_equal(fclose(config), 0);
}

/** Run a command of the program in the scene's folder; its exit code. */
static inline int program_run(const struct scene *scene, int ranks, const char *command,
                              char text[TEXT])
{
    char here[PATH_MAX];
    assert_non_null(getcwd(here, sizeof here));
    assert_int_equal(chdir(scene->folder), 0);
    int code = test_own_job(ranks, command, text, TEXT);
    assert_int_equal(chdir(here), 0);
    return code;
}

#define TRAIN "train -c config.yaml --psf psf.h5 --input recording.h5 -o "
#define RECONSTRUCT "reconstruct -c config.yaml --psf psf.h5 --input recording.h5 "

static inline const char *program_file(const struct scene *scene, const char *name)
{
    static char path[PATH];
    snprintf(path, sizeof path, "%s/%s", scene->folder, name);
    return path;
}

#endif
