/* Stacks of images, pooled and repeated. */
#ifndef V2V3D_NN_STACK_H
#define V2V3D_NN_STACK_H

#include <stdint.h>

/* [depth,channels,y,x]; with ends, an image before the first and one after the last: the channels
 * of images d-1, d, d+1 lie one after the other, as one image of three times the channels. */
struct v2v_stack {
    float *data;
    int64_t channels, depth, height, width;
    int ends; /* bool */
};

static inline int64_t v2v_stack_pixels(const struct v2v_stack *stack)
{
    return stack->height * stack->width;
}

/* Channel c of image d. */
static inline float *v2v_stack_at(const struct v2v_stack *stack, int64_t d, int64_t c)
{
    return stack->data + ((d + stack->ends) * stack->channels + c) * v2v_stack_pixels(stack);
}

/* Zeros before and after; of a stack without ends, nothing. */
void v2v_stack_clear_ends(const struct v2v_stack *stack);

/* to += from, by the calling thread alone. */
void v2v_stack_add(float *to, const float *from, int64_t count);

/* Maximum over windows of 2 x 2, and of 2 images where `out` has half the depth, of the first
 * channels of `in`; `which` [depth,channels,y,x] keeps the place 0 .. 7, as z y x in binary, of the
 * first maximum; NULL: it is not kept. */
void v2v_stack_pool(const struct v2v_stack *out, uint8_t *which, const struct v2v_stack *in);

/* din += the adjoint, at those places. */
void v2v_stack_pool_backward(const struct v2v_stack *din, const struct v2v_stack *dout,
                             const uint8_t *which);

/* Channels from `first` on of `out`: each pixel of `in` repeated 2 x 2, and each image twice where
 * `in` has half the depth. */
void v2v_stack_repeat(const struct v2v_stack *out, int64_t first, const struct v2v_stack *in);

/* din = the adjoint. @param scratch as large as an image of din */
void v2v_stack_repeat_backward(const struct v2v_stack *din, const struct v2v_stack *dout,
                               int64_t first, float *scratch);

#endif
