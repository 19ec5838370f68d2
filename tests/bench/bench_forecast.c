/* What this machine's figures make of more ranks than it has: a training step and a recording over
 * 1 to 512 ranks, the same work on more ranks (strong) and as much more work (weak).
 *   mpirun -n RANKS bench_forecast PSF [NAME=VALUE ..]      with the names of `settings` below
 * OMP_NUM_THREADS threads a rank. tests/bench/scaling.sh sets it beside what 1, 2 and 4 ranks
 * take. */
#include "network/forecast.h"

#include "cli/threads.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/volume.h"
#include "v2v3d/optics/psf.h"
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* The figures must not take long: a larger frame is measured by a part of it. */
enum { MOST_SIDE = 128 };

static const int rank_counts[] = {1, 2, 4, 8, 64, 512};
enum { COUNTS = sizeof rank_counts / sizeof rank_counts[0], MOST_HERE = 4 };

/* Of the network, of a step, of the recording, and between hosts where there is one alone. */
enum { WIDTH, BATCH, CROP, FRAMES, SIDE, LINK_MB_S, LINK_NS, SETTINGS };
static const char *const setting_names[SETTINGS] = {"width", "batch",     "crop",   "frames",
                                                    "side",  "link_mb_s", "link_ns"};

struct report {
    int64_t setting[SETTINGS];
    const char *scratch; /* folder to write to; NULL: files take no time */
    struct v2v_comm *world;
    struct v2v_forecast_machine machine;
    struct v2v_forecast_network network;
    struct v2v_forecast_speed speed;
    int hosts; /* that there are */
};

/* ---- measuring ---- */

/* Every rank writes a frame and has it on the disk, as reconstruction does. */
static enum v2v_status write_frames(double *seconds, struct v2v_volume_writer *writer,
                                    const struct v2v_volume_info *info,
                                    const struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    const int rank = v2v_comm_rank(world);
    float *frame = NULL;
    rc = V2V_ALLOC(frame, "bench", v2v_mem_product(info->slices, info->height, info->width));
    V2V_TRY(v2v_par_agree(world, rc));
    *seconds = v2v_clock_now();
    rc = v2v_volume_put(writer, V2V_VOLUME_MEAN, frame, rank, 0, info->slices);
    if (rc == V2V_OK) {
        rc = v2v_volume_mark_done(writer, rank, NULL);
    }
    V2V_TRY(v2v_par_agree(world, rc));
    *seconds = v2v_clock_now() - *seconds;
    v2v_par_max_f64(world, seconds, 1);
done:
    v2v_mem_free(frame);
    return rc;
}

static enum v2v_status measure_file(struct report *report)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume_writer *writer = NULL;
    const struct v2v_volume_info info = {.frames = v2v_comm_size(report->world),
                                         .slices = report->network.spec.slices,
                                         .height = report->setting[SIDE],
                                         .width = report->setting[SIDE]};
    const struct v2v_attribute task = {.name = V2V_VOLUME_TASK, .text = "forecast"};
    char path[4096];
    double seconds = 0.0;
    if (report->scratch == NULL) {
        return V2V_OK;
    }
    V2V_TRY(v2v_text_format(path, sizeof path, "%s/v2v3d-forecast.h5", report->scratch));
    V2V_TRY(
        v2v_volume_create(&writer, path, &info, 1u << V2V_VOLUME_MEAN, &task, 1, report->world));
    V2V_TRY(write_frames(&seconds, writer, &info, report->world));
    report->machine.file_byte_s =
        seconds / (double)v2v_mem_product(info.frames * info.slices, info.height, info.width) /
        (double)sizeof(float);
done:
    v2v_volume_abandon(&writer);
    return rc;
}

static int colour_of_host(void)
{
    char name[256] = "";
    return gethostname(name, sizeof name - 1) == 0 ? (int)(v2v_random_fnv1a64(name) >> 33) : 0;
}

static enum v2v_status measure(struct report *report, const char *path)
{
    enum v2v_status rc = V2V_OK;
    const int64_t *setting = report->setting;
    const int64_t side = setting[CROP] > MOST_SIDE ? MOST_SIDE : setting[CROP];
    struct v2v_psf_file psf = {0};
    struct v2v_shifts shifts = {0};
    struct v2v_comm *host = NULL;
    V2V_TRY(v2v_psf_read(&psf, path, "", V2V_NORMALIZE_NONE, report->world));
    V2V_TRY(v2v_par_agree(report->world, v2v_shifts_from_psf(&shifts, &psf)));
    const struct v2v_model_spec spec = {.views = psf.views,
                                        .slices = psf.slices,
                                        .width = setting[WIDTH],
                                        .features = 4,
                                        .branches = V2V_BRANCH_BOTH,
                                        .winograd = 1,
                                        .volume_scale = 1.0};
    rc = v2v_forecast_network_of(&report->network, &spec, &shifts);
    V2V_TRY(v2v_par_agree(report->world, rc));
    V2V_TRY(v2v_comm_split(&host, report->world, colour_of_host(), v2v_comm_rank(report->world)));
    report->machine =
        (struct v2v_forecast_machine){.cores = v2v_cli_cores(),
                                      .link_byte_s = 1e-6 / (double)setting[LINK_MB_S],
                                      .link_message_s = 1e-9 * (double)setting[LINK_NS]};
    report->hosts = v2v_comm_size(report->world) / v2v_comm_size(host);
    V2V_TRY(v2v_forecast_measure(&report->machine, &report->speed, &report->network, &shifts, side,
                                 host, report->world));
    V2V_TRY(measure_file(report));
done:
    v2v_comm_destroy(&host);
    v2v_shifts_fini(&shifts);
    v2v_psf_file_fini(&psf);
    return rc;
}

/* ---- printing ---- */

static void print_machine(const struct report *report)
{
    const struct v2v_forecast_machine *machine = &report->machine;
    const struct v2v_comm_cost *inside = &machine->inside;
    const long long side = (long long)report->speed.side;
    printf("forward pass of width %" PRId64
           " on %lld x %lld: %.3g s on one rank, %.3g s with %d at "
           "once: %.3g multiply-adds/s a rank; a host with all %d cores busy takes %.3g times as "
           "long\n",
           report->setting[WIDTH], side, side, report->speed.alone_s, report->speed.together_s,
           v2v_comm_size(report->world), 1.0 / machine->mac_s, machine->cores, machine->crowd);
    if (inside->ranks > 1) {
        printf("inside a host: message %.3g us, exchange %.3g GB/s a rank, all-reduce %.3g us a "
               "step, %.3g GB/s\n",
               1e6 * inside->message_s, 1e-9 / inside->byte_s, 1e6 * inside->sum_step_s,
               1e-9 / inside->sum_byte_s);
    }
    printf("between hosts: %.3g GB/s a host, message %.3g us; %s\n", 1e-9 / machine->link_byte_s,
           1e6 * machine->link_message_s,
           report->speed.is_link_measured ? "measured" : "given, not measured");
    if (machine->file_byte_s > 0.0) {
        printf("files: %.3g GB/s by all ranks together\n", 1e-9 / machine->file_byte_s);
    }
}

/* Few ranks are predicted for the hosts that there are, so that they can be compared with what is
 * measured here; more get as many hosts of the same kind as have a core for each thread. */
static int hosts_for(const struct report *report, int ranks)
{
    const struct v2v_forecast_machine *machine = &report->machine;
    int64_t hosts = ((int64_t)ranks * machine->threads + machine->cores - 1) / machine->cores;
    if (ranks <= MOST_HERE) {
        return ranks < report->hosts ? ranks : report->hosts;
    }
    return (int)hosts;
}

static enum v2v_status print_rows(const struct report *report, const char *name,
                                  const struct v2v_forecast_job *job, int is_weak)
{
    enum v2v_status rc = V2V_OK;
    double one_s = 0.0;
    for (int i = 0; i < COUNTS; i++) {
        struct v2v_forecast_job own = *job;
        struct v2v_forecast f;
        const int ranks = rank_counts[i];
        own.items *= is_weak ? ranks : 1;
        V2V_TRY(v2v_forecast(&f, &report->machine, &own, ranks, hosts_for(report, ranks)));
        one_s = i == 0 ? f.seconds : one_s;
        const double speedup = (is_weak ? ranks : 1) * one_s / f.seconds, share = 100 / f.seconds;
        char grid[48];
        V2V_TRY(v2v_text_format(grid, sizeof grid, "%dx%dx%d", f.data, f.shape.branches,
                                f.shape.shards));
        printf("%-12s %-6s %6d %5d %10s %7" PRId64
               " %10.4g %8.3g %9.1f %% | %7.1f %7.1f %8.1f %6.1f %7.1f %5.1f\n",
               name, is_weak ? "weak" : "strong", ranks, f.hosts, grid, own.items, f.seconds,
               speedup, 100.0 * speedup / ranks, share * f.compute_s, share * f.crowded_s,
               share * f.repeated_s, share * f.uneven_s, share * f.network_s, share * f.file_s);
    }
done:
    return rc;
}

static enum v2v_status print_table(const struct report *report)
{
    enum v2v_status rc = V2V_OK;
    const int64_t *setting = report->setting;
    const struct v2v_forecast_job step = {&report->network, 1, setting[BATCH], setting[CROP],
                                          setting[CROP]};
    const struct v2v_forecast_job recording = {&report->network, 0, setting[FRAMES], setting[SIDE],
                                               setting[SIDE]};
    print_machine(report);
    printf("%-12s %-6s %6s %5s %10s %7s %10s %8s %11s | %% of the time: compute crowded repeated "
           "uneven network files\n",
           "what", "", "ranks", "hosts", "grid", "items", "seconds", "speed-up", "efficiency");
    for (int is_weak = 0; is_weak <= 1; is_weak++) {
        V2V_TRY(print_rows(report, "training", &step, is_weak));
        V2V_TRY(print_rows(report, "recording", &recording, is_weak));
    }
done:
    return rc;
}

/* NAME=VALUE. */
static enum v2v_status set(struct report *report, const char *word)
{
    static const char scratch[] = "scratch=";
    const char *value = strchr(word, '=');
    if (strncmp(word, scratch, sizeof scratch - 1) == 0) {
        report->scratch = value + 1;
        return V2V_OK;
    }
    for (int i = 0; value != NULL && i < SETTINGS; i++) {
        const size_t length = strlen(setting_names[i]);
        if ((size_t)(value - word) == length && strncmp(word, setting_names[i], length) == 0) {
            return v2v_text_to_i64(&report->setting[i], value + 1, 1, 1000000000, setting_names[i],
                                   V2V_E_USAGE);
        }
    }
    return V2V_FAIL(V2V_E_USAGE, "no setting '%s'", word);
}

static enum v2v_status run(struct report *report, int argc, char **argv)
{
    enum v2v_status rc = V2V_OK;
    if (argc < 2) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "bench_forecast PSF [NAME=VALUE ..]"));
    }
    for (int i = 2; i < argc; i++) {
        V2V_TRY(set(report, argv[i]));
    }
    V2V_TRY(measure(report, argv[1]));
    if (v2v_comm_rank(report->world) == 0) {
        rc = print_table(report);
    }
    V2V_TRY(v2v_par_agree(report->world, rc));
done:
    return rc;
}

int main(int argc, char **argv)
{
    struct report report = {.setting = {128, 2, 128, 100, 512, 1250, 20000}};
    enum v2v_status rc = v2v_par_init(&report.world, &argc, &argv);
    if (rc == V2V_OK) {
        rc = run(&report, argc, argv);
    }
    if (rc != V2V_OK) {
        fprintf(stderr, "%s\n", v2v_status_message());
        v2v_par_abort(1);
    }
    v2v_par_finalize(&report.world);
    return 0;
}
