#include "v2v3d/sim/scene.h"

#include "v2v3d/base/random.h"

#include <math.h>

/* All lengths are in voxels, and voxels count as cubes. The densities make a maximum projection
 * that is full of structure while about 97 % of the voxels stay background. */
static const double edge = 0.8;                /* half-width of a structure's soft rim */
static const double pixels_per_neuron = 2500;  /* of the frame */
static const double pixels_per_fibre = 2000;   /* of the frame */
static const double pixels_per_vessel = 12000; /* of the frame */
enum { DENDRITES = 4, GENERATIONS = 2 };

struct point {
    double z, y, x;
};

/** A tube that wanders: what dendrites, fibres and vessels are made of. */
struct tube {
    struct point at, direction; /* direction has length 1 */
    double radius, end_radius;  /* along its length */
    double length, bend;        /* bend: standard deviation of the turn per step */
    double brightness;
};

struct scene {
    float *volume;
    int64_t slices, height, width;
    uint64_t seed;
    uint64_t stream, index; /* a stream a structure, an index a number drawn */
};

static void next_structure(struct scene *scene)
{
    scene->stream++;
    scene->index = 0;
}

static double uniform(struct scene *scene, double low, double high)
{
    return low + (high - low) * v2v_random_uniform(scene->seed, scene->stream, scene->index++);
}

static double normal(struct scene *scene)
{
    return v2v_random_normal(scene->seed, scene->stream, scene->index++);
}

static struct point plus(struct point a, double s, struct point b)
{
    return (struct point){a.z + s * b.z, a.y + s * b.y, a.x + s * b.x};
}

static struct point unit(struct point a)
{
    double length = sqrt(a.z * a.z + a.y * a.y + a.x * a.x) + 1e-12;
    return (struct point){a.z / length, a.y / length, a.x / length};
}

/** A direction that lies mostly in the plane of focus, as the fibres of a cortex layer do. */
static struct point any_direction(struct scene *scene, double tilt)
{
    double angle = uniform(scene, 0, 2 * acos(-1));
    return unit((struct point){tilt * normal(scene), sin(angle), cos(angle)});
}

static struct point any_place(struct scene *scene)
{
    double z = uniform(scene, 0, (double)scene->slices);
    double y = uniform(scene, 0, (double)scene->height);
    return (struct point){z, y, uniform(scene, 0, (double)scene->width)};
}

/** 1 inside, 0 outside, a smooth rim of 2 * edge between. @param depth of the place below the
 *  surface, negative outside */
static double soft(double depth)
{
    double t = fmin(fmax((depth + edge) / (2 * edge), 0), 1);
    return t * t * (3 - 2 * t);
}

struct range {
    int64_t first, end;
};

static struct range reach(double centre, double radius, int64_t n)
{
    struct range range = {(int64_t)floor(fmax(centre - radius - edge, 0)),
                          (int64_t)ceil(fmin(centre + radius + edge + 1, (double)n))};
    return range;
}

/** Lay an ellipsoid into the volume; where structures meet, the brighter one shows. `nucleus` is
 *  how much its core is darkened. */
static void stamp(struct scene *scene, struct point centre, struct point radius, double brightness,
                  double nucleus)
{
    struct range rz = reach(centre.z, radius.z, scene->slices);
    struct range ry = reach(centre.y, radius.y, scene->height);
    struct range rx = reach(centre.x, radius.x, scene->width);
    double mean_radius = cbrt(radius.z * radius.y * radius.x);
    for (int64_t z = rz.first; z < rz.end; z++) {
        for (int64_t y = ry.first; y < ry.end; y++) {
            for (int64_t x = rx.first; x < rx.end; x++) {
                double dz = ((double)z - centre.z) / radius.z;
                double dy = ((double)y - centre.y) / radius.y;
                double dx = ((double)x - centre.x) / radius.x;
                double r = sqrt(dz * dz + dy * dy + dx * dx); /* 1 on the surface */
                double value = brightness * soft((1 - r) * mean_radius) *
                               (1 - nucleus * soft((0.5 - r) * mean_radius));
                float *voxel = scene->volume + (z * scene->height + y) * scene->width + x;
                *voxel = fmaxf(*voxel, (float)value);
            }
        }
    }
}

/** @return the tube as it is at its end */
static struct tube draw_tube(struct scene *scene, struct tube tube)
{
    double first_radius = tube.radius;
    double beads = uniform(scene, 0, 2 * acos(-1)); /* varicosities: the fibre's slow swelling */
    for (double s = 0; s < tube.length; s += 0.5) {
        double part = s / tube.length;
        tube.radius = first_radius + part * (tube.end_radius - first_radius);
        double radius = tube.radius * (1 + 0.15 * sin(beads + 0.35 * s));
        stamp(scene, tube.at, (struct point){radius, radius, radius}, tube.brightness, 0);
        struct point turn = {0.4 * normal(scene), normal(scene), normal(scene)};
        tube.direction = unit(plus(tube.direction, tube.bend, turn));
        tube.at = plus(tube.at, 0.5, tube.direction);
    }
    return tube;
}

/** A dendrite forks in two at its end, GENERATIONS times. */
static void draw_dendrite(struct scene *scene, struct tube tube, int generation)
{
    struct tube end = draw_tube(scene, tube);
    for (int k = 0; generation < GENERATIONS && k < 2; k++) {
        struct tube child = end;
        struct point away = any_direction(scene, 0.3);
        child.direction = unit(plus(end.direction, 0.7, away));
        child.end_radius = 0.75 * end.radius;
        child.length = tube.length * uniform(scene, 0.5, 0.9);
        child.brightness = 0.9 * tube.brightness;
        draw_dendrite(scene, child, generation + 1);
    }
}

static void draw_neuron(struct scene *scene)
{
    struct point centre = any_place(scene);
    double brightness = uniform(scene, 0.55, 1), size = uniform(scene, 3, 5);
    struct point radius = {size * uniform(scene, 0.7, 1), size * uniform(scene, 0.8, 1.2), size};
    stamp(scene, centre, radius, brightness, 0.35);
    for (int k = 0; k < DENDRITES; k++) {
        struct tube dendrite = {.direction = any_direction(scene, 0.35),
                                .radius = uniform(scene, 1.0, 1.5),
                                .end_radius = 0.8,
                                .length = uniform(scene, 12, 28),
                                .bend = 0.09,
                                .brightness = 0.8 * brightness};
        dendrite.at = plus(centre, 0.8 * size, dendrite.direction);
        draw_dendrite(scene, dendrite, 0);
    }
}

static void draw_fibre(struct scene *scene)
{
    struct tube fibre = {.at = any_place(scene), .direction = any_direction(scene, 0.25)};
    fibre.radius = uniform(scene, 0.6, 1.0);
    fibre.end_radius = fibre.radius;
    fibre.length = uniform(scene, 40, 120);
    fibre.bend = 0.07;
    fibre.brightness = uniform(scene, 0.25, 0.6);
    draw_tube(scene, fibre);
}

/** A vessel crosses the whole field through a random place. */
static void draw_vessel(struct scene *scene)
{
    struct tube vessel = {.at = any_place(scene), .direction = any_direction(scene, 0.1)};
    vessel.radius = uniform(scene, 1.8, 3.2);
    vessel.end_radius = 0.8 * vessel.radius;
    vessel.length = (double)(scene->height + scene->width);
    vessel.bend = 0.04;
    vessel.brightness = uniform(scene, 0.3, 0.5);
    vessel.at = plus(vessel.at, -0.5 * vessel.length, vessel.direction);
    draw_tube(scene, vessel);
}

/** At least one of a kind, else one for so many pixels of the frame. */
static void draw_all(struct scene *scene, void (*draw)(struct scene *), double pixels_each)
{
    double area = (double)scene->height * (double)scene->width;
    int64_t count = (int64_t)fmax(1, rint(area / pixels_each));
    for (int64_t i = 0; i < count; i++) {
        next_structure(scene);
        draw(scene);
    }
}

enum v2v_status v2v_scene_fill(float *volume, int64_t slices, int64_t height, int64_t width,
                               uint64_t seed)
{
    if (slices < 1 || height < 1 || width < 1) {
        return V2V_FAIL(V2V_E_INPUT, "a scene of %lld x %lld x %lld voxels", (long long)slices,
                        (long long)height, (long long)width);
    }
    struct scene scene = {volume, slices, height, width, seed, 0, 0};
    for (int64_t i = 0; i < slices * height * width; i++) {
        volume[i] = 0;
    }
    draw_all(&scene, draw_vessel, pixels_per_vessel);
    draw_all(&scene, draw_fibre, pixels_per_fibre);
    draw_all(&scene, draw_neuron, pixels_per_neuron);
    return V2V_OK;
}
