#include "cli/demo.h"
#include "cli/demo_preset.h"
#include "cli/steps.h"
#include "cli/unused_settings.h"

#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/base/text.h"
#include "v2v3d/sim/scene.h"
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct arguments {
    struct v2v_common common;
    const char *folder, *max_time;
};

static const struct v2v_option options[] = {{.name = "output",
                                             .letter = 'o',
                                             .kind = V2V_OPTION_TEXT,
                                             .at = offsetof(struct arguments, folder),
                                             .value = "FOLDER",
                                             .help = "for everything that the demo makes",
                                             .initial = "demo-out"},
                                            {.name = "max-time",
                                             .kind = V2V_OPTION_TEXT,
                                             .at = offsetof(struct arguments, max_time),
                                             .value = "TIME",
                                             .help = "most time for the training",
                                             .initial = "260s"},
                                            {0}};

enum v2v_status v2v_demo_path(char path[V2V_PATH_BYTES], const struct v2v_demo *demo,
                              const char *name)
{
    return v2v_text_format(path, V2V_PATH_BYTES, "%s/%s", demo->folder, name);
}

/* Run one command line as a user would type it; "@name" stands for a file in the demo's folder. */
static enum v2v_status command(const struct v2v_demo *demo, const char *const *words)
{
    enum { MOST = 24, EXTRA = 3 };
    enum v2v_status rc = V2V_OK;
    const struct v2v_session *session = demo->session;
    char(*path)[V2V_PATH_BYTES] = NULL, threads[32];
    char force[] = "--force", quiet[] = "--quiet";
    char *argv[MOST + EXTRA];
    int argc = 0;
    rc = V2V_ALLOC(path, "demo.words", MOST);
    V2V_TRY(v2v_par_agree(session->world, rc));
    snprintf(threads, sizeof threads, "--threads=%d", session->threads);
    for (; words[argc] != NULL; argc++) {
        V2V_ASSERT(argc < MOST);
        V2V_TRY(words[argc][0] == '@'
                    ? v2v_demo_path(path[argc], demo, words[argc] + 1)
                    : v2v_text_format(path[argc], V2V_PATH_BYTES, "%s", words[argc]));
        argv[argc] = path[argc];
    }
    argv[argc++] = threads;
    if (session->force) {
        argv[argc++] = force;
    }
    if (session->quiet) {
        argv[argc++] = quiet;
    }
    V2V_TRY(v2v_cli_run(argc, argv, session->world));
done:
    v2v_mem_free(path);
    return rc;
}

static const char *const made[] = {"config.yaml", "psf.h5",       "truth.h5",      "recording.h5",
                                   "run",         "volume.h5",    "rld.h5",        "rld_best.h5",
                                   "results.txt", "results.json", "comparison.png"};

static enum v2v_status check_name(const struct v2v_demo *demo)
{
    return strstr(demo->folder, "%n") == NULL
               ? V2V_OK
               : V2V_FAIL(V2V_E_USAGE,
                          "%s: in names of outputs %%n stands for that of a recording; choose "
                          "another folder",
                          demo->folder);
}

/* None of what a demo makes may be there. Rank 0. */
static enum v2v_status check_folder(const struct v2v_demo *demo)
{
    enum v2v_status rc = V2V_OK;
    char path[V2V_PATH_BYTES];
    for (size_t i = 0; i < sizeof made / sizeof made[0] && !demo->session->force; i++) {
        V2V_TRY(v2v_demo_path(path, demo, made[i]));
        if (v2v_file_exists(path)) {
            V2V_TRY(V2V_FAIL(V2V_E_USAGE,
                             "%s: holds a demo already, or another %s; --force makes it anew",
                             demo->folder, made[i]));
        }
    }
done:
    return rc;
}

/* Others may not make a demo there meanwhile. */
static enum v2v_status open_folder(struct v2v_demo *demo)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_session *session = demo->session;
    char path[V2V_PATH_BYTES];
    char *text = NULL;
    if (v2v_step_on_root(session)) {
        V2V_TRY(check_name(demo));
        V2V_TRY(v2v_file_make_folder(demo->folder));
        V2V_TRY(v2v_demo_path(path, demo, "config.yaml"));
        V2V_TRY(v2v_file_lock_output(&demo->lock, demo->lock_name, path));
        V2V_TRY(check_folder(demo));
        V2V_TRY(v2v_config_text(&text, &session->config, NULL, 0));
        V2V_TRY(v2v_file_write_text(path, text));
    }
done:
    free(text);
    return v2v_par_agree(session->world, rc);
}

/* The scene as a volume of the PSFs' depth. */
static enum v2v_status write_scene(const struct v2v_demo *demo)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_session *session = demo->session;
    const struct v2v_config *config = &session->config;
    struct v2v_volume_writer *writer = NULL;
    float *volume = NULL;
    struct v2v_scene scene = {.slices = config->optics.slices,
                              .height = config->demo.size,
                              .width = config->demo.size,
                              .slice_um = 1,
                              .pixel_um = 1,
                              .seed = (uint64_t)config->demo.seed};
    char path[V2V_PATH_BYTES];
    struct v2v_volume_info info = {.frames = 1,
                                   .slices = config->optics.slices,
                                   .height = config->demo.size,
                                   .width = config->demo.size,
                                   .pixel_size_um = config->optics.pixel_size_um,
                                   .slice_spacing_um = config->optics.slice_spacing_um};
    struct v2v_part mine =
        v2v_par_part(info.slices, v2v_comm_size(session->world), v2v_comm_rank(session->world));
    V2V_TRY(v2v_demo_path(path, demo, "truth.h5"));
    V2V_TRY(v2v_step_output(session, path, NULL, 0));
    V2V_TRY(v2v_scene_find(&scene.kind, "mixed"));
    rc = V2V_ALLOC(volume, "demo.scene", v2v_mem_product(mine.count, info.height, info.width));
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_scene_draw(volume, &scene, 0, mine.first, mine.count);
    V2V_TRY(
        v2v_volume_create(&writer, path, &info, 1u << V2V_VOLUME_MEAN, NULL, 0, session->world));
    V2V_TRY(v2v_step_write_slices(session, writer, volume, 0, mine));
    V2V_TRY(v2v_volume_finish(&writer));
done:
    v2v_volume_abandon(&writer);
    v2v_mem_free(volume);
    return rc;
}

/* The time limit ends the training, not the demo; a signal ends both. */
static enum v2v_status train(const struct v2v_demo *demo, const char *max_time)
{
    const char *const words[] = {"train",   "-c",         "@config.yaml",  "--psf",
                                 "@psf.h5", "--input",    "@recording.h5", "-o",
                                 "@run",    "--max-time", max_time,        NULL};
    enum v2v_status rc = command(demo, words);
    int64_t signalled = v2v_stop_requested();
    v2v_par_max_i64(demo->session->world, &signalled, 1);
    return rc != V2V_STOPPED ? rc
           : signalled       ? V2V_FAIL(rc, "stopped on request; --force begins it anew")
                             : V2V_OK;
}

static enum v2v_status make_recording(const struct v2v_demo *demo)
{
    enum v2v_status rc = V2V_OK;
    char noise[64], seed[32], frames[32];
    const struct v2v_demo_settings *settings = &demo->session->config.demo;
    const char *const optics[] = {"psf", "simulate", "-c", "@config.yaml", "-o", "@psf.h5", NULL};
    const char *const simulate[] = {"simulate", "--psf",         "@psf.h5", "--volume", "@truth.h5",
                                    "-o",       "@recording.h5", "--noise", noise,      "--seed",
                                    seed,       "--frames",      frames,    NULL};
    snprintf(noise, sizeof noise, "gaussian:%.12g", settings->noise);
    snprintf(seed, sizeof seed, "%" PRId64, settings->seed);
    snprintf(frames, sizeof frames, "%" PRId64, settings->frames);
    V2V_TRY(command(demo, optics));
    V2V_TRY(write_scene(demo));
    V2V_TRY(command(demo, simulate));
done:
    return rc;
}

static enum v2v_status make_volumes(struct v2v_demo *demo)
{
    enum v2v_status rc = V2V_OK;
    const char *const reconstruct[] = {"reconstruct",     "--psf",   "@psf.h5",       "--weights",
                                       "@run/weights.h5", "--input", "@recording.h5", "-o",
                                       "@volume.h5",      NULL};
    V2V_TRY(command(demo, reconstruct));
    V2V_TRY(v2v_demo_deconvolve(demo));
done:
    return rc;
}

static enum v2v_status evaluate(struct v2v_demo *demo)
{
    static const char *const names[V2V_DEMO_ROWS] = {
        [V2V_DEMO_NETWORK] = "volume.h5",
        [V2V_DEMO_RLD] = "rld.h5",
        [V2V_DEMO_RLD_BEST] = "rld_best.h5",
    };
    enum v2v_status rc = V2V_OK;
    char volume[V2V_PATH_BYTES], truth[V2V_PATH_BYTES], psf[V2V_PATH_BYTES], input[V2V_PATH_BYTES];
    struct v2v_evaluation_job job = {.volume = volume, .truth = truth, .psf = psf, .input = input};
    V2V_TRY(v2v_demo_path(truth, demo, "truth.h5"));
    V2V_TRY(v2v_demo_path(psf, demo, "psf.h5"));
    V2V_TRY(v2v_demo_path(input, demo, "recording.h5"));
    for (int row = 0; row < V2V_DEMO_ROWS; row++) {
        V2V_TRY(v2v_demo_path(volume, demo, names[row]));
        V2V_TRY(v2v_evaluation_run(&demo->evaluation[row], &job, demo->session));
    }
done:
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_demo demo = {.session = session,
                            .folder = given->folder,
                            .lock = -1,
                            .iterations = session->config.demo.rld_iterations};
    double started = v2v_clock_now();
    V2V_TRY(open_folder(&demo));
    v2v_step_announce(session);
    if (v2v_step_on_root(session)) {
        v2v_unused_settings_warn_command("demo", session);
    }
    V2V_TRY(make_recording(&demo));
    V2V_TRY(train(&demo, given->max_time));
    V2V_TRY(make_volumes(&demo));
    V2V_TRY(evaluate(&demo));
    V2V_TRY(v2v_demo_pictures(&demo));
    demo.seconds = v2v_clock_now() - started;
    if (v2v_step_on_root(session)) {
        rc = v2v_demo_table(&demo);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
done:
    for (int row = 0; row < V2V_DEMO_ROWS; row++) {
        v2v_evaluation_fini(&demo.evaluation[row]);
    }
    v2v_mem_free(demo.curve);
    v2v_file_unlock_output(&demo.lock, demo.lock_name);
    return rc;
}

const struct v2v_command v2v_command_demo = {
    .name = "demo",
    .summary = "everything once, without input: simulate, train, reconstruct, compare",
    .options = options,
    .bytes = sizeof(struct arguments),
    .preset = demo_preset,
    .run = run};
