/** Loops over rows of pixels. All are called by one thread each. */
#ifndef OP_PIXELS_H
#define OP_PIXELS_H

#include <stdint.h>

/** phase[j * step + t] = line[4 t + j]: the pixels of `count` tiles, j < 4. */
void v2v_pixels_split(float *phase, int64_t step, const float *line, int64_t count);
/** Back again. */
void v2v_pixels_join(float *line, const float *phase, int64_t step, int64_t count);

/** row += line */
void v2v_pixels_add(float *row, const float *line, int64_t count);

/** Pixels [x0,x1) of a row that has every pixel of `row` twice. */
void v2v_pixels_repeat(float *line, const float *row, int64_t x0, int64_t x1);
/** Adjoint: adds to the row. */
void v2v_pixels_repeat_turned(float *row, const float *line, int64_t x0, int64_t x1);

/** line = leaky(line + bias) */
void v2v_pixels_activate(float *line, int64_t count, float bias, float slope);

/** v2v_leaky_backward by one thread. */
void v2v_pixels_activate_turned(float *din, const float *dout, const float *y, int64_t count,
                                float slope);

/** Rows in float32, their sums in double precision. */
double v2v_pixels_sum(const float *plane, int64_t rows, int64_t columns);

/** Every second of `count` pixels, where they lie. */
void v2v_pixels_drop_odd(float *line, int64_t count);
/** `count` pixels of a row with zeros between. */
void v2v_pixels_spread(float *line, const float *row, int64_t count);

#endif
