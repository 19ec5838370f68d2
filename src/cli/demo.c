#include "cli/demo.h"

#include "cli/picture.h"
#include "cli/projection.h"
#include "cli/steps.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/eval/metrics.h"
#include "v2v3d/io/json.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/recon/rld.h"
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

/* All ranks hold all slices afterwards: the sum over ranks of volumes that are zero elsewhere. */
static enum v2v_status iterate(struct frame *frame, struct v2v_rld *rld, int64_t iterations,
                               const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_part mine = v2v_rld_slices(rld);
    int64_t pixels = frame->size.height * frame->size.width;
    int64_t voxels = frame->size.slices * pixels;
    memset(frame->volume, 0, (size_t)voxels * sizeof(float));
    if (iterations > 0) {
        V2V_TRY(v2v_rld_run(rld, frame->volume + mine.first * pixels, frame->views, iterations));
        v2v_par_sum_f32(session->world, frame->volume, voxels);
    }
done:
    return rc;
}

enum v2v_status v2v_demo_rld_curve(struct v2v_demo *demo)
{
    static const double weight = 0.5; /* REFERENCE.md 7 */
    enum v2v_status rc = V2V_OK;
    const struct v2v_session *session = demo->session;
    struct frame frame;
    struct v2v_rld *rld = NULL;
    enum v2v_split split;
    V2V_TRY(open_frame(&frame, demo));
    rc = V2V_ALLOC(demo->curve, "demo.curve", demo->iterations + 1);
    V2V_TRY(v2v_par_agree(session->world, rc));
    V2V_TRY(
        v2v_projection_split(&split, session, &frame.psf, frame.size.height, frame.size.width, 1));
    V2V_TRY(v2v_rld_create(&rld, &frame.psf, frame.size.height, frame.size.width, weight, split,
                           session->world));
    demo->best = 1;
    for (int64_t i = 0; i <= demo->iterations; i++) {
        struct v2v_scores scores;
        v2v_watchdog_beat("demo: deconvolution");
        V2V_TRY(iterate(&frame, rld, i, session));
        rc = v2v_scores_of(&scores, frame.truth, frame.volume, frame.size.slices, frame.size.height,
                           frame.size.width, 0);
        V2V_TRY(v2v_par_agree(session->world, rc));
        demo->curve[i] = scores.psnr;
        demo->best = i > 0 && scores.psnr > demo->curve[demo->best] ? i : demo->best;
    }
done:
    v2v_rld_destroy(&rld);
    close_frame(&frame);
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
    V2V_TRY(v2v_picture_row(&canvas, parts, labels, PARTS));
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
    FILE *stream = open_memstream(&text, &bytes);
    if (stream == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_MEMORY, "no memory for the results' text"));
    }
    rc = v2v_json_print(stream, items, count);
    fclose(stream);
    V2V_TRY(rc);
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
    char *text = NULL;
    size_t bytes = 0;
    FILE *stream = open_memstream(&text, &bytes);
    if (stream == NULL) {
        return V2V_FAIL(V2V_E_MEMORY, "no memory for the table's text");
    }
    print_rows(stream, demo);
    fclose(stream);
    V2V_TRY(v2v_demo_path(path, demo, "results.txt"));
    V2V_TRY(v2v_file_write_text(path, text));
    V2V_TRY(write_json(demo));
    printf("%spictures, volumes and results are in %s\n", text, demo->folder);
done:
    free(text);
    return rc;
}
