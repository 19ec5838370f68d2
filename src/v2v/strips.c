#include "v2v/strips.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/op/blocked.h"
#include "v2v3d/op/tile_conv.h"
#include "v2v3d/op/winograd.h"
#include "v2v3d/par/watchdog.h"

#include <string.h>

/* Strips are multiples of UNIT rows. */
enum { TILE = V2V_TILE, STEPS = V2V_STRIPS_MOST + 1, UNIT = 8 * TILE };

/* A step is the alignment or a layer; behind every step but the last there is a strip. To have the
 * same bits whatever the strips' rows, but for the round-off of the alignment's border ring, a
 * step's strip reaches one row of tiles further at either end than the next one's; rows that the
 * strip above had too are moved, not computed again. */
struct v2v_strips {
    struct v2v_strips_spec spec;
    int64_t steps;
    struct v2v_winograd *filter[STEPS]; /* of each step; NULL: the alignment, or in bf16 .. */
    struct v2v_tile_conv *tile_conv[STEPS];
    struct v2v_tiles all;
    int64_t rows;        /* of the frame a strip, without those at its ends */
    int64_t held[STEPS]; /* rows of the strip behind each step */
    float *level;        /* [out] background behind the last step */
};

/* Rows that step i computes at either end beyond the strip. */
static int64_t margin(const struct v2v_strips *self, int64_t i)
{
    return TILE * (self->steps - 1 - i);
}

/* The layer of step i; NULL: the alignment. */
static struct v2v_layer *layer_of(const struct v2v_strips *self, int64_t i)
{
    int64_t first = self->spec.align != NULL;
    return i >= first ? self->spec.layer[i - first] : NULL;
}

/* Channels behind step i. */
static int64_t channels(const struct v2v_strips *self, int64_t i)
{
    const struct v2v_layer *layer = layer_of(self, i);
    return layer != NULL ? layer->out : layer_of(self, i + 1)->in;
}

/* Floats of a pixel of the strip behind step i; in bf16 strips are blocked. */
static int64_t pixel_floats(const struct v2v_strips *self, int64_t i)
{
    int64_t count = channels(self, i);
    return self->spec.in_bf16 ? v2v_blocked_floats(count, 1, 1) : count;
}

/* ---- plan ---- */

static void choose_rows(struct v2v_strips *self)
{
    int64_t height = self->spec.height, spare = self->spec.most_floats / self->spec.width, row = 0;
    for (int64_t i = 0; i < self->steps - 1; i++) {
        spare -= pixel_floats(self, i) * 2 * margin(self, i);
        row += pixel_floats(self, i);
    }
    int64_t most = v2v_within(spare / row / UNIT * UNIT, UNIT, height);
    int64_t strips = (height + most - 1) / most;
    int64_t rows = (height + strips - 1) / strips;
    self->rows = (rows + UNIT - 1) / UNIT * UNIT;
    for (int64_t i = 0; i < self->steps - 1; i++) {
        self->held[i] = v2v_within(self->rows + 2 * margin(self, i), 0, height);
    }
}

static struct v2v_strips laid_out(const struct v2v_strips_spec *spec)
{
    struct v2v_strips strips = {.spec = *spec, .steps = spec->layers + (spec->align != NULL)};
    choose_rows(&strips);
    return strips;
}

static enum v2v_status create_tile_conv(struct v2v_strips *self, int64_t i,
                                        const struct v2v_plane *plane)
{
    const struct v2v_layer *layer = layer_of(self, i);
    int64_t width = self->spec.width;
    struct v2v_tile_conv_spec spec = {.in = layer->in,
                                      .out = layer->out,
                                      .height = self->spec.height,
                                      .width = width,
                                      .plane = plane,
                                      .pitch = width >> layer->upsample,
                                      .half = layer->upsample,
                                      .in_pixels = i > 0 ? self->held[i - 1] * width : 0,
                                      .out_pixels = i < self->steps - 1 ? self->held[i] * width : 0,
                                      .stride2 = layer->stride == 2,
                                      .slope = layer->slope,
                                      .workspace = self->spec.workspace,
                                      .pool = self->spec.pool};
    return v2v_tile_conv_create(&self->tile_conv[i], &spec);
}

static enum v2v_status create_layer(struct v2v_strips *self, int64_t i)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_layer *layer = layer_of(self, i);
    int half = layer->upsample;
    int64_t height = self->spec.height, width = self->spec.width;
    int64_t rows = i > 0 ? self->held[i - 1] : height >> half;
    struct v2v_plane *plane = NULL;
    V2V_ASSERT(i == 0 || !half);
    V2V_TRY(V2V_ALLOC(plane, "strips.planes", layer->in));
    for (int64_t c = 0; c < layer->in; c++) {
        plane[c] = (struct v2v_plane){
            .offset = c * rows * (width >> half), .y1 = height, .x1 = width, .owner = c};
    }
    if (self->spec.in_bf16) {
        V2V_TRY(create_tile_conv(self, i, i > 0 ? NULL : plane));
        goto done;
    }
    struct v2v_winograd_spec spec = {.in = layer->in,
                                     .out = layer->out,
                                     .height = height,
                                     .width = width,
                                     .out_rows = i < self->steps - 1 ? self->held[i] : 0,
                                     .plane = plane,
                                     .pitch = width >> half,
                                     .half = half,
                                     .stride2 = layer->stride == 2,
                                     .slope = layer->slope,
                                     .workspace = self->spec.workspace,
                                     .pool = self->spec.pool};
    V2V_TRY(v2v_winograd_create(&self->filter[i], &spec));
done:
    v2v_mem_free(plane);
    return rc;
}

enum v2v_status v2v_strips_create(struct v2v_strips **strips, const struct v2v_strips_spec *spec,
                                  const struct v2v_padded *like)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_strips *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "strips", 1));
    *self = laid_out(spec);
    V2V_TRY(v2v_tiles_init(&self->all, spec->height, spec->width));
    if (spec->align != NULL) {
        struct v2v_align_conv_plan plan = {.like = like,
                                           .out_rows = self->held[0],
                                           .out_form =
                                               spec->in_bf16 ? V2V_FORM_BLOCKED : V2V_FORM_PLAIN,
                                           .is_listed = spec->in_bf16};
        V2V_TRY(v2v_align_conv_plan(spec->align, &plan));
    }
    V2V_TRY(V2V_ALLOC(self->level, "strips", channels(self, self->steps - 1)));
    for (int64_t i = 0; i < self->steps; i++) {
        if (layer_of(self, i) != NULL) {
            v2v_layer_fini(layer_of(self, i));
            V2V_TRY(create_layer(self, i));
        }
    }
done:
    if (rc != V2V_OK) {
        v2v_strips_destroy(&self);
    }
    *strips = self;
    return rc;
}

void v2v_strips_destroy(struct v2v_strips **strips)
{
    struct v2v_strips *self = *strips;
    if (self == NULL) {
        return;
    }
    for (int i = 0; i < STEPS; i++) {
        v2v_winograd_destroy(&self->filter[i]);
        v2v_tile_conv_destroy(&self->tile_conv[i]);
    }
    v2v_mem_free(self->level);
    v2v_tiles_fini(&self->all);
    v2v_mem_free(self);
    *strips = NULL;
}

static int64_t strip_floats(const struct v2v_strips *self, int64_t i)
{
    return (pixel_floats(self, i) * self->held[i] * self->spec.width + 15) / 16 * 16;
}

int64_t v2v_strips_floats(const struct v2v_strips_spec *spec)
{
    struct v2v_strips self = laid_out(spec);
    int64_t floats = 0;
    for (int64_t i = 0; i < self.steps - 1; i++) {
        floats += strip_floats(&self, i);
    }
    return floats;
}

void v2v_strips_weights_changed(struct v2v_strips *self, const struct v2v_parameters *parameters)
{
    for (int64_t i = self->spec.align != NULL; i < self->steps; i++) {
        const struct v2v_layer *layer = layer_of(self, i);
        const float *weight = v2v_parameter(parameters->fields, parameters->weights, layer->weight);
        const float *bias = v2v_parameter(parameters->fields, parameters->weights, layer->bias);
        if (self->spec.in_bf16) {
            v2v_tile_conv_set_weights(self->tile_conv[i], weight, bias);
        } else {
            v2v_winograd_set_weights(self->filter[i], weight, bias);
        }
    }
}

/* ---- forward ---- */

/* What step i leaves, for the rows of tiles [first, last). The last step's is the whole frame. */
static struct v2v_tiles_image behind(const struct v2v_strips *self,
                                     const struct v2v_strips_data *data, int64_t i, int64_t first,
                                     int64_t last)
{
    const struct v2v_layer *layer = layer_of(self, i);
    int half = layer != NULL && layer->stride == 2;
    struct v2v_tiles_image image = {.data = data->strips,
                                    .channels = channels(self, i),
                                    .width = self->spec.width >> half,
                                    .begin = i < self->steps - 1 ? first : 0,
                                    .first = first,
                                    .last = last,
                                    .size = TILE >> half};
    if (i == self->steps - 1) {
        image.data = data->out;
        image.rows_held = self->spec.height >> half;
        return image;
    }
    image.rows_held = self->held[i];
    for (int64_t before = 0; before < i; before++) {
        image.data += strip_floats(self, before);
    }
    return image;
}

/* Pixels of a strip before a row of tiles of the frame. */
static int64_t offset_of(const struct v2v_strips *self, const struct v2v_scene *scene, int64_t row)
{
    return scene != NULL ? scene->computed.before[row] * TILE * TILE
                         : row * TILE * self->spec.width;
}

/* Compute the tiles of step i in the rows of `image` from what the step before left. Of a scene's
 * strips only the computed tiles exist. They do not see the background about them as it is: to them
 * their own edges go on. Level background would end the haze about bright structures too early. */
static void compute(const struct v2v_strips *self, const struct v2v_strips_data *data, int64_t i,
                    const struct v2v_scene *scene, const struct v2v_tiles_image *image,
                    const struct v2v_tiles_image *before)
{
    const struct v2v_tiles *tiles = scene != NULL ? &scene->computed : &self->all;
    const struct v2v_tiles *list = scene != NULL || self->spec.in_bf16 ? tiles : NULL;
    struct v2v_winograd_part part = {.run = tiles->run + tiles->first[image->first],
                                     .runs = tiles->first[image->last] - tiles->first[image->first],
                                     .first_row = image->begin,
                                     .in_list = i > 0 ? list : NULL,
                                     .out_list = i < self->steps - 1 ? list : NULL};
    if (layer_of(self, i) == NULL) {
        v2v_align_conv_forward(self->spec.align, image->data, data->features, &part);
        return;
    }
    const float *in = i > 0 ? before->data : data->images;
    part.shift = i > 0 ? -offset_of(self, scene, before->begin) : 0;
    if (self->spec.in_bf16) {
        v2v_tile_conv_forward(self->tile_conv[i], image->data, in, &part);
    } else {
        v2v_winograd_forward_part(self->filter[i], image->data, in, &part);
    }
}

/* Rows of the strip above that `image` begins with move there; the others are to be computed. */
static void keep_rows(const struct v2v_strips *self, const struct v2v_scene *scene,
                      struct v2v_tiles_image *image, const struct v2v_tiles_image *above)
{
    if (image->begin < above->begin || image->begin >= above->last) {
        return;
    }
    int64_t begin = offset_of(self, scene, image->begin);
    int64_t from = begin - offset_of(self, scene, above->begin);
    int64_t pixels = offset_of(self, scene, above->last) - begin;
    /* blocks of channels side by side, or channels */
    int64_t size = self->spec.in_bf16 ? V2V_BLOCKED_CHANNELS / 2 : 1;
    int64_t count = self->spec.in_bf16 ? v2v_blocked_count(image->channels) : image->channels;
#pragma omp parallel for schedule(static)
    for (int64_t c = 0; c < count; c++) {
        float *channel = image->data + c * image->rows_held * image->width * size;
        memmove(channel, channel + from * size, (size_t)(pixels * size) * sizeof *channel);
    }
    image->first = above->last;
}

/* Rows [y,end) of the frame. `left` [steps]: what the strip computed before this one left, and then
 * what this one leaves. */
static void compute_strip(const struct v2v_strips *self, const struct v2v_strips_data *data,
                          const struct v2v_scene *scene, int64_t y, int64_t end,
                          struct v2v_tiles_image *left)
{
    int64_t height = self->spec.height;
    for (int64_t i = 0; i < self->steps; i++) {
        int64_t first = v2v_within(y - margin(self, i), 0, height);
        int64_t last = v2v_within(end + margin(self, i), 0, height);
        struct v2v_tiles_image image =
            behind(self, data, i, first / TILE, (last + TILE - 1) / TILE);
        if (i < self->steps - 1) {
            keep_rows(self, scene, &image, &left[i]);
        }
        v2v_watchdog_beat("a strip of the U-Net");
        compute(self, data, i, scene, &image, i > 0 ? &left[i - 1] : NULL);
        left[i] = image;
    }
}

/* The mean inside the sample. */
static void measure_level(float *level, const struct v2v_tiles_image *image,
                          const struct v2v_scene *scene)
{
    int64_t y0 = (scene->sample_row + 1 - image->begin) * image->size;
    int64_t x0 = (scene->sample_column + 1) * image->size;
    int64_t side = (V2V_SAMPLE_TILES - 2) * image->size;
#pragma omp parallel for schedule(static)
    for (int64_t c = 0; c < image->channels; c++) {
        const float *channel = image->data + c * image->rows_held * image->width;
        double sum = 0.0;
        for (int64_t line = y0; line < y0 + side; line++) {
            float part = 0.0f;
            for (int64_t x = x0; x < x0 + side; x++) {
                part += channel[line * image->width + x];
            }
            sum += (double)part;
        }
        level[c] = (float)(sum / (double)(side * side));
    }
}

/* All of a scene whose tiles fit into one strip. */
static int64_t rows_at_once(const struct v2v_strips *self, const struct v2v_scene *scene)
{
    int64_t fit = self->held[self->steps - 2] * self->spec.width / (TILE * TILE);
    return scene != NULL && scene->computed.count <= fit ? self->spec.height : self->rows;
}

void v2v_strips_forward(struct v2v_strips *self, const struct v2v_strips_data *data,
                        const struct v2v_scene *scene)
{
    struct v2v_tiles_image left[STEPS] = {0};
    int64_t height = self->spec.height, rows = rows_at_once(self, scene);
    for (int64_t y = 0; y < height; y += rows) {
        compute_strip(self, data, scene, y, v2v_smaller(y + rows, height), left);
    }
    if (scene != NULL) {
        struct v2v_tiles_image out = behind(self, data, self->steps - 1, 0, self->all.rows);
        measure_level(self->level, &out, scene);
        v2v_tiles_fill(&scene->dark, &out, self->level, 1);
    }
}
