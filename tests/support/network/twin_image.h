/** Feature maps of the double-precision twin and what it does to them beside convolving. */
#ifndef V2V_TEST_TWIN_IMAGE_H
#define V2V_TEST_TWIN_IMAGE_H

#include "v2v3d/base/status.h"
#include <stdint.h>

struct v2v_image {
    int64_t channels, height, width;
    double *data; /**< [c,y,x], owned */
};

/** All @kind Local. What makes an image @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_image_init(struct v2v_image *image, int64_t channels, int64_t height,
                               int64_t width) V2V_MUST_CHECK;
void v2v_image_fini(struct v2v_image *image);
int64_t v2v_image_count(const struct v2v_image *image);

/** image <- other, which is empty afterwards. */
void v2v_image_replace(struct v2v_image *image, struct v2v_image *other);

/** x <- x where positive, else slope * x. */
void v2v_image_leaky(struct v2v_image *image, double slope);

/** out = the channels of `first`, then those of `second` (NULL: none). */
enum v2v_status v2v_image_join(struct v2v_image *out, const struct v2v_image *first,
                               const struct v2v_image *second) V2V_MUST_CHECK;

enum v2v_status v2v_image_average_pool(struct v2v_image *out, const struct v2v_image *in,
                                       int factor) V2V_MUST_CHECK;
enum v2v_status v2v_image_max_pool2(struct v2v_image *out,
                                    const struct v2v_image *in) V2V_MUST_CHECK;

/** image <- nearest upsampling by 2. */
enum v2v_status v2v_image_nearest2(struct v2v_image *image) V2V_MUST_CHECK;

/** out [c,height,width]: source = i * (n_in - 1) / (n_out - 1), linear between neighbours. */
void v2v_image_bilinear(double *out, const struct v2v_image *in, int64_t height, int64_t width);

#endif
