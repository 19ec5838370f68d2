#include "sim/drawing.h"

#include "v2v3d/base/random.h"

#include <math.h>

static const double edge = 0.8; /* half-width of a structure's soft rim, in pixels */
static const double step = 0.5; /* between the balls of a tube */

/* Streams of their own, so that what moves is what stands still: the structure's number below. */
static const uint64_t motion_stream = (uint64_t)'M' << 56;
static const uint64_t lattice_stream = (uint64_t)'L' << 56;

double v2v_drawing_uniform(struct v2v_drawing *drawing, double low, double high)
{
    return low + (high - low) *
                     v2v_random_uniform(drawing->scene->seed, drawing->stream, drawing->index++);
}

static double normal(struct v2v_drawing *drawing)
{
    return v2v_random_normal(drawing->scene->seed, drawing->stream, drawing->index++);
}

struct v2v_point v2v_point_plus(struct v2v_point a, double s, struct v2v_point b)
{
    return (struct v2v_point){a.z + s * b.z, a.y + s * b.y, a.x + s * b.x};
}

static struct v2v_point unit(struct v2v_point a)
{
    const double length = sqrt(a.z * a.z + a.y * a.y + a.x * a.x) + 1e-12;
    return (struct v2v_point){a.z / length, a.y / length, a.x / length};
}

/* There and back between -range and range, from 0 on. */
static double turning_back(double way)
{
    const double range = V2V_SCENE_RANGE_UM;
    const double along = fmod(way + range, 4 * range);
    return along < 2 * range ? along - range : 3 * range - along;
}

void v2v_drawing_next(struct v2v_drawing *drawing)
{
    const struct v2v_scene *scene = drawing->scene;
    const uint64_t stream = motion_stream + ++drawing->stream;
    drawing->index = 0;
    const double angle = 2 * acos(-1) * v2v_random_uniform(scene->seed, stream, 0);
    const double tilt = 0.3 * v2v_random_normal(scene->seed, stream, 1);
    const struct v2v_point direction = unit((struct v2v_point){tilt, sin(angle), cos(angle)});
    drawing->shift = v2v_point_plus((struct v2v_point){0, 0, 0},
                                    turning_back(scene->motion_um * (double)drawing->t), direction);
}

struct v2v_point v2v_drawing_direction(struct v2v_drawing *drawing, double tilt)
{
    const double angle = v2v_drawing_uniform(drawing, 0, 2 * acos(-1));
    return unit((struct v2v_point){tilt * normal(drawing), sin(angle), cos(angle)});
}

struct v2v_point v2v_drawing_place(struct v2v_drawing *drawing)
{
    const double z = v2v_drawing_uniform(drawing, 0, drawing->size.z);
    const double y = v2v_drawing_uniform(drawing, 0, drawing->size.y);
    return (struct v2v_point){z, y, v2v_drawing_uniform(drawing, 0, drawing->size.x)};
}

/* 1 inside, 0 outside, a smooth rim between. @param depth of the place below the surface, negative
 * outside, in pixels */
static double soft(double depth)
{
    const double t = fmin(fmax((depth + edge) / (2 * edge), 0), 1);
    return t * t * (3 - 2 * t);
}

struct range {
    int64_t first, end;
};

/* Voxels from `first` to `end` that something of this radius and its rim reach; all in voxels. */
static struct range reach(double centre, double radius, int64_t first, int64_t end)
{
    return (struct range){(int64_t)floor(fmax(centre - radius, (double)first)),
                          (int64_t)ceil(fmin(centre + radius + 1, (double)end))};
}

void v2v_drawing_ellipsoid(struct v2v_drawing *drawing, struct v2v_point centre,
                           struct v2v_point radius, double brightness, double nucleus)
{
    const struct v2v_scene *scene = drawing->scene;
    const double pixel = scene->pixel_um, slice = scene->slice_um, rim = edge * pixel;
    centre = v2v_point_plus(centre, 1, drawing->shift);
    const struct range rz = reach(centre.z / slice, (radius.z + rim) / slice, drawing->first,
                                  drawing->first + drawing->count);
    const struct range ry = reach(centre.y / pixel, (radius.y + rim) / pixel, 0, scene->height);
    const struct range rx = reach(centre.x / pixel, (radius.x + rim) / pixel, 0, scene->width);
    const double mean_radius = cbrt(radius.z * radius.y * radius.x) / pixel;
    for (int64_t z = rz.first; z < rz.end; z++) {
        for (int64_t y = ry.first; y < ry.end; y++) {
            for (int64_t x = rx.first; x < rx.end; x++) {
                const double dz = ((double)z * slice - centre.z) / radius.z;
                const double dy = ((double)y * pixel - centre.y) / radius.y;
                const double dx = ((double)x * pixel - centre.x) / radius.x;
                const double r = sqrt(dz * dz + dy * dy + dx * dx); /* 1 on the surface */
                const double value = brightness * soft((1 - r) * mean_radius) *
                                     (1 - nucleus * soft((0.5 - r) * mean_radius));
                float *voxel =
                    drawing->slices + ((z - drawing->first) * scene->height + y) * scene->width + x;
                *voxel = fmaxf(*voxel, (float)value);
            }
        }
    }
}

struct v2v_tube v2v_drawing_tube(struct v2v_drawing *drawing, struct v2v_tube tube)
{
    const double first_radius = tube.radius;
    const double beads = v2v_drawing_uniform(drawing, 0, 2 * acos(-1)); /* its slow swelling */
    for (double s = 0; s < tube.length; s += step) {
        const double part = s / tube.length;
        tube.radius = first_radius + part * (tube.end_radius - first_radius);
        const double radius = tube.radius * (1 + 0.15 * sin(beads + 0.35 * s));
        v2v_drawing_ellipsoid(drawing, tube.at, (struct v2v_point){radius, radius, radius},
                              tube.brightness, 0);
        struct v2v_point turn = {.z = 0.4 * normal(drawing)};
        turn.y = normal(drawing);
        turn.x = normal(drawing);
        tube.direction = unit(v2v_point_plus(tube.direction, tube.bend, turn));
        tube.at = v2v_point_plus(tube.at, step, tube.direction);
    }
    return tube;
}

static void draw_branch(struct v2v_drawing *drawing, struct v2v_tube branch,
                        const struct v2v_tree *tree, int generation)
{
    const struct v2v_tube end = v2v_drawing_tube(drawing, branch);
    for (int k = 0; generation < tree->generations && k < 2; k++) {
        struct v2v_tube child = end;
        const struct v2v_point away = v2v_drawing_direction(drawing, tree->tilt);
        child.direction = unit(v2v_point_plus(end.direction, tree->spread, away));
        child.end_radius = tree->thinner * end.radius;
        child.length = branch.length * v2v_drawing_uniform(drawing, tree->least, tree->most);
        child.brightness = tree->dimmer * branch.brightness;
        draw_branch(drawing, child, tree, generation + 1);
    }
}

void v2v_drawing_tree(struct v2v_drawing *drawing, struct v2v_tube trunk,
                      const struct v2v_tree *tree)
{
    draw_branch(drawing, trunk, tree, 0);
}

/* The number of a lattice point, in [0,1). */
static double lattice_point(const struct v2v_drawing *drawing, int octave, int64_t z, int64_t y,
                            int64_t x)
{
    const int64_t bits = (1 << 18) - 1; /* of a coordinate: lattices of 262144 points repeat */
    const uint64_t index = (uint64_t)(((z & bits) << 36) | ((y & bits) << 18) | (x & bits));
    const uint64_t stream = lattice_stream + 2 * drawing->stream + (uint64_t)octave;
    return v2v_random_uniform(drawing->scene->seed, stream, index);
}

static double smooth(double t)
{
    return t * t * (3 - 2 * t);
}

/* The corners of a lattice's cell, kept for the places that follow in it. */
struct cell {
    int octave;
    double steps; /* of the lattice, in a micrometre */
    double z, y, x;
    double corner[8];
};

static void enter_cell(struct cell *cell, const struct v2v_drawing *drawing, double z, double y,
                       double x)
{
    if (z == cell->z && y == cell->y && x == cell->x) {
        return;
    }
    cell->z = z;
    cell->y = y;
    cell->x = x;
    for (int i = 0; i < 8; i++) {
        cell->corner[i] = lattice_point(drawing, cell->octave, (int64_t)z + (i >> 2),
                                        (int64_t)y + (i >> 1 & 1), (int64_t)x + (i & 1));
    }
}

/* The lattice's numbers between its points. */
static double in_cell(struct cell *cell, const struct v2v_drawing *drawing, struct v2v_point at)
{
    const double z = at.z * cell->steps, y = at.y * cell->steps, x = at.x * cell->steps;
    enter_cell(cell, drawing, floor(z), floor(y), floor(x));
    const double tz = smooth(z - cell->z), ty = smooth(y - cell->y), tx = smooth(x - cell->x);
    const double *c = cell->corner;
    const double near =
        (1 - ty) * ((1 - tx) * c[0] + tx * c[1]) + ty * ((1 - tx) * c[2] + tx * c[3]);
    const double far =
        (1 - ty) * ((1 - tx) * c[4] + tx * c[5]) + ty * ((1 - tx) * c[6] + tx * c[7]);
    return (1 - tz) * near + tz * far;
}

void v2v_drawing_tissue(struct v2v_drawing *drawing, double grain, double least, double most)
{
    const struct v2v_scene *scene = drawing->scene;
    struct cell coarse = {.octave = 0, .steps = 1 / grain, .x = NAN};
    struct cell fine = {.octave = 1, .steps = 2 / grain, .x = NAN};
    float *voxel = drawing->slices;
    for (int64_t z = 0; z < drawing->count; z++) {
        for (int64_t y = 0; y < scene->height; y++) {
            for (int64_t x = 0; x < scene->width; x++, voxel++) {
                const struct v2v_point at = {(double)(drawing->first + z) * scene->slice_um,
                                             (double)y * scene->pixel_um,
                                             (double)x * scene->pixel_um};
                const struct v2v_point own = v2v_point_plus(at, -1, drawing->shift);
                const double value =
                    (2 * in_cell(&coarse, drawing, own) + in_cell(&fine, drawing, own)) / 3;
                *voxel = fmaxf(*voxel, (float)(least + (most - least) * value));
            }
        }
    }
}
