#include "twin_conv.h"
#include <math.h>
#include <string.h>

/** One product of a convolution: out[o] += weight[w] * in[i], as flat indices. */
typedef void (*visit)(void *context, int64_t o, int64_t w, int64_t i);

struct sizes {
    int64_t rows, columns; /**< of the output */
    int64_t out, in, weights;
};

static struct sizes sizes_of(const struct v2v_conv_spec *s)
{
    struct sizes sizes = {.rows = (s->height - 1) / s->stride + 1,
                          .columns = (s->width - 1) / s->stride + 1};
    sizes.out = s->batch * s->out * sizes.rows * sizes.columns;
    sizes.in = s->batch * s->in * s->height * s->width;
    sizes.weights = s->out * s->in * s->kernel * s->kernel;
    return sizes;
}

/** The taps of one output pixel. */
static void visit_pixel(const struct v2v_conv_spec *s, int64_t n, int64_t o, int64_t y, int64_t x,
                        int64_t flat, visit visitor, void *context)
{
    int64_t pad = (s->kernel - 1) / 2;
    for (int64_t i = 0; i < s->in; i++) {
        for (int64_t k = 0; k < s->kernel; k++) {
            for (int64_t l = 0; l < s->kernel; l++) {
                int64_t row = y * s->stride + k - pad, column = x * s->stride + l - pad;
                if (row >= 0 && row < s->height && column >= 0 && column < s->width) {
                    visitor(context, flat, ((o * s->in + i) * s->kernel + k) * s->kernel + l,
                            ((n * s->in + i) * s->height + row) * s->width + column);
                }
            }
        }
    }
}

static void visit_all(const struct v2v_conv_spec *s, visit visitor, void *context)
{
    struct sizes sizes = sizes_of(s);
    int64_t flat = 0;
    for (int64_t n = 0; n < s->batch; n++) {
        for (int64_t o = 0; o < s->out; o++) {
            for (int64_t y = 0; y < sizes.rows; y++) {
                for (int64_t x = 0; x < sizes.columns; x++) {
                    visit_pixel(s, n, o, y, x, flat++, visitor, context);
                }
            }
        }
    }
}

struct arrays {
    struct twin sum;
    const float *left, *right;
};

static void add(struct twin sum, int64_t at, float left, float right)
{
    double term = (double)left * (double)right;
    sum.value[at] += term;
    if (sum.moduli != NULL) {
        sum.moduli[at] += fabs(term);
    }
}

static void add_forward(void *context, int64_t o, int64_t w, int64_t i)
{
    struct arrays *a = context;
    add(a->sum, o, a->left[i], a->right[w]);
}

static void add_data(void *context, int64_t o, int64_t w, int64_t i)
{
    struct arrays *a = context;
    add(a->sum, i, a->left[o], a->right[w]);
}

static void add_weights(void *context, int64_t o, int64_t w, int64_t i)
{
    struct arrays *a = context;
    add(a->sum, w, a->left[o], a->right[i]);
}

static void clear(struct twin sum, int64_t count)
{
    memset(sum.value, 0, (size_t)count * sizeof(double));
    if (sum.moduli != NULL) {
        memset(sum.moduli, 0, (size_t)count * sizeof(double));
    }
}

void twin_conv_forward(struct twin out, const struct v2v_conv_spec *spec, const float *in,
                       const float *weight, const float *bias)
{
    struct sizes sizes = sizes_of(spec);
    clear(out, sizes.out);
    for (int64_t at = 0; at < sizes.out; at++) {
        add(out, at, 1.0f, bias[at / (sizes.rows * sizes.columns) % spec->out]);
    }
    visit_all(spec, add_forward, &(struct arrays){out, in, weight});
}

void twin_conv_backward_data(struct twin din, const struct v2v_conv_spec *spec, const float *dout,
                             const float *weight)
{
    clear(din, sizes_of(spec).in);
    visit_all(spec, add_data, &(struct arrays){din, dout, weight});
}

void twin_conv_backward_weights(struct twin dweight, const struct v2v_conv_spec *spec,
                                const float *in, const float *dout)
{
    clear(dweight, sizes_of(spec).weights);
    visit_all(spec, add_weights, &(struct arrays){dweight, dout, in});
}

void twin_bilinear(double *out, const float *in, int64_t height, int64_t width, int factor)
{
    int64_t rows = height * factor, columns = width * factor;
    for (int64_t y = 0; y < rows; y++) {
        for (int64_t x = 0; x < columns; x++) {
            double sum = 0.0;
            double v = rows == 1 ? 0.0 : (double)(y * (height - 1)) / (double)(rows - 1);
            double u = columns == 1 ? 0.0 : (double)(x * (width - 1)) / (double)(columns - 1);
            for (int64_t k = 0; k < height; k++) {
                for (int64_t l = 0; l < width; l++) {
                    double hat =
                        fmax(0.0, 1.0 - fabs(v - (double)k)) * fmax(0.0, 1.0 - fabs(u - (double)l));
                    sum += hat * (double)in[k * width + l];
                }
            }
            out[y * columns + x] = sum;
        }
    }
}
