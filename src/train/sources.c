#include "train/sources.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/method/estimator.h"
#include "v2v3d/par/agreement.h"

#include <stdio.h>

enum { NAME_BYTES = 32 };

const struct v2v_recording_info *v2v_source_info(const struct v2v_source *source)
{
    return v2v_recording_info(source->of.recording);
}

const struct v2v_source *v2v_sources_of(const struct v2v_sources *sources, int64_t frame)
{
    const struct v2v_source *source = &sources->list[0];
    for (int64_t i = 1; i < sources->count && sources->list[i].first <= frame; i++) {
        source = &sources->list[i];
    }
    return source;
}

static enum v2v_status check_views(const struct v2v_sources *sources, int64_t psf_views)
{
    for (int64_t i = 0; i < sources->count; i++) {
        const struct v2v_recording_info *info = v2v_source_info(&sources->list[i]);
        if (info->views != psf_views) {
            return V2V_FAIL(V2V_E_INPUT, "recording %lld has %lld views, the PSF set %lld",
                            (long long)i + 1, (long long)info->views, (long long)psf_views);
        }
    }
    return V2V_OK;
}

/* Is there what examples are made of? */
static enum v2v_status check_examples(const struct v2v_sources *sources)
{
    const struct v2v_examples *examples = sources->examples;
    for (int64_t i = 0; examples != NULL && i < sources->count; i++) {
        const struct v2v_source *source = &sources->list[i];
        const struct v2v_recording_info *info = v2v_source_info(source);
        if (info->frames < examples->frames) {
            return V2V_FAIL(V2V_E_INPUT,
                            "recording %lld has %lld frames; learning from %s takes %lld or more",
                            (long long)i + 1, (long long)info->frames, examples->ops->name,
                            (long long)examples->frames);
        }
        if (!examples->ops->needs_truth) {
            continue;
        }
        const struct v2v_volume_info *truth = v2v_volume_info(source->of.truth);
        if (truth->slices != examples->outputs || truth->height != info->height ||
            truth->width != info->width || (truth->frames != 1 && truth->frames != info->frames)) {
            return V2V_FAIL(V2V_E_INPUT,
                            "truth %lld has %lld frames of %lld x %lld x %lld voxels, its "
                            "recording %lld of %lld x %lld pixels, the PSF set %lld slices",
                            (long long)i + 1, (long long)truth->frames, (long long)truth->slices,
                            (long long)truth->height, (long long)truth->width,
                            (long long)info->frames, (long long)info->height,
                            (long long)info->width, (long long)examples->outputs);
        }
    }
    return V2V_OK;
}

struct units {
    struct v2v_example_source *source;
    const struct v2v_psf_file *psf;
};

static enum v2v_status find_units_of(void *context)
{
    const struct units *units = context;
    return v2v_examples_truth_units(units->source, units->psf);
}

/* Rank 0 reads, and its answer is all ranks': others may round another way. */
static enum v2v_status find_units(struct v2v_sources *sources, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_examples *examples = sources->examples;
    const int is_wanted = examples != NULL && examples->ops->needs_truth;
    for (int64_t i = 0; i < sources->count && is_wanted; i++) {
        struct units units = {&sources->list[i].of, examples->psf};
        V2V_TRY(v2v_agreement_alone(comm, find_units_of, &units));
        v2v_par_broadcast(comm, &units.source->units, sizeof units.source->units, 0);
        if (units.source->units != 1.0) {
            v2v_log(V2V_LOG_INFO,
                    "truth %lld is in other units than its recording: it is taken times %.4g",
                    (long long)i + 1, units.source->units);
        }
    }
done:
    return rc;
}

static enum v2v_status add_sources(struct v2v_sources *sources, const struct v2v_train_job *job,
                                   const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_estimator_ops *maker =
        sources->examples != NULL ? sources->examples->ops->estimator : NULL;
    const struct v2v_input_settings input =
        maker != NULL ? v2v_estimator_input(maker, job->config) : job->config->input;
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(sources->list, "sources", job->recording_count)));
    sources->count = job->recording_count;
    for (int64_t i = 0; i < job->recording_count; i++) {
        struct v2v_source *source = &sources->list[i];
        struct v2v_example_source *of = &source->of;
        of->recording = job->recordings[i];
        of->truth = job->truths != NULL ? job->truths[i] : NULL;
        source->first = sources->frames;
        V2V_TRY(v2v_scaling_decide(&of->scaling, of->recording, &input, comm));
        V2V_TRY(v2v_level_range_add(&sources->levels, of->recording, &of->scaling, comm));
        const struct v2v_recording_info *info = v2v_source_info(source);
        int64_t pixels = info->height * info->width;
        sources->frames +=
            info->frames - (sources->examples != NULL ? sources->examples->frames - 1 : 0);
        sources->frame_pixels = pixels > sources->frame_pixels ? pixels : sources->frame_pixels;
        v2v_log(V2V_LOG_INFO, "recording %lld: %lld frames of %lld x %lld, offset %g, gain %g",
                (long long)i + 1, (long long)info->frames, (long long)info->height,
                (long long)info->width, of->scaling.offset, of->scaling.gain);
    }
    const int is_dark = sources->levels.frames == 0 || sources->levels.most[V2V_LEVEL_PEAK] < 0.0;
    if (maker != NULL && is_dark) { /* on all ranks */
        V2V_TRY(
            V2V_FAIL(V2V_E_INPUT,
                     "every frame is dark, or below its offset: there is nothing to learn from"));
    }
done:
    return rc;
}

enum v2v_status v2v_sources_init(struct v2v_sources *sources, const struct v2v_train_job *job,
                                 const struct v2v_examples *examples, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    *sources = (struct v2v_sources){.examples = examples};
    V2V_TRY(add_sources(sources, job, comm));
    V2V_TRY(v2v_par_agree(comm, check_views(sources, job->psf->views)));
    V2V_TRY(v2v_par_agree(comm, check_examples(sources)));
    V2V_TRY(find_units(sources, comm));
done:
    return rc;
}

void v2v_sources_fini(struct v2v_sources *sources)
{
    v2v_mem_free(sources->list);
    *sources = (struct v2v_sources){0};
}

/* Samples of the first frame that see nothing, of which the networks that are trained with frames
 * don't know. What can't be read is told where it is drawn. */
static void warn_of_blind(const struct v2v_source *source, const char *name)
{
    const struct v2v_recording_info *info = v2v_source_info(source);
    const int64_t samples = v2v_mem_product(info->views, info->height, info->width);
    float *views = NULL;
    int64_t blind = 0;
    if (V2V_ALLOC(views, "sources.frame", samples) == V2V_OK &&
        v2v_scaling_read_dark(&source->of.scaling, source->of.recording, views, &blind, 0) ==
            V2V_OK &&
        blind > 0) {
        v2v_log(V2V_LOG_WARNING,
                "%s, frame 0: %lld samples of one value see nothing and are taken for dark", name,
                (long long)blind);
    }
    v2v_mem_free(views);
}

void v2v_sources_warn(const struct v2v_sources *sources, const struct v2v_comm *comm)
{
    const struct v2v_examples *examples = sources->examples;
    const int takes_all = examples == NULL || examples->ops->estimator == NULL;
    char name[NAME_BYTES];
    for (int64_t i = 0; i < sources->count; i++) {
        const struct v2v_source *source = &sources->list[i];
        snprintf(name, sizeof name, "recording %lld", (long long)i + 1);
        v2v_scaling_warn(&source->of.scaling, name, comm);
        if (takes_all && v2v_comm_rank(comm) == 0) {
            warn_of_blind(source, name);
        }
    }
}
