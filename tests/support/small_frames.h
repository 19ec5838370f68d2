/** Frames of noise with a spot, and what fusing them gives. */
#ifndef TEST_SMALL_FRAMES_H
#define TEST_SMALL_FRAMES_H

#include "support.h"

#include "v2v3d/base/random.h"
#include "v2v3d/method/fusion.h"

#include <math.h>
#include <string.h>

enum { VIEWS = 2, HEIGHT = 60, WIDTH = 71, PIXELS = HEIGHT * WIDTH, SAMPLES = VIEWS * PIXELS };
enum { FRAMES = 5 };
static const double noise = 3.0;

static float frames[FRAMES][SAMPLES], fused[SAMPLES], other[SAMPLES];

/* A spot of this brightness and of two pixels' standard deviation, nearly outside of which nothing
 * is. */
static double spot(double brightness, int64_t i, double at_y, double at_x)
{
    const double y = (double)(i / WIDTH % HEIGHT) - at_y, x = (double)(i % WIDTH) - at_x;
    return brightness * exp(-(y * y + x * x) / 8.0);
}

/* Noise about a level; a spot that stands in one place in the first frame, then in another. */
static void make_frames(double brightness)
{
    for (int t = 0; t < FRAMES; t++) {
        for (int64_t i = 0; i < SAMPLES; i++) {
            frames[t][i] = (float)(100.0 + noise * v2v_random_normal(7, (uint64_t)t, (uint64_t)i) +
                                   spot(brightness, i, 30, t == 0 ? 20 : 50));
        }
    }
}

/* Frame 0 fused with `count` others, aligned or as they are, in place of `to`. */
static void fuse_frames(float *to, float (*of)[SAMPLES], int count, int is_aligned)
{
    struct v2v_fusion *fusion = NULL;
    assert_ok(v2v_fusion_create(&fusion, 1, VIEWS, HEIGHT, WIDTH, 0));
    v2v_fusion_begin(fusion, of[0]);
    for (int u = 1; u <= count; u++) {
        v2v_fusion_add(fusion, of[0], is_aligned ? v2v_fusion_align(fusion, of[0], of[u]) : of[u]);
    }
    memcpy(to, of[0], sizeof *of);
    v2v_fusion_end(fusion, to);
    v2v_fusion_destroy(&fusion);
}

static void fuse(float *to, float (*of)[SAMPLES], int count)
{
    fuse_frames(to, of, count, 0);
}

#endif
