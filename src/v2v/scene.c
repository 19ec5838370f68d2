#include "v2v/scene.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/statistics.h"

#include <float.h>
#include <string.h>

_Static_assert((int)V2V_TILE == (int)V2V_CARVE_TILE, "light is looked up by tile");

/* Noise alone: of 4096 tiles of 13 views x 39 slices of white noise the brightest showed 2.8 to 3.4
 * standard deviations, one in a hundred 2.0. */
static const double noise_deviations = 3.0;

/* Brightest: a hundredth of the tiles is brighter still, so that a hot pixel is not the measure. */
static const double brightest_share = 0.99;

/* With more tiles than this to compute, what is saved does not pay for what is lost. */
static const double most_share = 0.9;

enum v2v_status v2v_scene_init(struct v2v_scene *scene, const struct v2v_shifts *shifts,
                               int64_t height, int64_t width, const struct v2v_slab *slab)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiles *lists[] = {&scene->computed, &scene->dark};
    *scene = (struct v2v_scene){0};
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        V2V_TRY(v2v_tiles_init(lists[i], v2v_slab_computed(slab), width));
    }
    int64_t columns = scene->computed.columns;
    scene->tiles = (height + V2V_TILE - 1) / V2V_TILE * columns;
    V2V_TRY(V2V_ALLOC(scene->light, "scene", 2 * scene->tiles));
    scene->own_light = scene->light + v2v_slab_start(slab) / V2V_TILE * columns;
    V2V_TRY(V2V_ALLOC(scene->mask, "scene", scene->computed.rows * columns));
    V2V_TRY(v2v_scene_half_init(&scene->half, &scene->computed));
    V2V_TRY(v2v_carve_create(&scene->carve, shifts, height, width));
done:
    return rc;
}

void v2v_scene_fini(struct v2v_scene *scene)
{
    struct v2v_tiles *lists[] = {&scene->computed, &scene->dark};
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        v2v_tiles_fini(lists[i]);
    }
    v2v_scene_half_fini(&scene->half);
    v2v_carve_destroy(&scene->carve);
    v2v_mem_free(scene->light);
    v2v_mem_free(scene->mask);
    *scene = (struct v2v_scene){0};
}

static double brightest(struct v2v_scene *scene)
{
    int64_t tiles = scene->tiles;
    float *light = scene->light + tiles;
    memcpy(light, scene->light, (size_t)tiles * sizeof *light);
    return (double)v2v_select(light, tiles, (int64_t)(brightest_share * (double)(tiles - 1)));
}

/* The most light of a square of tiles. */
static float light_of_square(const struct v2v_scene *scene, int64_t row, int64_t column)
{
    float most = -FLT_MAX;
    for (int64_t i = 0; i < V2V_SAMPLE_TILES * V2V_SAMPLE_TILES; i++) {
        int64_t y = row + i / V2V_SAMPLE_TILES, x = column + i % V2V_SAMPLE_TILES;
        float light = scene->own_light[y * scene->computed.columns + x];
        most = light > most ? light : most;
    }
    return most;
}

/* The darkest square of tiles, in rows of squares from the first row on; FLT_MAX: the
 * frame is too small. */
static float find_sample(struct v2v_scene *scene)
{
    enum { SIDE = V2V_SAMPLE_TILES };
    float least = FLT_MAX;
    for (int64_t row = 0; row + SIDE <= scene->computed.rows; row += SIDE) {
        for (int64_t column = 0; column + SIDE <= scene->computed.columns; column++) {
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

/* Mark the tiles that hold light, or with `dark` those that do not. */
static void mark(struct v2v_scene *scene, float least, int dark)
{
    int64_t tiles = scene->computed.rows * scene->computed.columns;
    for (int64_t i = 0; i < tiles; i++) {
        scene->mask[i] = (scene->own_light[i] > least) != dark;
    }
}

static void mark_sample(struct v2v_scene *scene)
{
    for (int64_t i = 0; i < V2V_SAMPLE_TILES * V2V_SAMPLE_TILES; i++) {
        int64_t y = scene->sample_row + i / V2V_SAMPLE_TILES;
        int64_t x = scene->sample_column + i % V2V_SAMPLE_TILES;
        scene->mask[y * scene->computed.columns + x] = 1;
    }
}

int v2v_scene_look(struct v2v_scene *scene, const float *views, double tolerance)
{
    int64_t tiles = scene->computed.rows * scene->computed.columns;
    double noise = v2v_carve_light(scene->carve, scene->light, views);
    double seen = noise_deviations * noise, counts = tolerance * brightest(scene);
    float least = (float)(seen > counts ? seen : counts);
    float darkest = find_sample(scene);
    if (darkest == FLT_MAX || darkest > least) {
        return 0;
    }
    mark(scene, least, 1);
    v2v_tiles_set(&scene->dark, scene->mask);
    mark(scene, least, 0);
    mark_sample(scene);
    v2v_tiles_set(&scene->computed, scene->mask);
    v2v_scene_half_set(&scene->half, &scene->computed, &scene->dark, scene->sample_row,
                       scene->sample_column);
    return (double)scene->computed.count <= most_share * (double)tiles;
}
