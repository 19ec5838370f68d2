#include "method/motion.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/clones.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/coarse.h"
#include "v2v3d/tensor/smooth.h"
#include "v2v3d/tensor/statistics.h"
#include "v2v3d/tensor/warp.h"

#include <math.h>
#include <string.h>

/* REFERENCE.md 12. Squares of 8, 4 and 2 pixels; what is about a square lies within two times so
 * many others. */
enum { LEVELS = 3, COARSEST = 8, FINEST = COARSEST >> (LEVELS - 1), RADIUS = 4 };

/* Steps of the whole frame, squares of 8 pixels; of finer ones. */
enum { FIRST_STEPS = 6, STEPS = 2 };

/* What noise makes of a step's chi^2, 2 in the mean, once in 150 times; .. */
static const double least_chi2 = 10.0;

/* .. so many of its standard deviations are asked for of all views' own steps together. */
static const double least_deviations = 5.0;

/* Standard deviations of a step that are expected before anything is seen, pixels: of the whole
 * frame, of a view beside it, of what is about a square beside both. */
static const double of_frame = 8.0, of_view = 1.0, of_square = 0.5;

/* Pixels: what is nearer stays where it is. */
static const float least_way = 0.1f;

/* Of gradients g and of what is missed, e: g g^T and g e. */
enum { XX, XY, YY, XE, YE, MOMENTS };
/* Of a displacement, and how much of it counts. */
enum { ALONG_Y, ALONG_X, AXES, PART = AXES, FIELDS };

/* Means of squares of the views, smoothed, in units of the frame's noise. */
struct level {
    int64_t side, height, width; /* pixels of a square; squares */
    float *frame, *neighbour;    /* [v,height,width] */
};

/* Pixels, and what they take of the squares missed, in units of noise. */
struct step {
    float along[AXES];
    double chi2;
};

struct v2v_motion {
    int64_t views, height, width;
    double sigma;
    struct level level[LEVELS]; /* from coarse to fine */
    float *moved;               /* [v,height,width] of the finest, as all that follows */
    float *moments;             /* [MOMENTS,height,width] */
    float *lines;               /* [v,MOMENTS,width] */
    float *scratch;             /* [height,width] */
    float *way[FIELDS];         /* [height,width]: pixels from the frame to its neighbour .. */
    float *own[AXES];           /* [v]: .. and more of them in a view; 0 or 1 of both */
    float *of_pixels[FIELDS];   /* [height,width] of the frame: the way */
    struct step *step;          /* [v] */
};

static struct level level_of(int64_t height, int64_t width, int k)
{
    const int64_t side = COARSEST >> k;
    return (struct level){
        .side = side, .height = v2v_parts(height, side), .width = v2v_parts(width, side)};
}

static int64_t squares_of(const struct level *level)
{
    return v2v_mem_product(level->height, level->width, 1);
}

int64_t v2v_motion_floats(int64_t views, int64_t height, int64_t width)
{
    enum { OF_STEP = sizeof(struct step) / sizeof(float) };
    struct level level = {0};
    int64_t floats = v2v_mem_product(FIELDS, height, width);
    for (int k = 0; k < LEVELS; k++) {
        level = level_of(height, width, k);
        floats += v2v_mem_product(2 * views, squares_of(&level), 1);
    }
    return floats + v2v_mem_product(views + MOMENTS + 1 + FIELDS, squares_of(&level), 1) +
           v2v_mem_product(views, MOMENTS, level.width) + (AXES + OF_STEP) * views;
}

enum v2v_status v2v_motion_create(struct v2v_motion **motion, int64_t views, int64_t height,
                                  int64_t width)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_motion *made = NULL;
    int64_t squares = 0;
    *motion = NULL;
    V2V_TRY(V2V_ALLOC(made, "method.motion", 1));
    made->views = views;
    made->height = height;
    made->width = width;
    for (int k = 0; k < LEVELS; k++) {
        struct level *level = &made->level[k];
        *level = level_of(height, width, k);
        squares = squares_of(level);
        V2V_TRY(V2V_ALLOC(level->frame, "method.motion", v2v_mem_product(views, squares, 1)));
        V2V_TRY(V2V_ALLOC(level->neighbour, "method.motion", v2v_mem_product(views, squares, 1)));
    }
    V2V_TRY(V2V_ALLOC(made->moved, "method.motion", v2v_mem_product(views, squares, 1)));
    V2V_TRY(V2V_ALLOC(made->moments, "method.motion", v2v_mem_product(MOMENTS, squares, 1)));
    V2V_TRY(V2V_ALLOC(made->lines, "method.motion",
                      v2v_mem_product(views, MOMENTS, made->level[LEVELS - 1].width)));
    V2V_TRY(V2V_ALLOC(made->scratch, "method.motion", squares));
    for (int k = 0; k < FIELDS; k++) {
        V2V_TRY(V2V_ALLOC(made->way[k], "method.motion", squares));
        V2V_TRY(V2V_ALLOC(made->of_pixels[k], "method.motion", v2v_mem_product(height, width, 1)));
    }
    for (int axis = 0; axis < AXES; axis++) {
        V2V_TRY(V2V_ALLOC(made->own[axis], "method.motion", views));
    }
    V2V_TRY(V2V_ALLOC(made->step, "method.motion", views));
    *motion = made;
    made = NULL;
done:
    v2v_motion_destroy(&made);
    return rc;
}

void v2v_motion_destroy(struct v2v_motion **motion)
{
    struct v2v_motion *old = *motion;
    *motion = NULL;
    if (old != NULL) {
        for (int axis = 0; axis < AXES; axis++) {
            v2v_mem_free(old->own[axis]);
        }
        for (int k = 0; k < FIELDS; k++) {
            v2v_mem_free(old->of_pixels[k]);
            v2v_mem_free(old->way[k]);
        }
        v2v_mem_free(old->step);
        v2v_mem_free(old->scratch);
        v2v_mem_free(old->lines);
        v2v_mem_free(old->moments);
        v2v_mem_free(old->moved);
        for (int k = 0; k < LEVELS; k++) {
            v2v_mem_free(old->level[k].neighbour);
            v2v_mem_free(old->level[k].frame);
        }
        v2v_mem_free(old);
    }
}

/* From fine to coarse. */
static void take_levels(const struct v2v_motion *motion, float *const to[LEVELS],
                        const float *views)
{
    const float *from = views;
    int64_t height = motion->height, width = motion->width, side = FINEST;
    for (int k = LEVELS - 1; k >= 0; k--, side = 2) {
        const float scale = from == views ? (float)(1.0 / motion->sigma) : 1.0f;
        v2v_coarse_images(to[k], from, motion->views, height, width, side, scale);
        from = to[k];
        height = motion->level[k].height;
        width = motion->level[k].width;
    }
    for (int k = 0; k < LEVELS; k++) {
        v2v_soften_images(to[k], motion->views, motion->level[k].height, motion->level[k].width);
    }
}

void v2v_motion_begin(struct v2v_motion *motion, const float *views, double sigma)
{
    float *frame[LEVELS];
    for (int k = 0; k < LEVELS; k++) {
        frame[k] = motion->level[k].frame;
    }
    motion->sigma = sigma;
    take_levels(motion, frame, views);
}

/* ---- steps ---- */

/* Where a pixel's centre lies among squares of so many pixels. */
static inline float place(int64_t pixel, int64_t side)
{
    return ((float)pixel + 0.5f) / (float)side - 0.5f;
}

static inline float within(float x, float most)
{
    const float low = x > 0.0f ? x : 0.0f;
    return low < most ? low : most;
}

/* Between the pixels of an image; beyond it, its edge goes on. */
static inline float between(const float *image, int height, int width, float y, float x)
{
    const float row = within(y, (float)(height - 1)), column = within(x, (float)(width - 1));
    const int top = (int)row, left = (int)column, at = top * width + left;
    const int below = top + 1 < height ? width : 0, right = left + 1 < width ? 1 : 0;
    const float down = row - (float)top, over = column - (float)left;
    const float upper = image[at] + over * (image[at + right] - image[at]);
    const float lower = image[at + below] + over * (image[at + below + right] - image[at + below]);
    return upper + down * (lower - upper);
}

/* Of a view: squares of its own way, and what its light is multiplied with. */
struct moving {
    float y, x, factor;
};

/* A row of a view, whose squares lie further by these ways, of so many squares a pixel. */
V2V_SIMD_CLONES static void move_row(float *restrict to, const float *image, int height, int width,
                                     int y, const float *way_y, const float *way_x, float squares,
                                     struct moving moving)
{
#pragma omp simd
    for (int x = 0; x < width; x++) {
        const float at_y = (float)y + moving.y + squares * way_y[x];
        const float at_x = (float)x + moving.x + squares * way_x[x];
        to[x] = moving.factor * between(image, height, width, at_y, at_x);
    }
}

/* The neighbour's squares where the frame's are in it, as bright as these. */
static void move_squares(const struct v2v_motion *motion, const struct level *level, float factor)
{
    const int64_t height = level->height, width = level->width;
    const float squares = 1.0f / (float)level->side;
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t v = 0; v < motion->views; v++) {
        for (int64_t y = 0; y < height; y++) {
            const struct moving moving = {squares * motion->own[ALONG_Y][v],
                                          squares * motion->own[ALONG_X][v], factor};
            move_row(motion->moved + (v * height + y) * width,
                     level->neighbour + v * height * width, (int)height, (int)width, (int)y,
                     motion->way[ALONG_Y] + y * width, motion->way[ALONG_X] + y * width, squares,
                     moving);
        }
    }
}

/* Rows of a view's squares. */
struct rows {
    const float *above, *here, *below;
};

static struct rows rows_of(const float *squares, const struct level *level, int64_t v, int64_t y)
{
    const float *here = squares + (v * level->height + y) * level->width;
    return (struct rows){here - level->width, here, here + level->width};
}

/* What two frames show in a row of squares but the first and the last; `part` of their differences
 * across two squares, together, is the gradient of their mean. */
V2V_SIMD_CLONES static void add_moments(float *restrict moments, int64_t apart_by, struct rows a,
                                        struct rows b, float part, int64_t width)
{
    float *restrict xx = moments + XX * apart_by, *restrict xy = moments + XY * apart_by;
    float *restrict yy = moments + YY * apart_by, *restrict xe = moments + XE * apart_by;
    float *restrict ye = moments + YE * apart_by;
#pragma omp simd
    for (int64_t x = 1; x < width - 1; x++) {
        const float over = a.here[x + 1] - a.here[x - 1] + b.here[x + 1] - b.here[x - 1];
        const float down = a.below[x] - a.above[x] + b.below[x] - b.above[x];
        const float by_x = part * over, by_y = part * down, missed = a.here[x] - b.here[x];
        xx[x] += by_x * by_x;
        xy[x] += by_x * by_y;
        yy[x] += by_y * by_y;
        xe[x] += by_x * missed;
        ye[x] += by_y * missed;
    }
}

static float part_of(const struct level *level)
{
    return 0.25f / (float)level->side;
}

/* Moments of row y, over the views; 0 in the first and the last. */
static void sum_row(const struct v2v_motion *motion, const struct level *level, int64_t y)
{
    const int64_t width = level->width, squares = level->height * width;
    float *moments = motion->moments + y * width;
    for (int k = 0; k < MOMENTS; k++) {
        memset(moments + k * squares, 0, (size_t)width * sizeof *moments);
    }
    for (int64_t v = 0; v < motion->views && y > 0 && y < level->height - 1; v++) {
        add_moments(moments, squares, rows_of(level->frame, level, v, y),
                    rows_of(motion->moved, level, v, y), part_of(level), width);
    }
}

/* .. and of a view, all rows together. */
static void sum_view(double sums[MOMENTS], const struct v2v_motion *motion,
                     const struct level *level, int64_t v)
{
    const int64_t width = level->width;
    float *lines = motion->lines + v * MOMENTS * width;
    memset(lines, 0, (size_t)(MOMENTS * width) * sizeof *lines);
    for (int64_t y = 1; y < level->height - 1; y++) {
        add_moments(lines, width, rows_of(level->frame, level, v, y),
                    rows_of(motion->moved, level, v, y), part_of(level), width);
    }
    for (int k = 0; k < MOMENTS; k++) {
        sums[k] = v2v_sum(lines + k * width, width);
    }
}

static void sum_moments(const struct v2v_motion *motion, const struct level *level)
{
#pragma omp parallel for schedule(static)
    for (int64_t y = 0; y < level->height; y++) {
        sum_row(motion, level, y);
    }
}

/* Of a row: what two frames miss each other by, the second times `factor`, squared, in units of
 * `noise`, m / (1 + m): what changed counts for 1, wherever it is taken to be. */
V2V_SIMD_CLONES static void add_missed(float *restrict row, const float *a, const float *b,
                                       float factor, float noise, int64_t width)
{
#pragma omp simd
    for (int64_t x = 0; x < width; x++) {
        const float e = a[x] - factor * b[x];
        row[x] += e * e / (e * e + noise);
    }
}

/* .. over the views. */
static void find_missed(float *missed, const struct v2v_motion *motion, const struct level *level,
                        const float *other, float factor, double variance)
{
    const int64_t width = level->width, squares = squares_of(level);
#pragma omp parallel for schedule(static)
    for (int64_t y = 0; y < level->height; y++) {
        float *row = missed + y * width;
        memset(row, 0, (size_t)width * sizeof *row);
        for (int64_t v = 0; v < motion->views; v++) {
            const int64_t first = v * squares + y * width;
            add_missed(row, level->frame + first, other + first, factor, (float)variance, width);
        }
    }
}

/* Of moments in units of noise, which makes up `noise` of g g^T's diagonal: least squares of what
 * is left of it, drawn to 0 by the step's prior variance, more where gradients are noise. At most
 * the side of a square; none where nothing can be told. */
static struct step step_of(const double moments[MOMENTS], double noise, double prior, double most)
{
    const struct step none = {{0.0f, 0.0f}, 0.0};
    const double all = moments[XX] + moments[YY], clean = all - 2.0 * noise;
    if (!(clean > 0.0)) {
        return none;
    }
    const double drawn = all / clean / (prior * prior);
    const double xx = moments[XX] - noise + drawn, yy = moments[YY] - noise + drawn;
    const double xy = moments[XY], det = xx * yy - xy * xy;
    if (!(det > 0.0 && det < INFINITY)) {
        return none;
    }
    const double along_x = (yy * moments[XE] - xy * moments[YE]) / det;
    const double along_y = (xx * moments[YE] - xy * moments[XE]) / det;
    const double chi2 = along_x * moments[XE] + along_y * moments[YE];
    if (!(chi2 < INFINITY)) {
        return none;
    }
    return (struct step){{[ALONG_Y] = (float)fmin(fmax(along_y, -most), most),
                          [ALONG_X] = (float)fmin(fmax(along_x, -most), most)},
                         chi2};
}

/* Squares of gradients of one view, along y or x, that noise makes, in units of its variance: of
 * the mean of two frames, by (1 2 0 -2 -1) / 8 one way and (1 2 1) / 4 the other. */
static double noise_of(const struct level *level)
{
    const double of_taps = (10.0 / 64.0) * (6.0 / 16.0) / 4.0;
    return of_taps / (double)(level->side * level->side);
}

/* All that the frame shows, by one step. @return bool: there was more than noise to it */
static int move_frame(const struct v2v_motion *motion, const struct level *level, double variance)
{
    const int64_t squares = squares_of(level);
    double moments[MOMENTS];
    for (int k = 0; k < MOMENTS; k++) {
        moments[k] = 0.0;
        for (int64_t i = 0; i < squares; i++) {
            moments[k] += (double)motion->moments[k * squares + i] / variance;
        }
    }
    const struct step step = step_of(moments, 0.0, of_frame, (double)level->side);
    for (int axis = 0; axis < AXES && step.chi2 > least_chi2; axis++) {
        for (int64_t i = 0; i < squares; i++) {
            motion->way[axis][i] += step.along[axis];
        }
    }
    return step.chi2 > least_chi2;
}

/* What each view shows, by a step of its own; none where noise may be all. @return bool: steps were
 * taken */
static int move_views_apart(const struct v2v_motion *motion, const struct level *level,
                            double variance)
{
    const double by_noise = 2.0 * (double)motion->views, most = (double)level->side;
    const double noise = (double)((level->height - 2) * (level->width - 2)) * noise_of(level);
    double chi2 = 0.0;
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < motion->views; v++) {
        double sums[MOMENTS];
        sum_view(sums, motion, level, v);
        for (int k = 0; k < MOMENTS; k++) {
            sums[k] /= variance;
        }
        motion->step[v] = step_of(sums, noise, of_view, most);
        motion->step[v].chi2 = step_of(sums, 0.0, of_frame, most).chi2;
    }
    for (int64_t v = 0; v < motion->views; v++) {
        chi2 += motion->step[v].chi2;
    }
    const int is_taken = chi2 > by_noise + least_deviations * sqrt(2.0 * by_noise);
    for (int64_t v = 0; v < motion->views && is_taken; v++) {
        for (int axis = 0; axis < AXES; axis++) {
            motion->own[axis][v] += motion->step[v].along[axis];
        }
    }
    return is_taken;
}

/* The outermost squares have the moments of those beside them. */
static void repeat_edges(float *image, const struct level *level)
{
    const int64_t height = level->height, width = level->width;
    const size_t bytes = (size_t)width * sizeof *image;
    for (int64_t y = 0; y < height && width > 2; y++) {
        image[y * width] = image[y * width + 1];
        image[y * width + width - 1] = image[y * width + width - 2];
    }
    if (height > 2) {
        memcpy(image, image + width, bytes);
        memcpy(image + (height - 1) * width, image + (height - 2) * width, bytes);
    }
}

/* Means over what is about every square. */
static void smooth_about(const struct v2v_motion *motion, const struct level *level, float *image)
{
    repeat_edges(image, level);
    for (int pass = 0; pass < 2; pass++) {
        v2v_smooth_image(image, motion->scratch, image, level->height, level->width, RADIUS);
    }
}

/* What is about every square, by a step of its own. */
static void move_squares_apart(const struct v2v_motion *motion, const struct level *level,
                               double variance)
{
    const int64_t squares = squares_of(level);
    const double count = v2v_smooth_twice_count(RADIUS);
    const double noise = count * (double)motion->views * noise_of(level);
    for (int k = 0; k < MOMENTS; k++) {
        smooth_about(motion, level, motion->moments + k * squares);
    }
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < squares; i++) {
        double moments[MOMENTS];
        for (int k = 0; k < MOMENTS; k++) {
            moments[k] = count / variance * (double)motion->moments[k * squares + i];
        }
        const struct step step = step_of(moments, noise, of_square, (double)level->side);
        for (int axis = 0; axis < AXES; axis++) {
            motion->way[axis][i] += step.along[axis];
        }
    }
}

/* The way of a level's squares to those of the next. */
static void refine(const struct v2v_motion *motion, const struct level *from,
                   const struct level *to)
{
    for (int axis = 0; axis < AXES; axis++) {
        float *way = motion->way[axis];
        memcpy(motion->scratch, way, (size_t)squares_of(from) * sizeof *way);
#pragma omp parallel for schedule(static)
        for (int64_t y = 0; y < to->height; y++) {
            for (int64_t x = 0; x < to->width; x++) {
                way[y * to->width + x] = between(motion->scratch, (int)from->height,
                                                 (int)from->width, place(y, 2), place(x, 2));
            }
        }
    }
}

/* What changed, or came, may have moved what stands still: there nothing moves. */
static void keep_what_agrees(const struct v2v_motion *motion, const struct level *level,
                             float factor, double variance)
{
    const int64_t squares = squares_of(level);
    float *still = motion->moments, *moved = motion->moments + squares;
    find_missed(still, motion, level, level->neighbour, factor, variance);
    move_squares(motion, level, factor);
    find_missed(moved, motion, level, motion->moved, 1.0f, variance);
    smooth_about(motion, level, still);
    smooth_about(motion, level, moved);
    for (int64_t i = 0; i < squares; i++) {
        motion->way[PART][i] = moved[i] < still[i] ? 1.0f : 0.0f;
    }
}

void v2v_motion_find(struct v2v_motion *motion, const float *neighbour, double factor)
{
    float *squares[LEVELS];
    for (int k = 0; k < LEVELS; k++) {
        squares[k] = motion->level[k].neighbour;
    }
    take_levels(motion, squares, neighbour);
    for (int axis = 0; axis < AXES; axis++) {
        memset(motion->way[axis], 0, (size_t)squares_of(&motion->level[0]) * sizeof(float));
        memset(motion->own[axis], 0, (size_t)motion->views * sizeof(float));
    }
    for (int k = 0; k < LEVELS; k++) {
        const struct level *level = &motion->level[k];
        const double variance = (1.0 + factor * factor) / (double)(level->side * level->side);
        const int steps = k == 0 ? FIRST_STEPS : STEPS;
        move_squares(motion, level, (float)factor);
        sum_moments(motion, level);
        for (int i = 0; i < steps && move_frame(motion, level, variance); i++) {
            move_squares(motion, level, (float)factor);
            sum_moments(motion, level);
        }
        int rounds = 0;
        while (rounds < steps && move_views_apart(motion, level, variance)) {
            move_squares(motion, level, (float)factor);
            rounds++;
        }
        if (rounds > 0) {
            sum_moments(motion, level);
        }
        move_squares_apart(motion, level, variance);
        if (k + 1 < LEVELS) {
            refine(motion, level, level + 1);
        }
    }
    keep_what_agrees(motion, &motion->level[LEVELS - 1], (float)factor,
                     (1.0 + factor * factor) / (FINEST * FINEST));
}

/* A field at `count` pixels of a row, which lies at `y` among the squares. */
V2V_SIMD_CLONES static void field_of_row(float *restrict to, const float *field, int height,
                                         int width, float y, int count)
{
#pragma omp simd
    for (int x = 0; x < count; x++) {
        to[x] = between(field, height, width, y, place(x, FINEST));
    }
}

void v2v_motion_undo(const struct v2v_motion *motion, float *to, const float *neighbour)
{
    const struct level *finest = &motion->level[LEVELS - 1];
    const int64_t height = motion->height, width = motion->width;
#pragma omp parallel for schedule(static)
    for (int64_t y = 0; y < height; y++) {
        float *way[FIELDS];
        for (int k = 0; k < FIELDS; k++) {
            way[k] = motion->of_pixels[k] + y * width;
            field_of_row(way[k], motion->way[k], (int)finest->height, (int)finest->width,
                         place(y, FINEST), (int)width);
        }
        for (int64_t v = 0; v < motion->views; v++) {
            const int64_t first = v * height * width;
            const struct v2v_way moving = {.y = way[ALONG_Y],
                                           .x = way[ALONG_X],
                                           .part = way[PART],
                                           .more_y = motion->own[ALONG_Y][v],
                                           .more_x = motion->own[ALONG_X][v],
                                           .least = least_way};
            v2v_warp_row(to + first + y * width, neighbour + first, height, width, y, &moving);
        }
    }
}
