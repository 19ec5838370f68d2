#include "v2v3d/optics/taps.h"

#include "v2v3d/base/memory.h"

#include <stdlib.h>

struct candidate {
    struct v2v_tap tap;
    int64_t place; /* index into of[view,z,k,l] */
};

static int by_view_row_column(const void *left, const void *right)
{
    const struct v2v_tap *a = &((const struct candidate *)left)->tap;
    const struct v2v_tap *b = &((const struct candidate *)right)->tap;
    if (a->view != b->view) {
        return a->view < b->view ? -1 : 1;
    }
    if (a->y != b->y) {
        return a->y < b->y ? -1 : 1;
    }
    return (a->x > b->x) - (a->x < b->x);
}

static int64_t list_candidates(struct candidate *list, int32_t *of, const struct v2v_shifts *shifts,
                               const int32_t *views, int64_t count, unsigned rows, unsigned columns)
{
    int64_t found = 0;
    for (int64_t place = 0; place < count * shifts->slices * 9; place++) {
        int64_t i = place / (shifts->slices * 9);
        int64_t z = place / 9 % shifts->slices;
        int k = (int)(place / 3 % 3), l = (int)(place % 3);
        of[place] = -1;
        if (!(rows >> k & 1) || !(columns >> l & 1)) {
            continue;
        }
        int64_t at = views[i] * shifts->slices + z;
        list[found++] = (struct candidate){
            .tap = {(int32_t)i, k - 1 + shifts->dy[at], l - 1 + shifts->dx[at]}, .place = place};
    }
    return found;
}

enum v2v_status v2v_taps_create(struct v2v_taps *taps, const struct v2v_shifts *shifts,
                                const int32_t *views, int64_t count, unsigned rows,
                                unsigned columns, int merged)
{
    enum v2v_status rc = V2V_OK;
    struct candidate *list = NULL;
    int64_t places = v2v_mem_product(count, shifts->slices, 9);
    *taps = (struct v2v_taps){.views = count, .slices = shifts->slices};
    V2V_TRY(V2V_ALLOC(taps->of, "taps.of", places));
    V2V_TRY(V2V_ALLOC(taps->tap, "taps.tap", places));
    V2V_TRY(V2V_ALLOC(list, "taps.scratch", places));
    int64_t found = list_candidates(list, taps->of, shifts, views, count, rows, columns);
    qsort(list, (size_t)found, sizeof *list, by_view_row_column);
    for (int64_t i = 0; i < found; i++) {
        if (i == 0 || !merged || by_view_row_column(&list[i - 1], &list[i]) != 0) {
            taps->tap[taps->count++] = list[i].tap;
        }
        taps->of[list[i].place] = (int32_t)(taps->count - 1);
    }
done:
    v2v_mem_free(list);
    if (rc != V2V_OK) {
        v2v_taps_fini(taps);
    }
    return rc;
}

void v2v_taps_fini(struct v2v_taps *taps)
{
    v2v_mem_free(taps->tap);
    v2v_mem_free(taps->of);
    *taps = (struct v2v_taps){0};
}
