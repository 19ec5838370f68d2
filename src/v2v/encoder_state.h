/* What the encoder's files share: its layers, and what it holds of their images. */
#ifndef V2V3D_V2V_ENCODER_STATE_H
#define V2V3D_V2V_ENCODER_STATE_H

#include "v2v/encoder.h"

enum { BLOCKS = 6, LEVELS = 3, DEEP = 16, LEVEL_FEATURES = 4 };
enum { CONCATENATED = DEEP + LEVELS * LEVEL_FEATURES, GRADIENTS = 3 };

/* y = second(leaky(first(x))) + skip(x) */
struct block {
    struct v2v_layer first, second, skip;
    int has_skip;
    float *middle; /* [batch,out,y,x] after the activation */
    float *out;    /* [batch,out,y,x] */
};

/* Average pool by `factor`, 1 x 1 convolution, bilinear upsampling back. */
struct level {
    struct v2v_layer conv;
    int factor;
    float *pooled; /* [batch,16,y/factor,x/factor] */
    float *small;  /* [batch,4,y/factor,x/factor] after the activation */
};

/* Without training: full-size images are made in lines, from top to bottom. */
struct stream {
    int threads;   /* each makes a band of rows; 0: images are made one after the other */
    float **rings; /* [thread] what a layer left for the next one */
    float *joined; /* [28,y,x] as lines */
    float *pooled[LEVELS], *small[LEVELS]; /* as a level's */
    float *output;                         /* [features,y,x] */
};

struct v2v_encoder {
    int64_t features;
    int64_t batch, height, width;
    int training;
    struct v2v_layer entry, fuse, last;
    struct block block[BLOCKS];
    struct level level[LEVELS];
    float *entered;      /* [batch,4,y,x] */
    float *concatenated; /* [batch,28,y,x] */
    float *fused;        /* [batch,16,y,x] */
    float *output;       /* [batch,features,y,x] */
    float *scratch;      /* [batch,16,y,x] */
    struct stream stream;
    float *gradient[GRADIENTS]; /* [batch,28,y,x], [batch,16,y,x] twice; training only */
};

/* Is one view at a time encoded? Training keeps every image as a whole. */
static inline int v2v_encoder_may_stream(const struct v2v_encoder *encoder)
{
    return !encoder->training && encoder->batch == 1;
}

/* Is it in lines? */
static inline int v2v_encoder_streams(const struct v2v_encoder *encoder)
{
    return encoder->stream.threads > 0;
}

/* Floats of stream.joined. */
int64_t v2v_encoder_stream_floats(const struct v2v_encoder *encoder);

/* Memory of the threads, after the layers' plans. */
enum v2v_status v2v_encoder_stream_plan(struct v2v_encoder *encoder) V2V_MUST_CHECK;
void v2v_encoder_stream_fini(struct v2v_encoder *encoder);

/* v2v_encoder_forward of one view, to the same bits. */
const float *v2v_encoder_stream_forward(struct v2v_encoder *encoder, const float *view);

#endif
