#include "v2v3d/sim/planes.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/random.h"

#include <math.h>

enum { SHAPES = 12, WAVES = 24, BACKGROUND = 0 };

static const double least_period = 4, most_period = 64; /* of a texture, pixels */
static const double contrast = 0.35;                    /* of it: standard deviation over mean */
static const double most_stretch = 0.3;                 /* that slants make from view to view */
static const uint64_t planes_stream = (uint64_t)'P' << 56;

struct wave {
    double y, x, phase; /* radians a pixel */
};

/* Places are pixels of a camera at 0. */
struct plane {
    double y, x, disparity;  /* of its middle */
    double slope_y, slope_x; /* of the disparity */
    double cosine, sine;     /* of its turn */
    double height, width;    /* half of them */
    int is_disc;
    double brightness;
    struct wave wave[WAVES];
};

struct numbers {
    uint64_t seed, stream, index;
};

static double any(struct numbers *numbers, double least, double most)
{
    return least +
           (most - least) * v2v_random_uniform(numbers->seed, numbers->stream, numbers->index++);
}

static double turn(struct numbers *numbers)
{
    return any(numbers, 0, 2 * acos(-1));
}

static void weave(struct plane *plane, struct numbers *numbers)
{
    plane->brightness = any(numbers, 0.3, 0.8);
    for (int i = 0; i < WAVES; i++) {
        const double period = least_period * pow(most_period / least_period, any(numbers, 0, 1));
        const double frequency = 2 * acos(-1) / period, angle = turn(numbers);
        plane->wave[i] = (struct wave){frequency * sin(angle), frequency * cos(angle), 0};
        plane->wave[i].phase = turn(numbers);
    }
}

/* Plane i has a layer of disparities for itself: slants never bring one through another. */
static void place(struct plane *plane, const struct v2v_planes *planes, int i)
{
    struct numbers numbers = {planes->seed, planes_stream + (uint64_t)i, 0};
    const double side = (double)v2v_smaller(planes->height, planes->width);
    const double layer = (planes->nearest - planes->farthest) / (SHAPES + 1);
    double farthest_camera = 0;
    for (int64_t v = 0; v < planes->cameras->views; v++) {
        farthest_camera =
            fmax(farthest_camera, hypot(planes->cameras->at[v][0], planes->cameras->at[v][1]));
    }
    plane->y = any(&numbers, 0, (double)planes->height);
    plane->x = any(&numbers, 0, (double)planes->width);
    plane->height = side * any(&numbers, 0.1, 0.22);
    plane->width = side * any(&numbers, 0.1, 0.22);
    plane->is_disc = i % 2;
    double reach = hypot(plane->height, plane->width);
    if (i == BACKGROUND) {
        plane->y = 0.5 * (double)planes->height;
        plane->x = 0.5 * (double)planes->width;
        reach = hypot(plane->y, plane->x);
    }
    plane->disparity = planes->farthest + (i + 0.5) * layer;
    const double angle = turn(&numbers), slant = turn(&numbers);
    const double slope =
        fmin(0.5 * fabs(layer) / reach, most_stretch / fmax(farthest_camera, 1e-9));
    plane->cosine = cos(angle);
    plane->sine = sin(angle);
    plane->slope_y = slope * sin(slant);
    plane->slope_x = slope * cos(slant);
    weave(plane, &numbers);
}

/* Of the pixel, with a rim of a pixel; and the texture's place. */
static double cover(double *place_y, double *place_x, const struct plane *plane, int is_background,
                    const double camera[2], double y, double x)
{
    /* disparity = its own at the place (y, x) + disparity * camera, solved for it */
    const double disparity =
        (plane->disparity + plane->slope_y * (y - plane->y) + plane->slope_x * (x - plane->x)) /
        (1 - plane->slope_y * camera[0] - plane->slope_x * camera[1]);
    const double off_y = y + disparity * camera[0] - plane->y;
    const double off_x = x + disparity * camera[1] - plane->x;
    *place_y = off_y;
    *place_x = off_x;
    if (is_background) {
        return 1;
    }
    if (plane->is_disc) {
        return fmin(fmax(plane->height - hypot(off_y, off_x) + 0.5, 0), 1);
    }
    const double across = fabs(plane->cosine * off_y + plane->sine * off_x);
    const double along = fabs(plane->cosine * off_x - plane->sine * off_y);
    return fmin(fmax(fmin(plane->height - across, plane->width - along) + 0.5, 0), 1);
}

static double texture(const struct plane *plane, double y, double x)
{
    double sum = 0;
    for (int i = 0; i < WAVES; i++) {
        sum += cos(plane->wave[i].y * y + plane->wave[i].x * x + plane->wave[i].phase);
    }
    return plane->brightness * fmax(1 + contrast * sqrt(2.0 / WAVES) * sum, 0);
}

void v2v_planes_draw(float *view, const struct v2v_planes *planes, int64_t v)
{
    struct plane plane[SHAPES + 1];
    const double *camera = planes->cameras->at[v];
    for (int i = 0; i <= SHAPES; i++) {
        place(&plane[i], planes, i);
    }
#pragma omp parallel for schedule(static)
    for (int64_t y = 0; y < planes->height; y++) {
        for (int64_t x = 0; x < planes->width; x++) {
            double light = 0, left = 1;
            for (int i = SHAPES; i >= BACKGROUND && left > 0; i--) {
                double place_y, place_x;
                const double covered = cover(&place_y, &place_x, &plane[i], i == BACKGROUND, camera,
                                             (double)y, (double)x);
                if (covered > 0) {
                    light += left * covered * texture(&plane[i], place_y, place_x);
                }
                left *= 1 - covered;
            }
            view[y * planes->width + x] = (float)light;
        }
    }
}
