/* Bilinear upsampling by rows, then by columns. The places and weights of a run of columns lie on
 * the stack and serve all rows of a plane; places are exact integers. */
#include "v2v3d/base/clones.h"
#include "v2v3d/op/resample.h"
#include <string.h>

/** Columns of the output in one run. Factors are at least 1: a run reads RUN + 1 columns at most.
 */
enum { RUN = 512 };

/** Where an output index lies between input indices: (1-weight) * in[low] + weight * in[high]. */
struct place {
    int64_t low, high;
    float weight;
};

static struct place place_of(int64_t index, int64_t in, int64_t out)
{
    if (in == 1) {
        return (struct place){0, 0, 0.0f};
    }
    int64_t low = index * (in - 1) / (out - 1);
    int64_t rest = index * (in - 1) % (out - 1);
    return (struct place){.low = low,
                          .high = low + 1 < in ? low + 1 : low,
                          .weight = (float)((double)rest / (double)(out - 1))};
}

/** A run of output columns: column x lies at low[x], low[x] + 1 of the input's columns from `first`
 *  on. The one beyond the last column has weight 0 and is a repetition of the last. */
struct run {
    int64_t start, count; /**< output columns */
    int64_t first, width; /**< input columns read */
    int32_t low[RUN];
    float weight[RUN];
};

static void run_fill(struct run *run, int64_t start, int64_t in, int64_t out)
{
    run->start = start;
    run->count = out - start < RUN ? out - start : RUN;
    run->first = place_of(start, in, out).low;
    for (int64_t x = 0; x < run->count; x++) {
        struct place place = place_of(start + x, in, out);
        run->low[x] = (int32_t)(place.low - run->first);
        run->weight[x] = place.weight;
        run->width = place.high - run->first + 1;
    }
}

V2V_SIMD_CLONES
static void blend(float *out, const float *low, const float *high, float weight, int64_t count)
{
#pragma omp simd
    for (int64_t x = 0; x < count; x++) {
        out[x] = low[x] + weight * (high[x] - low[x]);
    }
}

V2V_SIMD_CLONES
static void spread(float *out, const float *row, const struct run *run)
{
#pragma omp simd
    for (int64_t x = 0; x < run->count; x++) {
        float low = row[run->low[x]];
        out[x] = low + run->weight[x] * (row[run->low[x] + 1] - low);
    }
}

/** low += (1-weight) * row, high += weight * row. */
V2V_SIMD_CLONES
static void split(float *low, float *high, const float *row, float weight, int64_t count)
{
    float rest = 1.0f - weight;
#pragma omp simd
    for (int64_t x = 0; x < count; x++) {
        low[x] += rest * row[x];
        high[x] += weight * row[x];
    }
}

/** The adjoint of spread, onto an input row of which the last column is its own neighbour. */
static void collect(float *row, const float *columns, const struct run *run)
{
    for (int64_t x = 0; x < run->count; x++) {
        int64_t low = run->low[x];
        int64_t high = low + 1 < run->width ? low + 1 : low;
        row[low] += (1.0f - run->weight[x]) * columns[x];
        row[high] += run->weight[x] * columns[x];
    }
}

/** A run of one output row; `row` is room for the input columns that it reads. */
static void forward_row(float *out, const float *in, float *row, const struct run *run,
                        const struct place *place, int64_t width)
{
    blend(row, in + place->low * width + run->first, in + place->high * width + run->first,
          place->weight, run->width);
    row[run->width] = row[run->width - 1];
    spread(out + run->start, row, run);
}

static void forward_run(float *out, const float *in, const struct run *run, int64_t height,
                        int64_t width, int factor)
{
    float row[RUN + 2] = {0.0f};
    for (int64_t y = 0; y < height * factor; y++) {
        struct place place = place_of(y, height, height * factor);
        forward_row(out + y * width * factor, in, row, run, &place, width);
    }
}

void v2v_bilinear_forward(float *out, const float *in, int64_t planes, int64_t height,
                          int64_t width, int factor)
{
    int64_t columns = width * factor;
#pragma omp parallel for schedule(static)
    for (int64_t c = 0; c < planes; c++) {
        for (int64_t x = 0; x < columns; x += RUN) {
            struct run run;
            run_fill(&run, x, width, columns);
            forward_run(out + c * height * factor * columns, in + c * height * width, &run, height,
                        width, factor);
        }
    }
}

void v2v_bilinear_lines(const struct v2v_lines *out, const float *in, int factor, int64_t first,
                        int64_t rows)
{
    int64_t height = out->height / factor, width = out->width / factor;
    for (int64_t x = 0; x < out->width; x += RUN) {
        struct run run;
        float row[RUN + 2] = {0.0f};
        run_fill(&run, x, width, out->width);
        for (int64_t y = first; y < first + rows; y++) {
            struct place place = place_of(y, height, out->height);
            float *to = v2v_lines_at(out, y);
            for (int64_t c = 0; c < out->channels; c++) {
                forward_row(to + c * v2v_lines_stride(out), in + c * height * width, row, &run,
                            &place, width);
            }
        }
    }
}

/** Rows first: the output rows between two input rows are added up for both, so that the columns,
 *  which take single steps, are collected once an input row. At the last input row the weight of
 * the row beyond is 0 and its sums are dropped. */
static void backward_run(float *din, const float *dout, const struct run *run, int64_t height,
                         int64_t width, int factor)
{
    float sums[2][RUN] = {{0.0f}};
    float *low = sums[0], *high = sums[1];
    int64_t row = 0;
    for (int64_t y = 0; y < height * factor; y++) {
        struct place place = place_of(y, height, height * factor);
        if (place.low > row) {
            collect(din + row * width + run->first, low, run);
            memset(low, 0, sizeof sums[0]);
            float *done = low;
            low = high;
            high = done;
            row = place.low;
        }
        split(low, high, dout + y * width * factor + run->start, place.weight, run->count);
    }
    collect(din + row * width + run->first, low, run);
    if (row + 1 < height) {
        collect(din + (row + 1) * width + run->first, high, run);
    }
}

void v2v_bilinear_backward(float *din, const float *dout, int64_t planes, int64_t height,
                           int64_t width, int factor)
{
    int64_t columns = width * factor;
#pragma omp parallel for schedule(static)
    for (int64_t c = 0; c < planes; c++) {
        float *plane = din + c * height * width;
        memset(plane, 0, (size_t)(height * width) * sizeof *plane);
        for (int64_t x = 0; x < columns; x += RUN) {
            struct run run;
            run_fill(&run, x, width, columns);
            backward_run(plane, dout + c * height * factor * columns, &run, height, width, factor);
        }
    }
}
