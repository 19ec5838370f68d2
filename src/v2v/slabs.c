#include "v2v/slabs.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/transfer.h"

#include <string.h>

struct v2v_slabs {
    struct v2v_slabs_spec spec;
    struct v2v_slab *slab; /* [count] */
    int ranks, rank;
    struct v2v_transfers *transfers;
    float *sent, *received; /* of features, one piece after the other by rank */
    float *gathered;
    int64_t *counts, *offsets; /* [ranks] of gathered floats */
};

struct v2v_slab v2v_slab_cut(int64_t height, int64_t unit, int64_t count, int64_t index)
{
    struct v2v_part part = v2v_par_part((height + unit - 1) / unit, count, index);
    struct v2v_slab slab = {.first = v2v_smaller(part.first * unit, height)};
    slab.rows = v2v_smaller((part.first + part.count) * unit, height) - slab.first;
    if (slab.rows > 0) {
        slab.above = v2v_smaller(slab.first, V2V_SLAB_MARGIN);
        slab.below = v2v_smaller(height - slab.first - slab.rows, V2V_SLAB_MARGIN);
    }
    return slab;
}

/* How many slabs are this rank's. */
static int64_t count_held(const struct v2v_slabs *self)
{
    return self->ranks == 1 ? self->spec.count : 1;
}

int64_t v2v_slabs_index(const struct v2v_slabs *self, int64_t local)
{
    return self->ranks == 1 ? local : self->rank;
}

const struct v2v_slab *v2v_slabs_at(const struct v2v_slabs *self, int64_t local)
{
    return &self->slab[v2v_slabs_index(self, local)];
}

/* ---- features ---- */

/* Rows of the frame that a slab reads: those of its ring too. */
static struct v2v_part rows_read(const struct v2v_slabs *self, const struct v2v_slab *slab)
{
    if (slab->rows == 0) {
        return (struct v2v_part){0, 0};
    }
    int64_t start = v2v_slab_start(slab), end = start + v2v_slab_computed(slab);
    int64_t first = v2v_within(start - self->spec.ring, 0, self->spec.height);
    int64_t last = v2v_within(end + self->spec.ring, 0, self->spec.height);
    return (struct v2v_part){first, last - first};
}

static int64_t floats_read(const struct v2v_slabs *self, int64_t index)
{
    return self->spec.features * rows_read(self, &self->slab[index]).count * self->spec.width;
}

/* Rows of a whole view's features [feature,y,x] -> [feature,rows,x], or those added back. */
static void pack_rows(const struct v2v_slabs *self, float *to, const float *whole,
                      struct v2v_part rows)
{
    int64_t width = self->spec.width, size = rows.count * width;
    for (int64_t c = 0; c < self->spec.features; c++) {
        memcpy(to + c * size, whole + (c * self->spec.height + rows.first) * width,
               (size_t)size * sizeof *to);
    }
}

static void add_rows(const struct v2v_slabs *self, float *whole, const float *from,
                     struct v2v_part rows)
{
    int64_t width = self->spec.width, size = rows.count * width;
    for (int64_t c = 0; c < self->spec.features; c++) {
        float *to = whole + (c * self->spec.height + rows.first) * width;
        for (int64_t i = 0; i < size; i++) {
            to[i] += from[c * size + i];
        }
    }
}

static int has_view(const struct v2v_slabs *self, const int32_t *view, int rank)
{
    return rank != self->rank && view[rank] >= 0;
}

void v2v_slabs_begin_features(struct v2v_slabs *self, struct v2v_padded *features,
                              const int32_t *view, const float *mine)
{
    int own_view = view[self->rank];
    float *sent = self->sent, *received = self->received;
    for (int64_t local = 0; local < count_held(self) && own_view >= 0; local++) {
        const struct v2v_slab *slab = v2v_slabs_at(self, local);
        struct v2v_part rows = rows_read(self, slab);
        if (rows.count > 0) {
            v2v_padded_put_rows(&features[local], own_view, mine + rows.first * self->spec.width,
                                self->spec.height, rows.first - v2v_slab_start(slab), rows.count);
        }
    }
    for (int r = 0; r < self->ranks; r++) {
        if (has_view(self, view, r)) {
            v2v_transfers_receive(self->transfers, received, floats_read(self, self->rank), r);
            received += floats_read(self, self->rank);
        }
    }
    for (int r = 0; r < self->ranks; r++) {
        if (r != self->rank && own_view >= 0) {
            pack_rows(self, sent, mine, rows_read(self, &self->slab[r]));
            v2v_transfers_send(self->transfers, sent, floats_read(self, r), r);
            sent += floats_read(self, r);
        }
    }
}

void v2v_slabs_end_features(struct v2v_slabs *self, struct v2v_padded *features,
                            const int32_t *view)
{
    const struct v2v_slab *slab = &self->slab[self->rank];
    struct v2v_part rows = rows_read(self, slab);
    const float *received = self->received;
    v2v_transfers_wait(self->transfers);
    for (int r = 0; r < self->ranks; r++) {
        if (has_view(self, view, r) && rows.count > 0) {
            v2v_padded_put_rows(features, view[r], received, rows.count,
                                rows.first - v2v_slab_start(slab), rows.count);
            received += floats_read(self, self->rank);
        }
    }
}

/* What this rank's slab makes of another rank's view goes there. */
static void send_gradients(struct v2v_slabs *self, const struct v2v_padded *dfeatures,
                           const int32_t *view)
{
    const struct v2v_slab *slab = &self->slab[self->rank];
    struct v2v_part rows = rows_read(self, slab);
    float *sent = self->received; /* these are the sizes that the features came in */
    for (int r = 0; r < self->ranks; r++) {
        if (has_view(self, view, r) && rows.count > 0) {
            v2v_padded_get_rows(dfeatures, view[r], sent, rows.first - v2v_slab_start(slab),
                                rows.count);
            v2v_transfers_send(self->transfers, sent, floats_read(self, self->rank), r);
            sent += floats_read(self, self->rank);
        }
    }
}

void v2v_slabs_return_features(struct v2v_slabs *self, float *mine,
                               const struct v2v_padded *dfeatures, const int32_t *view)
{
    int own_view = view[self->rank];
    float *received = self->sent;
    for (int r = 0; r < self->ranks && own_view >= 0; r++) {
        if (r != self->rank) {
            v2v_transfers_receive(self->transfers, received, floats_read(self, r), r);
            received += floats_read(self, r);
        }
    }
    send_gradients(self, dfeatures, view);
    v2v_transfers_wait(self->transfers);
    if (own_view < 0) {
        return;
    }
    received = self->sent;
    memset(mine, 0,
           (size_t)(self->spec.features * self->spec.height * self->spec.width) * sizeof *mine);
    for (int64_t index = 0; index < self->spec.count; index++) {
        const struct v2v_slab *slab = &self->slab[index];
        struct v2v_part rows = rows_read(self, slab);
        int is_here = self->ranks == 1 || index == self->rank;
        if (is_here && rows.count > 0) {
            v2v_padded_get_rows(&dfeatures[self->ranks == 1 ? index : 0], own_view, self->gathered,
                                rows.first - v2v_slab_start(slab), rows.count);
        }
        add_rows(self, mine, is_here ? self->gathered : received, rows);
        received += is_here ? 0 : floats_read(self, index);
    }
}

/* ---- whole images ---- */

/* Rows of a slab's part, and where they lie in the frame, at the images' size. */
static struct v2v_part rows_of_part(const struct v2v_slab *slab,
                                    const struct v2v_slabs_images *images)
{
    if (images->is_own) {
        return (struct v2v_part){slab->first >> images->half, slab->rows >> images->half};
    }
    return (struct v2v_part){v2v_slab_start(slab) >> images->half,
                             v2v_slab_computed(slab) >> images->half};
}

static int64_t part_floats(const struct v2v_slabs_spec *spec, const struct v2v_slab *slab,
                           const struct v2v_slabs_images *images)
{
    return images->channels * rows_of_part(slab, images).count * (spec->width >> images->half);
}

int64_t v2v_slabs_gathered_floats(const struct v2v_slabs_spec *spec,
                                  const struct v2v_slabs_images *images)
{
    int64_t floats = 0;
    for (int64_t i = 0; i < spec->count; i++) {
        struct v2v_slab slab = v2v_slab_cut(spec->height, spec->unit, spec->count, i);
        floats += part_floats(spec, &slab, images);
    }
    return floats;
}

/* Every slab's part, one after the other. */
static void gather_parts(struct v2v_slabs *self, const float *const *part,
                         const struct v2v_slabs_images *images)
{
    int64_t end = 0;
    for (int64_t i = 0; i < self->spec.count; i++) {
        int64_t floats = part_floats(&self->spec, &self->slab[i], images);
        V2V_ASSERT(end + floats <= self->spec.gathered_floats);
        if (self->ranks == 1 && floats > 0) {
            memcpy(self->gathered + end, part[i], (size_t)floats * sizeof **part);
        }
        if (self->ranks > 1) {
            self->counts[i] = floats;
            self->offsets[i] = end;
        }
        end += floats;
    }
    if (self->ranks > 1) {
        v2v_par_allgather_f32(self->spec.comm, self->gathered, part[0], self->counts,
                              self->offsets);
    }
}

/* whole's rows of every part: the own ones are copied, or all are added. */
static void spread_parts(const struct v2v_slabs *self, float *whole, const float *part,
                         const struct v2v_slab *slab, const struct v2v_slabs_images *images,
                         int is_sum)
{
    struct v2v_part rows = rows_of_part(slab, images);
    struct v2v_slabs_images own = *images;
    own.is_own = !is_sum || images->is_own;
    struct v2v_part taken = rows_of_part(slab, &own);
    int64_t width = self->spec.width >> images->half, height = self->spec.height >> images->half;
    int64_t count = taken.count * width;
#pragma omp parallel for schedule(static)
    for (int64_t c = 0; c < images->channels; c++) {
        const float *from = part + (c * rows.count + taken.first - rows.first) * width;
        float *to = whole + (c * height + taken.first) * width;
        if (!is_sum) {
            memcpy(to, from, (size_t)count * sizeof *to);
            continue;
        }
        for (int64_t i = 0; i < count; i++) {
            to[i] += from[i];
        }
    }
}

/* What is gathered lies apart: `whole` may be a part's memory. */
static void collect(const struct v2v_slabs *self, float *whole,
                    const struct v2v_slabs_images *images, int is_sum)
{
    const float *next = self->gathered;
    for (int64_t i = 0; i < self->spec.count && whole != NULL; i++) {
        spread_parts(self, whole, next, &self->slab[i], images, is_sum);
        next += part_floats(&self->spec, &self->slab[i], images);
    }
}

void v2v_slabs_gather(struct v2v_slabs *self, float *whole, const float *const *part,
                      const struct v2v_slabs_images *images)
{
    gather_parts(self, part, images);
    collect(self, whole, images, 0);
}

void v2v_slabs_sum(struct v2v_slabs *self, float *whole, const float *const *part,
                   const struct v2v_slabs_images *images)
{
    int64_t pixels = (self->spec.height >> images->half) * (self->spec.width >> images->half);
    gather_parts(self, part, images);
    if (whole != NULL) {
        memset(whole, 0, (size_t)(images->channels * pixels) * sizeof *whole);
    }
    collect(self, whole, images, 1);
}

void v2v_slabs_cut_out(const struct v2v_slabs *self, float *part, const float *whole, int64_t local,
                       const struct v2v_slabs_images *images)
{
    const struct v2v_slab *slab = v2v_slabs_at(self, local);
    const struct v2v_slabs_images computed = {.half = images->half};
    struct v2v_part rows = rows_of_part(slab, &computed), taken = rows_of_part(slab, images);
    int64_t width = self->spec.width >> images->half, height = self->spec.height >> images->half;
    int64_t before = taken.first - rows.first, after = rows.count - taken.count - before;
#pragma omp parallel for schedule(static)
    for (int64_t c = 0; c < images->channels; c++) {
        float *to = part + c * rows.count * width;
        memset(to, 0, (size_t)(before * width) * sizeof *to);
        memcpy(to + before * width, whole + (c * height + taken.first) * width,
               (size_t)(taken.count * width) * sizeof *to);
        memset(to + (before + taken.count) * width, 0, (size_t)(after * width) * sizeof *to);
    }
}

/* ---- creation ---- */

static void list_slabs(struct v2v_slabs *self)
{
    for (int64_t i = 0; i < self->spec.count; i++) {
        self->slab[i] = v2v_slab_cut(self->spec.height, self->spec.unit, self->spec.count, i);
    }
}

enum v2v_status v2v_slabs_create(struct v2v_slabs **slabs, const struct v2v_slabs_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_slabs *self = NULL;
    int64_t sent = 0;
    V2V_TRY(V2V_ALLOC(self, "slabs", 1));
    self->spec = *spec;
    self->ranks = v2v_comm_size(spec->comm);
    self->rank = v2v_comm_rank(spec->comm);
    V2V_ASSERT(self->ranks == 1 || self->ranks == spec->count);
    V2V_TRY(V2V_ALLOC(self->slab, "slabs", spec->count));
    V2V_TRY(V2V_ALLOC(self->counts, "slabs", self->ranks));
    V2V_TRY(V2V_ALLOC(self->offsets, "slabs", self->ranks));
    list_slabs(self);
    for (int64_t i = 0; i < spec->count && self->ranks > 1; i++) {
        sent += i != self->rank ? floats_read(self, i) : 0;
    }
    V2V_TRY(v2v_transfers_create(&self->transfers, spec->comm, 2 * self->ranks));
    V2V_TRY(V2V_ALLOC(self->sent, "slabs.features", sent));
    V2V_TRY(V2V_ALLOC(self->received, "slabs.features",
                      (self->ranks - 1) * floats_read(self, self->rank)));
    V2V_TRY(V2V_ALLOC(self->gathered, "slabs.images", spec->gathered_floats));
done:
    if (rc != V2V_OK) {
        v2v_slabs_destroy(&self);
    }
    *slabs = self;
    return rc;
}

void v2v_slabs_destroy(struct v2v_slabs **slabs)
{
    struct v2v_slabs *self = *slabs;
    if (self == NULL) {
        return;
    }
    v2v_transfers_destroy(&self->transfers);
    v2v_mem_free(self->sent);
    v2v_mem_free(self->received);
    v2v_mem_free(self->gathered);
    v2v_mem_free(self->counts);
    v2v_mem_free(self->offsets);
    v2v_mem_free(self->slab);
    v2v_mem_free(self);
    *slabs = NULL;
}
