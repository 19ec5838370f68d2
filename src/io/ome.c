#include "io/tiff_internal.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"

#include <libxml/xmlreader.h>
#include <stdio.h>
#include <string.h>

/* A line or two a page is usual. */
#define MOST_BYTES ((size_t)64 << 20)
/* No network; entities stay what they are, and a document that declares any is refused. */
#define OPTIONS (XML_PARSE_NONET | XML_PARSE_NOERROR | XML_PARSE_NOWARNING)

enum { DEPTH_PIXELS = 2, DEPTH_DATA = 3, DEPTH_UUID = 4, UUID_BYTES = 128, NAME_BYTES = 256 };

/* What the document has said so far. */
struct ome {
    struct v2v_tiff *tiff;
    xmlTextReaderPtr reader;
    int images, blocks; /* elements Image, TiffData */
    int in_pixels;
    int is_set;            /* its planes lie in several files */
    char file[NAME_BYTES]; /* one of the others, as far as it is named */
    char own[UUID_BYTES];  /* this file's identifier */
    int64_t size[V2V_TIFF_AXES], stride[V2V_TIFF_AXES];
    int64_t planes;
    int64_t *page; /* [planes], in the document's order; -1: not told yet; NULL: another count */
    int64_t told;  /* planes that have their page */
};

#define OME_FAIL(ome, ...) ome_fail((ome)->tiff->path, __LINE__, __VA_ARGS__)

__attribute__((format(printf, 3, 4))) static enum v2v_status ome_fail(const char *path, int line,
                                                                      const char *format, ...)
{
    char reason[V2V_MESSAGE_BYTES / 2];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(reason, sizeof reason, format, arguments);
    va_end(arguments);
    return v2v_status_fail(V2V_E_INPUT, __FILE__, line, "%s: OME-XML: %s", path, reason);
}

/* An attribute's text; *found = 0 when there is none. */
static enum v2v_status get_text(struct ome *ome, char *text, size_t bytes, int *found,
                                const char *name)
{
    enum v2v_status rc = V2V_OK;
    xmlChar *value = xmlTextReaderGetAttribute(ome->reader, (const xmlChar *)name);
    *found = value != NULL;
    text[0] = '\0';
    if (value != NULL && strlen((const char *)value) >= bytes) {
        V2V_TRY(OME_FAIL(ome, "%s is longer than %zu characters", name, bytes - 1));
    }
    if (value != NULL) {
        memcpy(text, value, strlen((const char *)value) + 1);
    }
done:
    xmlFree(value);
    return rc;
}

/* An attribute's whole number, else `otherwise`. */
static enum v2v_status get_count(struct ome *ome, int64_t *count, const char *name, int64_t least,
                                 int64_t otherwise)
{
    enum v2v_status rc = V2V_OK;
    char text[32], what[NAME_BYTES];
    int found = 0;
    *count = otherwise;
    V2V_TRY(get_text(ome, text, sizeof text, &found, name));
    if (found) {
        (void)snprintf(what, sizeof what, "%.200s: OME-XML: %s", ome->tiff->path, name);
        V2V_TRY(v2v_text_to_i64(count, text, least, INT32_MAX, what, V2V_E_INPUT));
    }
done:
    return rc;
}

/* A length or time of attribute `name` in the unit of `name`Unit; 0 when unknown. */
static enum v2v_status get_quantity(struct ome *ome, double *value, const char *name,
                                    double (*factor)(const char *unit), const char *usual)
{
    enum v2v_status rc = V2V_OK;
    char text[64], unit[64], unit_name[64];
    int found = 0, has_unit = 0;
    double number = 0.0;
    *value = 0.0;
    V2V_TRY(get_text(ome, text, sizeof text, &found, name));
    V2V_TRY(v2v_text_format(unit_name, sizeof unit_name, "%sUnit", name));
    V2V_TRY(get_text(ome, unit, sizeof unit, &has_unit, unit_name));
    if (found && v2v_text_to_f64(&number, text, 0.0, 1e12, name, V2V_E_INPUT) == V2V_OK) {
        *value = number * factor(has_unit ? unit : usual);
    }
done:
    return rc;
}

static enum v2v_status read_lengths(struct ome *ome)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff_info *info = &ome->tiff->info;
    double x = 0.0, y = 0.0;
    V2V_TRY(get_quantity(ome, &x, "PhysicalSizeX", v2v_tiff_length_um, "um"));
    V2V_TRY(get_quantity(ome, &y, "PhysicalSizeY", v2v_tiff_length_um, "um"));
    V2V_TRY(get_quantity(ome, &info->slice_spacing_um, "PhysicalSizeZ", v2v_tiff_length_um, "um"));
    V2V_TRY(get_quantity(ome, &info->frame_interval_s, "TimeIncrement", v2v_tiff_seconds, "s"));
    info->pixel_size_um = v2v_tiff_pixel_size(ome->tiff->path, x, y);
done:
    return rc;
}

/* Sizes, the order of the planes, and room for their pages. */
static enum v2v_status read_pixels(struct ome *ome)
{
    /* axes as in struct v2v_tiff_info: c, z, t */
    static const char letters[V2V_TIFF_AXES] = {'C', 'Z', 'T'};
    static const char *const names[V2V_TIFF_AXES] = {"SizeC", "SizeZ", "SizeT"};
    enum v2v_status rc = V2V_OK;
    const struct v2v_tiff_info *info = &ome->tiff->info;
    char order[16];
    int64_t height = 0, width = 0, stride = 1;
    int found = 0, known = 0;
    ome->in_pixels = 1;
    V2V_TRY(get_count(ome, &width, "SizeX", 1, info->width));
    V2V_TRY(get_count(ome, &height, "SizeY", 1, info->height));
    if (height != info->height || width != info->width) {
        V2V_TRY(OME_FAIL(ome, "says %lld x %lld pixels, page 1 has %lld x %lld", (long long)height,
                         (long long)width, (long long)info->height, (long long)info->width));
    }
    V2V_TRY(get_text(ome, order, sizeof order, &found, "DimensionOrder"));
    for (int i = 2; strlen(order) == 5 && strncmp(order, "XY", 2) == 0 && i < 5; i++) {
        const char *at = memchr(letters, order[i], sizeof letters);
        if (at != NULL && strchr(order + i + 1, order[i]) == NULL) {
            const int axis = (int)(at - letters);
            V2V_TRY(get_count(ome, &ome->size[axis], names[axis], 1, 1));
            ome->stride[axis] = stride;
            stride = v2v_mem_product(stride, ome->size[axis], 1);
            known++;
        }
    }
    if (known != V2V_TIFF_AXES || stride < 0) {
        V2V_TRY(OME_FAIL(ome, "DimensionOrder '%s' or its sizes cannot be read", order));
    }
    ome->planes = stride;
    V2V_TRY(read_lengths(ome));
    if (ome->planes == info->pages) {
        V2V_TRY(V2V_ALLOC(ome->page, "io.ome", ome->planes));
        for (int64_t i = 0; i < ome->planes; i++) {
            ome->page[i] = -1;
        }
    }
done:
    return rc;
}

/* "TiffData": PlaneCount pages from IFD on are the planes from (FirstC, FirstZ, FirstT) on. What is
 * left out: https://docs.openmicroscopy.org/ome-model/latest/ome-tiff/specification.html */
static enum v2v_status read_data(struct ome *ome)
{
    enum v2v_status rc = V2V_OK;
    static const char *const first[V2V_TIFF_AXES] = {"FirstC", "FirstZ", "FirstT"};
    int64_t page = 0, count = 0, plane = 0;
    ome->blocks++;
    if (ome->page == NULL) {
        return V2V_OK; /* refused at the end, unless for a better reason */
    }
    V2V_TRY(get_count(ome, &page, "IFD", 0, -1));
    V2V_TRY(get_count(ome, &count, "PlaneCount", 0, page >= 0 ? 1 : ome->planes));
    page = page >= 0 ? page : 0;
    for (int axis = 0; axis < V2V_TIFF_AXES; axis++) {
        int64_t at = 0;
        V2V_TRY(get_count(ome, &at, first[axis], 0, 0));
        if (at >= ome->size[axis]) {
            V2V_TRY(OME_FAIL(ome, "%s=\"%lld\" is outside the image", first[axis], (long long)at));
        }
        plane += at * ome->stride[axis];
    }
    if (count > ome->planes - plane || count > ome->planes - page) {
        V2V_TRY(OME_FAIL(ome, "its planes from %lld on need pages %lld to %lld; there are %lld",
                         (long long)plane + 1, (long long)page + 1, (long long)(page + count),
                         (long long)ome->planes));
    }
    for (int64_t i = 0; i < count; i++) {
        if (ome->page[plane + i] >= 0 && ome->page[plane + i] != page + i) {
            V2V_TRY(OME_FAIL(ome, "plane %lld is page %lld and page %lld",
                             (long long)(plane + i + 1), (long long)ome->page[plane + i] + 1,
                             (long long)(page + i + 1)));
        }
        ome->told += ome->page[plane + i] < 0;
        ome->page[plane + i] = page + i;
    }
done:
    return rc;
}

/* Which file a block's planes lie in. */
static enum v2v_status read_uuid(struct ome *ome)
{
    enum v2v_status rc = V2V_OK;
    char name[NAME_BYTES];
    int found = 0;
    xmlChar *text = xmlTextReaderReadString(ome->reader);
    const char *uuid = text != NULL ? (const char *)text : "";
    V2V_TRY(get_text(ome, name, sizeof name, &found, "FileName"));
    if (ome->own[0] == '\0') {
        (void)snprintf(ome->own, sizeof ome->own, "%s", uuid);
    }
    if (strncmp(ome->own, uuid, sizeof ome->own - 1) != 0) {
        ome->is_set = 1;
        memcpy(ome->file, name, sizeof name);
    }
done:
    xmlFree(text);
    return rc;
}

static enum v2v_status read_element(struct ome *ome)
{
    enum v2v_status rc = V2V_OK;
    const char *name = (const char *)xmlTextReaderConstLocalName(ome->reader);
    const int depth = xmlTextReaderDepth(ome->reader);
    int found = 0;
    if (depth == 0) {
        V2V_TRY(get_text(ome, ome->own, sizeof ome->own, &found, "UUID"));
    } else if (depth == 1 && strcmp(name, "BinaryOnly") == 0) {
        ome->is_set = 1;
        V2V_TRY(get_text(ome, ome->file, sizeof ome->file, &found, "MetadataFile"));
    } else if (depth == 1 && strcmp(name, "Image") == 0) {
        ome->images++;
    } else if (depth == DEPTH_PIXELS && strcmp(name, "Pixels") == 0 && ome->images == 1) {
        V2V_TRY(ome->in_pixels ? OME_FAIL(ome, "has two Pixels of one Image") : read_pixels(ome));
    } else if (depth == DEPTH_DATA && strcmp(name, "TiffData") == 0 && ome->images == 1) {
        V2V_TRY(ome->in_pixels ? read_data(ome) : OME_FAIL(ome, "has TiffData without Pixels"));
    } else if (depth == DEPTH_UUID && strcmp(name, "UUID") == 0) {
        V2V_TRY(read_uuid(ome));
    }
done:
    return rc;
}

/* From the first element on; *found: it is OME's. */
static enum v2v_status read_document(struct ome *ome, int *found)
{
    enum v2v_status rc = V2V_OK;
    int more = 0;
    while ((more = xmlTextReaderRead(ome->reader)) == 1) {
        const int type = xmlTextReaderNodeType(ome->reader);
        if (type == XML_READER_TYPE_DOCUMENT_TYPE) {
            V2V_TRY(OME_FAIL(ome, "declares a document type, which OME's has not"));
        }
        if (type != XML_READER_TYPE_ELEMENT) {
            continue;
        }
        if (xmlTextReaderDepth(ome->reader) == 0) {
            *found = strcmp((const char *)xmlTextReaderConstLocalName(ome->reader), "OME") == 0;
            if (!*found) {
                goto done;
            }
        }
        V2V_TRY(read_element(ome));
    }
    if (more < 0) {
        const xmlError *error = xmlGetLastError();
        const int length = error != NULL ? (int)strcspn(error->message, "\r\n") : 0;
        V2V_TRY(OME_FAIL(ome, "line %d: %.*s", error != NULL ? error->line : 0, length,
                         error != NULL ? error->message : ""));
    }
done:
    return rc;
}

/* All is read: do planes and pages fit? */
static enum v2v_status settle(struct ome *ome)
{
    enum v2v_status rc = V2V_OK;
    if (ome->is_set) {
        V2V_TRY(OME_FAIL(ome, "it is one of several files%s%s; only OME-TIFF in one file is read",
                         ome->file[0] != '\0' ? ", such as " : "", ome->file));
    }
    if (ome->images != 1 || !ome->in_pixels) {
        V2V_TRY(OME_FAIL(ome, "has %d images; only 1 is read", ome->images));
    }
    if (ome->page == NULL) {
        V2V_TRY(OME_FAIL(ome, "says %lld planes (c %lld, z %lld, t %lld), the file has %lld pages",
                         (long long)ome->planes, (long long)ome->size[0], (long long)ome->size[1],
                         (long long)ome->size[2], (long long)ome->tiff->info.pages));
    }
    if (ome->blocks > 0 && ome->told != ome->planes) {
        V2V_TRY(OME_FAIL(ome, "tells the pages of %lld of %lld planes", (long long)ome->told,
                         (long long)ome->planes));
    }
    V2V_TRY(
        v2v_tiff_set_axes(ome->tiff, ome->size, ome->stride, ome->blocks > 0 ? ome->page : NULL));
done:
    return rc;
}

enum v2v_status v2v_ome_read(struct v2v_tiff *tiff, const char *description, int *found)
{
    enum v2v_status rc = V2V_OK;
    struct ome ome = {.tiff = tiff};
    const size_t bytes = strlen(description);
    *found = 0;
    if (description[strspn(description, "\xef\xbb\xbf \t\r\n")] != '<' ||
        strstr(description, "OME") == NULL) {
        return V2V_OK;
    }
    if (bytes > MOST_BYTES) {
        V2V_TRY(OME_FAIL(&ome, "is longer than %zu bytes", MOST_BYTES));
    }
    ome.reader = xmlReaderForMemory(description, (int)bytes, NULL, NULL, OPTIONS);
    if (ome.reader == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_MEMORY, "%s: no memory for an XML reader", tiff->path));
    }
    V2V_TRY(read_document(&ome, found));
    if (*found) {
        V2V_TRY(settle(&ome));
    }
done:
    xmlFreeTextReader(ome.reader);
    v2v_mem_free(ome.page);
    return rc;
}
