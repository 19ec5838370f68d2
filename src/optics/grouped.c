#include "v2v3d/optics/grouped.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"

#include <math.h>

/* Of what a memory limit leaves a rank. */
static const double most_of_room = 0.5;

/* What is there for some of the views. */
struct group {
    struct v2v_projector *projector;
    float *volume, *rows; /* what the projector holds of both; NULL: its slices are whole */
};

struct v2v_grouped {
    const struct v2v_psf_file *psf;
    int64_t height, width;
    enum v2v_split split;
    const struct v2v_comm *comm;
    struct v2v_part slices;
    int64_t together;
    struct group all; /* where all views are one group */
};

/* As many views as may be, evenly; a rank may have less room than another. Collective(comm). */
static int64_t views_together(const struct v2v_grouped *grouped, int64_t most_bytes)
{
    const struct v2v_psf_file *psf = grouped->psf;
    struct v2v_psf_file some = *psf;
    const int ranks = v2v_comm_size(grouped->comm);
    const double room = most_of_room * (double)v2v_mem_room();
    const double images =
        (double)sizeof(float) * (double)grouped->height * (double)grouped->width / (double)ranks;
    for (; some.views > 1; some.views--) {
        const double all =
            (double)v2v_projector_bytes(&some, grouped->height, grouped->width, grouped->split, 1);
        const double here = images * (double)(some.views + psf->slices) +
                            (double)v2v_projector_bytes(&some, grouped->height, grouped->width,
                                                        grouped->split, ranks);
        if (all <= (double)most_bytes && here <= room) {
            break;
        }
    }
    int64_t groups = v2v_parts(psf->views, some.views);
    v2v_par_max_i64(grouped->comm, &groups, 1);
    return v2v_parts(psf->views, groups);
}

static void end(struct group *group)
{
    v2v_projector_destroy(&group->projector);
    v2v_mem_free(group->volume);
    v2v_mem_free(group->rows);
    *group = (struct group){0};
}

/* Collective(comm), agreed. */
static enum v2v_status begin(struct group *group, const struct v2v_grouped *grouped,
                             struct v2v_part views)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file some = *grouped->psf;
    v2v_watchdog_beat("spectra of the PSFs");
    some.views = views.count;
    some.data += v2v_mem_product(views.first * some.slices, some.height, some.width);
    V2V_TRY(v2v_projector_create(&group->projector, &some, grouped->height, grouped->width,
                                 grouped->split, grouped->comm));
    const struct v2v_projector_share share = v2v_projector_share(group->projector);
    const int is_whole = share.rows.count == grouped->height &&
                         share.slices.first == grouped->slices.first &&
                         share.slices.count == grouped->slices.count;
    if (!is_whole) {
        rc = V2V_ALLOC(group->volume, "optics.volume",
                       v2v_mem_product(share.slices.count, share.rows.count, grouped->width));
    }
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(group->rows, "optics.views",
                       v2v_mem_product(views.count, share.view_rows.count, grouped->width));
    }
    V2V_TRY(v2v_par_agree(grouped->comm, rc));
done:
    if (rc != V2V_OK) {
        end(group);
    }
    return rc;
}

enum v2v_status v2v_grouped_create(struct v2v_grouped **grouped, const struct v2v_psf_file *psf,
                                   int64_t height, int64_t width, enum v2v_split split,
                                   int64_t most_bytes, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_grouped *made = NULL;
    *grouped = NULL;
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(made, "optics.grouped", 1)));
    *made = (struct v2v_grouped){
        .psf = psf,
        .height = height,
        .width = width,
        .split = split,
        .comm = comm,
        .slices = v2v_par_part(psf->slices, v2v_comm_size(comm), v2v_comm_rank(comm))};
    made->together = views_together(made, most_bytes);
    if (made->together == psf->views) {
        V2V_TRY(begin(&made->all, made, (struct v2v_part){0, psf->views}));
    }
    *grouped = made;
    made = NULL;
done:
    v2v_grouped_destroy(&made);
    return rc;
}

void v2v_grouped_destroy(struct v2v_grouped **grouped)
{
    struct v2v_grouped *old = *grouped;
    *grouped = NULL;
    if (old != NULL) {
        end(&old->all);
        v2v_mem_free(old);
    }
}

struct v2v_part v2v_grouped_slices(const struct v2v_grouped *grouped)
{
    return grouped->slices;
}

int64_t v2v_grouped_together(const struct v2v_grouped *grouped)
{
    return grouped->together;
}

/* Collective(comm). @param views [v,y,x] of the group */
static void forward(struct group *group, float *views, const float *slices, int64_t count,
                    float scale)
{
    const float *volume = slices;
    if (group->volume != NULL) {
        v2v_projector_from_slices(group->projector, group->volume, slices);
        volume = group->volume;
    }
    v2v_projector_forward(group->projector, group->rows, volume, NULL, count, scale);
    v2v_projector_gather_views(group->projector, views, group->rows, count);
}

static void adjoint(struct group *group, float *slices, const float *views, int64_t count,
                    float scale)
{
    v2v_projector_cut_views(group->projector, group->rows, views, count);
    float *volume = group->volume != NULL ? group->volume : slices;
    v2v_projector_adjoint(group->projector, volume, group->rows, NULL, count, scale);
    if (group->volume != NULL) {
        v2v_projector_to_slices(group->projector, slices, group->volume);
    }
}

/* The group that begins with view v. */
static struct v2v_part views_of(const struct v2v_grouped *grouped, int64_t v)
{
    return (struct v2v_part){v, v2v_smaller(grouped->together, grouped->psf->views - v)};
}

enum v2v_status v2v_grouped_forward(struct v2v_grouped *grouped, float *views, const float *slices,
                                    float scale)
{
    enum v2v_status rc = V2V_OK;
    const int64_t all = grouped->psf->views, pixels = grouped->height * grouped->width;
    struct group group = {0};
    if (grouped->together == all) {
        forward(&grouped->all, views, slices, all, scale);
        return V2V_OK;
    }
    for (int64_t v = 0; v < all; v += grouped->together) {
        const struct v2v_part part = views_of(grouped, v);
        V2V_TRY(begin(&group, grouped, part));
        forward(&group, views + v * pixels, slices, part.count, scale);
        end(&group);
    }
done:
    return rc;
}

enum v2v_status v2v_grouped_adjoint(struct v2v_grouped *grouped, float *slices, const float *views,
                                    float scale)
{
    enum v2v_status rc = V2V_OK;
    const int64_t all = grouped->psf->views, pixels = grouped->height * grouped->width;
    const int64_t voxels = v2v_mem_product(grouped->slices.count, pixels, 1);
    struct group group = {0};
    float *part_of = NULL;
    if (grouped->together == all) {
        adjoint(&grouped->all, slices, views, all, scale);
        return V2V_OK;
    }
    V2V_TRY(v2v_par_agree(grouped->comm, V2V_ALLOC(part_of, "optics.volume", voxels)));
    for (int64_t v = 0; v < all; v += grouped->together) {
        const struct v2v_part part = views_of(grouped, v);
        float *to = v == 0 ? slices : part_of;
        V2V_TRY(begin(&group, grouped, part));
        adjoint(&group, to, views + v * pixels, part.count, scale);
        end(&group);
        for (int64_t i = 0; v > 0 && i < voxels; i++) {
            slices[i] += part_of[i];
        }
    }
done:
    v2v_mem_free(part_of);
    return rc;
}
