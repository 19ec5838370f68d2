#include "v2v3d/loss/loss.h"

#include "loss/terms.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/slicing.h"
#include "v2v3d/tensor/statistics.h"

#include <omp.h>
#include <string.h>

enum { BACKGROUND_BINS = 256 };

/* One row of the table: the function is one of the two. */
struct term {
    const char *name;
    double automatic[V2V_LOSS_PROFILES];
    v2v_view_term *of_view;
    v2v_volume_term *of_volume;
};

#define OF_VIEW(NAME, name, meaning, ...) {#name, {__VA_ARGS__}, v2v_term_##name, NULL},
#define OF_VOLUME(NAME, name, meaning, ...) {#name, {__VA_ARGS__}, NULL, v2v_term_##name},

static const struct term table[V2V_LOSS_TOTAL] = {V2V_LOSS_VIEW_TERMS(OF_VIEW)
                                                      V2V_LOSS_VOLUME_TERMS(OF_VOLUME)};

/* An output's views, projected. */
struct seen {
    int32_t *view; /* [count] */
    int64_t count;
    struct v2v_slicing *whole; /* from rows of all to whole ones of some */
};

struct v2v_loss {
    int profile;
    double weight[V2V_LOSS_TERMS];
    int64_t views, slices, height, width;
    struct v2v_window window;
    float scale;   /* of projections */
    double energy; /* a constant volume 1 projects to this */
    int outputs, threads;
    struct seen seen[V2V_LOSS_MOST_OUTPUTS];
    struct v2v_projector *projector; /* borrowed */
    const struct v2v_comm *comm;     /* borrowed */
    struct v2v_part *parts;          /* [ranks] */
    struct v2v_part rows;            /* of the volumes, of this rank */
    struct v2v_slicing *cut;         /* by these rows; NULL: the projector has the same */
    float *cut_slices, *cut_rows;    /* a volume on its way to the projector's share */
    struct v2v_fft2 *fft;            /* of the window */
    float *projection_rows;          /* [view,rows,x]: projections, then their gradients */
    float *projection;               /* [own view,y,x]; one rank: the same memory */
    float *scratch;                  /* [thread, 3, window]: difference, gradient, transform's */
    struct v2v_complex *spectrum;    /* [thread, window's half spectrum] */
    float *mean_view;                /* [y,x] */
    double *value;                   /* [output,term,items] shares of all views or rows */
    int64_t items;
};

const char *v2v_loss_name(int term)
{
    return term < V2V_LOSS_TOTAL ? table[term].name : "total";
}

void v2v_loss_weights(double *weights, const struct v2v_loss_settings *settings)
{
    for (int t = 0; t < V2V_LOSS_TOTAL; t++) {
        const struct v2v_number *given = &settings->weight[t];
        weights[t] = given->mode == V2V_NUMBER_AUTO    ? table[t].automatic[settings->profile]
                     : given->mode == V2V_NUMBER_GIVEN ? given->value
                                                       : 0.0;
    }
    weights[V2V_LOSS_TOTAL] = 1.0;
}

/* ---- creation ---- */

/* Room for n numbers such that the next ones start on a 64-byte boundary, as transforms ask. */
static int64_t aligned(int64_t n)
{
    return v2v_round_up(n, 16);
}

static enum v2v_status take_memory(struct v2v_loss *loss, const struct v2v_loss_setup *setup)
{
    enum v2v_status rc = V2V_OK;
    const int64_t ny = loss->window.y1 - loss->window.y0, nx = loss->window.x1 - loss->window.x0;
    const int64_t rows = v2v_projector_share(loss->projector).view_rows.count;
    int64_t most = 0;
    for (int o = 0; o < loss->outputs; o++) {
        const struct v2v_held_out *held_out = &setup->held_out[o];
        V2V_TRY(V2V_ALLOC(loss->seen[o].view, "loss", held_out->count));
        memcpy(loss->seen[o].view, held_out->view, (size_t)held_out->count * sizeof(int32_t));
        loss->seen[o].count = held_out->count;
        most = v2v_larger(most, held_out->count);
    }
    V2V_TRY(V2V_ALLOC(loss->projection_rows, "loss", most * rows * loss->width));
    loss->projection = loss->projection_rows;
    if (v2v_comm_size(loss->comm) > 1) {
        most = v2v_par_part(most, v2v_comm_size(loss->comm), 0).count;
        V2V_TRY(V2V_ALLOC(loss->projection, "loss", most * loss->height * loss->width));
    }
    loss->items = v2v_larger(loss->views, loss->height);
    V2V_TRY(V2V_ALLOC(loss->value, "loss", loss->outputs * V2V_LOSS_TOTAL * loss->items));
    V2V_TRY(V2V_ALLOC(loss->parts, "loss", v2v_comm_size(loss->comm)));
    V2V_TRY(V2V_ALLOC(loss->scratch, "loss", loss->threads * 3 * aligned(ny * nx)));
    V2V_TRY(V2V_ALLOC(loss->spectrum, "loss", loss->threads * aligned(ny * (nx / 2 + 1))));
    V2V_TRY(V2V_ALLOC(loss->mean_view, "loss", loss->height * loss->width));
    V2V_TRY(v2v_fft2_create(&loss->fft, ny, nx));
done:
    return rc;
}

/* loss->parts = every rank's. Collective(comm). */
static void gather_parts(struct v2v_loss *loss, struct v2v_part mine)
{
    const int ranks = v2v_comm_size(loss->comm);
    memset(loss->parts, 0, (size_t)ranks * sizeof *loss->parts);
    loss->parts[v2v_comm_rank(loss->comm)] = mine;
    v2v_par_sum_i64(loss->comm, &loss->parts->first, 2 * (int64_t)ranks);
}

static enum v2v_status create_slicings(struct v2v_loss *loss)
{
    enum v2v_status rc = V2V_OK;
    for (int o = 0; o < loss->outputs; o++) {
        V2V_TRY(v2v_slicing_create(&loss->seen[o].whole, loss->comm, loss->seen[o].count,
                                   loss->height, loss->width, loss->parts));
    }
done:
    return rc;
}

enum v2v_status v2v_loss_create(struct v2v_loss **loss, const struct v2v_loss_setup *setup)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_loss *self = NULL;
    const struct v2v_psf_file *psf = setup->psf;
    const struct v2v_window *w = &setup->window;
    double factor = setup->reduce == V2V_REDUCE_MEAN ? 1.0 / (double)psf->slices : 1.0;
    V2V_ASSERT(0 <= w->y0 && w->y0 < w->y1 && w->y1 <= setup->height);
    V2V_ASSERT(0 <= w->x0 && w->x0 < w->x1 && w->x1 <= setup->width);
    V2V_ASSERT(1 <= setup->outputs && setup->outputs <= V2V_LOSS_MOST_OUTPUTS);
    rc = V2V_ALLOC(self, "loss", 1);
    if (rc == V2V_OK) {
        *self = (struct v2v_loss){.profile = setup->settings->profile,
                                  .views = psf->views,
                                  .slices = psf->slices,
                                  .height = setup->height,
                                  .width = setup->width,
                                  .window = setup->window,
                                  .scale = (float)factor,
                                  .energy = v2v_psf_energy_mean(psf) * (double)psf->slices * factor,
                                  .outputs = setup->outputs,
                                  .threads = omp_get_max_threads(),
                                  .projector = setup->projector,
                                  .comm = setup->comm,
                                  .rows = v2v_projector_share(setup->projector).rows};
        v2v_loss_weights(self->weight, setup->settings);
        rc = take_memory(self, setup);
    }
    V2V_TRY(v2v_par_agree(setup->comm, rc));
    gather_parts(self, v2v_projector_share(self->projector).view_rows);
    V2V_TRY(v2v_par_agree(setup->comm, create_slicings(self)));
done:
    if (rc != V2V_OK) {
        v2v_loss_destroy(&self);
    }
    *loss = self;
    return rc;
}

static enum v2v_status create_cut(struct v2v_loss *loss)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_projector_share share = v2v_projector_share(loss->projector);
    V2V_TRY(v2v_slicing_create(&loss->cut, loss->comm, loss->slices, loss->height, loss->width,
                               loss->parts));
    V2V_TRY(V2V_ALLOC(loss->cut_slices, "loss",
                      v2v_slicing_own(loss->cut).count * loss->height * loss->width));
    V2V_TRY(V2V_ALLOC(loss->cut_rows, "loss", share.slices.count * share.rows.count * loss->width));
done:
    return rc;
}

enum v2v_status v2v_loss_hold(struct v2v_loss *loss, struct v2v_part rows)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_projector_share share = v2v_projector_share(loss->projector);
    int64_t differs = rows.first != share.rows.first || rows.count != share.rows.count ||
                      share.slices.count != loss->slices;
    v2v_par_max_i64(loss->comm, &differs, 1);
    gather_parts(loss, rows);
    loss->rows = rows;
    V2V_ASSERT(loss->cut == NULL);
    V2V_TRY(v2v_par_agree(loss->comm, differs ? create_cut(loss) : V2V_OK));
done:
    return rc;
}

void v2v_loss_destroy(struct v2v_loss **loss)
{
    struct v2v_loss *self = *loss;
    if (self == NULL) {
        return;
    }
    for (int o = 0; o < self->outputs; o++) {
        v2v_slicing_destroy(&self->seen[o].whole);
        v2v_mem_free(self->seen[o].view);
    }
    if (self->projection != self->projection_rows) {
        v2v_mem_free(self->projection);
    }
    void *memory[] = {self->projection_rows, self->value,     self->parts,    self->scratch,
                      self->spectrum,        self->mean_view, self->cut_rows, self->cut_slices};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
    v2v_slicing_destroy(&self->cut);
    v2v_fft2_destroy(&self->fft);
    v2v_mem_free(self);
    *loss = NULL;
}

/* ---- terms of views ---- */

/* Where every view's or row's share of output o's term goes. */
static double *values_of(const struct v2v_loss *loss, int o, int term)
{
    return loss->value + (o * V2V_LOSS_TOTAL + term) * loss->items;
}

/* The i-th of output o's views, whose projection [y,x] becomes its gradient: of the window, where
 * it is compared. Local, thread-safe. */
static void judge_view(struct v2v_loss *loss, int o, int64_t i, float *projection,
                       const float *recorded)
{
    const struct v2v_window *w = &loss->window;
    const int64_t ny = w->y1 - w->y0, nx = w->x1 - w->x0, at = w->y0 * loss->width + w->x0;
    const int64_t thread = omp_get_thread_num();
    float *difference = loss->scratch + thread * 3 * aligned(ny * nx);
    float *gradient = difference + aligned(ny * nx);
    struct v2v_term_view view = {
        .profile = loss->profile,
        .ny = ny,
        .nx = nx,
        .compared = (double)(loss->seen[o].count * ny * nx),
        .fft = loss->fft,
        .spectrum = loss->spectrum + thread * aligned(ny * (nx / 2 + 1)),
        .scratch = gradient + aligned(ny * nx),
    };
    for (int64_t y = 0; y < ny; y++) {
        for (int64_t x = 0; x < nx; x++) {
            const int64_t pixel = at + y * loss->width + x;
            difference[y * nx + x] = projection[pixel] - recorded[pixel];
        }
    }
    memset(gradient, 0, (size_t)(ny * nx) * sizeof *gradient);
    for (int t = 0; t < V2V_LOSS_TOTAL; t++) {
        if (table[t].of_view != NULL) {
            values_of(loss, o, t)[i] =
                table[t].of_view(&view, gradient, difference, loss->weight[t]);
        }
    }
    memset(projection, 0, (size_t)(loss->height * loss->width) * sizeof *projection);
    for (int64_t y = 0; y < ny; y++) {
        memcpy(projection + at + y * loss->width, gradient + y * nx, (size_t)nx * sizeof *gradient);
    }
}

/* A volume's rows here as the projector's share of it, and back. Collective(comm). */
static const float *to_share(struct v2v_loss *loss, const float *volume)
{
    if (loss->cut == NULL) {
        return volume;
    }
    v2v_slicing_to_slices(loss->cut, loss->cut_slices, volume);
    v2v_projector_from_slices(loss->projector, loss->cut_rows, loss->cut_slices);
    return loss->cut_rows;
}

static void from_share(struct v2v_loss *loss, float *volume)
{
    if (loss->cut != NULL) {
        v2v_projector_to_slices(loss->projector, loss->cut_slices, loss->cut_rows);
        v2v_slicing_to_rows(loss->cut, volume, loss->cut_slices);
    }
}

/* Output o's projection onto its views: each rank compares some of them. Collective(comm). */
static void view_terms(struct v2v_loss *loss, int o, float *dvolume, const float *volume,
                       const float *views)
{
    const struct seen *seen = &loss->seen[o];
    const struct v2v_part own = v2v_slicing_own(seen->whole);
    const int64_t pixels = loss->height * loss->width;
    const int is_cut = loss->projection != loss->projection_rows;
    v2v_projector_forward(loss->projector, loss->projection_rows, to_share(loss, volume),
                          seen->view, seen->count, loss->scale);
    if (is_cut) {
        v2v_slicing_to_slices(seen->whole, loss->projection, loss->projection_rows);
    }
#pragma omp parallel for schedule(static) num_threads(loss->threads)
    for (int64_t i = 0; i < own.count; i++) {
        judge_view(loss, o, own.first + i, loss->projection + i * pixels,
                   views + seen->view[own.first + i] * pixels);
    }
    if (is_cut) {
        v2v_slicing_to_rows(seen->whole, loss->projection_rows, loss->projection);
    }
    v2v_projector_adjoint(loss->projector, loss->cut == NULL ? dvolume : loss->cut_rows,
                          loss->projection_rows, seen->view, seen->count, loss->scale);
    from_share(loss, dvolume);
}

/* ---- terms of volumes ---- */

/* Histogram mode of the mean view, in units of the volume. */
static double background(struct v2v_loss *loss, const float *views)
{
    int64_t pixels = loss->height * loss->width;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < pixels; i++) {
        double sum = 0.0;
        for (int64_t v = 0; v < loss->views; v++) {
            sum += views[v * pixels + i];
        }
        loss->mean_view[i] = (float)(sum / (double)loss->views);
    }
    return v2v_background(loss->mean_view, pixels, BACKGROUND_BINS, 0) / loss->energy;
}

/* A term of output o's volume or the mean one in some of the rows here. Local, thread-safe. */
static void judge_rows(struct v2v_loss *loss, int o, int t, struct v2v_term_volume volume,
                       struct v2v_part rows, float *dvolume, const float *own, const float *other)
{
    double *value = values_of(loss, o, t) + loss->rows.first;
    for (volume.z = 0; volume.z < loss->slices; volume.z++) {
        for (int64_t y = rows.first; y < rows.first + rows.count; y++) {
            const int64_t at = volume.z * volume.stride + y * volume.width;
            value[y] +=
                table[t].of_volume(&volume, dvolume + at, own + at, other + at, loss->weight[t]);
        }
    }
}

static void volume_terms(struct v2v_loss *loss, int o, float *dvolume, const float *own,
                         const float *other, double floor)
{
    const struct v2v_term_volume volume = {.profile = loss->profile,
                                           .slices = loss->slices,
                                           .width = loss->width,
                                           .stride = loss->rows.count * loss->width,
                                           .slice = (double)(loss->height * loss->width),
                                           .share = 1.0 / loss->outputs,
                                           .background = floor};
#pragma omp parallel for schedule(static) num_threads(loss->threads)
    for (int64_t part = 0; part < loss->threads; part++) {
        const struct v2v_part rows = v2v_par_part(loss->rows.count, loss->threads, part);
        for (int t = 0; t < V2V_LOSS_TOTAL; t++) {
            if (table[t].of_volume != NULL) {
                judge_rows(loss, o, t, volume, rows, dvolume, own, other);
            }
        }
    }
}

/* ---- all terms ---- */

/* Shares are added in the order of outputs, views and rows, whichever rank they are from: one has
 * each. Collective(comm). */
static void add_up(struct v2v_loss *loss, double *terms)
{
    memset(terms, 0, V2V_LOSS_TERMS * sizeof *terms);
    v2v_par_sum_f64(loss->comm, loss->value, loss->outputs * V2V_LOSS_TOTAL * loss->items);
    for (int t = 0; t < V2V_LOSS_TOTAL; t++) {
        for (int o = 0; o < loss->outputs; o++) {
            double sum = 0.0;
            for (int64_t i = 0; i < loss->items; i++) {
                sum += values_of(loss, o, t)[i];
            }
            terms[t] += sum;
        }
        terms[V2V_LOSS_TOTAL] += loss->weight[t] * terms[t];
    }
}

void v2v_loss_evaluate(struct v2v_loss *loss, double *terms, unsigned outputs,
                       float *const *dvolume, const float *const *volume, const float *views)
{
    const double floor = background(loss, views);
    memset(loss->value, 0,
           (size_t)(loss->outputs * V2V_LOSS_TOTAL * loss->items) * sizeof *loss->value);
    for (int o = 0; o < loss->outputs; o++) {
        if (outputs >> o & 1) {
            view_terms(loss, o, dvolume[o], volume[o], views);
            volume_terms(loss, o, dvolume[o], volume[o], volume[loss->outputs - 1 - o], floor);
        }
    }
    add_up(loss, terms);
}
