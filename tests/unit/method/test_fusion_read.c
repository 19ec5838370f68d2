/* Fusing frames: hard input, and frames of a recording. */
#include "small_frames.h"
#include "small_recording.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/statistics.h"

#include <string.h>

/* ---- hard input ---- */

static void without_noise_or_finite_samples_a_frame_stays_as_it_is(void **state)
{
    (void)state;
    static float flat[FRAMES][SAMPLES];
    for (int64_t i = 0; i < FRAMES * SAMPLES; i++) {
        flat[i / SAMPLES][i % SAMPLES] = (float)(i / SAMPLES);
    }
    fuse_frames(fused, flat, FRAMES - 1, 1);
    assert_memory_equal(fused, flat[0], sizeof fused);
    make_frames(0.0);
    frames[0][SAMPLES / 2] = INFINITY;
    frames[0][SAMPLES / 3] = NAN;
    fuse(fused, frames, FRAMES - 1);
    assert_memory_equal(fused, frames[0], sizeof fused);
}

static void what_is_not_finite_in_a_neighbour_is_left_out(void **state)
{
    (void)state;
    make_frames(0.0);
    frames[1][HEIGHT / 2 * WIDTH + WIDTH / 2] = INFINITY;
    frames[2][HEIGHT / 3 * WIDTH + WIDTH / 3] = NAN;
    for (int is_aligned = 1; is_aligned >= 0; is_aligned--) {
        fuse_frames(fused, frames, 2, is_aligned);
        assert_int_equal(v2v_first_not_finite(fused, SAMPLES), -1);
    }
    fuse(other, frames, 1);
    assert_true(fused[PIXELS + WIDTH] != other[PIXELS + WIDTH]); /* in another view it counts */
}

static void frames_too_small_for_noise_stay_as_they_are(void **state)
{
    (void)state;
    const float t[3] = {1.0f, 2.0f, 4.0f}, u[3] = {5.0f, 6.0f, 7.0f};
    float to[3];
    struct v2v_fusion *fusion = NULL;
    assert_ok(v2v_fusion_create(&fusion, 2, 1, 1, 3, 0));
    v2v_fusion_begin(fusion, t);
    v2v_fusion_add(fusion, t, v2v_fusion_align(fusion, t, u));
    v2v_fusion_end(fusion, to);
    assert_memory_equal(to, t, sizeof to);
    v2v_fusion_destroy(&fusion);
}

static void memory_is_what_it_is_told_to_be(void **state)
{
    (void)state;
    for (int i = 0; i < 4; i++) {
        struct v2v_fusion *fusion = NULL;
        const int64_t neighbours = i % 2;
        const int leaves_blind = i / 2;
        const size_t held = v2v_mem_held();
        assert_ok(v2v_fusion_create(&fusion, neighbours, VIEWS, HEIGHT, WIDTH, leaves_blind));
        const int64_t taken = (int64_t)(v2v_mem_held() - held);
        const int64_t planned = 4 * v2v_fusion_floats(neighbours, VIEWS, HEIGHT, WIDTH);
        assert_true(taken >= planned && taken < planned + 4096); /* and the object itself */
        v2v_fusion_destroy(&fusion);
    }
}

/* ---- recordings ---- */

static const struct v2v_scaling scaling = {.offset = 100, .gain = 0.25};

static void read_frame(float *to, struct v2v_recording *recording, int64_t neighbours, int64_t t)
{
    struct v2v_fusion *fusion = NULL;
    assert_ok(v2v_recording_read_seen(recording, to, 0.0, NULL, t)); /* its marks stay with it */
    const size_t held = v2v_mem_held();
    assert_ok(v2v_fusion_create(&fusion, neighbours, VIEWS, HEIGHT, WIDTH, 0));
    const int64_t taken = (int64_t)(v2v_mem_held() - held);
    assert_ok(v2v_fusion_read(fusion, to, recording, &scaling, t));
    assert_int_equal(v2v_mem_held() - held, taken);
    v2v_fusion_destroy(&fusion);
}

static struct v2v_recording *record(int64_t count)
{
    const struct v2v_recording_info info = {
        .frames = count, .views = VIEWS, .height = HEIGHT, .width = WIDTH};
    return small_recording(test_folder(NULL), &frames[0][0], &info);
}

/* The scaled frames t - neighbours .. t + neighbours, or as many at the recording's ends. */
static void expect(float *to, int64_t neighbours, int64_t t)
{
    static float scaled[FRAMES][SAMPLES];
    const int64_t all = 2 * neighbours + 1 < FRAMES ? 2 * neighbours + 1 : FRAMES;
    const int64_t middle = t - neighbours > 0 ? t - neighbours : 0;
    const int64_t first = middle + all <= FRAMES ? middle : FRAMES - all;
    int count = 0;
    for (int64_t u = first; u < first + all; u++) {
        float *place = u == t ? scaled[0] : scaled[++count];
        memcpy(place, frames[u], sizeof scaled[0]);
        v2v_scaling_apply(&scaling, place, SAMPLES);
    }
    fuse_frames(to, scaled, count, 1);
}

static void a_window_of_frames_is_read_and_ends_with_the_recording(void **state)
{
    (void)state;
    make_frames(8.0 * noise);
    struct v2v_recording *recording = record(FRAMES);
    for (int64_t neighbours = 1; neighbours <= FRAMES; neighbours++) {
        for (int64_t t = 0; t < FRAMES; t++) {
            read_frame(fused, recording, neighbours, t);
            expect(other, neighbours, t);
            assert_memory_equal(fused, other, sizeof fused);
        }
    }
    v2v_recording_close(&recording);
}

static void a_range_has_the_bits_of_the_whole_recording(void **state)
{
    (void)state;
    make_frames(8.0 * noise);
    struct v2v_recording *recording = record(FRAMES);
    assert_ok(v2v_recording_cut(recording, 1, 3));
    for (int64_t first = 1; first < 3; first++) { /* and a range of the range */
        for (int64_t t = 0; t < v2v_recording_info(recording)->frames; t++) {
            read_frame(fused, recording, 2, t);
            expect(other, 2, first + t);
            assert_memory_equal(fused, other, sizeof fused);
        }
        assert_ok(v2v_recording_cut(recording, first == 1, 1));
        assert_int_equal(v2v_recording_info(recording)->before, 2);
        assert_int_equal(v2v_recording_info(recording)->after, 2);
    }
    v2v_recording_close(&recording);
}

static void alone_or_without_neighbours_a_frame_stays_as_it_is(void **state)
{
    (void)state;
    make_frames(8.0 * noise);
    for (int64_t neighbours = 0; neighbours < 2; neighbours++) {
        struct v2v_recording *recording = record(neighbours == 0 ? FRAMES : 1);
        read_frame(fused, recording, neighbours, 0);
        memcpy(other, frames[0], sizeof other);
        v2v_scaling_apply(&scaling, other, SAMPLES);
        assert_memory_equal(fused, other, sizeof fused);
        v2v_recording_close(&recording);
    }
}

/* A corner that no light comes to, of counts below the camera's zero: found as it was recorded,
 * left out as a calibration moves it. */
static void a_masked_corner_is_left_out_of_calibrated_views(void **state)
{
    (void)state;
    enum { CORNER = 14, FAR = 2 * CORNER };
    struct v2v_view_calibration view[VIEWS] = {
        {.gain = 1.0, .distortion_y = {0.8}, .shading = {0.1, -0.2}}, {.gain = 1.0}};
    const struct v2v_calibration calibration = {VIEWS, HEIGHT, WIDTH, view, NULL};
    struct v2v_scaling calibrated = scaling;
    calibrated.calibration = &calibration;
    make_frames(8.0 * noise);
    for (int64_t i = 0; i < (int64_t)FRAMES * CORNER * CORNER; i++) {
        frames[i / (CORNER * CORNER)][i / CORNER % CORNER * WIDTH + i % CORNER] = 40.0f;
    }
    struct v2v_recording *recording = record(FRAMES);
    assert_ok(v2v_recording_calibrate(recording, &calibration));
    for (int64_t neighbours = 0; neighbours < 3; neighbours += 2) {
        float *const to[2] = {other, fused}; /* all of it, and without the corner */
        for (int leaves_blind = 0; leaves_blind < 2; leaves_blind++) {
            struct v2v_fusion *fusion = NULL;
            assert_ok(v2v_fusion_create(&fusion, neighbours, VIEWS, HEIGHT, WIDTH, leaves_blind));
            assert_ok(v2v_fusion_read(fusion, to[leaves_blind], recording, &calibrated, 1));
            v2v_fusion_destroy(&fusion);
        }
        assert_int_equal(v2v_blind_count(other, SAMPLES), 0);
        assert_in_range(v2v_blind_count(fused, SAMPLES), CORNER * CORNER,
                        (CORNER + 4) * (CORNER + 4));
        for (int64_t i = 0; i < SAMPLES; i++) {
            const int64_t y = i / WIDTH, x = i % WIDTH;
            assert_true(fused[i] == V2V_BLIND || neighbours > 0 || fused[i] == other[i]);
            assert_true(fused[i] == V2V_BLIND || y >= CORNER || x >= CORNER);
            assert_true(fused[i] != V2V_BLIND || (y < FAR && x < FAR));
        }
    }
    v2v_recording_close(&recording);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(without_noise_or_finite_samples_a_frame_stays_as_it_is),
        cmocka_unit_test(what_is_not_finite_in_a_neighbour_is_left_out),
        cmocka_unit_test(frames_too_small_for_noise_stay_as_they_are),
        cmocka_unit_test(memory_is_what_it_is_told_to_be),
        cmocka_unit_test(a_window_of_frames_is_read_and_ends_with_the_recording),
        cmocka_unit_test(a_range_has_the_bits_of_the_whole_recording),
        cmocka_unit_test(alone_or_without_neighbours_a_frame_stays_as_it_is),
        cmocka_unit_test(a_masked_corner_is_left_out_of_calibrated_views),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
