/* The encoder without training: every thread takes a band of rows and goes down it some rows at a
 * time, through all layers, so that what a layer leaves is read again while a core's cache holds
 * it. A band begins and ends with the rows of its neighbours that its own ones read: these are
 * computed twice. */
#include "v2v/encoder_state.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/op/resample.h"

#include <omp.h>
#include <string.h>

/* Images of a band: the view, behind the entry, and behind the two layers of each block. */
enum { IMAGES = 2 + 2 * BLOCKS, DEEPEST = IMAGES - 1 };

/* Rows of an image that are made at a time: those that the coarsest level makes one of. In a ring
 * they follow what is read again, two rows of the next layer's and that below or above the image.
 */
enum { AT_ONCE = 8, HELD = AT_ONCE + 3 };

_Static_assert(AT_ONCE == 2 << (LEVELS - 1), "every level pools what is made at a time");

/* With fewer rows than this in a band too many of them are computed twice: a tenth at 32. */
static const int64_t least_rows = 32;

struct band {
    const struct v2v_encoder *encoder;
    int64_t first, last;            /* rows of the deepest image that it makes, in whole rows of the
                                       coarsest level */
    struct v2v_lines joined;        /* whole: all bands' */
    struct v2v_lines image[IMAGES]; /* rings; the deepest is whole */
    struct v2v_lines skipped;       /* behind a 1 x 1 convolution beside a block's layers */
    int64_t done[IMAGES];           /* rows above this one are made */
};

static int channels_of(const struct v2v_encoder *encoder, int image)
{
    return image == 0   ? 1
           : image == 1 ? (int)encoder->entry.out
                        : (int)encoder->block[(image - 2) / 2].first.out;
}

/* ---- plan ---- */

/* The rows above and below the image, and an odd number of rows: see lines.c's pitch. */
static struct v2v_lines joined_lines(const struct v2v_encoder *encoder)
{
    return v2v_lines_view(encoder->stream.joined, CONCATENATED, (encoder->height + 2) | 1,
                          encoder->height, encoder->width);
}

int64_t v2v_encoder_stream_floats(const struct v2v_encoder *encoder)
{
    return v2v_lines_floats(CONCATENATED, (encoder->height + 2) | 1, encoder->width);
}

/* Floats of a thread's rings. */
static int64_t ring_floats(const struct v2v_encoder *encoder)
{
    int64_t floats = 0;
    for (int i = 0; i < IMAGES; i++) {
        floats += v2v_lines_floats(channels_of(encoder, i), HELD, encoder->width);
    }
    return floats;
}

/* The deepest image's ring is that of what is added to it: the image itself is joined. */
static struct band band_of(const struct v2v_encoder *encoder, int t)
{
    const struct stream *stream = &encoder->stream;
    struct band band = {.encoder = encoder};
    int64_t units = encoder->height / AT_ONCE;
    float *memory = stream->rings[t];
    for (int i = 0; i < IMAGES; i++) {
        int channels = channels_of(encoder, i);
        band.image[i] = v2v_lines_view(memory, channels, HELD, encoder->height, encoder->width);
        memory += v2v_lines_floats(channels, HELD, encoder->width);
    }
    band.joined = joined_lines(encoder);
    band.skipped = band.image[DEEPEST];
    band.image[DEEPEST] = v2v_lines_channels(&band.joined, 0, DEEP);
    band.first = units * t / stream->threads * AT_ONCE;
    band.last = units * (t + 1) / stream->threads * AT_ONCE;
    return band;
}

static int all_take_lines(const struct v2v_encoder *encoder)
{
    int all = v2v_conv_takes_lines(encoder->entry.conv) &&
              v2v_conv_takes_lines(encoder->fuse.conv) && v2v_conv_takes_lines(encoder->last.conv);
    for (int b = 0; b < BLOCKS; b++) {
        const struct block *block = &encoder->block[b];
        all &= v2v_conv_takes_lines(block->first.conv) && v2v_conv_takes_lines(block->second.conv);
        all &= !block->has_skip || v2v_conv_takes_lines(block->skip.conv);
    }
    return all;
}

enum v2v_status v2v_encoder_stream_plan(struct v2v_encoder *encoder)
{
    enum v2v_status rc = V2V_OK;
    struct stream *stream = &encoder->stream;
    int threads = omp_get_max_threads();
    v2v_encoder_stream_fini(encoder);
    if (!v2v_encoder_may_stream(encoder) || encoder->height % AT_ONCE != 0 ||
        (threads > 1 && encoder->height / threads < least_rows) || !all_take_lines(encoder)) {
        return V2V_OK;
    }
    V2V_TRY(V2V_ALLOC(stream->rings, "encoder.rings", threads));
    stream->threads = threads;
    for (int i = 0; i < threads; i++) {
        V2V_TRY(V2V_ALLOC(stream->rings[i], "encoder.rings", ring_floats(encoder)));
    }
done:
    return rc;
}

void v2v_encoder_stream_fini(struct v2v_encoder *encoder)
{
    struct stream *stream = &encoder->stream;
    for (int i = 0; i < stream->threads; i++) {
        v2v_mem_free(stream->rings[i]);
    }
    v2v_mem_free(stream->rings);
    stream->rings = NULL;
    stream->threads = 0;
}

/* ---- the deepest image ---- */

/* Rows of image i that the band needs: one more at either end for every layer below. */
static int64_t begin_of(const struct band *band, int i)
{
    return v2v_within(band->first - (DEEPEST - i), 0, band->last);
}

static int64_t end_of(const struct band *band, int i)
{
    return v2v_smaller(band->last + DEEPEST - i, band->encoder->height);
}

/* Rows of the view, between columns of zeros. */
static void take_view(const struct band *band, const float *view, int64_t first, int64_t rows)
{
    const struct v2v_lines *to = &band->image[0];
    for (int64_t y = first; y < first + rows; y++) {
        memcpy(v2v_lines_at(to, y), view + y * to->width, (size_t)to->width * sizeof *view);
    }
}

/* Rows of image i > 0. Behind a block its input is added, or what a convolution makes of that. */
static void compute(const struct band *band, int i, int64_t first, int64_t rows)
{
    const struct v2v_encoder *encoder = band->encoder;
    const struct v2v_lines *image = &band->image[i];
    if (i == 1) {
        v2v_conv_forward_lines(encoder->entry.conv, image, image - 1, first, rows);
        return;
    }
    const struct block *block = &encoder->block[(i - 2) / 2];
    if (i % 2 == 0) {
        v2v_conv_forward_lines(block->first.conv, image, image - 1, first, rows);
        return;
    }
    const struct v2v_lines *beside = image - 2;
    struct v2v_lines skipped = v2v_lines_channels(&band->skipped, 0, image->channels);
    v2v_conv_forward_lines(block->second.conv, image, image - 1, first, rows);
    if (block->has_skip) {
        v2v_conv_forward_lines(block->skip.conv, &skipped, beside, first, rows);
        beside = &skipped;
    }
    v2v_lines_add(image, beside, first, rows);
}

/* The next rows of image i: as far as the image before it reaches and the ring has room. */
static void go_on(struct band *band, int i, const float *view)
{
    int64_t first = band->done[i], last = v2v_smaller(end_of(band, i), first + AT_ONCE);
    if (i > 0 && band->done[i - 1] < band->encoder->height) {
        last = v2v_smaller(last, band->done[i - 1] - 1);
    }
    if (last <= first) {
        return;
    }
    if (i == 0) {
        take_view(band, view, first, last - first);
    } else {
        compute(band, i, first, last - first);
    }
    v2v_lines_frame(&band->image[i], first, last - first);
    band->done[i] = last;
}

/* Pool what came since `pooled`, in whole rows of the coarsest level. */
static int64_t pool(const struct band *band, int64_t pooled)
{
    const struct v2v_encoder *encoder = band->encoder;
    int64_t rows = (band->done[DEEPEST] - pooled) / AT_ONCE * AT_ONCE;
    for (int k = 0; k < LEVELS && rows > 0; k++) {
        int factor = encoder->level[k].factor;
        v2v_avgpool_lines(encoder->stream.pooled[k], &band->image[DEEPEST], factor, pooled / factor,
                          rows / factor);
    }
    return pooled + rows;
}

static void go_down(struct band *band, const float *view)
{
    int64_t pooled = band->first;
    for (int i = 0; i <= DEEPEST; i++) {
        band->done[i] = begin_of(band, i);
    }
    while (band->done[DEEPEST] < band->last) {
        for (int i = 0; i <= DEEPEST; i++) {
            go_on(band, i, view);
        }
        pooled = pool(band, pooled);
    }
}

/* ---- the levels, and the two layers behind ---- */

static void run_level(const struct v2v_encoder *encoder, int k)
{
    const struct stream *stream = &encoder->stream;
    const struct level *level = &encoder->level[k];
    v2v_conv_forward(level->conv.conv, stream->small[k], stream->pooled[k]);
#pragma omp parallel for schedule(static) num_threads(stream->threads)
    for (int t = 0; t < stream->threads; t++) {
        struct band band = band_of(encoder, t);
        struct v2v_lines part =
            v2v_lines_channels(&band.joined, DEEP + k * LEVEL_FEATURES, LEVEL_FEATURES);
        v2v_bilinear_lines(&part, stream->small[k], level->factor, band.first,
                           band.last - band.first);
        v2v_lines_frame(&part, band.first, band.last - band.first);
    }
}

/* What the one layer leaves goes to the other in a ring that is free again. */
static void finish(const struct band *band)
{
    const struct v2v_encoder *encoder = band->encoder;
    const struct v2v_lines *fused = &band->skipped;
    struct v2v_lines output = v2v_lines_of_image(encoder->stream.output, encoder->features,
                                                 encoder->height, encoder->width);
    for (int64_t y = band->first; y < band->last; y += AT_ONCE) {
        v2v_conv_forward_lines(encoder->fuse.conv, fused, &band->joined, y, AT_ONCE);
        v2v_conv_forward_lines(encoder->last.conv, &output, fused, y, AT_ONCE);
    }
}

const float *v2v_encoder_stream_forward(struct v2v_encoder *encoder, const float *view)
{
    const struct stream *stream = &encoder->stream;
#pragma omp parallel for schedule(static) num_threads(stream->threads)
    for (int t = 0; t < stream->threads; t++) {
        struct band band = band_of(encoder, t);
        go_down(&band, view);
    }
    for (int k = 0; k < LEVELS; k++) {
        run_level(encoder, k);
    }
#pragma omp parallel for schedule(static) num_threads(stream->threads)
    for (int t = 0; t < stream->threads; t++) {
        struct band band = band_of(encoder, t);
        finish(&band);
    }
    return stream->output;
}
