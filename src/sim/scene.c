#include "v2v3d/sim/scene.h"

#include "sim/drawing.h"
#include "v2v3d/base/bounds.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

struct range {
    double least, most;
};

/** What tubes of a kind that begin anywhere have in common; lengths in micrometres. */
struct strand {
    double tilt; /* v2v_drawing_direction */
    struct range radius;
    double taper; /* part of the radius that is left at the end */
    struct range length;
    double bend;
    struct range brightness;
};
static const struct strand fibre = {0.25, {0.6, 1.0}, 1.0, {40, 120}, 0.07, {0.25, 0.6}};
static const struct strand trunk = {0.3, {2.5, 5}, 0.8, {60, 120}, 0.05, {0.5, 1}};
/* Of a cytoskeleton: thin and nearly straight. */
static const struct strand filament = {0.15, {0.4, 0.6}, 1.0, {30, 90}, 0.03, {0.4, 1}};
static const struct v2v_tree capillaries = {3, 0.8, 0.4, 0.6, 0.9, 0.8, 1.0};

/** The trees that grow out of a cell's body. */
struct arbor {
    int trees;
    double tilt;
    struct range radius;
    double end_radius;
    struct range length;
    double bend, dimmer; /* dimmer: part of the body's brightness */
    struct v2v_tree tree;
};
static const struct arbor dendrites = {
    4, 0.35, {1.0, 1.5}, 0.8, {12, 28}, 0.09, 0.8, {2, 0.7, 0.3, 0.5, 0.9, 0.75, 0.9}};
static const struct arbor processes = {
    6, 0.6, {0.6, 0.9}, 0.5, {6, 12}, 0.15, 0.7, {3, 0.9, 0.5, 0.6, 1.0, 0.8, 0.9}};

static double any_of(struct v2v_drawing *drawing, struct range range)
{
    return v2v_drawing_uniform(drawing, range.least, range.most);
}

static struct v2v_tube any_strand(struct v2v_drawing *drawing, const struct strand *strand)
{
    struct v2v_tube tube = {.at = v2v_drawing_place(drawing), .bend = strand->bend};
    tube.direction = v2v_drawing_direction(drawing, strand->tilt);
    tube.radius = any_of(drawing, strand->radius);
    tube.end_radius = strand->taper * tube.radius;
    tube.length = any_of(drawing, strand->length);
    tube.brightness = any_of(drawing, strand->brightness);
    return tube;
}

/* Around a body of this size. */
static void draw_arbor(struct v2v_drawing *drawing, const struct arbor *arbor,
                       struct v2v_point centre, double size, double brightness)
{
    for (int k = 0; k < arbor->trees; k++) {
        struct v2v_tube tube = {.direction = v2v_drawing_direction(drawing, arbor->tilt),
                                .end_radius = arbor->end_radius,
                                .bend = arbor->bend,
                                .brightness = arbor->dimmer * brightness};
        tube.radius = any_of(drawing, arbor->radius);
        tube.length = any_of(drawing, arbor->length);
        tube.at = v2v_point_plus(centre, 0.8 * size, tube.direction);
        v2v_drawing_tree(drawing, tube, &arbor->tree);
    }
}

static void draw_neuron(struct v2v_drawing *drawing)
{
    const struct v2v_point centre = v2v_drawing_place(drawing);
    const double brightness = v2v_drawing_uniform(drawing, 0.55, 1);
    const double size = v2v_drawing_uniform(drawing, 3, 5);
    struct v2v_point radius = {.x = size};
    radius.z = size * v2v_drawing_uniform(drawing, 0.7, 1);
    radius.y = size * v2v_drawing_uniform(drawing, 0.8, 1.2);
    v2v_drawing_ellipsoid(drawing, centre, radius, brightness, 0.35);
    draw_arbor(drawing, &dendrites, centre, size, brightness);
}

static void draw_microglia(struct v2v_drawing *drawing)
{
    const struct v2v_point centre = v2v_drawing_place(drawing);
    const double brightness = v2v_drawing_uniform(drawing, 0.6, 1);
    const double size = v2v_drawing_uniform(drawing, 2.5, 3.5);
    v2v_drawing_ellipsoid(drawing, centre, (struct v2v_point){0.8 * size, size, 1.2 * size},
                          brightness, 0);
    draw_arbor(drawing, &processes, centre, size, brightness);
}

static void draw_fibre(struct v2v_drawing *drawing)
{
    v2v_drawing_tube(drawing, any_strand(drawing, &fibre));
}

static void draw_filament(struct v2v_drawing *drawing)
{
    v2v_drawing_tube(drawing, any_strand(drawing, &filament));
}

/* A vessel that forks down to capillaries. */
static void draw_vessel_tree(struct v2v_drawing *drawing)
{
    v2v_drawing_tree(drawing, any_strand(drawing, &trunk), &capillaries);
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

static void draw_bead(struct v2v_drawing *drawing)
{
    const struct v2v_point centre = v2v_drawing_place(drawing);
    const double radius = v2v_drawing_uniform(drawing, 0.5, 1.0);
    v2v_drawing_ellipsoid(drawing, centre, (struct v2v_point){radius, radius, radius},
                          v2v_drawing_uniform(drawing, 0.6, 1), 0);
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
                                      .count = v2v_smaller(count - z, band),
                                      .t = t,
                                      .size = size_of(scene)};
        for (const struct structure *s = kinds[scene->kind].structures; s->draw != NULL; s++) {
            draw_all(&drawing, s);
        }
    }
}
