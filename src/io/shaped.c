#include "io/tiff_internal.h"
#include "v2v3d/base/memory.h"

#include <jansson.h>
#include <stdio.h>
#include <string.h>

enum { MOST_AXES = 8 };

/* tifffile's {"shape": [..], "axes": ".."}, without the axes y and x. */
struct shape {
    int rank;
    int64_t size[MOST_AXES], pages;
    char axes[MOST_AXES + 1]; /* "": not named */
};

static enum v2v_status shape_fail(const struct v2v_tiff *tiff, const json_t *object,
                                  const char *reason)
{
    char text[128];
    const size_t length =
        json_dumpb(json_object_get(object, "shape"), text, sizeof text - 1, JSON_COMPACT);
    text[length < sizeof text ? length : 0] = '\0'; /* longer: not all is in it */
    return V2V_FAIL(V2V_E_INPUT, "%s: its description says the shape %s, %s", tiff->path, text,
                    reason);
}

/* The object of a description that has a shape; NULL: it is another text. */
static json_t *parse(const char *description)
{
    json_t *object = description != NULL && description[0] == '{'
                         ? json_loads(description, JSON_REJECT_DUPLICATES, NULL)
                         : NULL;
    if (object != NULL && !json_is_array(json_object_get(object, "shape"))) {
        json_decref(object);
        object = NULL;
    }
    return object;
}

static enum v2v_status read_shape(struct shape *shape, const struct v2v_tiff *tiff,
                                  const json_t *object)
{
    const struct v2v_tiff_info *info = &tiff->info;
    const json_t *array = json_object_get(object, "shape");
    const char *axes = json_string_value(json_object_get(object, "axes"));
    int64_t size[MOST_AXES] = {0};
    int rank = (int)json_array_size(array);
    *shape = (struct shape){.pages = 1};
    if (rank < 2 || rank > MOST_AXES || (axes != NULL && strlen(axes) != (size_t)rank)) {
        return shape_fail(tiff, object, "which has not from 2 to 8 axes, or not as many as names");
    }
    for (int i = 0; i < rank; i++) {
        size[i] = json_integer_value(json_array_get(array, (size_t)i));
        if (size[i] <= 0) {
            return shape_fail(tiff, object, "which are not counts");
        }
    }
    if (rank > 2 && size[rank - 1] == 1 && size[rank - 2] == info->width &&
        (size[rank - 3] == info->height)) {
        rank--; /* samples of a pixel */
    }
    if (size[rank - 2] != info->height || size[rank - 1] != info->width ||
        (axes != NULL && strncmp(axes + rank - 2, "YX", 2) != 0)) {
        return shape_fail(tiff, object, "which does not end with the y and x of its pages");
    }
    for (int i = 0; i < rank - 2; i++) {
        shape->pages = v2v_mem_product(shape->pages, size[i], 1);
        if (size[i] > 1) {
            shape->size[shape->rank] = size[i];
            shape->axes[shape->rank++] = axes != NULL ? axes[i] : '\0';
        }
    }
    return V2V_OK;
}

/* Frame after frame written on its own: every `pages` pages say the same shape. */
static enum v2v_status check_repeats(struct v2v_tiff *tiff, const json_t *object, int64_t pages)
{
    enum v2v_status rc = V2V_OK;
    json_t *other = NULL;
    for (int64_t page = pages; page < tiff->info.pages; page += pages) {
        const char *description = NULL;
        v2v_tiff_beat(page / pages);
        V2V_TRY(v2v_tiff_go_to(tiff, page));
        (void)TIFFGetField(tiff->handle, TIFFTAG_IMAGEDESCRIPTION, &description);
        other = parse(description);
        if (other == NULL ||
            !json_equal(json_object_get(other, "shape"), json_object_get(object, "shape"))) {
            V2V_TRY(shape_fail(tiff, object, "but it has more pages, which do not repeat it"));
        }
        json_decref(other);
        other = NULL;
    }
done:
    json_decref(other);
    return rc;
}

/* Which axis is which: t and c by name, whatever is left has the slices or views. */
static enum v2v_status settle(struct v2v_tiff *tiff, const struct shape *shape,
                              const json_t *object)
{
    enum { C, Z, T };
    int64_t size[V2V_TIFF_AXES] = {1, 1, 1}, stride[V2V_TIFF_AXES] = {1, 1, 1};
    int64_t step = 1;
    for (int i = shape->rank - 1; i >= 0; i--) {
        const char name = shape->axes[i];
        const int is_time = name == 'T' || (name == '\0' && shape->rank == 2 && i == 0);
        const int axis = name == 'C' ? C : is_time ? T : Z;
        if (size[axis] > 1) {
            return shape_fail(tiff, object,
                              "in which slices, channels and frames cannot be told apart: tifffile "
                              "names them by metadata={'axes': 'TZCYX'}");
        }
        size[axis] = shape->size[i];
        stride[axis] = step;
        step *= shape->size[i];
    }
    if (step < tiff->info.pages) { /* written frame by frame */
        if (size[T] > 1) {
            return shape_fail(tiff, object, "several times");
        }
        size[T] = tiff->info.pages / step;
        stride[T] = step;
    }
    return v2v_tiff_set_axes(tiff, size, stride, NULL);
}

enum v2v_status v2v_shaped_read(struct v2v_tiff *tiff, const char *description, int *found)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pages = tiff->info.pages;
    struct shape shape;
    json_t *object = parse(description);
    *found = object != NULL;
    if (object == NULL) {
        return V2V_OK;
    }
    V2V_TRY(read_shape(&shape, tiff, object));
    if (shape.pages == 1) { /* of a page, not of the file */
        *found = 0;
        goto done;
    }
    if (shape.pages < 0 || pages % shape.pages != 0) {
        char reason[64];
        (void)snprintf(reason, sizeof reason, "but it has %lld pages", (long long)pages);
        V2V_TRY(shape_fail(tiff, object, reason));
    }
    V2V_TRY(check_repeats(tiff, object, shape.pages));
    V2V_TRY(settle(tiff, &shape, object));
done:
    json_decref(object);
    return rc;
}
