/* A picture of run time against error: time on a logarithmic axis, PSNR upwards, a front of steps.
 *   draw_pareto POINTS.tsv OUT.png TITLE
 * POINTS.tsv, a line a method: name, seconds in all, seconds of a frame alone, PSNR, 1 if it is on
 * the front. Methods that were trained have a ring where a frame alone would be. Names that begin
 * with the same letters have one colour.
 */
#include "v2v3d/io/png.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { HEIGHT = 760, WIDTH = 1240, LEFT = 70, RIGHT = 30, TOP = 44, BOTTOM = 64 };
enum { MOST = 100, NAME = 32, BOXES = 5 * MOST, LETTER = 12, ROWS = 14, RADIUS = 5 };

static const uint32_t white = 0xffffff, black = 0x202020, grey = 0xe4e4e4, dark = 0x909090;
static const uint32_t colours[] = {0xb03030, 0xd08000, 0x2060b0, 0x208040, 0x7040a0, 0x008890};
enum { COLOURS = sizeof colours / sizeof *colours };

struct point {
    char name[NAME];
    double seconds, frame, psnr;
    int front;
    uint32_t rgb;
};

struct box {
    int64_t y, x, height, width;
};

struct plot {
    struct v2v_canvas canvas;
    struct point point[MOST];
    struct box box[BOXES]; /* what names may not cover */
    int points, boxes;
    double least_s, most_s, least_db, most_db; /* of the axes */
};

static int64_t x_of(const struct plot *plot, double seconds)
{
    const double part = log(seconds / plot->least_s) / log(plot->most_s / plot->least_s);
    return LEFT + (int64_t)lround(part * (WIDTH - LEFT - RIGHT));
}

static int64_t y_of(const struct plot *plot, double psnr)
{
    const double part = (psnr - plot->least_db) / (plot->most_db - plot->least_db);
    return HEIGHT - BOTTOM - (int64_t)lround(part * (HEIGHT - TOP - BOTTOM));
}

static void disc(struct plot *plot, int64_t y, int64_t x, int radius, uint32_t rgb)
{
    for (int64_t d = -radius; d <= radius; d++) {
        const int64_t half = (int64_t)sqrt((double)(radius * radius - d * d) + radius);
        v2v_canvas_fill(&plot->canvas, y + d, x - half, 1, 2 * half + 1, rgb);
    }
}

/* A colour a family: the letters that names begin with. */
static void choose_colours(struct plot *plot)
{
    int families = 0;
    for (int i = 0; i < plot->points; i++) {
        struct point *point = &plot->point[i];
        const size_t letters = strcspn(point->name, "-0123456789");
        int j = 0;
        while (j < i && (strcspn(plot->point[j].name, "-0123456789") != letters ||
                         strncmp(plot->point[j].name, point->name, letters) != 0)) {
            j++;
        }
        point->rgb = j < i ? plot->point[j].rgb : colours[families++ % COLOURS];
    }
}

static int read_points(struct plot *plot, const char *path)
{
    FILE *stream = fopen(path, "r");
    if (stream == NULL) {
        return 0;
    }
    for (struct point p;
         plot->points < MOST && fscanf(stream, "%31s %lf %lf %lf %d", p.name, &p.seconds, &p.frame,
                                       &p.psnr, &p.front) == 5;) {
        plot->point[plot->points++] = p;
    }
    const int whole = feof(stream);
    fclose(stream);
    return whole && plot->points > 0;
}

static void choose_axes(struct plot *plot)
{
    plot->least_s = plot->least_db = INFINITY;
    plot->most_s = plot->most_db = -INFINITY;
    for (int i = 0; i < plot->points; i++) {
        const struct point *p = &plot->point[i];
        plot->least_s = fmin(plot->least_s, fmin(p->frame, p->seconds));
        plot->most_s = fmax(plot->most_s, p->seconds);
        plot->least_db = fmin(plot->least_db, p->psnr);
        plot->most_db = fmax(plot->most_db, p->psnr);
    }
    plot->least_s /= 1.3;
    plot->most_s *= 1.8; /* room for a name */
    plot->least_db = floor(plot->least_db - 0.2);
    plot->most_db = ceil(plot->most_db + 0.2);
}

/* Grid lines with their values. */
static void draw_axes(struct plot *plot, const char *title)
{
    static const struct {
        double seconds;
        const char *text;
    } ticks[] = {{0.1, "0.1 s"},  {0.2, "0.2 s"},   {0.5, "0.5 s"}, {1, "1 s"},
                 {2, "2 s"},      {5, "5 s"},       {10, "10 s"},   {20, "20 s"},
                 {30, "30 s"},    {60, "1 min"},    {120, "2 min"}, {300, "5 min"},
                 {600, "10 min"}, {1800, "30 min"}, {3600, "1 h"},  {14400, "4 h"}};
    const int64_t bottom = HEIGHT - BOTTOM, columns = WIDTH - LEFT - RIGHT;
    const double range = plot->most_db - plot->least_db, step = range > 12 ? 2 : 1;
    struct v2v_canvas *canvas = &plot->canvas;
    v2v_canvas_fill(canvas, 0, 0, HEIGHT, WIDTH, white);
    for (size_t i = 0; i < sizeof ticks / sizeof *ticks; i++) {
        if (ticks[i].seconds >= plot->least_s && ticks[i].seconds <= plot->most_s) {
            const int64_t x = x_of(plot, ticks[i].seconds);
            const int64_t half = LETTER * (int64_t)strlen(ticks[i].text) / 2;
            v2v_canvas_fill(canvas, TOP, x, bottom - TOP, 1, grey);
            v2v_canvas_text(canvas, bottom + 8, x - half, ticks[i].text, 2, black);
        }
    }
    for (double db = ceil(plot->least_db / step) * step; db <= plot->most_db; db += step) {
        char text[16];
        snprintf(text, sizeof text, "%g", db);
        v2v_canvas_fill(canvas, y_of(plot, db), LEFT, 1, columns, grey);
        v2v_canvas_text(canvas, y_of(plot, db) - ROWS / 2,
                        LEFT - 10 - LETTER * (int64_t)strlen(text), text, 2, black);
    }
    v2v_canvas_fill(canvas, bottom, LEFT, 2, columns, black);
    v2v_canvas_fill(canvas, TOP, LEFT, bottom - TOP, 2, black);
    v2v_canvas_text(canvas, 14, LEFT, title, 2, black);
    v2v_canvas_text(canvas, HEIGHT - 28, LEFT,
                    "disc: training, start and one frame; ring: start and one frame alone; "
                    "line: the front",
                    2, black);
}

static int by_time(const void *a, const void *b)
{
    const struct point *p = a, *q = b;
    return (p->seconds > q->seconds) - (p->seconds < q->seconds);
}

/* Names stay off this. */
static void keep_clear(struct plot *plot, int64_t y, int64_t x, int64_t height, int64_t width)
{
    if (plot->boxes < BOXES) {
        plot->box[plot->boxes++] = (struct box){y, x, height, width};
    }
}

/* A piece of the front. */
static void line(struct plot *plot, int64_t y, int64_t x, int64_t height, int64_t width)
{
    v2v_canvas_fill(&plot->canvas, y, x, height, width, dark);
    keep_clear(plot, y - 1, x - 1, height + 2, width + 2);
}

/* From one method of the front to the next, and on to the edge. */
static void draw_front(struct plot *plot)
{
    const struct point *last = NULL;
    for (int i = 0; i <= plot->points; i++) {
        const struct point *p = i < plot->points ? &plot->point[i] : NULL;
        if (p != NULL && !p->front) {
            continue;
        }
        const int64_t x = p != NULL ? x_of(plot, p->seconds) : WIDTH - RIGHT;
        if (last != NULL) {
            const int64_t from = x_of(plot, last->seconds), y = y_of(plot, last->psnr);
            line(plot, y - 1, from, 2, x - from);
            if (p != NULL) {
                const int64_t to = y_of(plot, p->psnr);
                line(plot, to, x - 1, y - to, 2);
            }
        }
        last = p;
    }
}

static void draw_points(struct plot *plot)
{
    for (int i = 0; i < plot->points; i++) {
        const struct point *p = &plot->point[i];
        const int64_t y = y_of(plot, p->psnr), x = x_of(plot, p->seconds);
        if (p->frame < p->seconds) {
            const int64_t frame = x_of(plot, p->frame);
            disc(plot, y, frame, RADIUS, p->rgb);
            disc(plot, y, frame, RADIUS - 2, white);
            keep_clear(plot, y - RADIUS, frame - RADIUS, 2 * RADIUS + 1, 2 * RADIUS + 1);
        }
        disc(plot, y, x, RADIUS, p->rgb);
        keep_clear(plot, y - RADIUS, x - RADIUS, 2 * RADIUS + 1, 2 * RADIUS + 1);
    }
}

static int is_free(const struct plot *plot, int64_t y, int64_t x, int64_t width)
{
    int free = x > LEFT && x + width < WIDTH && y > TOP && y + ROWS < HEIGHT - BOTTOM;
    for (int i = 0; i < plot->boxes; i++) {
        const struct box *box = &plot->box[i];
        free &= y >= box->y + box->height || y + ROWS <= box->y || x >= box->x + box->width ||
                x + width <= box->x;
    }
    return free;
}

/* Where the name goes: beside the disc, or the ring where the disc lies on one before it. */
static double place_of(const struct plot *plot, const struct point *p)
{
    for (const struct point *q = plot->point; q < p; q++) {
        if (llabs(x_of(plot, q->seconds) - x_of(plot, p->seconds)) < RADIUS &&
            llabs(y_of(plot, q->psnr) - y_of(plot, p->psnr)) < RADIUS) {
            return p->frame;
        }
    }
    return p->seconds;
}

/* Beside its point, above or below it, wherever there is room first; with a line where that is not
 * near. */
static void draw_name(struct plot *plot, const struct point *p)
{
    const int64_t y = y_of(plot, p->psnr), x = x_of(plot, place_of(plot, p));
    const int64_t width = LETTER * (int64_t)strlen(p->name), gap = RADIUS + 5;
    for (int64_t away = 0; away < HEIGHT; away += 2) {
        for (int place = 0; place < 4; place++) {
            const int64_t left = place % 2 == 0 ? x + gap : x - gap - width;
            const int64_t top = y - ROWS / 2 + (place / 2 == 0 ? -away : away);
            if (is_free(plot, top, left, width)) {
                if (away > ROWS) {
                    const int64_t end = top + ROWS / 2;
                    v2v_canvas_fill(&plot->canvas, end < y ? end : y,
                                    place % 2 == 0 ? x + gap / 2 : x - gap / 2, llabs(end - y), 1,
                                    p->rgb);
                }
                v2v_canvas_text(&plot->canvas, top, left, p->name, 2, p->rgb);
                keep_clear(plot, top, left, ROWS + 1, width);
                return;
            }
        }
    }
}

int main(int argc, char **argv)
{
    static struct plot plot;
    int code = 1;
    if (argc != 4 || !read_points(&plot, argv[1])) {
        fprintf(stderr, "usage: draw_pareto POINTS.tsv OUT.png TITLE\n");
        return 2;
    }
    choose_colours(&plot);
    qsort(plot.point, (size_t)plot.points, sizeof *plot.point, by_time);
    choose_axes(&plot);
    if (v2v_canvas_init(&plot.canvas, HEIGHT, WIDTH) == V2V_OK) {
        draw_axes(&plot, argv[3]);
        draw_front(&plot);
        draw_points(&plot);
        for (int i = 0; i < 2 * plot.points; i++) { /* the front's names first */
            const struct point *p = &plot.point[i % plot.points];
            if (p->front == (i < plot.points)) {
                draw_name(&plot, p);
            }
        }
        code = v2v_png_write(argv[2], plot.canvas.rgb, HEIGHT, WIDTH, 3) != V2V_OK;
    }
    if (code != 0) {
        fprintf(stderr, "draw_pareto: %s\n", v2v_status_message());
    }
    v2v_canvas_fini(&plot.canvas);
    return code;
}
