#include "v2v/align_taps.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/op/gemm.h"
#include "v2v3d/optics/taps.h"

#include <omp.h>
#include <string.h>

/* The frame falls into nine regions: the middle, and the one-pixel border ring's edges and corners,
 * where kernel rows or columns that leave the frame are left out. */
enum { REGIONS = 9, CLASSES = 3, MIDDLE = REGIONS / 2 };

/* Pixels of a strip that one matrix product takes: rows of patches stay in the last-level cache. */
#define STRIP_PIXELS 1024

/* Output channels whose weights are merged together, side by side; slices at a time, all their
 * kernels' places. */
enum { TOGETHER = 8, SLICES = 8, PLACES = 9 };

static const unsigned class_taps[CLASSES] = {V2V_TAPS_NOT_FIRST, V2V_TAPS_ALL, V2V_TAPS_NOT_LAST};

struct region {
    int64_t y0, y1, x0, x1; /* half open */
    struct v2v_taps taps;
    struct v2v_piece weight; /* [out, taps*features] merged */
};

struct v2v_align_taps {
    struct v2v_align_conv_spec spec;
    int32_t *views; /* [view_count], owned */
    int ring_only;
    int64_t slices;
    int64_t height, width;
    int64_t out_rows; /* that the output array holds */
    int out_form;     /* enum v2v_form */
    int64_t columns;  /* taps*features of the largest region */
    int threads;
    const float *bias;
    struct region region[REGIONS];
    float *patch; /* [columns, STRIP_PIXELS] */
    float *strip; /* [out, STRIP_PIXELS] */
};

static int skips(const struct v2v_align_taps *conv, int region)
{
    return conv->ring_only && region == MIDDLE;
}

/* ---- creation ---- */

enum v2v_status v2v_align_taps_create(struct v2v_align_taps **conv, const struct v2v_shifts *shifts,
                                      const struct v2v_align_conv_spec *spec, int ring_only)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_align_taps *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "align_taps", 1));
    self->spec = *spec;
    self->slices = shifts->slices;
    self->ring_only = ring_only;
    V2V_TRY(V2V_ALLOC(self->views, "align_taps.views", spec->view_count));
    memcpy(self->views, spec->views, (size_t)spec->view_count * sizeof *self->views);
    self->spec.views = self->views;
    for (int i = 0; i < REGIONS; i++) {
        struct region *region = &self->region[i];
        if (skips(self, i)) {
            continue;
        }
        V2V_TRY(v2v_taps_create(&region->taps, shifts, self->views, spec->view_count,
                                class_taps[i / CLASSES], class_taps[i % CLASSES],
                                !spec->every_slice));
        int64_t columns = region->taps.count * spec->features;
        self->columns = columns > self->columns ? columns : self->columns;
    }
done:
    if (rc != V2V_OK) {
        v2v_align_taps_destroy(&self);
    }
    *conv = self;
    return rc;
}

static void free_scratch(struct v2v_align_taps *conv)
{
    float **scratch[] = {&conv->patch, &conv->strip};
    for (size_t i = 0; i < sizeof scratch / sizeof *scratch; i++) {
        v2v_mem_free(*scratch[i]);
        *scratch[i] = NULL;
    }
}

void v2v_align_taps_destroy(struct v2v_align_taps **conv)
{
    if (*conv == NULL) {
        return;
    }
    for (int i = 0; i < REGIONS; i++) {
        v2v_taps_fini(&(*conv)->region[i].taps);
        v2v_pool_give(&(*conv)->region[i].weight);
    }
    free_scratch(*conv);
    v2v_mem_free((*conv)->views);
    v2v_mem_free(*conv);
    *conv = NULL;
}

static int64_t region_columns(const struct v2v_align_taps *conv, const struct region *region)
{
    return region->taps.count * conv->spec.features;
}

static int64_t all_columns(const struct v2v_align_taps *conv)
{
    int64_t columns = 0;
    for (int i = 0; i < REGIONS; i++) {
        columns += region_columns(conv, &conv->region[i]);
    }
    return columns;
}

/* In the shared workspace: the gradients of all regions' merged weights, one after the other,
 * [out,columns]; a share of every thread's, [columns,TOGETHER]. */
static int64_t share_floats(const struct v2v_align_taps *conv)
{
    return all_columns(conv) * TOGETHER;
}

static int64_t gradient_floats(const struct v2v_align_taps *conv, int training)
{
    return training ? v2v_mem_product(conv->spec.out, all_columns(conv), 1) : 0;
}

enum v2v_status v2v_align_taps_plan(struct v2v_align_taps *conv,
                                    const struct v2v_align_conv_plan *plan)
{
    enum v2v_status rc = V2V_OK;
    int64_t height = plan->like->height, width = plan->like->width;
    const int64_t y[CLASSES + 1] = {0, 1, height - 1, height};
    const int64_t x[CLASSES + 1] = {0, 1, width - 1, width};
    int64_t out = conv->spec.out;
    conv->height = height;
    conv->width = width;
    conv->out_rows = plan->out_rows;
    conv->out_form = plan->out_form;
    for (int i = 0; i < REGIONS; i++) {
        struct region *region = &conv->region[i];
        region->y0 = y[i / CLASSES];
        region->y1 = y[i / CLASSES + 1];
        region->x0 = x[i % CLASSES];
        region->x1 = x[i % CLASSES + 1];
    }
    for (int i = 0; i < REGIONS; i++) {
        struct region *region = &conv->region[i];
        if (!skips(conv, i)) {
            V2V_TRY(v2v_pool_take(&region->weight, conv->spec.method.pool, "align_taps.weights",
                                  v2v_mem_product(out, region_columns(conv, region), 1)));
        }
    }
    free_scratch(conv);
    int64_t pixels = width > STRIP_PIXELS ? width : STRIP_PIXELS;
    V2V_TRY(V2V_ALLOC(conv->patch, "align_taps.patch", v2v_mem_product(conv->columns, pixels, 1)));
    V2V_TRY(V2V_ALLOC(conv->strip, "align_taps.strip", v2v_mem_product(out, pixels, 1)));
    conv->threads = omp_get_max_threads();
    V2V_TRY(v2v_workspace_reserve(conv->spec.method.workspace,
                                  conv->threads * share_floats(conv) +
                                      gradient_floats(conv, plan->training)));
done:
    return rc;
}

/* ---- full weights <-> merged weights ---- */

/* to [count,TOGETHER] from rows [rows][count] that are `step` floats apart; and back. */
static void side_by_side(float *to, const float *from, int64_t step, int64_t rows, int64_t count)
{
    if (rows < TOGETHER) {
        memset(to, 0, (size_t)(count * TOGETHER) * sizeof *to);
    }
    for (int64_t n = 0; n < count; n++) {
        for (int64_t r = 0; r < rows; r++) {
            to[n * TOGETHER + r] = from[r * step + n];
        }
    }
}

static void one_by_one(float *to, const float *from, int64_t step, int64_t rows, int64_t count)
{
    for (int64_t r = 0; r < rows; r++) {
        for (int64_t n = 0; n < count; n++) {
            to[r * step + n] = from[n * TOGETHER + r];
        }
    }
}

/* Add the full weights of a few output channels that every region keeps to its taps, or the taps
 * back to the full weights: one is the adjoint of the other. The full weights come from memory
 * once. */
enum direction { FULL_TO_MERGED, MERGED_TO_FULL };

static void add_places(enum direction direction, float *merged, int64_t step, float *full,
                       const int32_t *of, int64_t count)
{
    for (int64_t place = 0; place < count; place++) {
        if (of[place] < 0) {
            continue;
        }
        float *m = merged + of[place] * step, *w = full + place * TOGETHER;
        float *to = direction == FULL_TO_MERGED ? m : w;
        const float *from = direction == FULL_TO_MERGED ? w : m;
#pragma omp simd
        for (int r = 0; r < TOGETHER; r++) {
            to[r] += from[r];
        }
    }
}

static void add_share(const struct v2v_align_taps *conv, enum direction direction, float *share,
                      float *full, int64_t rows)
{
    int64_t features = conv->spec.features, slices = conv->slices;
    int64_t row = conv->spec.view_count * features * slices * PLACES;
    float part[SLICES * PLACES * TOGETHER];
    for (int64_t plane = 0; plane < conv->spec.view_count * features; plane++) {
        int64_t view = plane / features, feature = plane % features;
        for (int64_t z = 0; z < slices; z += SLICES) {
            int64_t count = (slices - z < SLICES ? slices - z : SLICES) * PLACES;
            float *w = full + (plane * slices + z) * PLACES, *merged = share + feature * TOGETHER;
            side_by_side(part, w, row, rows, count);
            for (int i = 0; i < REGIONS; i++) {
                const struct region *region = &conv->region[i];
                if (!skips(conv, i)) {
                    add_places(direction, merged, features * TOGETHER, part,
                               region->taps.of + (view * slices + z) * PLACES, count);
                }
                merged += region_columns(conv, region) * TOGETHER;
            }
            if (direction == MERGED_TO_FULL) {
                one_by_one(w, part, row, rows, count);
            }
        }
    }
}

static float *thread_share(const struct v2v_align_taps *conv)
{
    return conv->spec.method.workspace->data + omp_get_thread_num() * share_floats(conv);
}

static float *all_gradients(const struct v2v_align_taps *conv)
{
    return conv->spec.method.workspace->data + conv->threads * share_floats(conv);
}

void v2v_align_taps_set_weights(struct v2v_align_taps *conv, const float *weight, const float *bias)
{
    int64_t row = conv->spec.view_count * conv->spec.features * conv->slices * PLACES;
    int64_t out = conv->spec.out;
    conv->bias = bias;
#pragma omp parallel for schedule(static) num_threads(conv->threads)
    for (int64_t o = 0; o < out; o += TOGETHER) {
        int64_t rows = out - o < TOGETHER ? out - o : TOGETHER;
        float *share = thread_share(conv);
        memset(share, 0, (size_t)share_floats(conv) * sizeof *share);
        add_share(conv, FULL_TO_MERGED, share, (float *)(uintptr_t)(weight + o * row), rows);
        for (int i = 0; i < REGIONS; i++) {
            int64_t columns = region_columns(conv, &conv->region[i]);
            one_by_one(v2v_piece_data(&conv->region[i].weight) + o * columns, share, columns, rows,
                       columns);
            share += columns * TOGETHER;
        }
    }
}

static void set_full_gradient(const struct v2v_align_taps *conv, float *dweight)
{
    int64_t row = conv->spec.view_count * conv->spec.features * conv->slices * PLACES;
    int64_t out = conv->spec.out;
#pragma omp parallel for schedule(static) num_threads(conv->threads)
    for (int64_t o = 0; o < out; o += TOGETHER) {
        int64_t rows = out - o < TOGETHER ? out - o : TOGETHER;
        float *share = thread_share(conv);
        const float *gradient = all_gradients(conv);
        for (int i = 0; i < REGIONS; i++) {
            int64_t columns = region_columns(conv, &conv->region[i]);
            side_by_side(share, gradient + o * columns, columns, rows, columns);
            share += columns * TOGETHER;
            gradient += out * columns;
        }
        memset(dweight + o * row, 0, (size_t)(rows * row) * sizeof *dweight);
        add_share(conv, MERGED_TO_FULL, thread_share(conv), dweight + o * row, rows);
    }
}

/* ---- strips ---- */

struct rectangle {
    int64_t y0, y1, x0, x1;
};

/* A region's pixels in a run of tiles. */
static struct rectangle cut(const struct region *region, const struct v2v_tile_run *run)
{
    int64_t y0 = run->row * V2V_TILE, x0 = run->first * V2V_TILE;
    int64_t y1 = y0 + V2V_TILE, x1 = x0 + run->count * V2V_TILE;
    return (struct rectangle){.y0 = y0 > region->y0 ? y0 : region->y0,
                              .y1 = y1 < region->y1 ? y1 : region->y1,
                              .x0 = x0 > region->x0 ? x0 : region->x0,
                              .x1 = x1 < region->x1 ? x1 : region->x1};
}

/* The next rectangle of a region's pixels in the runs from *run on: runs of neighbouring rows with
 * the same columns are one. Without rows: there is none. */
static struct rectangle next_rectangle(int64_t *run, const struct region *region,
                                       const struct v2v_winograd_part *part)
{
    struct rectangle joined = {0};
    for (; *run < part->runs; (*run)++) {
        struct rectangle more = cut(region, &part->run[*run]);
        if (more.y0 >= more.y1 || more.x0 >= more.x1) {
            continue;
        }
        if (joined.y0 == joined.y1) {
            joined = more;
        } else if (more.y0 == joined.y1 && more.x0 == joined.x0 && more.x1 == joined.x1) {
            joined.y1 = more.y1;
        } else {
            break;
        }
    }
    return joined;
}

/* Rows [y0,y1) of a rectangle of a region: what one matrix product takes. */
struct strip {
    const struct region *region;
    int64_t y0, y1, x0, width, pixels;
};

static struct strip strip_at(const struct region *region, const struct rectangle *rectangle,
                             int64_t y)
{
    struct strip strip = {
        .region = region, .y0 = y, .x0 = rectangle->x0, .width = rectangle->x1 - rectangle->x0};
    int64_t rows = STRIP_PIXELS / strip.width;
    strip.y1 = y + (rows > 1 ? rows : 1);
    strip.y1 = strip.y1 < rectangle->y1 ? strip.y1 : rectangle->y1;
    strip.pixels = (strip.y1 - strip.y0) * strip.width;
    return strip;
}

/* Where tap t of feature c reads for the strip's first pixel. */
static float *tap_source(const struct v2v_align_taps *conv, const struct strip *strip,
                         const struct v2v_padded *features, int64_t t, int64_t c)
{
    const struct v2v_tap *tap = &strip->region->taps.tap[t];
    return features->data + v2v_padded_offset(features, conv->views[tap->view], c) +
           (strip->y0 + tap->y) * v2v_padded_pitch(features) + strip->x0 + tap->x;
}

/* patch[(tap,feature), pixel] */
static void gather(const struct v2v_align_taps *conv, const struct strip *strip,
                   const struct v2v_padded *features)
{
    int64_t count = features->features, columns = strip->region->taps.count * count;
#pragma omp parallel for schedule(static)
    for (int64_t column = 0; column < columns; column++) {
        const float *from = tap_source(conv, strip, features, column / count, column % count);
        float *to = conv->patch + column * strip->pixels;
        for (int64_t y = strip->y0; y < strip->y1; y++) {
            memcpy(to, from, (size_t)strip->width * sizeof *to);
            to += strip->width;
            from += v2v_padded_pitch(features);
        }
    }
}

/* Adjoint of gather: add the patches to the planes, each plane by one thread. */
static void scatter(const struct v2v_align_taps *conv, const struct strip *strip,
                    struct v2v_padded *dfeatures)
{
    int64_t count = dfeatures->features;
    const struct v2v_taps *taps = &strip->region->taps;
#pragma omp parallel for schedule(dynamic)
    for (int64_t owner = 0; owner < taps->views * count; owner++) {
        for (int64_t t = 0; t < taps->count; t++) {
            if (taps->tap[t].view != owner / count) {
                continue;
            }
            float *to = tap_source(conv, strip, dfeatures, t, owner % count);
            const float *from = conv->patch + (t * count + owner % count) * strip->pixels;
            for (int64_t y = strip->y0; y < strip->y1; y++) {
                for (int64_t x = 0; x < strip->width; x++) {
                    to[x] += from[x];
                }
                to += v2v_padded_pitch(dfeatures);
                from += strip->width;
            }
        }
    }
}

/* ---- forward and backward ---- */

/* Bias and activation, where the sums are. */
static void activate_strip(const struct v2v_align_taps *conv, const struct strip *strip)
{
    float slope = conv->spec.slope;
#pragma omp parallel for schedule(static)
    for (int64_t o = 0; o < conv->spec.out; o++) {
        float *sum = conv->strip + o * strip->pixels;
        for (int64_t i = 0; i < strip->pixels; i++) {
            float value = sum[i] + conv->bias[o];
            sum[i] = value > 0.0f ? value : slope * value;
        }
    }
}

static void give_strip(const struct v2v_align_taps *conv, const struct strip *strip, float *out,
                       int64_t first)
{
#pragma omp parallel for schedule(static)
    for (int64_t o = 0; o < conv->spec.out; o++) {
        const float *from = conv->strip + o * strip->pixels;
        for (int64_t y = strip->y0; y < strip->y1; y++) {
            memcpy(out + (o * conv->out_rows + y - first) * conv->width + strip->x0, from,
                   (size_t)strip->width * sizeof *out);
            from += strip->width;
        }
    }
}

/* To the tiles of a list, of which those from row `first` of tiles on are held. */
static void give_strip_listed(const struct v2v_align_taps *conv, const struct strip *strip,
                              float *out, const struct v2v_tiles *list, int64_t first)
{
    enum { TILE = V2V_TILE };
#pragma omp parallel for schedule(static)
    for (int64_t o = 0; o < conv->spec.out; o++) {
        const float *from = conv->strip + o * strip->pixels;
        float *channel = out + o * conv->out_rows * conv->width;
        for (int64_t i = 0; i < strip->pixels; i++) {
            int64_t y = strip->y0 + i / strip->width, x = strip->x0 + i % strip->width;
            int64_t tile = list->number[y / TILE * list->columns + x / TILE] - list->before[first];
            channel[(tile * TILE + y % TILE) * TILE + x % TILE] = from[i];
        }
    }
}

/* Likewise blocked. */
static void give_strip_listed_blocked(const struct v2v_align_taps *conv, const struct strip *strip,
                                      float *out, const struct v2v_tiles *list, int64_t first)
{
    enum { TILE = V2V_TILE };
    struct v2v_blocked image = {.data = out,
                                .channels = conv->spec.out,
                                .height = 1,
                                .width = conv->out_rows * conv->width};
#pragma omp parallel for schedule(static)
    for (int64_t block = 0; block < v2v_blocked_count(image.channels); block++) {
        int64_t o = block * V2V_BLOCKED_CHANNELS;
        for (int64_t i = 0; i < strip->pixels; i++) {
            const float *row[V2V_BLOCKED_CHANNELS] = {NULL};
            for (int c = 0; c < V2V_BLOCKED_CHANNELS && o + c < image.channels; c++) {
                row[c] = conv->strip + (o + c) * strip->pixels + i;
            }
            int64_t y = strip->y0 + i / strip->width, x = strip->x0 + i % strip->width;
            int64_t tile = list->number[y / TILE * list->columns + x / TILE] - list->before[first];
            v2v_blocked_set(&image, block, 0, (tile * TILE + y % TILE) * TILE + x % TILE, row, 1);
        }
    }
}

static void give_strip_blocked(const struct v2v_align_taps *conv, const struct strip *strip,
                               float *out)
{
    struct v2v_blocked image = {
        .data = out, .channels = conv->spec.out, .height = conv->height, .width = conv->width};
#pragma omp parallel for schedule(static)
    for (int64_t block = 0; block < v2v_blocked_count(image.channels); block++) {
        for (int64_t y = strip->y0; y < strip->y1; y++) {
            const float *row[V2V_BLOCKED_CHANNELS] = {NULL};
            int64_t o = block * V2V_BLOCKED_CHANNELS;
            for (int i = 0; i < V2V_BLOCKED_CHANNELS && o + i < image.channels; i++) {
                row[i] = conv->strip + (o + i) * strip->pixels + (y - strip->y0) * strip->width;
            }
            v2v_blocked_set(&image, block, y, strip->x0, row, strip->width);
        }
    }
}

static void give(const struct v2v_align_taps *conv, const struct strip *strip, float *out,
                 const struct v2v_winograd_part *part)
{
    if (conv->out_form == V2V_FORM_BLOCKED && part != NULL) {
        give_strip_listed_blocked(conv, strip, out, part->out_list, part->first_row);
    } else if (conv->out_form == V2V_FORM_BLOCKED) {
        give_strip_blocked(conv, strip, out);
    } else if (part != NULL && part->out_list != NULL) {
        give_strip_listed(conv, strip, out, part->out_list, part->first_row);
    } else {
        give_strip(conv, strip, out, part != NULL ? part->first_row * V2V_TILE : 0);
    }
}

static void forward_rectangle(struct v2v_align_taps *conv, float *out,
                              const struct v2v_padded *features, const struct region *region,
                              const struct rectangle *rectangle,
                              const struct v2v_winograd_part *part)
{
    int64_t columns = region->taps.count * conv->spec.features;
    for (int64_t y = rectangle->y0; y < rectangle->y1;) {
        struct strip strip = strip_at(region, rectangle, y);
        gather(conv, &strip, features);
        v2v_gemm(conv->spec.method.backend, 0, 0, conv->spec.out, strip.pixels, columns, 1.0f,
                 v2v_piece_data(&region->weight), columns, conv->patch, strip.pixels, 0.0f,
                 conv->strip, strip.pixels);
        activate_strip(conv, &strip);
        give(conv, &strip, out, part);
        y = strip.y1;
    }
}

static struct rectangle whole(const struct region *region)
{
    return (struct rectangle){region->y0, region->y1, region->x0, region->x1};
}

void v2v_align_taps_forward(struct v2v_align_taps *conv, float *out,
                            const struct v2v_padded *features, const struct v2v_winograd_part *part)
{
    for (int i = 0; i < REGIONS; i++) {
        const struct region *region = &conv->region[i];
        struct rectangle rectangle = whole(region);
        if (skips(conv, i)) {
            continue;
        }
        if (part == NULL) {
            forward_rectangle(conv, out, features, region, &rectangle, NULL);
            continue;
        }
        for (int64_t run = 0; run < part->runs;) {
            rectangle = next_rectangle(&run, region, part);
            forward_rectangle(conv, out, features, region, &rectangle, part);
        }
    }
}

/* Copy the strip's part of dout to conv->strip. */
static void take_strip(const struct v2v_align_taps *conv, const struct strip *strip,
                       const float *dout)
{
#pragma omp parallel for schedule(static)
    for (int64_t o = 0; o < conv->spec.out; o++) {
        float *to = conv->strip + o * strip->pixels;
        for (int64_t y = strip->y0; y < strip->y1; y++) {
            memcpy(to, dout + (o * conv->height + y) * conv->width + strip->x0,
                   (size_t)strip->width * sizeof *to);
            to += strip->width;
        }
    }
}

void v2v_align_taps_backward(struct v2v_align_taps *conv, float *dweight,
                             struct v2v_padded *dfeatures, const struct v2v_padded *features,
                             const float *dout)
{
    int backend = conv->spec.method.backend;
    int64_t out = conv->spec.out;
    float *gradient = all_gradients(conv);
    for (int i = 0; i < REGIONS; i++) {
        const struct region *region = &conv->region[i];
        int64_t columns = region_columns(conv, region);
        if (skips(conv, i)) {
            continue;
        }
        struct rectangle rectangle = whole(region);
        for (int64_t y = region->y0; y < region->y1;) {
            struct strip strip = strip_at(region, &rectangle, y);
            int64_t pixels = strip.pixels;
            gather(conv, &strip, features);
            take_strip(conv, &strip, dout);
            v2v_gemm(backend, 0, 1, out, columns, pixels, 1.0f, conv->strip, pixels, conv->patch,
                     pixels, y > region->y0 ? 1.0f : 0.0f, gradient, columns);
            v2v_gemm(backend, 1, 0, columns, pixels, out, 1.0f, v2v_piece_data(&region->weight),
                     columns, conv->strip, pixels, 0.0f, conv->patch, pixels);
            scatter(conv, &strip, dfeatures);
            y = strip.y1;
        }
        gradient += out * columns;
    }
    set_full_gradient(conv, dweight);
}
