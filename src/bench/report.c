#include "v2v3d/bench/bench.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/json.h"
#include "v2v3d/op/bf16.h"
#include <math.h>
#include <stdlib.h>

/* What no row tells about. */
static const char *left_out(const struct v2v_bench_result *result)
{
    return result->bf16 >= V2V_BF16_NATIVE
               ? "all rows ran"
               : "no row in bf16: this processor has no instructions for it";
}

/* A right-aligned column; NaN: there is no such figure. */
static void print_figure(FILE *stream, int width, int digits, double value)
{
    if (isnan(value)) {
        fprintf(stream, "%*s  ", width, "-");
    } else {
        fprintf(stream, "%*.*f  ", width, digits, value);
    }
}

static void print_row(FILE *stream, const struct v2v_bench_result *result,
                      const struct v2v_bench_row *row)
{
    fprintf(stream, "%-22s  %5lld  ", row->name, (long long)row->width);
    print_figure(stream, 9, 4, row->forward_s);
    print_figure(stream, 9, 4, row->forward_floor_s);
    print_figure(stream, 7, 2, result->row[0].forward_s / row->forward_s);
    print_figure(stream, 9, 4, row->step_s);
    print_figure(stream, 9, 4, row->step_floor_s);
    print_figure(stream, 8, 2, row->step_s / row->step_forward_s);
    fprintf(stream, "%8.1e  %8.1e  ", row->error[0], row->error[1]);
    if (isnan(row->psnr_change)) {
        fprintf(stream, "%8s", "-");
    } else {
        fprintf(stream, "%+8.4f", row->psnr_change);
    }
    fprintf(stream, "  %8.1f  %8.0f\n", 100.0 * row->computed_part, row->model_bytes / 1e6);
}

void v2v_bench_print(FILE *stream, const struct v2v_bench_result *result,
                     const struct v2v_bench_machine *machine)
{
    const struct v2v_bench_rates *rates = &result->rates;
    fprintf(stream, "%s, threads: %d; %s\n%s\nload average at the start: %.1f\n",
            machine->processor, machine->threads, machine->instructions, machine->libraries,
            machine->load);
    fprintf(stream,
            "forward pass over %lld x %lld, training step over %lld x %lld pixels of %lld views, "
            "%lld slices; medians of %lld\n",
            (long long)result->size, (long long)result->size, (long long)result->step_size,
            (long long)result->step_size, (long long)result->views, (long long)result->slices,
            (long long)result->repeat);
    fprintf(stream,
            "floors: multiply-adds over %.1f G/s (GEMM: oneDNN %.1f, OpenBLAS %.1f), bytes over "
            "%.1f GB/s (copy)\n",
            fmax(rates->gemm_onednn, rates->gemm_openblas) / 1e9, rates->gemm_onednn / 1e9,
            rates->gemm_openblas / 1e9, rates->copy / 1e9);
    fprintf(stream, "%s\n", left_out(result));
    if (!isnan(result->twin_psnr)) {
        fprintf(stream, "the twin's PSNR is %.3f dB\n", result->twin_psnr);
    }
    fprintf(stream, "\n%-22s  %5s  %9s  %9s  %7s  %9s  %9s  %8s  %8s  %8s  %8s  %8s  %8s\n",
            "variant", "width", "forward s", "floor s", "speed", "step s", "floor s", "step/fwd",
            "error 1", "error 2", "dPSNR dB", "tiles %", "model MB");
    for (int64_t i = 0; i < result->rows; i++) {
        print_row(stream, result, &result->row[i]);
    }
    fprintf(stream,
            "\nspeed: forward passes in the time of one of the first row; "
            "step/fwd: a step over its own forward pass\n"
            "error: |volume - twin| / |twin| of branch 1 and 2, the twin in double precision\n"
            "tiles: of the full-size layers that were computed; floors count all of them\n"
            "peak resident memory of the whole run, twin included: %.0f MB\n",
            result->peak_bytes / 1e6);
}

/* ---- JSON ---- */

enum { FIGURES = 13, HEAD = 16, NAME = 64 };

static void add_number(struct v2v_json_item *items, int64_t *count, const char *name, double number)
{
    items[(*count)++] = (struct v2v_json_item){.name = name, .number = number};
}

static void add_text(struct v2v_json_item *items, int64_t *count, const char *name,
                     const char *text)
{
    items[(*count)++] = (struct v2v_json_item){.name = name, .text = text};
}

static void add_head(struct v2v_json_item *items, int64_t *count,
                     const struct v2v_bench_result *result, const struct v2v_bench_machine *machine)
{
    add_text(items, count, "processor", machine->processor);
    add_text(items, count, "instructions", machine->instructions);
    add_text(items, count, "libraries", machine->libraries);
    add_text(items, count, "note", left_out(result));
    add_number(items, count, "threads", machine->threads);
    add_number(items, count, "load", machine->load);
    add_number(items, count, "views", (double)result->views);
    add_number(items, count, "slices", (double)result->slices);
    add_number(items, count, "size", (double)result->size);
    add_number(items, count, "step_size", (double)result->step_size);
    add_number(items, count, "repeat", (double)result->repeat);
    add_number(items, count, "gemm_onednn_macs_per_s", result->rates.gemm_onednn);
    add_number(items, count, "gemm_openblas_macs_per_s", result->rates.gemm_openblas);
    add_number(items, count, "copy_bytes_per_s", result->rates.copy);
    add_number(items, count, "twin_psnr", result->twin_psnr);
    add_number(items, count, "peak_resident_bytes", result->peak_bytes);
    V2V_ASSERT(*count <= HEAD);
}

static enum v2v_status add_row(struct v2v_json_item *items, int64_t *count, char (*names)[NAME],
                               const struct v2v_bench_row *row)
{
    enum v2v_status rc = V2V_OK;
    const struct {
        const char *name;
        double value;
    } figures[FIGURES] = {{"width", (double)row->width},
                          {"forward_s", row->forward_s},
                          {"forward_floor_s", row->forward_floor_s},
                          {"step_s", row->step_s},
                          {"step_forward_s", row->step_forward_s},
                          {"step_floor_s", row->step_floor_s},
                          {"macs", row->macs},
                          {"bytes", row->bytes},
                          {"error_1", row->error[0]},
                          {"error_2", row->error[1]},
                          {"psnr_change", row->psnr_change},
                          {"computed_part", row->computed_part},
                          {"model_bytes", row->model_bytes}};
    for (int f = 0; f < FIGURES; f++) {
        V2V_TRY(v2v_text_format(names[f], NAME, "%s.%s", row->id, figures[f].name));
        add_number(items, count, names[f], figures[f].value);
    }
done:
    return rc;
}

enum v2v_status v2v_bench_write_json(const char *path, const struct v2v_bench_result *result,
                                     const struct v2v_bench_machine *machine)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_json_item *items = NULL;
    char(*names)[NAME] = NULL, *text = NULL;
    size_t bytes = 0;
    int64_t count = 0;
    FILE *stream = NULL;
    V2V_TRY(V2V_ALLOC(items, "bench.json", HEAD + FIGURES * result->rows));
    V2V_TRY(V2V_ALLOC(names, "bench.json", FIGURES * result->rows));
    add_head(items, &count, result, machine);
    for (int64_t i = 0; i < result->rows; i++) {
        V2V_TRY(add_row(items, &count, names + i * FIGURES, &result->row[i]));
    }
    stream = open_memstream(&text, &bytes);
    if (stream == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_MEMORY, "%s: no memory for its text", path));
    }
    V2V_TRY(v2v_json_print(stream, items, count));
    V2V_TRY(v2v_file_write_text(path, text));
done:
    if (stream != NULL) {
        fclose(stream);
    }
    free(text);
    v2v_mem_free(names);
    v2v_mem_free(items);
    return rc;
}
