/* What methods make of scenes, side by side: maxima along z, of the middle of each.
 *   draw_table OUT.png SCENE.tsv...
 * SCENE.tsv, a line a picture: a kind, a file, its label, between tabs. The kinds: `truth`, a
 * volume that decides on the greys of all others; `view`, the first one of a recording, in greys of
 * its own; `volume`.
 */
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/eval/preview.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/volume.h"
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { COLUMNS = 6, SIDE = 192, GAP = 8, LABEL_ROWS = 12, MOST = 100, TEXT = 4096 };

struct cell {
    char kind[8], file[TEXT], label[64];
};

/* Cells in rows of COLUMNS; a scene begins a row. */
struct table {
    struct cell cell[MOST];
    int place[MOST]; /* in the picture, row by row */
    int cells, places;
};

static enum v2v_status read_scene(struct table *table, const char *path)
{
    enum v2v_status rc = V2V_OK;
    FILE *stream = fopen(path, "r");
    if (stream == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s cannot be read", path));
    }
    table->places = (int)v2v_parts(table->places, COLUMNS) * COLUMNS;
    for (struct cell *cell = table->cell + table->cells;
         table->cells < MOST && fscanf(stream, "%7[^\t]\t%4095[^\t]\t%63[^\n]\n", cell->kind,
                                       cell->file, cell->label) == 3;
         cell++) {
        table->place[table->cells++] = table->places++;
    }
    if (!feof(stream)) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: a line without kind, file and label", path));
    }
done:
    if (stream != NULL) {
        fclose(stream);
    }
    return rc;
}

/* image[y,x] = max over z of stack[z,y,x], in the middle. */
static void project(float *image, const struct v2v_preview *size, const float *stack,
                    int64_t slices, int64_t height, int64_t width)
{
    const int64_t top = (height - size->height) / 2, left = (width - size->width) / 2;
    for (int64_t i = 0; i < size->height * size->width; i++) {
        const int64_t y = top + i / size->width, x = left + i % size->width;
        image[i] = stack[y * width + x];
        for (int64_t z = 1; z < slices; z++) {
            const float voxel = stack[(z * height + y) * width + x];
            image[i] = voxel > image[i] ? voxel : image[i];
        }
    }
}

/* Frame 0 of a volume, [z,y,x], or of a recording, [v,y,x]. The caller frees it. */
static enum v2v_status read_stack(float **stack, int64_t size[3], const struct cell *cell,
                                  const struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_input_settings settings = {0};
    struct v2v_volume *volume = NULL;
    struct v2v_recording *recording = NULL;
    if (strcmp(cell->kind, "view") == 0) {
        V2V_TRY(v2v_recording_open(&recording, cell->file, &settings, world));
        const struct v2v_recording_info *info = v2v_recording_info(recording);
        memcpy(size, (int64_t[]){info->views, info->height, info->width}, 3 * sizeof *size);
    } else {
        V2V_TRY(v2v_volume_open(&volume, cell->file, NULL, world));
        const struct v2v_volume_info *info = v2v_volume_info(volume);
        memcpy(size, (int64_t[]){info->slices, info->height, info->width}, 3 * sizeof *size);
    }
    V2V_TRY(V2V_ALLOC(*stack, "draw.stack", v2v_mem_product(size[0], size[1], size[2])));
    V2V_TRY(recording != NULL ? v2v_recording_read(recording, *stack, 0)
                              : v2v_volume_read(volume, *stack, 0, 0, size[0]));
done:
    v2v_recording_close(&recording);
    v2v_volume_close(&volume);
    return rc;
}

/* @param high of the scene's truth, which sets it */
static enum v2v_status draw_cell(struct v2v_canvas *canvas, const struct cell *cell, int place,
                                 double *high, const struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    const int is_view = strcmp(cell->kind, "view") == 0;
    const int64_t y = GAP + place / COLUMNS * (SIDE + LABEL_ROWS + GAP);
    const int64_t x = GAP + place % COLUMNS * (SIDE + GAP);
    int64_t size[3];
    float *stack = NULL, *image = NULL;
    V2V_TRY(read_stack(&stack, size, cell, world));
    struct v2v_preview preview = {.slices = 1,
                                  .height = v2v_smaller(size[1], SIDE),
                                  .width = v2v_smaller(size[2], SIDE),
                                  .z_zoom = 1,
                                  .low = NAN,
                                  .high = NAN};
    V2V_TRY(V2V_ALLOC(image, "draw.image", v2v_mem_product(preview.height, preview.width, 1)));
    project(image, &preview, stack, is_view ? 1 : size[0], size[1], size[2]);
    V2V_TRY(v2v_preview_widen(&preview, image));
    if (strcmp(cell->kind, "truth") == 0) {
        *high = preview.high;
    }
    v2v_canvas_text(canvas, y, x, cell->label, 1, 0xffffff);
    v2v_canvas_image(canvas, y + LABEL_ROWS, x, image, preview.height, preview.width, 0.0F,
                     (float)(is_view ? preview.high : *high), 1);
done:
    v2v_mem_free(image);
    v2v_mem_free(stack);
    return rc;
}

static enum v2v_status draw(const char *output, const struct table *table,
                            const struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_canvas canvas = {0};
    double high = 1.0;
    const int64_t rows = v2v_parts(table->places, COLUMNS);
    V2V_TRY(v2v_canvas_init(&canvas, GAP + rows * (SIDE + LABEL_ROWS + GAP),
                            GAP + COLUMNS * (SIDE + GAP)));
    for (int i = 0; i < table->cells; i++) {
        V2V_TRY(draw_cell(&canvas, &table->cell[i], table->place[i], &high, world));
    }
    V2V_TRY(v2v_png_write(output, canvas.rgb, canvas.height, canvas.width, 3));
done:
    v2v_canvas_fini(&canvas);
    return rc;
}

int main(int argc, char **argv)
{
    static struct table table;
    struct v2v_comm *world = NULL;
    enum v2v_status rc = v2v_par_init(&world, &argc, &argv);
    if (rc == V2V_OK && argc < 3) {
        fprintf(stderr, "usage: draw_table OUT.png SCENE.tsv...\n");
        v2v_par_finalize(&world);
        return 2;
    }
    for (int i = 2; rc == V2V_OK && i < argc; i++) {
        rc = read_scene(&table, argv[i]);
    }
    if (rc == V2V_OK) {
        rc = draw(argv[1], &table, world);
    }
    if (rc != V2V_OK) {
        fprintf(stderr, "draw_table: %s\n", v2v_status_message());
    }
    v2v_par_finalize(&world);
    return rc != V2V_OK;
}
