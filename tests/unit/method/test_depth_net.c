/* The network of slices against its formulas in double precision, and what follows from its having
 * no biases. Its gradient is tests/property/method/test_depth_net_gradient.c. */
#include "small_depth_net.h"
#include "small_draw.h"

#include "v2v3d/op/gemm.h"

#include <string.h>

enum { FEATURES = V2V_FEATURES, MOST_SLICES = 5, MOST_PIXELS = 48 * 48 };
enum { MOST_VOXELS = MOST_SLICES * MOST_PIXELS, MOST_INPUTS = 48 };

/* Products that a voxel's sum has, of all layers. */
static const double terms = 9 * (11 + 16 + 16 + 32 + 48 + 16);

struct size {
    int64_t slices, height, width;
};

/* [z,c,y,x] */
struct images {
    double x[MOST_INPUTS * MOST_VOXELS];
};

static struct images input, hidden, pooled, upper, lower;

static double *plane_of(struct images *images, int64_t channels, int64_t pixels, int64_t z,
                        int64_t c)
{
    return images->x + (z * channels + c) * pixels;
}

/* out = sum of 3 x 3 taps over zero padding; above 0, but of the last layer. */
static void convolve(struct images *out, const struct images *in, const float *weight,
                     const struct size *size, int64_t ins, int64_t outs)
{
    const int64_t h = size->height, w = size->width;
    double *to = out->x;
    for (int64_t i = 0; i < size->slices * outs * h * w; i++) {
        const int64_t x = i % w, y = i / w % h, o = i / (w * h) % outs, z = i / (w * h * outs);
        double sum = 0.0;
        for (int64_t c = 0; c < ins; c++) {
            const double *plane = in->x + (z * ins + c) * h * w;
            const float *tap = weight + (o * ins + c) * 9;
            for (int64_t dy = y > 0 ? -1 : 0; dy <= (y < h - 1); dy++) {
                for (int64_t dx = x > 0 ? -1 : 0; dx <= (x < w - 1); dx++) {
                    sum += plane[(y + dy) * w + x + dx] * (double)tap[(dy + 1) * 3 + dx + 1];
                }
            }
        }
        to[i] = outs > 1 && sum < 0.0 ? 0.0 : sum;
    }
}

static int64_t bounded(int64_t z, int64_t slices)
{
    return z < 0 ? 0 : z >= slices ? slices - 1 : z;
}

/* The k first of 16 channels of slice z - 1, the next k of z + 1. */
static int64_t mixed(int64_t z, int64_t c, int64_t k, int64_t slices)
{
    return bounded(c % 16 < k ? z - 1 : c % 16 < 2 * k ? z + 1 : z, slices);
}

static void mix(struct images *out, const struct images *in, const struct size *size,
                int64_t channels, int64_t k)
{
    const int64_t pixels = size->height * size->width;
    for (int64_t i = 0; i < size->slices * channels; i++) {
        const int64_t z = i / channels, c = i % channels;
        memcpy(out->x + i * pixels, in->x + (mixed(z, c, k, size->slices) * channels + c) * pixels,
               (size_t)pixels * sizeof(double));
    }
}

static void pool(struct images *out, const struct images *in, const struct size *size,
                 int64_t channels)
{
    const int64_t h = size->height / 2, w = size->width / 2;
    for (int64_t i = 0; i < size->slices * channels * h * w; i++) {
        const int64_t x = i % w, y = i / w % h, plane = i / (w * h);
        const double *from = in->x + (plane * 2 * h + 2 * y) * 2 * w + 2 * x;
        out->x[i] = (from[0] + from[1] + from[2 * w] + from[2 * w + 1]) / 4.0;
    }
}

/* Channels of h2, then those of d2, each pixel twice in y and x. */
static void join(struct images *out, const struct images *h2, const struct images *d2,
                 const struct size *size)
{
    const int64_t h = size->height, w = size->width;
    for (int64_t i = 0; i < size->slices * 48 * h * w; i++) {
        const int64_t x = i % w, y = i / w % h, c = i / (w * h) % 48, z = i / (w * h * 48);
        out->x[i] = c < 16 ? h2->x[((z * 16 + c) * h + y) * w + x]
                           : d2->x[((z * 32 + c - 16) * (h / 2) + y / 2) * (w / 2) + x / 2];
    }
}

static void gather(struct images *out, const float *features, const struct size *size)
{
    static const int64_t feature[] = {0, 0, 0, 0, 0, 1, 1, 1, 2, 2, 2};
    static const int64_t distance[] = {-2, -1, 0, 1, 2, -1, 0, 1, -1, 0, 1};
    const int64_t pixels = size->height * size->width;
    for (int64_t z = 0; z < size->slices; z++) {
        for (int64_t c = 0; c < 11; c++) {
            const int64_t from = bounded(z + distance[c], size->slices);
            double *to = plane_of(out, 11, pixels, z, c);
            for (int64_t i = 0; i < pixels; i++) {
                to[i] = (double)features[(feature[c] * size->slices + from) * pixels + i];
            }
        }
    }
}

static const float *weight_of(const struct small_depth_net *net, int i)
{
    return net->network.weights + net->network.schema.fields.item[i].offset;
}

static void twin(struct images *out, const struct small_depth_net *net, const float *features,
                 const struct size *size)
{
    const struct size half = {size->slices, size->height / 2, size->width / 2};
    gather(&input, features, size);
    convolve(&hidden, &input, weight_of(net, 0), size, 11, 16);
    mix(&input, &hidden, size, 16, 4);
    convolve(&upper, &input, weight_of(net, 1), size, 16, 16);
    pool(&pooled, &upper, size, 16);
    mix(&input, &pooled, &half, 16, 4);
    convolve(&hidden, &input, weight_of(net, 2), &half, 16, 32);
    mix(&input, &hidden, &half, 32, 4);
    convolve(&lower, &input, weight_of(net, 3), &half, 32, 32);
    join(&hidden, &upper, &lower, size);
    mix(&input, &hidden, size, 48, 2);
    convolve(&hidden, &input, weight_of(net, 4), size, 48, 16);
    convolve(out, &hidden, weight_of(net, 5), size, 16, 1);
    for (int64_t i = 0; i < size->slices * size->height * size->width; i++) {
        out->x[i] += (double)features[i];
    }
}

static int64_t voxels_of(const struct size *size)
{
    return size->slices * size->height * size->width;
}

static void run(struct small_depth_net *net, float *volume, const float *features)
{
    net->network.ops->weights_changed(&net->network);
    net->network.ops->forward(&net->network, &volume, features);
}

/* Sizes by which one backend or the other computes a layer, and slices that are both outermost. */
static void the_network_is_its_formulas(void **state)
{
    (void)state;
    static const struct size sizes[] = {{5, 8, 12}, {3, 48, 48}, {1, 6, 4}, {2, 10, 2}};
    static float volume[MOST_VOXELS];
    static struct images expected;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        struct small_depth_net net;
        const int64_t voxels = voxels_of(&sizes[i]);
        float *features = small_draw(FEATURES * voxels, 1, 1.0);
        small_depth_net_init(&net, sizes[i].slices, sizes[i].height, sizes[i].width);
        float *last = net.network.weights + net.network.schema.fields.item[5].offset;
        for (int64_t k = 0; k < 16 * 9; k++) { /* it counts */
            last[k] *= 10.0f;
        }
        run(&net, volume, features);
        twin(&expected, &net, features, &sizes[i]);
        const double error = test_relative_l2_to_double(volume, expected.x, voxels);
        if (!(error <= test_rounding(terms))) {
            fail_msg("%d slices: %g, allowed %g", (int)sizes[i].slices, error,
                     test_rounding(terms));
        }
        v2v_mem_free(features);
        small_depth_net_fini(&net);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void without_a_last_layer_nothing_is_corrected(void **state)
{
    (void)state;
    enum { SLICES = 3, SIDE = 8, VOXELS = SLICES * SIDE * SIDE };
    static float volume[VOXELS];
    struct small_depth_net net;
    float *features = small_draw(FEATURES * VOXELS, 2, 1.0);
    small_depth_net_init(&net, SLICES, SIDE, SIDE);
    const struct v2v_fields_item *last = &net.network.schema.fields.item[5];
    memset(net.network.weights + last->offset, 0, (size_t)last->count * sizeof(float));
    run(&net, volume, features);
    for (int i = 0; i < VOXELS; i++) {
        assert_true(volume[i] == features[i]);
    }
    v2v_mem_free(features);
    small_depth_net_fini(&net);
    assert_int_equal(v2v_mem_held(), 0);
}

/* Powers of two leave every rounding as it is. */
static void brighter_features_give_a_brighter_volume(void **state)
{
    (void)state;
    enum { SLICES = 3, SIDE = 48, VOXELS = SLICES * SIDE * SIDE };
    static float volume[VOXELS], brighter[VOXELS];
    struct small_depth_net net;
    float *features = small_draw(FEATURES * VOXELS, 3, 1.0);
    small_depth_net_init(&net, SLICES, SIDE, SIDE);
    run(&net, volume, features);
    static const float factors[] = {0x1p-20f, 0x1p20f, 0.3f};
    float before = 1.0f;
    for (size_t k = 0; k < sizeof factors / sizeof *factors; k++) {
        for (int i = 0; i < FEATURES * VOXELS; i++) {
            features[i] *= factors[k] / before;
        }
        before = factors[k];
        run(&net, brighter, features);
        for (int i = 0; i < VOXELS && k < 2; i++) {
            assert_true(brighter[i] == volume[i] * factors[k]);
        }
        for (int i = 0; i < VOXELS; i++) {
            brighter[i] /= factors[k];
        }
        assert_true(test_relative_l2(brighter, volume, VOXELS) <= test_rounding(terms));
    }
    v2v_mem_free(features);
    small_depth_net_fini(&net);
    assert_int_equal(v2v_mem_held(), 0);
}

/* A tile with DEPTH_NET_HALO around it has the values of the whole. */
static void tiles_are_parts_of_the_whole(void **state)
{
    (void)state;
    enum { SLICES = 2, HEIGHT = 4, WIDTH = 48, PART = 16, AT = 16, HALO = DEPTH_NET_HALO };
    enum { TILE = PART + 2 * HALO, WHOLE = SLICES * HEIGHT * WIDTH };
    static float whole[WHOLE], part[SLICES * HEIGHT * TILE];
    struct small_depth_net net;
    float *features = small_draw(FEATURES * WHOLE, 4, 1.0);
    small_depth_net_init(&net, SLICES, HEIGHT, WIDTH);
    run(&net, whole, features);
    small_depth_net_fini(&net);
    small_depth_net_init(&net, SLICES, HEIGHT, TILE);
    for (int row = 0; row < FEATURES * SLICES * HEIGHT; row++) {
        memmove(features + row * TILE, features + row * WIDTH + AT - HALO, TILE * sizeof(float));
    }
    run(&net, part, features);
    for (int row = 0; row < SLICES * HEIGHT; row++) {
        assert_true(test_relative_l2(part + row * TILE + HALO, whole + row * WIDTH + AT, PART) <=
                    test_rounding(terms));
    }
    v2v_mem_free(features);
    small_depth_net_fini(&net);
    assert_int_equal(v2v_mem_held(), 0);
}

/* Forward and backward, and nothing is taken for them. */
static void two_threads_give_the_bits_of_one(void **state)
{
    (void)state;
    enum { SLICES = 3, SIDE = 48, VOXELS = SLICES * SIDE * SIDE, MOST_FLOATS = 40000 };
    static float volume[2][VOXELS], gradients[2][MOST_FLOATS];
    float *features = small_draw(FEATURES * VOXELS, 5, 1.0);
    for (int t = 0; t < 2; t++) {
        struct small_depth_net net;
        v2v_op_set_threads(t + 1);
        small_depth_net_init(&net, SLICES, SIDE, SIDE);
        const int64_t floats = net.network.schema.fields.total;
        const float *const dvolume[] = {volume[t]};
        const size_t held = v2v_mem_held();
        assert_true(floats <= MOST_FLOATS);
        v2v_mem_set_limit(held);
        run(&net, volume[t], features);
        net.network.ops->backward(&net.network, dvolume);
        v2v_mem_set_limit(0);
        assert_int_equal(v2v_mem_held(), held);
        memcpy(gradients[t], net.network.gradients, (size_t)floats * sizeof(float));
        small_depth_net_fini(&net);
    }
    v2v_op_set_threads(1);
    assert_memory_equal(volume[0], volume[1], sizeof volume[0]);
    assert_memory_equal(gradients[0], gradients[1], sizeof gradients[0]);
    v2v_mem_free(features);
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_network_is_its_formulas),
        cmocka_unit_test(without_a_last_layer_nothing_is_corrected),
        cmocka_unit_test(brighter_features_give_a_brighter_volume),
        cmocka_unit_test(tiles_are_parts_of_the_whole),
        cmocka_unit_test(two_threads_give_the_bits_of_one),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
