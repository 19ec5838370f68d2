#include "nn/scene.h"

#include "v2v3d/base/memory.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

_Static_assert((int)V2V_TILE == (int)V2V_CARVE_TILE, "light is looked up by tile");

/* Noise alone: of 4096 tiles of 13 views x 39 slices of white noise the brightest showed 3.7
 * standard deviations, one in a hundred 2.8. */
static const double noise_deviations = 4.0;

/* Brightest: a hundredth of the tiles is brighter still, so that a hot pixel is not the measure. */
static const double brightest_share = 0.99;

/* With more tiles than this to compute, what is saved does not pay for what is lost. */
static const double most_share = 0.9;

enum v2v_status v2v_scene_init(struct v2v_scene *scene, const struct v2v_shifts *shifts,
                               int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiles *lists[] = {&scene->computed, &scene->halo, &scene->skipped, &scene->sample,
                                 &scene->sample_halo};
    *scene = (struct v2v_scene){0};
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        V2V_TRY(v2v_tiles_init(lists[i], height, width));
    }
    int64_t tiles = scene->computed.rows * scene->computed.columns;
    V2V_TRY(V2V_ALLOC(scene->light, "scene", 2 * tiles));
    V2V_TRY(V2V_ALLOC(scene->mask, "scene", 2 * tiles));
    V2V_TRY(v2v_carve_create(&scene->carve, shifts, height, width));
done:
    return rc;
}

void v2v_scene_fini(struct v2v_scene *scene)
{
    struct v2v_tiles *lists[] = {&scene->computed, &scene->halo, &scene->skipped, &scene->sample,
                                 &scene->sample_halo};
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        v2v_tiles_fini(lists[i]);
    }
    v2v_carve_destroy(&scene->carve);
    v2v_mem_free(scene->light);
    v2v_mem_free(scene->mask);
    *scene = (struct v2v_scene){0};
}

static int compare(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static double brightest(struct v2v_scene *scene, int64_t tiles)
{
    float *sorted = scene->light + tiles;
    memcpy(sorted, scene->light, (size_t)tiles * sizeof *sorted);
    qsort(sorted, (size_t)tiles, sizeof *sorted, compare);
    return (double)sorted[(int64_t)(brightest_share * (double)(tiles - 1))];
}

/* The most light of a square of tiles. */
static float light_of_square(const struct v2v_scene *scene, int64_t row, int64_t column)
{
    float most = -FLT_MAX;
    for (int64_t i = 0; i < V2V_SAMPLE_TILES * V2V_SAMPLE_TILES; i++) {
        int64_t y = row + i / V2V_SAMPLE_TILES, x = column + i % V2V_SAMPLE_TILES;
        float light = scene->light[y * scene->computed.columns + x];
        most = light > most ? light : most;
    }
    return most;
}

/* The darkest square of tiles inside the frame's outermost ones; FLT_MAX: the frame is too small.
 */
static float find_sample(struct v2v_scene *scene)
{
    float least = FLT_MAX;
    for (int64_t row = 1; row + V2V_SAMPLE_TILES < scene->computed.rows; row++) {
        for (int64_t column = 1; column + V2V_SAMPLE_TILES < scene->computed.columns; column++) {
            float light = light_of_square(scene, row, column);
            if (light < least) {
                least = light;
                scene->sample_row = row;
                scene->sample_column = column;
            }
        }
    }
    return least;
}

/* Is a tile within one tile of a marked one? */
static int touches(const uint8_t *mask, const struct v2v_tiles *tiles, int64_t row, int64_t column)
{
    for (int64_t y = row - 1; y <= row + 1; y++) {
        for (int64_t x = column - 1; x <= column + 1; x++) {
            if (y >= 0 && y < tiles->rows && x >= 0 && x < tiles->columns &&
                mask[y * tiles->columns + x]) {
                return 1;
            }
        }
    }
    return 0;
}

/* The listed tiles are `mask`'s; `halo` and `rest` (NULL: not wanted) become the others that touch
 * one of them, and all others. */
static void list(struct v2v_scene *scene, struct v2v_tiles *listed, struct v2v_tiles *halo,
                 struct v2v_tiles *rest)
{
    const uint8_t *mask = scene->mask;
    uint8_t *other = scene->mask + listed->rows * listed->columns;
    v2v_tiles_set(listed, mask);
    for (int64_t row = 0; row < listed->rows; row++) {
        for (int64_t column = 0; column < listed->columns; column++) {
            int64_t i = row * listed->columns + column;
            other[i] = !mask[i] && touches(mask, listed, row, column);
        }
    }
    v2v_tiles_set(halo, other);
    if (rest == NULL) {
        return;
    }
    for (int64_t i = 0; i < listed->rows * listed->columns; i++) {
        other[i] = !mask[i];
    }
    v2v_tiles_set(rest, other);
}

int v2v_scene_look(struct v2v_scene *scene, const float *views, double tolerance)
{
    int64_t columns = scene->computed.columns, tiles = scene->computed.rows * columns;
    double noise = v2v_carve_light(scene->carve, scene->light, views);
    double seen = noise_deviations * noise, counts = tolerance * brightest(scene, tiles);
    float least = (float)(seen > counts ? seen : counts);
    float dark = find_sample(scene);
    if (dark == FLT_MAX || dark > least) {
        return 0;
    }
    for (int64_t i = 0; i < tiles; i++) {
        scene->mask[i] = scene->light[i] > least;
    }
    list(scene, &scene->computed, &scene->halo, &scene->skipped);
    if ((double)scene->computed.count > most_share * (double)tiles) {
        return 0;
    }
    memset(scene->mask, 0, (size_t)tiles);
    for (int64_t i = 0; i < V2V_SAMPLE_TILES * V2V_SAMPLE_TILES; i++) {
        int64_t y = scene->sample_row + i / V2V_SAMPLE_TILES;
        scene->mask[y * columns + scene->sample_column + i % V2V_SAMPLE_TILES] = 1;
    }
    list(scene, &scene->sample, &scene->sample_halo, NULL);
    return 1;
}
