/* Views of views by a network, over ranks: what one rank makes, to the bit, whatever tiles and
 * shares there are. */
#include "small_recording.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/io/weights_file.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/recon/denoise.h"

#include <math.h>
#include <string.h>

/* Frames of tiles of 4 in time; sides of more than one tile of 160. */
enum { FRAMES = 11, VIEWS = 3, HEIGHT = 200, WIDTH = 178, STACK = 4, TILE = 160 };
enum { PIXELS = HEIGHT * WIDTH, SAMPLES = VIEWS * PIXELS };

static struct v2v_config config;
static float frames[FRAMES * SAMPLES], read[SAMPLES], other[SAMPLES];
static char weights[1024];
static const char *folder;

/* A network of the registry for such frames, and its weights in a file: rank 0's. */
static struct v2v_network *make_network(void)
{
    struct v2v_network *network = NULL;
    struct v2v_weights_info info;
    const struct v2v_psf_file any = {.views = VIEWS, .slices = 1};
    const struct v2v_network_spec spec = {
        .config = &config, .psf = &any, .views = VIEWS, .slices = 1, .outputs = V2V_NETWORK_ALL};
    assert_ok(v2v_network_create(&network, config.model.method, &spec));
    assert_ok(v2v_rule_weights(&network->schema.fields, network->weights, V2V_RULE_HE, 7));
    assert_ok(v2v_network_describe(&info, &config, VIEWS, 1, 0));
    snprintf(weights, sizeof weights, "%s/weights.h5", folder);
    if (v2v_comm_rank(test_world()) == 0) {
        const float *const group[V2V_WEIGHTS_GROUPS] = {network->weights};
        assert_ok(
            v2v_weights_file_write(weights, &info, &network->schema.fields, group, NULL, NULL));
    }
    v2v_par_barrier(test_world());
    return network;
}

static int setup(void **state)
{
    (void)state;
    folder = test_folder(test_world());
    v2v_log_configure(V2V_LOG_WARNING, 0);
    v2v_config_defaults(&config);
    assert_ok(v2v_config_set(&config, "model.method=deepcad"));
    config.deepcad.width = 2;
    config.deepcad.levels = 2;
    config.deepcad.frames = STACK;
    for (int64_t i = 0; i < FRAMES * SAMPLES; i++) {
        frames[i] = (float)(50.0 + 10.0 * v2v_random_normal(3, 0, (uint64_t)i));
    }
    return 0;
}

static struct v2v_recording *record(int64_t count)
{
    const struct v2v_recording_info info = {
        .frames = count, .views = VIEWS, .height = HEIGHT, .width = WIDTH};
    return small_recording(folder, frames, &info);
}

static const struct v2v_scaling scaling = {.offset = 10.0, .gain = 0.01};

/* The example of denoise.h. */
static enum v2v_status header_example(struct v2v_denoise_report *report, const char *path,
                                      struct v2v_recording *recording, struct v2v_recording *clean,
                                      const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_denoise_job job = {.config = &config,
                                        .weights = weights,
                                        .recording = recording,
                                        .scaling = &scaling,
                                        .clean = clean,
                                        .zero_of_clean = scaling.offset,
                                        .output = path};
    V2V_TRY(v2v_denoise_run(&job, report, comm));
done:
    return rc;
}

/* Denoise as NAME.h5 on these ranks and open it. */
static struct v2v_recording *denoise(struct v2v_denoise_report *report, const char *name,
                                     struct v2v_recording *recording, struct v2v_recording *clean,
                                     const struct v2v_comm *comm)
{
    char path[1024];
    struct v2v_recording *made = NULL;
    const struct v2v_input_settings settings = {.views = VIEWS};
    snprintf(path, sizeof path, "%s/%s.h5", folder, name);
    assert_ok(header_example(report, path, recording, clean, comm));
    assert_ok(v2v_recording_open(&made, path, &settings, comm));
    return made;
}

/* A tile is what the network makes of the stack that is cut there; its first or last rows and
 * columns are kept. Scaled in another order: three roundings of numbers up to 1e3.
 * @param t first frame of the stack @param y0, x0 its corner */
static void check_tile(struct v2v_network *network, struct v2v_recording *made, int64_t t,
                       int64_t y0, int64_t x0)
{
    static float in[STACK * TILE * TILE], out[STACK * TILE * TILE];
    float *outputs[V2V_NETWORK_MOST_OUTPUTS] = {out};
    const struct v2v_network_plan plan = {.height = TILE, .width = TILE};
    const int64_t v = 1, kept = t == 0 ? 0 : STACK - 1;
    for (int64_t i = 0; i < STACK * TILE * TILE; i++) {
        const int64_t from = t + i / TILE / TILE, y = y0 + i / TILE % TILE, x = x0 + i % TILE;
        in[i] = (frames[(from * VIEWS + v) * PIXELS + y * WIDTH + x] - 10.0f) * 0.01f;
    }
    assert_ok(network->ops->plan(network, &plan));
    network->ops->weights_changed(network);
    network->ops->forward(network, outputs, in);
    assert_ok(v2v_recording_read(made, read, t + kept));
    for (int64_t i = 0; i < 80 * 80; i++) {
        const int64_t y = i / 80 + (y0 > 0 ? TILE - 80 : 0), x = i % 80 + (x0 > 0 ? TILE - 80 : 0);
        const double expected = (double)out[(kept * TILE + y) * TILE + x] * 100.0 + 10.0;
        assert_true(fabs((double)read[v * PIXELS + (y0 + y) * WIDTH + x0 + x] - expected) <=
                    3 * 6e-8 * 1e3);
    }
}

static void any_ranks_make_the_same_views(void **state)
{
    (void)state;
    struct v2v_denoise_report report, alone;
    struct v2v_network *network = make_network();
    struct v2v_recording *recording = record(FRAMES);
    struct v2v_recording *made = denoise(&report, "together", recording, recording, test_world());
    assert_int_equal(v2v_recording_info(made)->frames, FRAMES);
    assert_true(isinf(report.psnr_before) && isfinite(report.psnr_after)); /* it is its own truth */
    if (v2v_comm_rank(test_world()) == 0) {
        struct v2v_recording *own = NULL;
        char path[1024];
        const struct v2v_input_settings settings = {.views = VIEWS};
        snprintf(path, sizeof path, "%s/recording.h5", folder);
        assert_ok(v2v_recording_open(&own, path, &settings, NULL));
        struct v2v_recording *one = denoise(&alone, "alone", own, own, NULL);
        for (int64_t t = 0; t < FRAMES; t++) {
            assert_ok(v2v_recording_read(made, read, t));
            assert_ok(v2v_recording_read(one, other, t));
            assert_memory_equal(read, other, sizeof read);
        }
        check_tile(network, one, 0, 0, 0);
        check_tile(network, one, FRAMES - STACK, HEIGHT - TILE, WIDTH - TILE);
        assert_true(fabs(alone.psnr_after - report.psnr_after) < 1e-6);
        v2v_recording_close(&one);
        v2v_recording_close(&own);
    }
    v2v_par_barrier(test_world());
    v2v_recording_close(&made);
    v2v_recording_close(&recording);
    v2v_network_destroy(&network);
}

/* Two frames are taken as the first two of four, first, second, first, second. */
static void a_recording_shorter_than_a_stack_goes_on_backwards(void **state)
{
    (void)state;
    enum { SHORT = STACK / 2 };
    static float kept[SHORT * SAMPLES];
    struct v2v_denoise_report report;
    struct v2v_network *network = make_network();
    for (int n = SHORT; n <= STACK; n += SHORT) {
        struct v2v_recording *recording = record(n);
        struct v2v_recording *made = denoise(&report, "short", recording, NULL, test_world());
        assert_int_equal(v2v_recording_info(made)->frames, n);
        assert_true(isnan(report.psnr_after));
        for (int64_t t = 0; t < SHORT; t++) {
            assert_ok(v2v_recording_read(made, read, t));
            if (n == SHORT) {
                memcpy(kept + t * SAMPLES, read, sizeof read);
            } else {
                assert_memory_equal(kept + t * SAMPLES, read, sizeof read);
            }
        }
        v2v_recording_close(&made);
        v2v_recording_close(&recording);
        memcpy(frames + SHORT * SAMPLES, frames, sizeof kept);
    }
    v2v_network_destroy(&network);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(any_ranks_make_the_same_views, setup),
        cmocka_unit_test_setup(a_recording_shorter_than_a_stack_goes_on_backwards, setup),
    };
    return test_mpi_main(tests, argc, argv);
}
