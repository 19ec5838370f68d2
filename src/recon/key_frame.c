#include "recon/key_frame.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

/* Pixels of a square's side; frames that are compared, and that may become the key frame. */
enum { SIDE = 8, COMPARED = 3, LOOKED_AT = 4 };

/* One is fewer than half of them. */
enum { LEAST_VIEWS = 3 };

/* What a view differs by is more than noise makes, in standard deviations, more than this part of
 * its light, and so many times what half of the views change by. */
static const double certain = 5.0, least_part = 0.1, unlike_others = 2.0;

struct v2v_key_frames {
    int64_t views, height, width;
    int64_t squares;        /* of an image */
    float *mean[COMPARED];  /* [v,squares] */
    float *noise[COMPARED]; /* likewise: variance of the means */
    float *change;          /* [2,v]; of a pair of frames, the second is rearranged */
    double *least;          /* [v] of that, for a view that differs */
    uint8_t *differs;       /* [compared,v]: the other two frames do */
};

static int64_t squares_of(int64_t height, int64_t width)
{
    return height / SIDE * (width / SIDE);
}

int64_t v2v_key_frames_floats(int64_t views, int64_t height, int64_t width)
{
    return v2v_mem_product(2 * COMPARED, views, squares_of(height, width));
}

enum v2v_status v2v_key_frames_create(struct v2v_key_frames **keys, int64_t views, int64_t height,
                                      int64_t width)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_key_frames *made = NULL;
    const int64_t squares = squares_of(height, width);
    *keys = NULL;
    V2V_TRY(V2V_ALLOC(made, "recon.key", 1));
    made->views = views;
    made->height = height;
    made->width = width;
    made->squares = squares;
    for (int i = 0; i < COMPARED; i++) {
        V2V_TRY(V2V_ALLOC(made->mean[i], "recon.key", v2v_mem_product(views, squares, 1)));
        V2V_TRY(V2V_ALLOC(made->noise[i], "recon.key", v2v_mem_product(views, squares, 1)));
    }
    V2V_TRY(V2V_ALLOC(made->change, "recon.key", 2 * views));
    V2V_TRY(V2V_ALLOC(made->least, "recon.key", views));
    V2V_TRY(V2V_ALLOC(made->differs, "recon.key", COMPARED * views));
    *keys = made;
    made = NULL;
done:
    v2v_key_frames_destroy(&made);
    return rc;
}

void v2v_key_frames_destroy(struct v2v_key_frames **keys)
{
    struct v2v_key_frames *old = *keys;
    *keys = NULL;
    if (old != NULL) {
        for (int i = 0; i < COMPARED; i++) {
            v2v_mem_free(old->mean[i]);
            v2v_mem_free(old->noise[i]);
        }
        v2v_mem_free(old->change);
        v2v_mem_free(old->least);
        v2v_mem_free(old->differs);
        v2v_mem_free(old);
    }
}

/* Means of squares, and their noise by |a - b - c + d|, which smooth light leaves alone. */
static void measure(const struct v2v_key_frames *keys, int slot, const float *views)
{
    enum { DIFFERENCES = (SIDE - 1) * (SIDE - 1) };
    const int64_t columns = keys->width / SIDE;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < keys->views * keys->squares; i++) {
        const int64_t square = i % keys->squares, width = keys->width;
        const float *at = views + i / keys->squares * keys->height * width +
                          square / columns * SIDE * width + square % columns * SIDE;
        double sum = 0.0;
        for (int64_t y = 0; y < SIDE - 1; y++) {
            for (const float *p = at + y * width; p < at + y * width + SIDE - 1; p++) {
                const double bent =
                    ((double)p[0] - (double)p[1]) - ((double)p[width] - (double)p[width + 1]);
                sum += bent * bent;
            }
        }
        keys->mean[slot][i] = (float)v2v_mean_of_square(at, width, SIDE);
        keys->noise[slot][i] = (float)(sum / (4.0 * DIFFERENCES * SIDE * SIDE));
    }
}

/* Of view v: the mean square of what two frames differ by, less noise; and the least of it that is
 * plainly more than noise, and matters. */
static void compare_view(const struct v2v_key_frames *keys, int64_t v, int one, int other)
{
    const int64_t first = v * keys->squares;
    double change = 0.0, spread = 0.0, light = 0.0;
    for (int64_t i = first; i < first + keys->squares; i++) {
        const double a = (double)keys->mean[one][i], b = (double)keys->mean[other][i];
        const double noise = (double)keys->noise[one][i] + (double)keys->noise[other][i];
        change += (a - b) * (a - b) - noise;
        light += fmax(a * a, b * b);
        spread += 2.0 * noise * noise;
    }
    keys->change[v] = (float)change;
    keys->least[v] = certain * sqrt(spread) + least_part * least_part * light;
}

/* Views that two frames differ in, and most others don't. */
static void compare(const struct v2v_key_frames *keys, uint8_t *differs, int one, int other)
{
    const int64_t views = keys->views;
    for (int64_t v = 0; v < views; v++) {
        compare_view(keys, v, one, other);
    }
    memcpy(keys->change + views, keys->change, (size_t)views * sizeof(float));
    const double others = fmax(0.0, (double)v2v_select(keys->change + views, views, views / 2));
    for (int64_t v = 0; v < views; v++) {
        differs[v] =
            (double)keys->change[v] > keys->least[v] + unlike_others * unlike_others * others;
    }
}

/* Less than half as bright as either other frame, as where the light was shut off? Of frames of
 * noise alone none is. */
static int is_dim(const struct v2v_key_frames *keys, int slot)
{
    const int64_t count = keys->views * keys->squares;
    double light[COMPARED], noise = 0.0;
    for (int i = 0; i < COMPARED; i++) {
        light[i] = v2v_sum(keys->mean[i], count);
        noise = fmax(noise, sqrt(v2v_sum(keys->noise[i], count)));
    }
    const double others = fmin(light[(slot + 1) % COMPARED], light[(slot + 2) % COMPARED]);
    return others > certain * noise && 2.0 * light[slot] < others;
}

/* Is the frame in this slot odd: in a view or some, fewer than half, it differs from both others,
 * which don't differ from each other? */
static int is_odd(const struct v2v_key_frames *keys, int slot)
{
    const int64_t views = keys->views;
    int64_t odd = 0;
    for (int i = 0; i < COMPARED; i++) {
        compare(keys, keys->differs + i * views, (i + 1) % COMPARED, (i + 2) % COMPARED);
    }
    for (int64_t v = 0; v < views; v++) {
        odd += !keys->differs[slot * views + v] &&
               keys->differs[(slot + 1) % COMPARED * views + v] &&
               keys->differs[(slot + 2) % COMPARED * views + v];
    }
    return odd > 0 && 2 * odd < views;
}

enum v2v_status v2v_key_frames_choose(struct v2v_key_frames *keys, int64_t *key, float *views,
                                      struct v2v_recording *recording,
                                      const struct v2v_scaling *scaling, int64_t first,
                                      int64_t count)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    const int64_t apart = v2v_larger(info->apart, 1); /* frames that share no pages */
    const int64_t end = info->frames + info->after;
    *key = first;
    if (count < 2 || keys->views < LEAST_VIEWS) {
        return V2V_OK;
    }
    for (int64_t i = 0; i < v2v_smaller(count, LOOKED_AT); i++) {
        const int64_t t = first + i;
        const int64_t later = v2v_smaller((end - 1 - t) / apart, COMPARED - 1);
        const int slot = (int)(COMPARED - 1 - later);
        if (t >= end || t - slot * apart < -info->before) {
            break;
        }
        for (int k = 0; k < COMPARED; k++) {
            v2v_watchdog_beat("choosing a key frame");
            V2V_TRY(v2v_scaling_read_dark(scaling, recording, views, NULL, t + (k - slot) * apart));
            measure(keys, k, views);
        }
        if (!is_odd(keys, slot) && !is_dim(keys, slot)) {
            *key = t;
            break;
        }
    }
done:
    return rc;
}
