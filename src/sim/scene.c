#include "v2v3d/sim/scene.h"

#include "sim/drawing.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const struct v2v_tree dendrites = {2, 0.7, 0.3, 0.5, 0.9, 0.75, 0.9};
static const struct v2v_tree processes = {3, 0.9, 0.5, 0.6, 1.0, 0.8, 0.9};
static const struct v2v_tree capillaries = {3, 0.8, 0.4, 0.6, 0.9, 0.8, 1.0};

static void draw_neuron(struct v2v_drawing *drawing)
{
    const struct v2v_point centre = v2v_drawing_place(drawing);
    const double brightness = v2v_drawing_uniform(drawing, 0.55, 1);
    const double size = v2v_drawing_uniform(drawing, 3, 5);
    struct v2v_point radius = {.x = size};
    radius.z = size * v2v_drawing_uniform(drawing, 0.7, 1);
    radius.y = size * v2v_drawing_uniform(drawing, 0.8, 1.2);
    v2v_drawing_ellipsoid(drawing, centre, radius, brightness, 0.35);
    for (int k = 0; k < 4; k++) {
        struct v2v_tube dendrite = {.direction = v2v_drawing_direction(drawing, 0.35)};
        dendrite.radius = v2v_drawing_uniform(drawing, 1.0, 1.5);
        dendrite.end_radius = 0.8;
        dendrite.length = v2v_drawing_uniform(drawing, 12, 28);
        dendrite.bend = 0.09;
        dendrite.brightness = 0.8 * brightness;
        dendrite.at = v2v_point_plus(centre, 0.8 * size, dendrite.direction);
        v2v_drawing_tree(drawing, dendrite, &dendrites);
    }
}

static void draw_fibre(struct v2v_drawing *drawing)
{
    struct v2v_tube fibre = {.at = v2v_drawing_place(drawing)};
    fibre.direction = v2v_drawing_direction(drawing, 0.25);
    fibre.radius = v2v_drawing_uniform(drawing, 0.6, 1.0);
    fibre.end_radius = fibre.radius;
    fibre.length = v2v_drawing_uniform(drawing, 40, 120);
    fibre.bend = 0.07;
    fibre.brightness = v2v_drawing_uniform(drawing, 0.25, 0.6);
    v2v_drawing_tube(drawing, fibre);
}

/* A vessel crosses the whole field through a random place. */
static void draw_vessel(struct v2v_drawing *drawing)
{
    struct v2v_tube vessel = {.at = v2v_drawing_place(drawing)};
    vessel.direction = v2v_drawing_direction(drawing, 0.1);
    vessel.radius = v2v_drawing_uniform(drawing, 1.8, 3.2);
    vessel.end_radius = 0.8 * vessel.radius;
    vessel.length = drawing->size.y + drawing->size.x;
    vessel.bend = 0.04;
    vessel.brightness = v2v_drawing_uniform(drawing, 0.3, 0.5);
    vessel.at = v2v_point_plus(vessel.at, -0.5 * vessel.length, vessel.direction);
    v2v_drawing_tube(drawing, vessel);
}

/* A vessel that forks down to capillaries. */
static void draw_vessel_tree(struct v2v_drawing *drawing)
{
    struct v2v_tube trunk = {.at = v2v_drawing_place(drawing)};
    trunk.direction = v2v_drawing_direction(drawing, 0.3);
    trunk.radius = v2v_drawing_uniform(drawing, 2.5, 5);
    trunk.end_radius = 0.8 * trunk.radius;
    trunk.length = v2v_drawing_uniform(drawing, 60, 120);
    trunk.bend = 0.05;
    trunk.brightness = v2v_drawing_uniform(drawing, 0.5, 1);
    v2v_drawing_tree(drawing, trunk, &capillaries);
}

/* Light in the cytoplasm, little in the nucleus. */
static void draw_cell(struct v2v_drawing *drawing)
{
    const struct v2v_point centre = v2v_drawing_place(drawing);
    const double brightness = v2v_drawing_uniform(drawing, 0.4, 1);
    const double size = v2v_drawing_uniform(drawing, 4, 7);
    struct v2v_point radius = {.z = size * v2v_drawing_uniform(drawing, 0.6, 1)};
    radius.y = size * v2v_drawing_uniform(drawing, 0.7, 1.3);
    radius.x = size * v2v_drawing_uniform(drawing, 0.7, 1.3);
    v2v_drawing_ellipsoid(drawing, centre, radius, brightness, 0.8);
}

static void draw_microglia(struct v2v_drawing *drawing)
{
    const struct v2v_point centre = v2v_drawing_place(drawing);
    const double brightness = v2v_drawing_uniform(drawing, 0.6, 1);
    const double size = v2v_drawing_uniform(drawing, 2.5, 3.5);
    v2v_drawing_ellipsoid(drawing, centre, (struct v2v_point){0.8 * size, size, 1.2 * size},
                          brightness, 0);
    for (int k = 0; k < 6; k++) {
        struct v2v_tube process = {.direction = v2v_drawing_direction(drawing, 0.6)};
        process.radius = v2v_drawing_uniform(drawing, 0.6, 0.9);
        process.end_radius = 0.5;
        process.length = v2v_drawing_uniform(drawing, 6, 12);
        process.bend = 0.15;
        process.brightness = 0.7 * brightness;
        process.at = v2v_point_plus(centre, 0.8 * size, process.direction);
        v2v_drawing_tree(drawing, process, &processes);
    }
}

static void draw_bead(struct v2v_drawing *drawing)
{
    const struct v2v_point centre = v2v_drawing_place(drawing);
    const double radius = v2v_drawing_uniform(drawing, 0.5, 1.0);
    v2v_drawing_ellipsoid(drawing, centre, (struct v2v_point){radius, radius, radius},
                          v2v_drawing_uniform(drawing, 0.6, 1), 0);
}

/* Of a cytoskeleton: thin and nearly straight. */
static void draw_filament(struct v2v_drawing *drawing)
{
    struct v2v_tube filament = {.at = v2v_drawing_place(drawing)};
    filament.direction = v2v_drawing_direction(drawing, 0.15);
    filament.radius = v2v_drawing_uniform(drawing, 0.4, 0.6);
    filament.end_radius = filament.radius;
    filament.length = v2v_drawing_uniform(drawing, 30, 90);
    filament.bend = 0.03;
    filament.brightness = v2v_drawing_uniform(drawing, 0.4, 1);
    v2v_drawing_tube(drawing, filament);
}

static void draw_neuropil(struct v2v_drawing *drawing)
{
    v2v_drawing_tissue(drawing, 12, 0.05, 0.45);
}

/* The structures of a kind of scene: at least one of each, else one in so many cubic micrometres;
 * 0: one in all. */
struct structure {
    void (*draw)(struct v2v_drawing *drawing);
    double volume_um3;
};

static const struct kind {
    const char *name;
    struct structure structures[4]; /* closed by {0} */
} kinds[] = {
    {"neurons", {{draw_neuron, 27500}}},
    {"vessels", {{draw_vessel_tree, 100000}}},
    {"cells", {{draw_cell, 4000}}},
    {"microglia", {{draw_microglia, 40000}}},
    {"beads", {{draw_bead, 3000}}},
    {"filaments", {{draw_filament, 4000}}},
    {"dense", {{draw_neuropil, 0}, {draw_cell, 8000}, {draw_fibre, 22000}}},
    {"mixed", {{draw_vessel, 132000}, {draw_fibre, 22000}, {draw_neuron, 27500}}},
};
enum { KINDS = sizeof kinds / sizeof kinds[0] };

const char *v2v_scene_name(int kind)
{
    return kind >= 0 && kind < KINDS ? kinds[kind].name : NULL;
}

enum v2v_status v2v_scene_find(int *kind, const char *name)
{
    char names[128] = "";
    size_t length = 0;
    for (int i = 0; i < KINDS; i++) {
        if (strcmp(kinds[i].name, name) == 0) {
            *kind = i;
            return V2V_OK;
        }
        length += (size_t)snprintf(names + length, sizeof names - length, "%s%s", i > 0 ? ", " : "",
                                   kinds[i].name);
    }
    return V2V_FAIL(V2V_E_USAGE, "scene '%s' is none of: %s", name, names);
}

/* In micrometres. */
static struct v2v_point size_of(const struct v2v_scene *scene)
{
    return (struct v2v_point){(double)scene->slices * scene->slice_um,
                              (double)scene->height * scene->pixel_um,
                              (double)scene->width * scene->pixel_um};
}

static double count_of(const struct structure *structure, struct v2v_point size)
{
    return structure->volume_um3 > 0
               ? fmax(1, rint(size.z * size.y * size.x / structure->volume_um3))
               : 1;
}

enum v2v_status v2v_scene_check(const struct v2v_scene *scene)
{
    const double most = 1e5; /* minutes */
    const struct v2v_point size = size_of(scene);
    double count = 0;
    for (const struct structure *s = kinds[scene->kind].structures; s->draw != NULL; s++) {
        count += count_of(s, size);
    }
    return count <= most
               ? V2V_OK
               : V2V_FAIL(V2V_E_USAGE,
                          "a scene of %g x %g x %g um would have %g structures, %g at most are "
                          "drawn: are pixel size (%g um) and slice spacing (%g um) right?",
                          size.z, size.y, size.x, count, most, scene->pixel_um, scene->slice_um);
}

static void draw_all(struct v2v_drawing *drawing, const struct structure *structure)
{
    const int64_t count = (int64_t)count_of(structure, drawing->size);
    for (int64_t i = 0; i < count; i++) {
        v2v_drawing_next(drawing);
        structure->draw(drawing);
    }
}

void v2v_scene_draw(float *volume, const struct v2v_scene *scene, int64_t t, int64_t first,
                    int64_t count)
{
    V2V_ASSERT(scene->kind >= 0 && scene->kind < KINDS && scene->pixel_um > 0 &&
               scene->slice_um > 0);
    const int64_t band = 5; /* slices: all structures are gone through for each */
    const int64_t pixels = scene->height * scene->width;
    memset(volume, 0, (size_t)(count * pixels) * sizeof *volume);
    /* Threads draw all structures, each into its own slices. */
#pragma omp parallel for schedule(dynamic)
    for (int64_t z = 0; z < count; z += band) {
        struct v2v_drawing drawing = {.scene = scene,
                                      .slices = volume + z * pixels,
                                      .first = first + z,
                                      .count = count - z < band ? count - z : band,
                                      .t = t,
                                      .size = size_of(scene)};
        for (const struct structure *s = kinds[scene->kind].structures; s->draw != NULL; s++) {
            draw_all(&drawing, s);
        }
    }
}
