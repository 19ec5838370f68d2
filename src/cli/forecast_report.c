#include "cli/forecast_report.h"

#include "cli/bench_input.h"
#include "cli/steps.h"
#include "cli/threads.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/bench/forecast.h"
#include <inttypes.h>
#include <math.h>

/* The figures must not take long: a larger frame is measured by a part of it. */
enum { MOST_SIDE = 128 };

static const int rank_counts[] = {1, 2, 4, 8, 64, 512};
enum { COUNTS = sizeof rank_counts / sizeof rank_counts[0], MOST_HERE = 4 };

struct report {
    const struct v2v_forecast_options *options;
    const struct v2v_session *session;
    struct v2v_forecast_machine machine;
    struct v2v_forecast_network network;
    struct v2v_forecast_speed speed;
    int hosts; /* that there are */
};

static struct v2v_model_spec describe_model(const struct v2v_session *session,
                                            const struct v2v_psf_file *psf)
{
    const struct v2v_config *config = &session->config;
    return (struct v2v_model_spec){.views = psf->views,
                                   .slices = psf->slices,
                                   .width = config->model.width,
                                   .features = config->model.features,
                                   .branches = V2V_BRANCH_BOTH,
                                   .backend = config->model.backend,
                                   .winograd = config->model.winograd,
                                   .every_slice = !config->model.merge,
                                   .volume_scale = config->model.volume_scale};
}

/* ---- measuring ---- */

/* Every rank writes a frame and has it on the disk, as reconstruction does. */
static enum v2v_status write_frames(double *seconds, struct v2v_volume_writer *writer,
                                    const struct v2v_volume_info *info,
                                    const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const int rank = v2v_comm_rank(session->world);
    float *frame = NULL;
    rc = V2V_ALLOC(frame, "check.frame", v2v_mem_product(info->slices, info->height, info->width));
    V2V_TRY(v2v_par_agree(session->world, rc));
    *seconds = v2v_clock_now();
    rc = v2v_volume_put(writer, V2V_VOLUME_MEAN, frame, rank, 0, info->slices);
    if (rc == V2V_OK) {
        rc = v2v_volume_mark_done(writer, rank, NULL);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    *seconds = v2v_clock_now() - *seconds;
    v2v_par_max_f64(session->world, seconds, 1);
done:
    v2v_mem_free(frame);
    return rc;
}

static enum v2v_status measure_file(struct report *report)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_session *session = report->session;
    struct v2v_volume_writer *writer = NULL;
    struct v2v_volume_info info = {.frames = v2v_comm_size(session->world),
                                   .slices = report->network.spec.slices,
                                   .height = report->options->side,
                                   .width = report->options->side};
    char path[V2V_PATH_BYTES];
    double seconds = 0.0;
    if (report->options->scratch == NULL) {
        return V2V_OK;
    }
    V2V_TRY(v2v_text_format(path, sizeof path, "%s/v2v3d-check.h5", report->options->scratch));
    V2V_TRY(v2v_step_output(session, path, NULL, 0));
    const struct v2v_attribute task = {.name = V2V_VOLUME_TASK, .text = "check"};
    V2V_TRY(
        v2v_volume_create(&writer, path, &info, 1u << V2V_VOLUME_MEAN, &task, 1, session->world));
    V2V_TRY(write_frames(&seconds, writer, &info, session));
    report->machine.file_byte_s =
        seconds / (double)v2v_mem_product(info.frames * info.slices, info.height, info.width) /
        (double)sizeof(float);
done:
    v2v_volume_abandon(&writer);
    return rc;
}

static enum v2v_status measure(struct report *report)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_session *session = report->session;
    const struct v2v_bench_paths paths = {.psf = report->options->psf};
    const int64_t crop = session->config.train.crop;
    int64_t side = crop == 0 || crop > MOST_SIDE ? MOST_SIDE : crop;
    struct v2v_bench_input input = {0};
    struct v2v_shifts shifts = {0};
    struct v2v_comm *host = NULL;
    V2V_TRY(v2v_par_agree(session->world, v2v_bench_input_init(&input, &paths, side, session)));
    V2V_TRY(v2v_par_agree(session->world, v2v_shifts_from_psf(&shifts, &input.psf)));
    const struct v2v_model_spec spec = describe_model(session, &input.psf);
    rc = v2v_forecast_network_of(&report->network, &spec, &shifts);
    V2V_TRY(v2v_par_agree(session->world, rc));
    V2V_TRY(v2v_cli_neighbourhood(&host, session->world));
    report->machine =
        (struct v2v_forecast_machine){.cores = v2v_cli_cores(),
                                      .link_byte_s = 1e-9 / report->options->link_gb_s,
                                      .link_message_s = 1e-6 * report->options->link_delay_us};
    report->hosts = v2v_comm_size(session->world) / v2v_comm_size(host);
    V2V_TRY(v2v_forecast_measure(&report->machine, &report->speed, &report->network, &shifts, side,
                                 host, session->world));
    V2V_TRY(measure_file(report));
done:
    v2v_comm_destroy(&host);
    v2v_shifts_fini(&shifts);
    v2v_bench_input_fini(&input);
    return rc;
}

/* ---- printing ---- */

static void print_machine(const struct report *report)
{
    const struct v2v_forecast_machine *machine = &report->machine;
    const struct v2v_network_cost *inside = &machine->inside;
    const long long side = (long long)report->speed.side;
    printf("\nscaling, by figures of this run: forward pass of width %" PRId64
           " on %lld x %lld %.3g s on one rank, %.3g s with %d at once: %.3g multiply-adds/s a "
           "rank; a host with all %d cores busy takes %.3g times as long\n",
           report->network.spec.width, side, side, report->speed.alone_s, report->speed.together_s,
           v2v_comm_size(report->session->world), 1.0 / machine->mac_s, machine->cores,
           machine->crowd);
    if (inside->ranks > 1) {
        printf("inside a host: message %.3g us, exchange %.3g GB/s a rank, all-reduce %.3g us a "
               "step, %.3g GB/s\n",
               1e6 * inside->message_s, 1e-9 / inside->byte_s, 1e6 * inside->sum_step_s,
               1e-9 / inside->sum_byte_s);
    } else {
        printf("inside a host: not measured, for a rank alone; taken as free\n");
    }
    printf("between hosts: %.3g GB/s a host, message %.3g us; %s\n", 1e-9 / machine->link_byte_s,
           1e6 * machine->link_message_s,
           report->speed.is_link_measured ? "measured" : "given, not measured");
    if (machine->file_byte_s > 0.0) {
        printf("files: %.3g GB/s by all ranks together\n", 1e-9 / machine->file_byte_s);
    } else {
        printf("files: not measured (--scratch), taken as free\n");
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
    const struct v2v_forecast_machine *machine = &report->machine;
    double one_s = 0.0;
    for (int i = 0; i < COUNTS; i++) {
        struct v2v_forecast_job own = *job;
        struct v2v_forecast f;
        const int ranks = rank_counts[i];
        own.items *= is_weak ? ranks : 1;
        V2V_TRY(v2v_forecast(&f, machine, &own, ranks, hosts_for(report, ranks)));
        one_s = i == 0 ? f.seconds : one_s;
        const double speedup = (is_weak ? ranks : 1) * one_s / f.seconds, share = 100 / f.seconds;
        char grid[48];
        V2V_TRY(v2v_text_format(grid, sizeof grid, "%dx%dx%d", f.data, f.shape.branches,
                                f.shape.shards));
        printf("%-12s %-6s %6d %5d%s %10s %7" PRId64
               " %10.4g %8.3g %9.1f %% | %7.1f %7.1f %8.1f %6.1f %7.1f %5.1f\n",
               name, is_weak ? "weak" : "strong", ranks, f.hosts,
               ranks * machine->threads > f.hosts * machine->cores ? "*" : " ", grid, own.items,
               f.seconds, speedup, 100.0 * speedup / ranks, share * f.compute_s,
               share * f.crowded_s, share * f.repeated_s, share * f.uneven_s, share * f.network_s,
               share * f.file_s);
    }
done:
    return rc;
}

static enum v2v_status print_table(const struct report *report)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_train_settings *train = &report->session->config.train;
    const int64_t side = report->options->side, crop = train->crop > 0 ? train->crop : side;
    const struct v2v_forecast_job step = {&report->network, 1, train->batch, crop, crop};
    const struct v2v_forecast_job recording = {&report->network, 0, report->options->frames, side,
                                               side};
    print_machine(report);
    printf("predicted: a training step of crops of %" PRId64 " x %" PRId64
           ", and a recording of frames of %" PRId64 " x %" PRId64 "; %d thread%s a rank\n",
           crop, crop, side, side, report->machine.threads, report->machine.threads > 1 ? "s" : "");
    printf("%-12s %-6s %6s %5s  %10s %7s %10s %8s %11s | %% of the time: compute crowded repeated "
           "uneven network files\n",
           "what", "", "ranks", "hosts", "grid", "items", "seconds", "speed-up", "efficiency");
    for (int is_weak = 0; is_weak <= 1; is_weak++) {
        V2V_TRY(print_rows(report, "training", &step, is_weak));
        V2V_TRY(print_rows(report, "recording", &recording, is_weak));
    }
    printf("* more threads than cores\n");
done:
    return rc;
}

enum v2v_status v2v_forecast_report(const struct v2v_forecast_options *options,
                                    const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct report report = {.options = options, .session = session};
    V2V_TRY(measure(&report));
    if (v2v_step_on_root(session)) {
        rc = print_table(&report);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
done:
    return rc;
}
