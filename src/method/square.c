#include "method/square.h"

#include "method/registration.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/field.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

enum { STEP = 16 };

/* Of the light that as large a part of the square holds in the mean: little. */
static const double little = 0.5;

/* Of pixels that aren't blind: their number, their sum, and that of their squares. */
struct sums {
    double count, sum, squares;
};

/* Add `sign` times the sums of rows of a square's columns. */
static void add_rows(struct sums *sums, double sign, const float *image, int64_t width,
                     const struct v2v_part *columns, struct v2v_part rows)
{
    for (int64_t y = rows.first; y < rows.first + rows.count; y++) {
        const float *row = image + y * width + columns->first;
        double count = 0.0, sum = 0.0, squares = 0.0;
        for (int64_t x = 0; x < columns->count; x++) {
            const int is_seen = row[x] != V2V_BLIND;
            const double pixel = is_seen ? (double)row[x] : 0.0;
            count += is_seen;
            sum += pixel;
            squares += pixel * pixel;
        }
        sums->count += sign * count;
        sums->sum += sign * sum;
        sums->squares += sign * squares;
    }
}

/* Downwards a square gains rows below and loses as many above. */
struct v2v_square v2v_square_find(const float *image, int64_t width, struct v2v_part rows,
                                  struct v2v_part columns, int64_t side)
{
    struct v2v_square here = {{rows.first, v2v_smaller(side, rows.count)},
                              {columns.first, v2v_smaller(side, columns.count)}};
    struct v2v_square best = here;
    const int64_t last_top = rows.first + rows.count - here.rows.count;
    const int64_t last_left = columns.first + columns.count - here.columns.count;
    V2V_ASSERT(side >= STEP);
    double most = -1.0;
    for (; here.columns.first <= last_left; here.columns.first += STEP) {
        struct sums sums = {0};
        here.rows.first = rows.first;
        add_rows(&sums, 1.0, image, width, &here.columns, here.rows);
        while (1) {
            const double variation = sums.squares - sums.sum * sums.sum / fmax(sums.count, 1.0);
            const int64_t above = here.rows.first, below = above + here.rows.count;
            if (variation > most) {
                most = variation;
                best = here;
            }
            here.rows.first += STEP;
            if (here.rows.first > last_top) {
                break;
            }
            add_rows(&sums, -1.0, image, width, &here.columns, (struct v2v_part){above, STEP});
            add_rows(&sums, 1.0, image, width, &here.columns, (struct v2v_part){below, STEP});
        }
    }
    return best;
}

void v2v_square_cut(const struct v2v_square *square, float *to, const float *images, int64_t count,
                    int64_t height, int64_t width)
{
    const int64_t rows = square->rows.count, columns = square->columns.count;
    for (int64_t row = 0; row < count * rows; row++) {
        const int64_t y = row / rows * height + square->rows.first + row % rows;
        memcpy(to + row * columns, images + y * width + square->columns.first,
               (size_t)columns * sizeof *to);
    }
}

/* All but a narrow margin. */
static struct v2v_part widely_judged(int64_t side)
{
    const int64_t edge = v2v_smaller(V2V_FIELD_MARGIN / 3, v2v_field_margin(side));
    return (struct v2v_part){edge, side - 2 * edge};
}

/* The squares of a part's pixels, all views together, beyond those of the noise. */
static double light_in(const struct v2v_square_views *square, int64_t views,
                       const struct v2v_square *part, double sigma)
{
    struct sums sums = {0};
    for (int64_t v = 0; v < views; v++) {
        add_rows(&sums, 1.0, square->views + v * square->height * square->width, square->width,
                 &part->columns, part->rows);
    }
    return sums.squares - sums.count * sigma * sigma;
}

/* .. where the views, which are [v,height,width], are judged. */
static enum v2v_status choose_judged(struct v2v_square_views *square, int64_t views)
{
    enum v2v_status rc = V2V_OK;
    const int64_t height = square->height, width = square->width;
    const struct v2v_square all = {{0, height}, {0, width}};
    const struct v2v_square inner = {v2v_registration_judged(height),
                                     v2v_registration_judged(width)};
    float *scratch = NULL;
    V2V_TRY(V2V_ALLOC(scratch, "square.views", v2v_mem_product(views, height, width)));
    const double sigma = v2v_noise_of_images(scratch, square->views, views, height, width);
    const double share =
        (double)(inner.rows.count * inner.columns.count) / (double)(height * width);
    const int is_dark = light_in(square, views, &inner, sigma) <
                        little * share * light_in(square, views, &all, sigma);
    square->judged =
        is_dark ? (struct v2v_square){widely_judged(height), widely_judged(width)} : inner;
done:
    v2v_mem_free(scratch);
    return rc;
}

static int64_t first_that_sees(const float *views, int64_t count, int64_t pixels)
{
    int64_t v = 0;
    while (v < count - 1 && v2v_blind_count(views + v * pixels, pixels) == pixels) {
        v++;
    }
    return v;
}

enum v2v_status v2v_square_views_init(struct v2v_square_views *square,
                                      const struct v2v_problem *problem, const float *views,
                                      const struct v2v_averaging *averaging, int64_t side)
{
    enum v2v_status rc = V2V_OK;
    const int64_t count = problem->psf->views, height = problem->height, width = problem->width;
    const struct v2v_part rows = {0, height}, columns = {0, width};
    const float *varying = views + first_that_sees(views, count, height * width) * height * width;
    const struct v2v_square place = v2v_square_find(varying, width, rows, columns, side);
    *square = (struct v2v_square_views){.height = place.rows.count, .width = place.columns.count};
    const int64_t samples = v2v_mem_product(count, square->height, square->width);
    V2V_TRY(V2V_ALLOC(square->views, "square.views", samples));
    v2v_square_cut(&place, square->views, views, count, height, width);
    V2V_TRY(choose_judged(square, count));
    if (averaging != NULL) {
        V2V_TRY(V2V_ALLOC(square->frames, "square.views", samples));
        v2v_square_cut(&place, square->frames, averaging->frames, count, height, width);
        square->averaging = *averaging;
        square->averaging.frames = square->frames;
    }
done:
    return rc;
}

void v2v_square_views_fini(struct v2v_square_views *square)
{
    v2v_mem_free(square->views);
    v2v_mem_free(square->frames);
    *square = (struct v2v_square_views){0};
}

const struct v2v_averaging *v2v_square_averaging(const struct v2v_square_views *square)
{
    return square->frames != NULL ? &square->averaging : NULL;
}
