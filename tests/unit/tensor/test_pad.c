/* Padding by reflection to the network's grid, and back. */
#include "support.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/tensor/pad.h"

enum { PLANES = 2, HEIGHT = 3, WIDTH = 5, PADDED_HEIGHT = 8, PADDED_WIDTH = 16 };

static void fill(float *x, int count)
{
    for (int i = 0; i < count; i++) {
        x[i] = (float)(i + 1);
    }
}

/* Step by step along the mirror image: to the last pixel, back to the first, and so on. */
static int walk(int steps, int n)
{
    int at = 0, direction = 1;
    for (int i = 0; i < steps && n > 1; i++) {
        if (at + direction < 0 || at + direction >= n) {
            direction = -direction;
        }
        at += direction;
    }
    return at;
}

static void sizes_round_up_to_the_grid(void **state)
{
    (void)state;
    static const int64_t cases[][3] = {{1, 32, 32}, {32, 32, 32}, {33, 32, 64}, {512, 32, 512}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_int_equal(v2v_round_up(cases[i][0], cases[i][1]), cases[i][2]);
    }
}

static void check_reflection(int height, int width)
{
    float in[PLANES * HEIGHT * WIDTH], out[PLANES * PADDED_HEIGHT * PADDED_WIDTH];
    fill(in, PLANES * height * width);
    v2v_pad_reflect(out, in, PLANES, height, width, PADDED_HEIGHT, PADDED_WIDTH);
    for (int i = 0; i < PLANES * PADDED_HEIGHT * PADDED_WIDTH; i++) {
        int p = i / (PADDED_HEIGHT * PADDED_WIDTH);
        int y = walk(i / PADDED_WIDTH % PADDED_HEIGHT, height), x = walk(i % PADDED_WIDTH, width);
        assert_true(out[i] == in[(p * height + y) * width + x]);
    }
}

static void padding_reflects_to_and_fro_without_repeating_the_edge(void **state)
{
    (void)state;
    check_reflection(HEIGHT, WIDTH);
    check_reflection(2, 4);
    check_reflection(1, 1);
    check_reflection(1, WIDTH);
    check_reflection(HEIGHT, 1);
}

static void a_frame_on_the_grid_is_copied(void **state)
{
    (void)state;
    float in[PLANES * HEIGHT * WIDTH], out[PLANES * HEIGHT * WIDTH];
    fill(in, PLANES * HEIGHT * WIDTH);
    v2v_pad_reflect(out, in, PLANES, HEIGHT, WIDTH, HEIGHT, WIDTH);
    assert_memory_equal(out, in, sizeof in);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sizes_round_up_to_the_grid),
        cmocka_unit_test(padding_reflects_to_and_fro_without_repeating_the_edge),
        cmocka_unit_test(a_frame_on_the_grid_is_copied),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
