#include "op/x86/amx_gradient.h"

#include "op/conv_backend.h"
#include "op/x86/amx.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"

#include <omp.h>
#include <string.h>

/** Pixels of a strip: 32 channels of either side stay in the second-level cache. */
static const int64_t STRIP_PIXELS = 8192;

struct amx_gradient {
    struct v2v_conv_spec spec;
    int64_t height, width;     /**< of the output */
    int64_t rows;              /**< of it in a strip */
    int64_t steps;             /**< of 32 pixels in a row */
    int64_t in_blocks, blocks; /**< of 32 channels: of the input, of the output */
    /* The left side: [channel][row][column modulo the stride][pitch] */
    int64_t left_rows, pitch, channel;
    int64_t right; /**< numbers of 16 outputs of a strip, [row][step][tile] */
    int threads;
};

/** What lies in the scratch: sums [block][input block][tap], as the products have them. */
struct sides {
    float *sums;
    bf16 *left, *right;
};

static int64_t taps(const struct amx_gradient *self)
{
    return (int64_t)self->spec.kernel * self->spec.kernel;
}

enum v2v_status amx_gradient_create(struct amx_gradient **gradient,
                                    const struct v2v_conv_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct amx_gradient *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "conv", 1));
    self->spec = *spec;
    self->height = conv_out_height(spec);
    self->width = conv_out_width(spec);
    self->steps = v2v_parts(self->width, AMX_DEPTH);
    self->rows =
        v2v_within(STRIP_PIXELS / (self->steps * AMX_DEPTH * spec->stride), 1, self->height);
    self->in_blocks = v2v_parts(spec->in, AMX_BLOCK);
    self->blocks = v2v_parts(spec->out, AMX_BLOCK);
    self->left_rows = (self->rows - 1) * spec->stride + spec->kernel;
    self->pitch = (self->steps + 1) * AMX_DEPTH;
    /* An odd number of cache lines: 16 channels in turn don't meet in one set of a cache. */
    self->channel = self->left_rows * spec->stride * self->pitch;
    self->channel += self->channel / AMX_DEPTH % 2 == 0 ? AMX_DEPTH : 0;
    self->right = self->rows * self->steps * AMX_TILE;
    self->threads = omp_get_max_threads();
done:
    *gradient = self;
    return rc;
}

void amx_gradient_destroy(struct amx_gradient *gradient)
{
    v2v_mem_free(gradient);
}

static int64_t sum_floats(const struct amx_gradient *self)
{
    return self->blocks * self->in_blocks * taps(self) * AMX_SUMS;
}

static int64_t left_numbers(const struct amx_gradient *self)
{
    return self->in_blocks * AMX_BLOCK * self->channel;
}

int64_t amx_gradient_floats(const struct amx_gradient *self)
{
    return sum_floats(self) + left_numbers(self) / 2 + self->blocks * self->right;
}

static struct sides place(const struct amx_gradient *self, float *scratch)
{
    struct sides sides = {.sums = scratch, .left = (bf16 *)(scratch + sum_floats(self))};
    sides.right = sides.left + left_numbers(self);
    return sides;
}

static void clear(bf16 *to, int64_t numbers)
{
    memset(to, 0, (size_t)numbers * sizeof *to);
}

/** The pixels of a row that are `phase` modulo the stride, counted with the zeros before it. */
static void pack_phase(const struct amx_gradient *self, bf16 *to, const float *from, int64_t phase)
{
    int64_t stride = self->spec.stride, before = (self->spec.kernel - 1) / 2;
    int64_t first = phase < before ? v2v_parts(before - phase, stride) : 0;
    int64_t x = first * stride + phase - before, count = v2v_parts(self->spec.width - x, stride);
    clear(to, first);
    v2v_amx_pack_row(to + first, from + x, count, stride);
    clear(to + first + count, self->pitch - first - count);
}

static void pack_channel(const struct amx_gradient *self, bf16 *to, const float *image, int64_t y0)
{
    int64_t stride = self->spec.stride, row = stride * self->pitch;
    int64_t first = y0 * stride - (self->spec.kernel - 1) / 2;
    for (int64_t r = 0; r < self->left_rows; r++) {
        int64_t y = first + r;
        if (image == NULL || y < 0 || y >= self->spec.height) {
            clear(to + r * row, row);
            continue;
        }
        for (int64_t phase = 0; phase < stride; phase++) {
            pack_phase(self, to + r * row + phase * self->pitch, image + y * self->spec.width,
                       phase);
        }
    }
}

/** Rows behind the image's last count nothing: they are zeros on the right side. */
static void pack_outputs(const struct amx_gradient *self, bf16 *to, const float *dout, int64_t o,
                         int64_t y0)
{
    int64_t plane = self->height * self->width, row = self->steps * AMX_TILE;
    int64_t rows = v2v_smaller(self->rows, self->height - y0);
    for (int64_t r = 0; r < rows; r++) {
        v2v_amx_pack_pairs(to + r * row, dout + o * plane + (y0 + r) * self->width, plane,
                           self->spec.out - o, self->width);
    }
    clear(to + rows * row, self->right - rows * row);
}

static void pack_strip(const struct amx_gradient *self, const struct sides *sides, const float *in,
                       const float *dout, int64_t y0)
{
    int64_t plane = self->spec.height * self->spec.width;
#pragma omp for schedule(static)
    for (int64_t c = 0; c < self->in_blocks * AMX_BLOCK; c++) {
        pack_channel(self, sides->left + c * self->channel,
                     c < self->spec.in ? in + c * plane : NULL, y0);
    }
#pragma omp for schedule(static)
    for (int64_t o = 0; o < self->blocks * 2; o++) {
        pack_outputs(self, sides->right + o * self->right, dout, o * AMX_SIDE, y0);
    }
}

static void correlate(const struct amx_gradient *self, const struct sides *sides)
{
    int64_t stride = self->spec.stride, row = stride * self->pitch;
#pragma omp for schedule(static)
    for (int64_t i = 0; i < self->blocks * self->in_blocks * taps(self); i++) {
        int64_t pair = i / taps(self), t = i % taps(self);
        int64_t y = t / self->spec.kernel, x = t % self->spec.kernel;
        const bf16 *right = sides->right + pair / self->in_blocks * 2 * self->right;
        const bf16 *left = sides->left + pair % self->in_blocks * AMX_BLOCK * self->channel;
        struct amx_rows rows = {.left = left + y * row + x % stride * self->pitch + x / stride,
                                .right = {right, right + self->right},
                                .channel = self->channel,
                                .left_row = stride * row,
                                .right_row = self->steps * AMX_TILE,
                                .rows = self->rows,
                                .steps = self->steps};
        v2v_amx_correlate(sides->sums + i * AMX_SUMS, &rows);
    }
}

/** The sums of 32 outputs by 32 channels to their places. */
static void give(const struct amx_gradient *self, float *dweight, const float *sums, int64_t o0,
                 int64_t c0)
{
    int64_t outputs = v2v_smaller(self->spec.out - o0, AMX_BLOCK);
    int64_t channels = v2v_smaller(self->spec.in - c0, AMX_BLOCK);
    for (int64_t o = 0; o < outputs; o++) {
        float *to = dweight + ((o0 + o) * self->spec.in + c0) * taps(self);
        for (int64_t c = 0; c < channels; c++) {
            int64_t tile = c / AMX_SIDE * 2 + o / AMX_SIDE;
            const float *from = sums + (tile * AMX_SIDE + c % AMX_SIDE) * AMX_SIDE + o % AMX_SIDE;
            for (int64_t t = 0; t < taps(self); t++) {
                *to++ += from[t * AMX_SUMS];
            }
        }
    }
}

void amx_gradient_add(const struct amx_gradient *self, float *scratch, float *dweight,
                      const float *in, const float *dout)
{
    struct sides sides = place(self, scratch);
    int64_t in_image = self->spec.in * self->spec.height * self->spec.width;
    int64_t out_image = self->spec.out * self->height * self->width;
    int64_t pairs = self->blocks * self->in_blocks, pair = taps(self) * AMX_SUMS;
#pragma omp parallel num_threads(self->threads)
    {
        v2v_amx_begin();
#pragma omp for schedule(static)
        for (int64_t i = 0; i < pairs; i++) {
            memset(sides.sums + i * pair, 0, (size_t)pair * sizeof *sides.sums);
        }
        for (int64_t n = 0; n < self->spec.batch; n++) {
            for (int64_t y0 = 0; y0 < self->height; y0 += self->rows) {
                pack_strip(self, &sides, in + n * in_image, dout + n * out_image, y0);
                correlate(self, &sides);
            }
        }
#pragma omp for schedule(static)
        for (int64_t i = 0; i < pairs; i++) {
            give(self, dweight, sides.sums + i * pair, i / self->in_blocks * AMX_BLOCK,
                 i % self->in_blocks * AMX_BLOCK);
        }
        v2v_amx_end();
    }
}
