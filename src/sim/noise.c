#include "v2v3d/sim/noise.h"

#include "v2v3d/base/random.h"
#include "v2v3d/base/text.h"
#include "v2v3d/tensor/statistics.h"

#include <string.h>

static const double level_percentile = 99.5;

/* Streams of this purpose: 'N' in the top byte, the frame number below. */
static const uint64_t noise_stream = (uint64_t)'N' << 56;

struct kind {
    const char *prefix;
    int kind;
    double least, most; /* of the amount */
};
static const struct kind kinds[] = {
    {"gaussian:", V2V_NOISE_GAUSSIAN, 0, 1e6},
    {"poisson:", V2V_NOISE_POISSON, 1e-6, 1e12},
};

enum v2v_status v2v_noise_parse(struct v2v_noise *noise, const char *text)
{
    *noise = (struct v2v_noise){.kind = V2V_NOISE_NONE};
    if (strcmp(text, "none") == 0) {
        return V2V_OK;
    }
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        size_t length = strlen(kinds[i].prefix);
        if (strncmp(text, kinds[i].prefix, length) == 0) {
            noise->kind = kinds[i].kind;
            return v2v_text_to_f64(&noise->amount, text + length, kinds[i].least, kinds[i].most,
                                   text, V2V_E_USAGE);
        }
    }
    return V2V_FAIL(V2V_E_USAGE, "noise '%s' is none of: none, gaussian:S, poisson:N", text);
}

enum v2v_status v2v_noise_level(struct v2v_noise *noise, const float *clean, int64_t count)
{
    enum v2v_status rc = v2v_percentile(&noise->level, clean, count, level_percentile);
    if (rc == V2V_OK && noise->kind != V2V_NOISE_NONE && !(noise->level > 0)) {
        rc = V2V_FAIL(V2V_E_INPUT,
                      "noise is relative to the views' %.1fth percentile, which is %g: the scene "
                      "is too dark or too sparse",
                      level_percentile, noise->level);
    }
    return rc;
}

static float gaussian(const struct v2v_noise *noise, float clean, uint64_t seed, uint64_t stream,
                      uint64_t index)
{
    double sigma = noise->amount * noise->level;
    return (float)(clean + sigma * v2v_random_normal(seed, stream, index));
}

static float poisson(const struct v2v_noise *noise, float clean, uint64_t seed, uint64_t stream,
                     uint64_t index)
{
    double unit = noise->level / noise->amount; /* of the views, per photon */
    double mean = clean > 0 ? clean / unit : 0;
    return (float)(unit * (double)v2v_random_poisson(seed, stream, index, mean));
}

void v2v_noise_apply(float *noisy, const float *clean, int64_t count, const struct v2v_noise *noise,
                     uint64_t seed, int64_t t, int64_t first)
{
    uint64_t stream = noise_stream + (uint64_t)t;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < count; i++) {
        uint64_t index = (uint64_t)(first + i);
        switch (noise->kind) {
        case V2V_NOISE_GAUSSIAN:
            noisy[i] = gaussian(noise, clean[i], seed, stream, index);
            break;
        case V2V_NOISE_POISSON:
            noisy[i] = poisson(noise, clean[i], seed, stream, index);
            break;
        default:
            noisy[i] = clean[i];
        }
    }
}
