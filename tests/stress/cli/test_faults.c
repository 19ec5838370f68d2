/* The fault points that commands pass, on one rank and on two: the job ends, in time, with a
 * failure; what RUN holds still is a complete checkpoint; no half-made output looks finished. */
#include "program.h"

#include <string.h>

enum phase { RESUMED, NETWORK, BY_TV, BY_RLD, BY_DINER, TO_TIFF, FROM_TIFF, DENOISED, PHASES };
enum { BASE_STEPS = 2 };

#define DECONVOLVE "deconvolve -c config.yaml --psf psf.h5 --input recording.h5 --iterations 3 "

/* Frames that the job before finished are there: forced. */
static const char *const commands[PHASES] = {
    [RESUMED] = TRAIN "run --steps 4 --resume",
    [NETWORK] = RECONSTRUCT "--weights run/weights.h5 -o volume.h5 --force",
    [BY_TV] = DECONVOLVE "--method tv -o volume.h5 --force",
    [BY_RLD] = DECONVOLVE "--method rld -o volume.h5 --force",
    [BY_DINER] = DECONVOLVE "--method diner -o volume.h5 --force",
    [TO_TIFF] = DECONVOLVE "--method rl -o volume.tif --force",
    [FROM_TIFF] = "preview made.tif -o picture.png --force",
    [DENOISED] = "denoise -c config.yaml --weights deepcad.h5 --input recording.h5 -o volume.h5 "
                 "--force"};
static const char *const outputs[] = {"volume.h5", "volume.tif", "picture.png"};

/* Which passages of a site fail, and whether it is the last rank's turn or rank 0's alone. */
static const struct site {
    const char *name;
    enum phase phase;
    int passes, everywhere;
} sites[] = {
    {"checkpoint.read", RESUMED, 1, 1},   {"checkpoint.write", RESUMED, 2, 0},
    {"file.write_text", RESUMED, 1, 0},   {"file.commit", RESUMED, 2, 0},
    {"json.print", RESUMED, 2, 0},        {"h5.create", RESUMED, 2, 0},
    {"h5.write", RESUMED, 2, 0},          {"h5.flush", RESUMED, 2, 0},
    {"reconstruct.frame", NETWORK, 1, 1}, {"h5.create", NETWORK, 1, 1},
    {"h5.write", NETWORK, 1, 1},          {"h5.mark", NETWORK, 2, 1},
    {"file.commit", NETWORK, 1, 0},       {"tv.iteration", BY_TV, 2, 1},
    {"rld.iteration", BY_RLD, 2, 1},      {"diner.step", BY_DINER, 2, 1},
    {"tiff.write_page", TO_TIFF, 1, 0},   {"volume.write", TO_TIFF, 1, 0},
    {"tiff.read", FROM_TIFF, 1, 0},       {"png.write", FROM_TIFF, 1, 0},
    {"denoise.unit", DENOISED, 1, 1},
};

static void assert_failed_in_time(int code, const char *fault, const char *text)
{
    /* 128 and above: a signal, of which SIGALRM is the time limit's; a bug ends by SIGABRT. Below
     * 64: none of the program's failures, but a sanitizer's exit (1, or 23 for a leak). */
    if (code < 64 || code >= 128) {
        fail_msg("%s: exit code %d\n%s", fault, code, text);
    }
}

/* One job with a fault; leaves RUN as it was. */
static int run_with(struct scene *scene, enum phase phase, int ranks, const char *fault, char *text)
{
    char copy[2 * PATH];
    snprintf(copy, sizeof copy, "rm -rf '%s/run' && cp -r '%s/base' '%s/run'", scene->folder,
             scene->folder, scene->folder);
    assert_int_equal(system(copy), 0);
    setenv("V2V_FAULT", fault, 1);
    int code = program_run(scene, ranks, commands[phase], text);
    unsetenv("V2V_FAULT");
    return code;
}

/* Exit code of a job with a fault: when it fails it must fail properly. */
static int check_fault(struct scene *scene, enum phase phase, int ranks, const char *fault)
{
    static char text[TEXT];
    int code = run_with(scene, phase, ranks, fault, text);
    if (code != 0) {
        assert_failed_in_time(code, fault, text);
        assert_true(scene_step(scene, program_file(scene, "run/weights.h5")) >= BASE_STEPS);
        for (size_t i = 0; i < sizeof outputs / sizeof *outputs; i++) {
            assert_false(v2v_file_exists(program_file(scene, outputs[i])));
        }
    }
    return code;
}

/* A finished run of two steps, to go on from; a volume as TIFF; weights that denoise. */
static void setup(struct scene *scene)
{
    static const char *const makes[] = {
        TRAIN "base --steps 2", DECONVOLVE "--method rl -o made.tif",
        "weights init -c config.yaml --psf psf.h5 --set model.method=deepcad -o deepcad.h5"};
    static char text[TEXT];
#ifndef V2V_FAULTS
    test_skip("this build has no fault points: -DV2V_FAULTS=ON");
#endif
    program_init(scene);
    for (size_t i = 0; i < sizeof makes / sizeof *makes; i++) {
        if (program_run(scene, 1, makes[i], text) != 0) {
            fail_msg("%s", text);
        }
    }
}

static void walk(int ranks)
{
    struct scene scene;
    char fault[64];
    setup(&scene);
    for (size_t i = 0; i < sizeof sites / sizeof *sites; i++) {
        const struct site *site = &sites[i];
        for (int nth = 1; nth <= site->passes; nth++) {
            snprintf(fault, sizeof fault, "%s:%d:%d", site->name, site->everywhere ? ranks - 1 : 0,
                     nth);
            if (check_fault(&scene, site->phase, ranks, fault) == 0) {
                fail_msg("%s went unnoticed", fault);
            }
            if (site->phase == NETWORK && strcmp(site->name, "file.commit") == 0) {
                /* all frames are done, and stay */
                assert_true(v2v_file_exists(program_file(&scene, "volume.h5.v2v3d-part")));
            }
        }
    }
    scene_fini(&scene);
}

static void every_fault_on_one_rank_ends_the_job_and_spares_the_checkpoint(void **state)
{
    (void)state;
    walk(1);
}

static void every_fault_on_two_ranks_ends_the_job_and_spares_the_checkpoint(void **state)
{
    (void)state;
    walk(2);
}

/* Memory runs out at every so-many-th allocation, until the job needs no more. */
static void walk_memory(enum phase phase, int ranks, int first, int stride)
{
    struct scene scene;
    char fault[64];
    int code = -1, failures = -1;
    setup(&scene);
    for (int nth = first; code != 0; nth += stride) {
        snprintf(fault, sizeof fault, "mem:%d:%d", ranks - 1, nth);
        code = check_fault(&scene, phase, ranks, fault);
        failures++;
    }
    print_message("%d ranks: %d failed allocations, one in %d\n", ranks, failures, stride);
    assert_true(failures > 0);
    scene_fini(&scene);
}

static void training_survives_no_memory_at_any_place(void **state)
{
    (void)state;
    walk_memory(RESUMED, 1, 1, 67);
    walk_memory(RESUMED, 2, 1, 101);
}

static void reconstruction_survives_no_memory_at_any_place(void **state)
{
    (void)state;
    walk_memory(NETWORK, 1, 2, 67);
    walk_memory(NETWORK, 2, 2, 101);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_fault_on_one_rank_ends_the_job_and_spares_the_checkpoint),
        cmocka_unit_test(every_fault_on_two_ranks_ends_the_job_and_spares_the_checkpoint),
        cmocka_unit_test(training_survives_no_memory_at_any_place),
        cmocka_unit_test(reconstruction_survives_no_memory_at_any_place),
    };
    return PROGRAM_OR_TESTS(tests, argc, argv);
}
