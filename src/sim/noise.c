#include "v2v3d/sim/noise.h"

#include "v2v3d/base/random.h"
#include "v2v3d/base/text.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

static const double level_percentile = 99.5;

/* Of the brightest sample: what transforms leave where there is no light is 1e-7 of it. */
static const double round_off = 1e-5;

/* That a Poisson number can be drawn of. */
static const double most_photons = 1e15;

/* Streams of this purpose: 'N' in the top byte, the frame number below. */
static const uint64_t noise_stream = (uint64_t)'N' << 56;
static const uint64_t read_noise = (uint64_t)1 << 48; /* further up, a camera's */

struct number {
    const char *name;
    double initial, least, most;
};

/* The numbers that follow a kind, separated by colons; without an initial value (NAN) one must be
 * given. */
enum { NUMBERS = 4 };
static const struct kind {
    const char *name;
    int kind;
    struct number number[NUMBERS];
} kinds[] = {
    {"none", V2V_NOISE_NONE, {{0}}},
    {"gaussian", V2V_NOISE_GAUSSIAN, {{"S", NAN, 0, 1e6}}},
    {"poisson", V2V_NOISE_POISSON, {{"N", NAN, 1e-6, 1e12}}},
    {"camera",
     V2V_NOISE_CAMERA,
     {{"N", NAN, 1e-6, 1e12},
      {"GAIN", 1, 1e-6, 1e6},
      {"OFFSET", 100, 0, V2V_NOISE_MOST_COUNTS},
      {"READ", 1.6, 0, 1e6}}},
};

/* *rest is what follows the kind's name. */
static const struct kind *find(const char **rest, const char *text)
{
    const size_t length = strcspn(text, ":");
    *rest = text + length;
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        if (strlen(kinds[i].name) == length && strncmp(kinds[i].name, text, length) == 0) {
            return &kinds[i];
        }
    }
    return NULL;
}

/* One number of `text` behind the colon at *rest, which moves on to the next. */
static enum v2v_status parse_number(double *value, const char **rest, const struct number *number,
                                    const char *text)
{
    char word[64], what[128];
    enum v2v_status rc = V2V_OK;
    if (**rest == '\0' && !isnan(number->initial)) {
        *value = number->initial;
        return V2V_OK;
    }
    const char *begin = *rest + (**rest == ':');
    const size_t length = strcspn(begin, ":");
    V2V_TRY(v2v_text_format(what, sizeof what, "noise '%.80s': %s", text, number->name));
    if (length >= sizeof word) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s is no number", what));
    }
    V2V_TRY(v2v_text_format(word, sizeof word, "%.*s", (int)length, begin));
    V2V_TRY(v2v_text_to_f64(value, word, number->least, number->most, what, V2V_E_USAGE));
    *rest = begin + length;
done:
    return rc;
}

enum v2v_status v2v_noise_parse(struct v2v_noise *noise, const char *text)
{
    enum v2v_status rc = V2V_OK;
    const char *rest = NULL;
    const struct kind *kind = find(&rest, text);
    double *const value[NUMBERS] = {&noise->amount, &noise->gain, &noise->offset, &noise->read};
    *noise = (struct v2v_noise){.kind = kind != NULL ? kind->kind : V2V_NOISE_NONE};
    for (int i = 0; kind != NULL && i < NUMBERS && kind->number[i].name != NULL; i++) {
        V2V_TRY(parse_number(value[i], &rest, &kind->number[i], text));
    }
    if (kind == NULL || *rest != '\0') {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE,
                         "noise '%s' is none of: none, gaussian:S, poisson:N, "
                         "camera:N[:GAIN[:OFFSET[:READ]]]",
                         text));
    }
done:
    return rc;
}

static double brightest(const float *clean, int64_t count)
{
    float most = 0;
    for (int64_t i = 0; i < count; i++) {
        most = fmaxf(most, clean[i]);
    }
    return (double)most;
}

enum v2v_status v2v_noise_level(struct v2v_noise *noise, const float *clean, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_percentile(&noise->level, clean, count, level_percentile));
    if (noise->kind != V2V_NOISE_NONE && !(noise->level > round_off * brightest(clean, count))) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "noise is relative to the views' %.1fth percentile, which is %g: the "
                         "scene is too dark or too sparse",
                         level_percentile, noise->level));
    }
done:
    return rc;
}

/* Photons at this brightness of the clean views, in the mean. */
static double photons_of(const struct v2v_noise *noise, double clean)
{
    return clean > 0 ? clean / (noise->level / noise->amount) : 0;
}

enum v2v_status v2v_noise_check(const struct v2v_noise *noise, const float *clean, int64_t count)
{
    const double photons =
        noise->kind == V2V_NOISE_POISSON ? photons_of(noise, brightest(clean, count)) : 0;
    return photons <= most_photons
               ? V2V_OK
               : V2V_FAIL(V2V_E_INPUT,
                          "the brightest sample would have %g photons, of which %g "
                          "can be drawn at most: fewer for the noise",
                          photons, most_photons);
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
    const double unit = noise->level / noise->amount; /* of the views, per photon */
    const double mean = photons_of(noise, clean);
    return (float)(unit * (double)v2v_random_poisson(seed, stream, index, mean));
}

static float camera(const struct v2v_noise *noise, float clean, uint64_t seed, uint64_t stream,
                    uint64_t index)
{
    const double mean = fmin(photons_of(noise, clean), most_photons);
    const double photons = (double)v2v_random_poisson(seed, stream, index, mean);
    const double read = noise->read * v2v_random_normal(seed, stream + read_noise, index);
    const double counts = rint(noise->offset + noise->gain * (photons + read));
    return (float)fmin(fmax(counts, 0), V2V_NOISE_MOST_COUNTS);
}

void v2v_noise_expected(float *expected, const float *clean, int64_t count,
                        const struct v2v_noise *noise)
{
    const int is_camera = noise->kind == V2V_NOISE_CAMERA;
    for (int64_t i = 0; i < count; i++) {
        expected[i] = is_camera ? (float)(noise->offset + noise->gain * photons_of(noise, clean[i]))
                                : clean[i];
    }
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
        case V2V_NOISE_CAMERA:
            noisy[i] = camera(noise, clean[i], seed, stream, index);
            break;
        default:
            noisy[i] = clean[i];
        }
    }
}
