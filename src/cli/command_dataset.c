#include "cli/steps.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/sim/dataset.h"
#include <inttypes.h>
#include <stdio.h>

struct arguments {
    struct v2v_common common;
    const char *psf, *folder, *noise, *size;
    struct v2v_words scenes;
    int64_t count, seed;
    int resume;
};

static const struct v2v_option options[] = {
    V2V_OPTION_PSF(struct arguments, psf, 1),
    {.name = "count",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, count),
     .value = "N",
     .help = "scenes in all",
     .required = 1,
     .least = 1,
     .most = 1e6},
    {.name = "seed",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, seed),
     .value = "S",
     .help = "scene n is that of simulate --seed S * 1000000 + n",
     .initial = "1",
     .least = 0,
     .most = 1e9},
    {.name = "output",
     .letter = 'o',
     .kind = V2V_OPTION_TEXT,
     .at = offsetof(struct arguments, folder),
     .value = "FOLDER",
     .help = "train, validation (one in ten) and test (one in ten): truth, clean and noisy views",
     .required = 1},
    {.name = "scenes",
     .kind = V2V_OPTION_LIST,
     .at = offsetof(struct arguments, scenes),
     .value = "KIND...",
     .help = "in turn, of " V2V_SCENE_KINDS "; default: all"},
    V2V_OPTION_NOISE(struct arguments, noise, "gaussian:0.2"),
    V2V_OPTION_SIZE(struct arguments, size),
    V2V_OPTION_SWITCH(struct arguments, resume, "resume", "make the scenes that are missing"),
    V2V_OPTION_NORMALIZE,
    V2V_OPTION_SET("pixel-size", "input.pixel_size_um", "UM", "of the scenes"),
    V2V_OPTION_SET("slice-spacing", "input.slice_spacing_um", "UM", "of the scenes"),
    {0}};

/* The kinds that are named; none: all. Memory of *kinds is the caller's to free. */
static enum v2v_status find_kinds(int **kinds, int64_t *count, const struct v2v_words *named)
{
    enum v2v_status rc = V2V_OK;
    const int64_t most = 32;
    int all = 0;
    while (v2v_scene_name(all) != NULL) {
        all++;
    }
    *count = named->count > 0 ? named->count : all;
    if (*count > most) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--scenes: %" PRId64 " kinds, %" PRId64 " at most", *count,
                         most));
    }
    V2V_TRY(V2V_ALLOC(*kinds, "cli.scenes", *count));
    for (int i = 0; i < *count; i++) {
        (*kinds)[i] = i;
        if (named->count > 0) {
            V2V_TRY(v2v_scene_find(&(*kinds)[i], named->item[i]));
        }
    }
done:
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file psf = {0};
    struct v2v_dataset_report report;
    struct v2v_dataset dataset = {.folder = given->folder,
                                  .count = given->count,
                                  .seed = given->seed,
                                  .noise = given->noise,
                                  .resume = given->resume,
                                  .force = session->force};
    int *kinds = NULL;
    V2V_TRY(v2v_noise_parse(&dataset.simulation.noise, given->noise));
    V2V_TRY(v2v_par_agree(session->world, find_kinds(&kinds, &dataset.kind_count, &given->scenes)));
    dataset.kinds = kinds;
    V2V_TRY(v2v_step_psf(session, &psf, given->psf));
    V2V_TRY(v2v_step_scene(&dataset.scene, &dataset.simulation, session, &psf, given->size));
    for (int64_t i = 0; i < dataset.kind_count; i++) {
        dataset.scene.kind = kinds[i];
        V2V_TRY(v2v_scene_check(&dataset.scene));
    }
    v2v_step_announce(session);
    V2V_TRY(v2v_dataset_make(&report, &dataset, &psf, session->world));
    if (v2v_step_on_root(session)) {
        printf("%s: %" PRId64 " scenes made, %" PRId64 " kept, in %.1f s\n", given->folder,
               report.made, report.kept, report.seconds);
    }
done:
    v2v_mem_free(kinds);
    v2v_psf_file_fini(&psf);
    return rc;
}

const struct v2v_command v2v_command_dataset = {
    .name = "dataset",
    .summary = "scenes with their recordings, for training and tests",
    .options = options,
    .bytes = sizeof(struct arguments),
    .run = run};
