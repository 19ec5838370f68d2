#include "cli/demo.h"

#include "cli/picture.h"
#include "cli/steps.h"
#include "cli/volumes.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/eval/metrics.h"
#include "v2v3d/io/json.h"
#include "v2v3d/tensor/statistics.h"
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* One frame of the demo, on all ranks. */
struct frame {
    struct v2v_psf_file psf;
    struct v2v_volume *truth_file;
    struct v2v_recording *recording;
    struct v2v_volume_info size;
    float *truth, *volume; /* [z,y,x] */
    float *views;          /* [v,y,x] */
};

static enum v2v_status open_frame(struct frame *frame, const struct v2v_demo *demo)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_session *session = demo->session;
    char path[V2V_PATH_BYTES];
    *frame = (struct frame){0};
    V2V_TRY(v2v_demo_path(path, demo, "psf.h5"));
    V2V_TRY(v2v_step_psf(session, &frame->psf, path));
    V2V_TRY(v2v_demo_path(path, demo, "truth.h5"));
    V2V_TRY(v2v_step_volume(session, &frame->truth_file, path, &frame->psf));
    V2V_TRY(v2v_demo_path(path, demo, "recording.h5"));
    V2V_TRY(v2v_step_recording(session, &frame->recording, path, &frame->psf));
    frame->size = *v2v_volume_info(frame->truth_file);
    int64_t voxels = v2v_mem_product(frame->size.slices, frame->size.height, frame->size.width);
    int64_t samples = v2v_mem_product(frame->psf.views, frame->size.height, frame->size.width);
    rc = V2V_ALLOC(frame->truth, "demo.truth", voxels);
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(frame->volume, "demo.volume", voxels);
    }
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(frame->views, "demo.views", samples);
    }
    if (rc == V2V_OK) {
        rc = v2v_volume_read(frame->truth_file, frame->truth, 0, 0, frame->size.slices);
    }
    if (rc == V2V_OK) {
        rc = v2v_recording_read(frame->recording, frame->views, 0);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
done:
    return rc;
}

static void close_frame(struct frame *frame)
{
    v2v_mem_free(frame->views);
    v2v_mem_free(frame->volume);
    v2v_mem_free(frame->truth);
    v2v_recording_close(&frame->recording);
    v2v_volume_close(&frame->truth_file);
    v2v_psf_file_fini(&frame->psf);
}

/* Looks on at the deconvolution: scores every iterate of a frame and writes the best one. */
struct onlooker {
    struct v2v_demo *demo;
    struct frame frame;
    struct v2v_volume_writer *writer;
    float *best; /* [z,y,x] */
    double best_psnr;
    enum v2v_status rc; /* of its own: what monitors return is no status */
};

/* All ranks of the shard hold all slices afterwards. */
static void gather(float *volume, const struct v2v_volume_info *size,
                   const struct v2v_iterate *iterate)
{
    const struct v2v_estimator *estimator = iterate->estimator;
    const int64_t pixels = size->height * size->width, voxels = size->slices * pixels;
    memset(volume, 0, (size_t)voxels * sizeof *volume);
    v2v_iterate_slices(iterate, volume + estimator->slices.first * pixels);
    v2v_par_sum_f32(estimator->shard, volume, voxels);
}

static enum v2v_status score(double *psnr, const struct frame *frame)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_scores scores;
    V2V_TRY(v2v_scores_of(&scores, frame->truth, frame->volume, frame->size.slices,
                          frame->size.height, frame->size.width, 0));
    *psnr = scores.psnr;
done:
    return rc;
}

/* Collective(shard), agreed. */
static enum v2v_status look(struct onlooker *onlooker, int64_t iteration,
                            const struct v2v_iterate *iterate)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_demo *demo = onlooker->demo;
    const struct v2v_estimator *estimator = iterate->estimator;
    const struct v2v_volume_info *size = &onlooker->frame.size;
    const struct v2v_part mine = estimator->slices;
    const int64_t pixels = size->height * size->width;
    double psnr = 0.0;
    gather(onlooker->frame.volume, size, iterate);
    V2V_TRY(v2v_par_agree(estimator->shard, score(&psnr, &onlooker->frame)));
    const int is_best = iteration == 1 || psnr > onlooker->best_psnr;
    if (is_best) {
        onlooker->best_psnr = psnr;
        memcpy(onlooker->best, onlooker->frame.volume,
               (size_t)(size->slices * pixels) * sizeof(float));
    }
    if (estimator->frame == 0) {
        demo->curve[iteration] = psnr;
        demo->best = is_best ? iteration : demo->best;
    }
    if (iteration == demo->iterations) {
        rc = v2v_volume_put(onlooker->writer, V2V_VOLUME_MEAN, onlooker->best + mine.first * pixels,
                            estimator->frame, mine.first, mine.count);
        V2V_TRY(v2v_par_agree(estimator->shard, rc));
        V2V_TRY(v2v_volume_mark_done(onlooker->writer, estimator->frame, estimator->shard));
    }
done:
    return rc;
}

/* Of a failure, which is told in the end, the method is to know nothing: it would take its volume
 * for finished. */
static int enough(void *context, int64_t iteration, const struct v2v_iterate *iterate)
{
    struct onlooker *onlooker = context;
    if (onlooker->rc == V2V_OK) { /* a failure of an earlier frame stays */
        onlooker->rc = look(onlooker, iteration, iterate);
    }
    return 0;
}

static enum v2v_status begin_to_look(struct onlooker *onlooker)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_demo *demo = onlooker->demo;
    const struct v2v_session *session = demo->session;
    struct frame *frame = &onlooker->frame;
    char path[V2V_PATH_BYTES];
    V2V_TRY(open_frame(frame, demo));
    struct v2v_volume_info info = frame->size;
    info.frames = v2v_recording_info(frame->recording)->frames;
    rc = V2V_ALLOC(demo->curve, "demo.curve", demo->iterations + 1);
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(onlooker->best, "demo.volume",
                       v2v_mem_product(info.slices, info.height, info.width));
    }
    if (rc == V2V_OK) {
        rc = score(&demo->curve[0], frame); /* of zeros */
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    V2V_TRY(v2v_demo_path(path, demo, "rld_best.h5"));
    V2V_TRY(v2v_step_output(session, path, NULL, 0));
    V2V_TRY(v2v_volume_create(&onlooker->writer, path, &info, 1u << V2V_VOLUME_MEAN, NULL, 0,
                              session->world));
done:
    return rc;
}

enum v2v_status v2v_demo_deconvolve(struct v2v_demo *demo)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_session session = *demo->session;
    const struct v2v_estimator_ops *ops = NULL;
    struct onlooker onlooker = {.demo = demo};
    const struct v2v_monitor monitor = {enough, &onlooker};
    char psf[V2V_PATH_BYTES], input[V2V_PATH_BYTES], output[V2V_PATH_BYTES];
    const struct v2v_volumes given = {.psf = psf, .input = input, .output = output};
    session.config.deconv.iterations = demo->iterations;
    session.config.deconv.stop = V2V_STOP_FIXED;
    session.config.recon.skip = (struct v2v_number){.mode = V2V_NUMBER_NONE}; /* the network's */
    V2V_TRY(v2v_config_set(&session.config, "deconv.method=rld"));
    V2V_TRY(v2v_demo_path(psf, demo, "psf.h5"));
    V2V_TRY(v2v_demo_path(input, demo, "recording.h5"));
    V2V_TRY(v2v_demo_path(output, demo, "rld.h5"));
    V2V_TRY(v2v_estimator_find(&ops, "rld"));
    V2V_TRY(begin_to_look(&onlooker));
    V2V_TRY(v2v_volumes_make(&given, ops, &monitor, &session));
    V2V_TRY(v2v_par_agree(session.world, onlooker.rc));
    V2V_TRY(v2v_volume_finish(&onlooker.writer));
done:
    v2v_volume_abandon(&onlooker.writer);
    v2v_mem_free(onlooker.best);
    close_frame(&onlooker.frame);
    return rc;
}

/* First view, drawn as large as the others' top view. */
static enum v2v_status draw_view(struct v2v_canvas *canvas, const struct frame *frame, float high)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_canvas_init(canvas, frame->size.height, frame->size.width));
    v2v_canvas_image(canvas, 0, 0, frame->views, frame->size.height, frame->size.width, 0.0f, high,
                     1);
done:
    return rc;
}

static enum v2v_status draw_comparison(const struct v2v_demo *demo, const struct frame *frame,
                                       struct v2v_volume *const *volumes)
{
    enum { PARTS = 4 };
    static const char *const labels[PARTS] = {"view 0", "RLD", "V2V3D", "truth"};
    enum v2v_status rc = V2V_OK;
    struct v2v_canvas parts[PARTS] = {{0}}, canvas = {0};
    char path[V2V_PATH_BYTES];
    double view_high = 0.0, high = 0.0;
    int64_t pixels = frame->size.height * frame->size.width;
    int zoom = v2v_picture_z_zoom(&frame->size);
    V2V_TRY(v2v_percentile(&view_high, frame->views, pixels, 99.9));
    V2V_TRY(v2v_percentile(&high, frame->truth, frame->size.slices * pixels, 99.9));
    V2V_TRY(draw_view(&parts[0], frame, (float)view_high));
    for (int i = 1; i < PARTS; i++) {
        V2V_TRY(v2v_picture_frame(&parts[i], volumes[i - 1], 0, zoom, 0.0, high));
    }
    V2V_TRY(v2v_picture_grid(&canvas, parts, labels, PARTS, PARTS, 2));
    V2V_TRY(v2v_demo_path(path, demo, "comparison.png"));
    V2V_TRY(v2v_png_write(path, canvas.rgb, canvas.height, canvas.width, 3));
done:
    v2v_canvas_fini(&canvas);
    for (int i = 0; i < PARTS; i++) {
        v2v_canvas_fini(&parts[i]);
    }
    return rc;
}

enum v2v_status v2v_demo_pictures(const struct v2v_demo *demo)
{
    enum { VOLUMES = 3 };
    static const char *const names[VOLUMES] = {"rld_best.h5", "volume.h5", "truth.h5"};
    enum v2v_status rc = V2V_OK;
    const struct v2v_session *session = demo->session;
    struct v2v_volume *volumes[VOLUMES] = {NULL};
    struct frame frame;
    char path[V2V_PATH_BYTES];
    V2V_TRY(open_frame(&frame, demo));
    for (int i = 0; i < VOLUMES; i++) {
        V2V_TRY(v2v_demo_path(path, demo, names[i]));
        V2V_TRY(v2v_step_volume(session, &volumes[i], path, &frame.psf));
    }
    if (v2v_step_on_root(session)) {
        rc = draw_comparison(demo, &frame, volumes);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
done:
    for (int i = 0; i < VOLUMES; i++) {
        v2v_volume_close(&volumes[i]);
    }
    close_frame(&frame);
    return rc;
}

/* Rows of the table as text; `empty` is the score of a volume of zeros. */
static void print_rows(FILE *stream, const struct v2v_demo *demo)
{
    const struct v2v_session *session = demo->session;
    char names[V2V_DEMO_ROWS][64];
    snprintf(names[V2V_DEMO_NETWORK], sizeof names[0], "V2V3D");
    snprintf(names[V2V_DEMO_RLD], sizeof names[0], "RLD, %" PRId64 " iterations", demo->iterations);
    snprintf(names[V2V_DEMO_RLD_BEST], sizeof names[0], "RLD, best iteration (%" PRId64 ")",
             demo->best);
    fprintf(stream, "%-28s %9s %7s %9s\n", "", "PSNR, dB", "SSIM", "residual");
    for (int row = 0; row < V2V_DEMO_ROWS; row++) {
        const double *mean = demo->evaluation[row].mean;
        fprintf(stream, "%-28s %9.2f %7.3f %9.3f\n", names[row], mean[V2V_FIGURE_PSNR],
                mean[V2V_FIGURE_SSIM], mean[V2V_FIGURE_RESIDUAL]);
    }
    fprintf(stream, "%-28s %9.2f\n", "empty volume", demo->curve[0]);
    fprintf(stream, "%" PRId64 " frames, noise %g; %d ranks x %d threads; %.0f s in all\n",
            session->config.demo.frames, session->config.demo.noise, v2v_comm_size(session->world),
            session->threads, demo->seconds);
}

static enum v2v_status write_json(const struct v2v_demo *demo)
{
    static const char *const rows[V2V_DEMO_ROWS] = {"v2v3d", "rld", "rld_best"};
    static const int figures[] = {V2V_FIGURE_PSNR, V2V_FIGURE_SSIM, V2V_FIGURE_RESIDUAL};
    enum { FIGURES = sizeof figures / sizeof figures[0], NAME = 40 };
    enum v2v_status rc = V2V_OK;
    char names[V2V_DEMO_ROWS * FIGURES][NAME], path[V2V_PATH_BYTES];
    struct v2v_json_item items[V2V_DEMO_ROWS * FIGURES + 4];
    static const char what[] = "the results' text";
    FILE *stream = NULL;
    char *text = NULL;
    size_t bytes = 0;
    int64_t count = 0;
    for (int i = 0; i < V2V_DEMO_ROWS * FIGURES; i++) {
        int row = i / FIGURES, figure = figures[i % FIGURES];
        snprintf(names[i], NAME, "%s_%s", rows[row], v2v_figure_names[figure]);
        items[count++] = (struct v2v_json_item){
            .name = names[i], .number = demo->evaluation[row].mean[figure], .count = -1};
    }
    items[count++] = (struct v2v_json_item){
        .name = "rld_best_iteration", .number = (double)demo->best, .count = -1};
    items[count++] = (struct v2v_json_item){
        .name = "rld_psnr_by_iteration", .values = demo->curve, .count = demo->iterations + 1};
    items[count++] =
        (struct v2v_json_item){.name = "seconds", .number = demo->seconds, .count = -1};
    V2V_TRY(v2v_text_open(&stream, &text, &bytes, what));
    V2V_TRY(v2v_text_close(v2v_json_print(stream, items, count), stream, &text, what));
    V2V_TRY(v2v_demo_path(path, demo, "results.json"));
    V2V_TRY(v2v_file_write_text(path, text));
done:
    free(text);
    return rc;
}

enum v2v_status v2v_demo_table(const struct v2v_demo *demo)
{
    enum v2v_status rc = V2V_OK;
    char path[V2V_PATH_BYTES];
    static const char what[] = "the table's text";
    FILE *stream = NULL;
    char *text = NULL;
    size_t bytes = 0;
    V2V_TRY(v2v_text_open(&stream, &text, &bytes, what));
    print_rows(stream, demo);
    V2V_TRY(v2v_text_close(V2V_OK, stream, &text, what));
    V2V_TRY(v2v_demo_path(path, demo, "results.txt"));
    V2V_TRY(v2v_file_write_text(path, text));
    V2V_TRY(write_json(demo));
    printf("%spictures, volumes and results are in %s\n", text, demo->folder);
done:
    free(text);
    return rc;
}
