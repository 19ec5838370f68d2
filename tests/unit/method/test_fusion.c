/* Views fused with those of neighbouring frames, against plain loops in double precision and
 * against what statistics say. */
#include "small_frames.h"

#include "method/brightness.h"
#include "method/local_brightness.h"
#include "method/photons.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

static double sigma_of(const float *views)
{
    static float scratch[SAMPLES];
    return v2v_noise_of_images(scratch, views, VIEWS, HEIGHT, WIDTH);
}

/* Sum of squares of the finer Gaussian's taps. */
static double of_fine(void)
{
    double sum = 0.0, squares = 0.0;
    for (int k = -8; k <= 8; k++) {
        sum += exp(-k * k / 8.0);
        squares += exp(-k * k / 4.0);
    }
    return pow(squares / (sum * sum), 2.0);
}

/* ---- the twin ---- */

/* Pixel (y,x) of a smoothed image with its edges repeated. */
static double smoothed(const double *image, int y, int x, double sigma)
{
    const int reach = (int)(4 * sigma);
    double sum = 0.0, taps = 0.0;
    for (int k = -reach; k <= reach; k++) {
        for (int l = -reach; l <= reach; l++) {
            const int row = y + k < 0 ? 0 : y + k >= HEIGHT ? HEIGHT - 1 : y + k;
            const int column = x + l < 0 ? 0 : x + l >= WIDTH ? WIDTH - 1 : x + l;
            const double tap = exp(-0.5 * (k * k + l * l) / (sigma * sigma));
            sum += tap * image[row * WIDTH + column];
            taps += tap;
        }
    }
    return sum / taps;
}

/* The noise of frame t: its variance is gain * level + variance, where it is that of photons. */
static struct v2v_photons noise_about(const float *t)
{
    static float scratch[SAMPLES];
    struct v2v_photons found = v2v_photons_find(scratch, t, VIEWS, HEIGHT, WIDTH, NULL);
    if (!found.is_clear) {
        found.gain = 0.0;
        found.variance = pow(sigma_of(t), 2.0);
    }
    return found;
}

/* Of every pixel of a view, by the light about it. */
static void levels_of(double *level, const float *view)
{
    static double light[PIXELS];
    for (int i = 0; i < PIXELS; i++) {
        light[i] = (double)view[i];
    }
    for (int i = 0; i < PIXELS; i++) {
        level[i] = fmax(smoothed(light, i / WIDTH, i % WIDTH, 2.0), 0.0);
    }
}

/* Factors of a neighbour's samples; tests/unit/method/test_local_brightness.c judges them. */
static void factors_of(float *factor, const float *t, const float *u)
{
    static struct v2v_ratio ratios[SAMPLES / 64];
    static float photons[SAMPLES];
    static double level[PIXELS];
    struct v2v_local_brightness *local = NULL;
    const struct v2v_photons found = noise_about(t);
    const double unit = found.gain * found.bright + found.variance;
    for (int v = 0; v < VIEWS; v++) {
        levels_of(level, t + v * PIXELS);
        for (int i = 0; i < PIXELS; i++) {
            photons[v * PIXELS + i] = (float)(found.gain / unit * level[i]);
        }
    }
    assert_ok(v2v_local_brightness_create(&local, VIEWS, HEIGHT, WIDTH));
    v2v_local_brightness_begin(local, t, photons, unit, found.variance / unit);
    v2v_local_brightness_find(
        local, factor, u, v2v_brightness_factor(ratios, t, u, VIEWS, HEIGHT, WIDTH, sigma_of(t)));
    v2v_local_brightness_destroy(&local);
}

/* Of the smoothed difference of a view and a neighbour's, whose light counts f times. */
static void deviations_of(double *deviation, const float *view, const struct v2v_photons *found,
                          const float *factor)
{
    static double level[PIXELS];
    levels_of(level, view);
    for (int i = 0; i < PIXELS; i++) {
        const double f = (double)factor[i];
        const double of_photons = (1.0 + f) * found->gain, even = (1.0 + f * f) * found->variance;
        const double in_light =
            found->gain * found->bright * (1.0 + f) + (1.0 + f * f) * found->variance;
        deviation[i] = sqrt(fmax(of_photons * level[i] + even, 0.01 * in_light) * of_fine());
    }
}

/* Weights and factors of frame u beside frame t, as REFERENCE.md 12 has them. */
static void weights_of(double *weight, float *factor, const float *t, const float *u)
{
    static double deviation[PIXELS], change[PIXELS], square[PIXELS], mean[PIXELS], e[SAMPLES];
    const struct v2v_photons found = noise_about(t);
    const double in_light = found.gain * found.bright;
    factors_of(factor, t, u);
    memset(mean, 0, sizeof mean);
    for (int v = 0; v < VIEWS; v++) {
        deviations_of(deviation, t + v * PIXELS, &found, factor + v * PIXELS);
        for (int i = 0; i < PIXELS; i++) {
            const int at = v * PIXELS + i;
            change[i] = ((double)t[at] - (double)factor[at] * (double)u[at]) / deviation[i];
        }
        for (int i = 0; i < PIXELS; i++) {
            square[i] = pow(smoothed(change, i / WIDTH, i % WIDTH, 2.0), 2.0);
        }
        for (int i = 0; i < PIXELS; i++) {
            e[v * PIXELS + i] = smoothed(square, i / WIDTH, i % WIDTH, 3.0);
            mean[i] += e[v * PIXELS + i] / VIEWS;
        }
    }
    for (int i = 0; i < PIXELS; i++) {
        const double m = smoothed(mean, i / WIDTH, i % WIDTH, 3.0);
        const double of_all = 12.0 * fmax(0.0, m - 1.0 - 1.34 / sqrt(VIEWS));
        for (int at = i; at < SAMPLES; at += PIXELS) {
            const double f = (double)factor[at];
            const double still =
                (in_light + found.variance) / (f * in_light + f * f * found.variance);
            weight[at] = still / (1.0 + 2.0 * fmax(0.0, e[at] - 1.5) + of_all);
        }
    }
}

/* What rounding moves a fused sample by, of frames up to `light` that differ by `most` at most. A
 * weight changes with E by 2 w^2 and E with the root of it, s, by 2 s: by 4 w^2 s <= 5 together
 * (1.5 < E; w = 1 at 1.5 and falls as 1 / E). s is moved by `of_root`; E is a sum of 2 x 25 more
 * taps, which are positive: w^2 E <= 1.5, twice. With M, that begins at 1.95, it changes by 12 w^2
 * and so by 24 w^2 sqrt M <= 34, and by 12 w^2 M <= 24 times the rounding of M, that of E, of the
 * mean and of 2 x 25 taps. A weight's first factor multiplies what it is divided by in the end. */
static double rounding_of(double of_root, double most, double light, int count)
{
    const double of_weight =
        (5.0 + 34.0) * of_root + 3.0 * test_rounding(50) + 24.0 * test_rounding(100 + VIEWS);
    return count * of_weight * most + count * 0x1p-23 * (light + most);
}

/* Here s is a sum of 2 x 17 taps of differences, of samples of 100 times a factor, over sigma *
 * sqrt(of_fine) at least. */
static double rounding(double most, int count)
{
    const double differences = test_rounding(34) * most + 0x1p-23 * (100.0 + most);
    return rounding_of(differences / (sigma_of(frames[0]) * sqrt(of_fine())), most, 100.0, count);
}

/* Of frame 0 and a neighbour, whose light counts `factor` times. */
static double difference(int64_t i, int t, double factor)
{
    return fabs((double)frames[0][i] - factor * (double)frames[t][i]);
}

static double greatest_difference(void)
{
    double most = 0.0;
    for (int t = 1; t < FRAMES; t++) {
        for (int64_t i = 0; i < SAMPLES; i++) {
            most = fmax(most, difference(i, t, 1.0));
        }
    }
    return most;
}

/* Frame 0 and two others, by these weights and factors. */
static void assert_fused(double (*weight)[SAMPLES], float (*factor)[SAMPLES], double bound)
{
    fuse(fused, frames, 2);
    for (int64_t i = 0; i < SAMPLES; i++) {
        double sum = (double)frames[0][i], of = 1.0;
        for (int u = 0; u < 2; u++) {
            sum += weight[u][i] * (double)factor[u][i] * (double)frames[u + 1][i];
            of += weight[u][i];
        }
        assert_true(fabs((double)fused[i] - sum / of) <= bound);
    }
}

static void fused_views_match_plain_loops(void **state)
{
    (void)state;
    enum { COUNT = 2 };
    static double weight[COUNT][SAMPLES];
    static float factor[COUNT][SAMPLES];
    double most = 0.0;
    make_frames(8.0 * noise);
    for (int u = 0; u < COUNT; u++) {
        for (int64_t i = 0; i < SAMPLES; i++) {
            frames[u + 1][i] *= 1.0f + 0.5f * (float)u;
        }
        weights_of(weight[u], factor[u], frames[0], frames[u + 1]);
        for (int64_t i = 0; i < SAMPLES; i++) {
            most = fmax(most, difference(i, u + 1, (double)factor[u][i]));
        }
    }
    const double bound = rounding(most, COUNT);
    assert_true(bound < 0.1 * noise); /* another tap or constant would be seen */
    assert_fused(weight, factor, bound);
}

/* Photons in no, some and much light, where a spot moves, beside read noise of 1: where it is dark
 * the least variance counts. The second neighbour is half as bright again. */
static void make_photons(void)
{
    static const double levels[] = {0.0, 20.0, 400.0};
    for (int t = 0; t < FRAMES; t++) {
        const double factor = t == 2 ? 1.5 : 1.0;
        for (int64_t i = 0; i < SAMPLES; i++) {
            const uint64_t at = (uint64_t)i, stream = 2 * (uint64_t)t;
            const double level =
                levels[i % WIDTH * 3 / WIDTH] + spot(100.0, i, 30, t == 0 ? 20 : 60);
            frames[t][i] = (float)((double)v2v_random_poisson(7, stream, at, factor * level) +
                                   v2v_random_normal(7, stream + 1, at));
        }
    }
}

/* A smoothed change s is a sum of 2 x 17 taps, of differences of two samples, over the root of a
 * variance, with the rounding of a level of 2 x 17 positive taps. */
static void photons_match_plain_loops(void **state)
{
    (void)state;
    enum { COUNT = 2 };
    static double weight[COUNT][SAMPLES], deviation[PIXELS];
    static float factor[COUNT][SAMPLES];
    double most = 0.0, of_root = 0.0;
    make_photons();
    const struct v2v_photons found = noise_about(frames[0]);
    const double least = 0.01 * (found.gain * found.bright + found.variance);
    assert_true(found.is_clear && found.variance > 0.0 && found.variance < least);
    for (int u = 0; u < COUNT; u++) {
        weights_of(weight[u], factor[u], frames[0], frames[u + 1]);
        for (int i = 0; i < SAMPLES; i++) {
            if (i % PIXELS == 0) {
                deviations_of(deviation, frames[0] + i, &found, factor[u] + i);
            }
            const double change = difference(i, u + 1, (double)factor[u][i]);
            const double sample = 2.0 * fabs((double)frames[0][i]) + change;
            most = fmax(most, change);
            of_root = fmax(of_root, (2.0 * test_rounding(34) * change + 0x1p-23 * sample) /
                                        deviation[i % PIXELS]);
        }
    }
    const int dark = WIDTH / 6; /* where factors are those of all */
    assert_true(fabs((double)factor[0][dark] - 1.0) < 0.1);
    assert_true(fabs((double)factor[1][dark] * 1.5 - 1.0) < 0.1);
    /* factors go by moments over variances, whose levels are sums of 2 x 17 taps */
    const double of_factors = COUNT * 8.0 * test_rounding(34) * found.bright;
    const double bound = rounding_of(of_root, most, found.bright, COUNT) + of_factors;
    assert_true(bound < sqrt(least)); /* a tenth of the noise in the light: likewise */
    assert_fused(weight, factor, bound);
}

/* ---- statistics ---- */

/* The variance of n normal samples is known to sqrt(2 / n) of itself, of which this allows five. A
 * weight depends on 13 x 13 pixels and more, hardly on its own. */
static void noise_of_a_still_scene_falls_as_the_weights_say(void **state)
{
    (void)state;
    static double weight[SAMPLES], sum[SAMPLES], squares[SAMPLES];
    static float factor[SAMPLES];
    double variance = 0.0, expected = 0.0;
    make_frames(0.0);
    for (int64_t i = 0; i < SAMPLES; i++) {
        sum[i] = squares[i] = 1.0;
    }
    for (int u = 1; u < FRAMES; u++) {
        weights_of(weight, factor, frames[0], frames[u]);
        for (int64_t i = 0; i < SAMPLES; i++) {
            sum[i] += weight[i];
            squares[i] += pow(weight[i] * (double)factor[i], 2.0);
        }
    }
    fuse(fused, frames, FRAMES - 1);
    for (int64_t i = 0; i < SAMPLES; i++) {
        variance += pow((double)fused[i] - 100.0, 2.0) / SAMPLES;
        expected += noise * noise * squares[i] / (sum[i] * sum[i]) / SAMPLES;
    }
    assert_true(fabs(variance / expected - 1.0) <= 5.0 * sqrt(2.0 / SAMPLES));
    assert_true(expected < 1.2 * noise * noise / FRAMES); /* nearly all of them count */
}

/* Photons: a mean square of differences of 1 in the light as in the dark, so that neighbours count
 * in both; by one noise for all samples none would in the light, where it is ten times as large. */
static void photons_are_averaged_where_it_is_bright_and_where_it_is_dark(void **state)
{
    (void)state;
    enum { DARK = 4, LIGHT = 400, EDGE = 12 };
    double squares[2] = {0}, count[2] = {0};
    for (int t = 0; t < FRAMES; t++) {
        for (int64_t i = 0; i < SAMPLES; i++) {
            const double level = i % WIDTH < WIDTH / 2 ? DARK : LIGHT;
            frames[t][i] = (float)v2v_random_poisson(7, (uint64_t)t, (uint64_t)i, level);
        }
    }
    fuse(fused, frames, FRAMES - 1);
    for (int64_t i = 0; i < SAMPLES; i++) {
        const int64_t x = i % WIDTH;
        const int is_light = x >= WIDTH / 2;
        if (x < WIDTH / 2 - EDGE || x >= WIDTH / 2 + EDGE) {
            const double level = is_light ? LIGHT : DARK;
            squares[is_light] += pow((double)fused[i] - level, 2.0) / level;
            count[is_light] += 1.0;
        }
    }
    for (int k = 0; k < 2; k++) {
        const double known_to = 5.0 * sqrt(2.0 / count[k]);
        assert_true(squares[k] / count[k] < (1.0 + known_to) * 1.1 / FRAMES);
    }
}

/* Of a change by c everywhere E and M are exactly c^2 / (2 sigma^2 of_fine), at the edges too.
 * Below 0 there is no light whose brightness could have changed. */
static void a_uniform_change_weighs_as_the_formula_says(void **state)
{
    (void)state;
    make_frames(0.0);
    for (int64_t i = 0; i < SAMPLES; i++) {
        frames[0][i] -= 200.0f;
    }
    const double sigma = sigma_of(frames[0]);
    for (double e = 0.25; e < 1e4; e *= 2.0) {
        const double c = sqrt(e * 2.0 * of_fine()) * sigma;
        const double of_all = 12.0 * fmax(0.0, e - 1.0 - 1.34 / sqrt(VIEWS));
        const double w = 1.0 / (1.0 + 2.0 * fmax(0.0, e - 1.5) + of_all);
        for (int64_t i = 0; i < SAMPLES; i++) {
            frames[1][i] = (float)((double)frames[0][i] + c);
        }
        fuse(fused, frames, 1);
        /* c is rounded with its sample, below 256, by d = 2^-17: it counts as d, and by 2 d / c of
         * E */
        const double bound = rounding(c, 1) + (1.0 + 6.0) * 0x1p-17;
        for (int64_t i = 0; i < SAMPLES; i++) {
            const double gained = (double)fused[i] - (double)frames[0][i];
            assert_true(fabs(gained - c * w / (1.0 + w)) <= bound);
        }
    }
}

/* Light that doubles over the recording, of a scene that stands still: a frame keeps its
 * brightness, with the noise of an average. */
static void brightness_of_a_frame_is_kept(void **state)
{
    (void)state;
    for (int t = 0; t < FRAMES; t++) {
        for (int64_t i = 0; i < SAMPLES; i++) {
            const double factor = 1.0 + (double)t / (FRAMES - 1);
            frames[t][i] = (float)(factor * (10.0 + spot(8.0 * noise, i, 30, 35)) +
                                   noise * v2v_random_normal(7, (uint64_t)t, (uint64_t)i));
        }
    }
    fuse(fused, frames, FRAMES - 1);
    double sum = 0.0, squares = 0.0, own = 0.0;
    for (int64_t i = 0; i < SAMPLES; i++) {
        const double clean = 10.0 + spot(8.0 * noise, i, 30, 35);
        sum += (double)fused[i] / SAMPLES;
        own += clean / SAMPLES;
        squares += pow((double)fused[i] - clean, 2.0) / SAMPLES;
    }
    /* The median knows a factor to 1.25 times what all light does, 3 sigma sqrt(SAMPLES) / (own
     * SAMPLES) at most, of two frames' noise. */
    assert_true(fabs(sum / own - 1.0) < 5.0 * 1.25 * sqrt(2.0) * noise / (own * sqrt(SAMPLES)));
    /* f is 1, 0.8, 0.67, 0.57, 0.5. Of weights f^-2 the variance would be 1 / 11.9; some fall by
     * chance. Without the brightest frame it would be 1 / 7.87. */
    assert_true(squares < noise * noise / 7.87);
}

/* The spot, smoothed to half of its brightness b, leaves E = 0.3 (b / 2)^2 / (2 sigma^2 of_fine) at
 * its centre: 1.9 (b / sigma)^2. Noise may take half of that, so that a weight is at most 1 / 1.9
 * (sigma / b)^2, by which the difference of two frames counts. */
static void what_moved_is_that_of_the_frame_itself(void **state)
{
    (void)state;
    const double brightness = 20.0 * noise;
    make_frames(brightness);
    fuse(fused, frames, FRAMES - 1);
    const double bound = (FRAMES - 1) * greatest_difference() / (1.9 * 20.0 * 20.0);
    assert_true(bound < 0.2 * noise);
    for (int64_t i = 0; i < SAMPLES; i++) {
        if (spot(1.0, i, 30, 20) > 0.6 || spot(1.0, i, 30, 50) > 0.6) {
            assert_true(fabs((double)fused[i] - (double)frames[0][i]) <= bound);
        }
    }
}

/* Frames that fused samples say they are means of: all where nothing changed, one where a spot came
 * or went. Where nothing changed as much of the variance is left as that says, or, since noise
 * takes some weight from some, a little less. And nothing of views of one frame. */
static void samples_say_how_many_frames_they_are_of(void **state)
{
    (void)state;
    struct v2v_fusion *fusion = NULL;
    double squares = 0.0, expected = 0.0, count = 0.0;
    make_frames(20.0 * noise);
    assert_ok(v2v_fusion_create(&fusion, 1, VIEWS, HEIGHT, WIDTH, 0));
    assert_null(v2v_fusion_averaging(fusion));
    v2v_fusion_begin(fusion, frames[0]);
    for (int u = 1; u < FRAMES; u++) {
        v2v_fusion_add(fusion, frames[0], frames[u]);
    }
    memcpy(fused, frames[0], sizeof fused);
    v2v_fusion_end(fusion, fused);
    const struct v2v_averaging *averaging = v2v_fusion_averaging(fusion);
    assert_non_null(averaging);
    assert_true(averaging->sigma == sigma_of(frames[0]));
    assert_memory_equal(v2v_fusion_recorded(fusion), frames[0], sizeof frames[0]);
    assert_false(averaging->is_of_photons);
    for (int64_t i = 0; i < SAMPLES; i++) {
        const double of = (double)averaging->frames[i];
        const int is_spot = spot(1.0, i, 30, 20) > 0.6 || spot(1.0, i, 30, 50) > 0.6;
        /* a neighbour's spot of 20 of 100 / 3 is taken down to the light about it */
        assert_true(of >= 1.0 && of <= 1.0 + (FRAMES - 1) * pow(1.0 + 20.0 * noise / 100.0, 2.0));
        assert_true(!is_spot || of < 1.1);
        if (spot(1.0, i, 30, 20) < 1e-6 && spot(1.0, i, 30, 50) < 1e-6) {
            squares += pow((double)fused[i] - 100.0, 2.0);
            expected += noise * noise / of;
            count += 1.0;
        }
    }
    if (!(squares / expected > 0.85 && squares / expected < 1.0 + 5.0 * sqrt(2.0 / count))) {
        fail_msg("variance %g of what frames say", squares / expected);
    }
    memset(frames[0], 0, sizeof frames[0]); /* no noise: nothing is averaged */
    v2v_fusion_begin(fusion, frames[0]);
    v2v_fusion_end(fusion, fused);
    assert_null(v2v_fusion_averaging(fusion));
    assert_null(v2v_fusion_recorded(fusion));
    v2v_fusion_destroy(&fusion);
}

static void weights_do_not_depend_on_the_unit(void **state)
{
    (void)state;
    static float scaled[FRAMES][SAMPLES];
    static const double scales[] = {0.1, 10.0, 1e-20, 1e15};
    make_frames(8.0 * noise);
    fuse(fused, frames, FRAMES - 1);
    const double bound = 2.0 * rounding(greatest_difference(), FRAMES - 1);
    for (size_t s = 0; s < sizeof scales / sizeof scales[0]; s++) {
        for (int64_t i = 0; i < FRAMES * SAMPLES; i++) {
            scaled[i / SAMPLES][i % SAMPLES] =
                (float)((double)frames[i / SAMPLES][i % SAMPLES] * scales[s]);
        }
        fuse(other, scaled, FRAMES - 1);
        for (int64_t i = 0; i < SAMPLES; i++) {
            assert_true(fabs((double)other[i] / scales[s] - (double)fused[i]) <= bound);
        }
    }
}

/* Spots at random, of this part of the noise, that all move by this a frame, pixels; and others of
 * 20 that flash, in each frame elsewhere. Frame 0 without noise in `fused`. */
static void make_spots(double brightness, double along_y, double along_x, int flashes)
{
    enum { SPOTS = 20 };
    for (int t = 0; t < FRAMES; t++) {
        for (int64_t i = 0; i < SAMPLES; i++) {
            double light = 10.0;
            for (int k = 0; k < SPOTS + flashes; k++) {
                const int is_flash = k >= SPOTS;
                const uint64_t stream = is_flash ? 2 * (uint64_t)t + 2 : 0;
                const double y = HEIGHT * v2v_random_uniform(8, stream, (uint64_t)k);
                const double x = WIDTH * v2v_random_uniform(8, stream + 1, (uint64_t)k);
                light += spot((is_flash ? 20.0 : brightness) * noise, i, y + along_y * t,
                              x + along_x * t);
            }
            frames[t][i] = (float)(light + noise * v2v_random_normal(7, (uint64_t)t, (uint64_t)i));
            fused[i] = t == 0 ? (float)light : fused[i];
        }
    }
}

/* Against `fused`, the mean square of what is missed in frame 0, in its noise; not near the edges,
 * where spots come in. */
static double missed(int is_aligned)
{
    enum { EDGE = 12 };
    double squares = 0.0, count = 0.0;
    fuse_frames(other, frames, FRAMES - 1, is_aligned);
    for (int64_t i = 0; i < SAMPLES; i++) {
        const int64_t y = i / WIDTH % HEIGHT, x = i % WIDTH;
        if (y >= EDGE && y < HEIGHT - EDGE && x >= EDGE && x < WIDTH - EDGE) {
            squares += pow(((double)other[i] - (double)fused[i]) / noise, 2.0);
            count += 1.0;
        }
    }
    return squares / count;
}

/* Five frames would leave a fifth of the variance; of neighbours as they are those that moved by
 * two pixels and more count nowhere near a spot. */
static void what_moves_is_averaged_where_frames_are_aligned(void **state)
{
    (void)state;
    make_spots(20.0, 1.6, -1.2, 0);
    const double as_they_are = missed(0), aligned = missed(1);
    if (!(aligned < 1.3 / FRAMES && as_they_are > 1.5 * aligned)) {
        fail_msg("%g of the variance is left, %g aligned", as_they_are, aligned);
    }
}

/* What comes and goes must not move what stands still: no more is missed than of neighbours as they
 * are, give or take a fiftieth; a variance of 2 x 36 x 47 samples is known to 0.024. */
static void what_flashes_moves_nothing(void **state)
{
    (void)state;
    for (int flashes = 0; flashes <= 12; flashes += 4) {
        make_spots(8.0, 0.0, 0.0, flashes);
        const double as_they_are = missed(0), aligned = missed(1);
        if (!(aligned < 1.02 * as_they_are)) {
            fail_msg("%d: %g of the variance is left, %g aligned", flashes, as_they_are, aligned);
        }
    }
}

/* A spot that the camera cuts off is found there in the mean, and the mean is nowhere above. */
static void what_is_cut_off_stays_cut_off(void **state)
{
    (void)state;
    const float most = 150.0f;
    int64_t saturated = 0;
    make_spots(60.0, 0.0, 0.0, 0);
    for (int64_t i = 0; i < FRAMES * SAMPLES; i++) {
        float *sample = &frames[i / SAMPLES][i % SAMPLES];
        *sample = fminf(*sample, most);
    }
    fuse(fused, frames, FRAMES - 1);
    for (int64_t i = 0; i < SAMPLES; i++) {
        saturated += frames[0][i] == most;
        assert_true(fused[i] <= most && (frames[0][i] < most || fused[i] == most));
    }
    assert_true(saturated > 100);
    assert_true(sigma_of(fused) < 0.7 * sigma_of(frames[0]));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fused_views_match_plain_loops),
        cmocka_unit_test(photons_match_plain_loops),
        cmocka_unit_test(noise_of_a_still_scene_falls_as_the_weights_say),
        cmocka_unit_test(photons_are_averaged_where_it_is_bright_and_where_it_is_dark),
        cmocka_unit_test(a_uniform_change_weighs_as_the_formula_says),
        cmocka_unit_test(brightness_of_a_frame_is_kept),
        cmocka_unit_test(what_moved_is_that_of_the_frame_itself),
        cmocka_unit_test(what_moves_is_averaged_where_frames_are_aligned),
        cmocka_unit_test(what_flashes_moves_nothing),
        cmocka_unit_test(samples_say_how_many_frames_they_are_of),
        cmocka_unit_test(weights_do_not_depend_on_the_unit),
        cmocka_unit_test(what_is_cut_off_stays_cut_off),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
