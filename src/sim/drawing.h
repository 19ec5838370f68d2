/** What scenes are drawn with: random numbers of a structure, and shapes with soft rims. Lengths
 *  are micrometres from the corner of the scene's first voxel. */
#ifndef V2V_SIM_DRAWING_H
#define V2V_SIM_DRAWING_H

#include "v2v3d/sim/scene.h"

struct v2v_point {
    double z, y, x;
};

struct v2v_drawing {
    const struct v2v_scene *scene;
    float *slices;          /* [count,y,x] */
    int64_t first, count;   /* of the scene's slices */
    int64_t t;              /* frame */
    struct v2v_point size;  /* of the whole scene */
    uint64_t stream, index; /* a stream a structure, an index a number drawn */
    struct v2v_point shift; /* where the structure has moved to */
};

/** A tube that wanders: what processes, fibres and vessels are made of. */
struct v2v_tube {
    struct v2v_point at, direction; /* direction has length 1 */
    double radius, end_radius;      /* along its length */
    double length, bend;            /* bend: standard deviation of the turn per step */
    double brightness;
};

/** A tree of tubes: each forks in two at its end. */
struct v2v_tree {
    int generations;        /* of forks */
    double spread;          /* how far a child turns away */
    double tilt;            /* of children, out of the plane of focus */
    double least, most;     /* part of its parent's length that a child has */
    double thinner, dimmer; /* part of its parent's radius and brightness, likewise */
};

/** From now on the numbers drawn are the next structure's, and it has moved on its own way. */
void v2v_drawing_next(struct v2v_drawing *drawing);

double v2v_drawing_uniform(struct v2v_drawing *drawing, double low, double high);

/** A place within the scene. */
struct v2v_point v2v_drawing_place(struct v2v_drawing *drawing);

/** A direction; `tilt` is the deviation of its part along z: 0.1 .. 0.4 lie mostly in the plane of
 *  focus, as the fibres of a cortex layer do. */
struct v2v_point v2v_drawing_direction(struct v2v_drawing *drawing, double tilt);

/** @return a + s * b */
struct v2v_point v2v_point_plus(struct v2v_point a, double s, struct v2v_point b);

/** Where structures meet, the brighter one shows. `nucleus` is how much the core is darkened. */
void v2v_drawing_ellipsoid(struct v2v_drawing *drawing, struct v2v_point centre,
                           struct v2v_point radius, double brightness, double nucleus);

/** @return the tube as it is at its end */
struct v2v_tube v2v_drawing_tube(struct v2v_drawing *drawing, struct v2v_tube tube);

void v2v_drawing_tree(struct v2v_drawing *drawing, struct v2v_tube trunk,
                      const struct v2v_tree *tree);

/** Light everywhere, smoothly between `least` and `most`: random numbers on a lattice of `grain`
 *  micrometres and of half of it, interpolated. */
void v2v_drawing_tissue(struct v2v_drawing *drawing, double grain, double least, double most);

#endif
