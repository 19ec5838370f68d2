#include "network/twin_image.h"

#include "v2v3d/base/memory.h"
#include <string.h>

enum v2v_status v2v_image_init(struct v2v_image *image, int64_t channels, int64_t height,
                               int64_t width)
{
    *image = (struct v2v_image){.channels = channels, .height = height, .width = width};
    return V2V_ALLOC(image->data, "twin.image", v2v_mem_product(channels, height, width));
}

void v2v_image_fini(struct v2v_image *image)
{
    v2v_mem_free(image->data);
    *image = (struct v2v_image){0};
}

int64_t v2v_image_count(const struct v2v_image *image)
{
    return image->channels * image->height * image->width;
}

void v2v_image_replace(struct v2v_image *image, struct v2v_image *other)
{
    v2v_image_fini(image);
    *image = *other;
    *other = (struct v2v_image){0};
}

void v2v_image_leaky(struct v2v_image *image, double slope)
{
    for (int64_t i = 0; i < v2v_image_count(image); i++) {
        image->data[i] *= image->data[i] > 0.0 ? 1.0 : slope;
    }
}

enum v2v_status v2v_image_join(struct v2v_image *out, const struct v2v_image *first,
                               const struct v2v_image *second)
{
    enum v2v_status rc = V2V_OK;
    int64_t more = second != NULL ? second->channels : 0;
    V2V_TRY(v2v_image_init(out, first->channels + more, first->height, first->width));
    memcpy(out->data, first->data, (size_t)v2v_image_count(first) * sizeof *out->data);
    if (second != NULL) {
        V2V_ASSERT(second->height == first->height && second->width == first->width);
        memcpy(out->data + v2v_image_count(first), second->data,
               (size_t)v2v_image_count(second) * sizeof *out->data);
    }
done:
    return rc;
}

/* Each output is the sum, or the maximum, of a factor x factor block. */
static enum v2v_status pool(struct v2v_image *out, const struct v2v_image *in, int factor,
                            int is_sum)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_image_init(out, in->channels, in->height / factor, in->width / factor));
    int64_t rows = in->channels * out->height;
    for (int64_t row = 0; row < rows; row++) {
        for (int64_t x = 0; x < out->width; x++) {
            const double *block = in->data + (row * in->width + x) * factor;
            double value = block[0];
            for (int i = 1; i < factor * factor; i++) {
                double next = block[i / factor * in->width + i % factor];
                value = is_sum ? value + next : value > next ? value : next;
            }
            out->data[row * out->width + x] = value;
        }
    }
done:
    return rc;
}

enum v2v_status v2v_image_average_pool(struct v2v_image *out, const struct v2v_image *in,
                                       int factor)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(pool(out, in, factor, 1));
    for (int64_t i = 0; i < v2v_image_count(out); i++) {
        out->data[i] /= factor * factor;
    }
done:
    return rc;
}

enum v2v_status v2v_image_max_pool2(struct v2v_image *out, const struct v2v_image *in)
{
    return pool(out, in, 2, 0);
}

enum v2v_status v2v_image_nearest2(struct v2v_image *image)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_image out = {0};
    V2V_TRY(v2v_image_init(&out, image->channels, 2 * image->height, 2 * image->width));
    for (int64_t row = 0; row < out.channels * out.height; row++) {
        for (int64_t x = 0; x < out.width; x++) {
            out.data[row * out.width + x] = image->data[row / 2 * image->width + x / 2];
        }
    }
done:
    v2v_image_replace(image, &out);
    return rc;
}

/* The two neighbours of output i on one axis, and how much of the upper one it takes. */
struct place {
    int64_t low, high;
    double part;
};

static struct place place_of(int64_t i, int64_t from, int64_t to)
{
    double source = to > 1 ? (double)(i * (from - 1)) / (double)(to - 1) : 0.0;
    int64_t low = (int64_t)source;
    return (struct place){
        .low = low, .high = low + 1 < from ? low + 1 : low, .part = source - (double)low};
}

void v2v_image_bilinear(double *out, const struct v2v_image *in, int64_t height, int64_t width)
{
    for (int64_t c = 0; c < in->channels; c++) {
        const double *plane = in->data + c * in->height * in->width;
        for (int64_t y = 0; y < height; y++) {
            struct place at_y = place_of(y, in->height, height);
            const double *above = plane + at_y.low * in->width;
            const double *below = plane + at_y.high * in->width;
            for (int64_t x = 0; x < width; x++) {
                struct place at_x = place_of(x, in->width, width);
                double upper = above[at_x.low] + at_x.part * (above[at_x.high] - above[at_x.low]);
                double lower = below[at_x.low] + at_x.part * (below[at_x.high] - below[at_x.low]);
                out[(c * height + y) * width + x] = upper + at_y.part * (lower - upper);
            }
        }
    }
}
