/* Frames in tiles against the network planned for the whole. */
#include "method/correction.h"
#include "small_depth_net.h"
#include "small_draw.h"

#include <string.h>

enum { SLICES = 2, FEATURES = V2V_FEATURES };

/* Products that a voxel's sum has, of all layers. */
static const double terms = 9 * (11 + 16 + 16 + 32 + 48 + 16);

static void check_frame(int64_t height, int64_t width)
{
    struct small_depth_net net;
    struct v2v_correction *correction = NULL;
    const int64_t voxels = SLICES * height * width;
    const int64_t even_y = height + height % 2, even_x = width + width % 2;
    const int64_t even_voxels = SLICES * even_y * even_x;
    float *features = small_draw(FEATURES * voxels, 1, 1.0), *volume = small_draw(voxels, 2, 1.0);
    float *even = small_draw(FEATURES * even_voxels, 3, 1.0);
    float *whole = small_draw(even_voxels, 4, 1.0);
    /* behind an odd side comes its last line but one */
    for (int64_t i = 0; i < FEATURES * even_voxels; i++) {
        const int64_t y = i / even_x % even_y, x = i % even_x;
        const int64_t from_y = y < height ? y : height > 1 ? height - 2 : 0;
        const int64_t from_x = x < width ? x : width > 1 ? width - 2 : 0;
        even[i] = features[(i / even_x / even_y * height + from_y) * width + from_x];
    }
    small_depth_net_init(&net, SLICES, even_y, even_x);
    struct v2v_network *network = &net.network;
    network->ops->forward(network, &whole, even);
    assert_ok(v2v_correction_create(&correction, network, height, width));
    const size_t held = v2v_mem_held();
    v2v_mem_set_limit(held);
    v2v_correction_run(correction, volume, features);
    v2v_mem_set_limit(0);
    for (int64_t row = 0; row < SLICES * height; row++) {
        float *line = whole + (row / height * even_y + row % height) * even_x;
        for (int64_t x = 0; x < width; x++) {
            line[x] = line[x] < 0.0f ? 0.0f : line[x];
        }
        assert_true(test_relative_l2(volume + row * width, line, width) <= test_rounding(terms));
    }
    v2v_correction_destroy(&correction);
    small_depth_net_fini(&net);
    v2v_mem_free(features);
    v2v_mem_free(volume);
    v2v_mem_free(even);
    v2v_mem_free(whole);
    assert_int_equal(v2v_mem_held(), 0);
}

/* One tile, two that overlap much or little, and sides that are odd. */
static void tiles_give_the_volume_of_the_whole(void **state)
{
    (void)state;
    check_frame(96, 12);
    check_frame(98, 6);
    check_frame(8, 176);
    check_frame(11, 259);
    check_frame(97, 5);
    check_frame(1, 7);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tiles_give_the_volume_of_the_whole),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
