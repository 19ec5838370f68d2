#include "io/bdv_xml.h"

#include <inttypes.h>
#include <libxml/xmlwriter.h>
#include <stdarg.h>
#include <string.h>

/* A document, and whether any call on it failed: there is but one reason, memory. */
struct document {
    xmlTextWriterPtr writer;
    int failed;
};

static void note(struct document *document, int outcome)
{
    document->failed |= outcome < 0;
}

static void begin(struct document *document, const char *name, const char *attribute,
                  const char *value)
{
    note(document, xmlTextWriterStartElement(document->writer, BAD_CAST name));
    if (attribute != NULL) {
        note(document,
             xmlTextWriterWriteAttribute(document->writer, BAD_CAST attribute, BAD_CAST value));
    }
}

static void end(struct document *document)
{
    note(document, xmlTextWriterEndElement(document->writer));
}

__attribute__((format(printf, 3, 4))) static void put(struct document *document, const char *name,
                                                      const char *format, ...)
{
    char text[V2V_PATH_BYTES];
    va_list arguments;
    va_start(arguments, format);
    const int length = vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    document->failed |= length < 0 || (size_t)length >= sizeof text;
    note(document, xmlTextWriterWriteElement(document->writer, BAD_CAST name, BAD_CAST text));
}

static const char *last_part(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash != NULL ? slash + 1 : path;
}

/* Lengths that nobody states are those of a cube; without a pixel's size all are in pixels. */
static void voxel_size(double size[3], const struct v2v_volume_info *info)
{
    const double pixel = info->pixel_size_um > 0.0 ? info->pixel_size_um : 1.0;
    size[0] = size[1] = pixel;
    size[2] =
        info->pixel_size_um > 0.0 && info->slice_spacing_um > 0.0 ? info->slice_spacing_um : pixel;
}

static void put_setups(struct document *document, const char *path,
                       const struct v2v_volume_info *info)
{
    double size[3];
    voxel_size(size, info);
    begin(document, "ViewSetups", NULL, NULL);
    begin(document, "ViewSetup", NULL, NULL);
    put(document, "id", "0");
    put(document, "name", "%s", last_part(path));
    put(document, "size", "%" PRId64 " %" PRId64 " %" PRId64, info->width, info->height,
        info->slices);
    begin(document, "voxelSize", NULL, NULL);
    put(document, "unit", info->pixel_size_um > 0.0 ? "micrometer" : "pixel");
    put(document, "size", "%.9g %.9g %.9g", size[0], size[1], size[2]);
    end(document);
    begin(document, "attributes", NULL, NULL);
    put(document, "channel", "1");
    end(document);
    end(document);
    begin(document, "Attributes", "name", "channel");
    begin(document, "Channel", NULL, NULL);
    put(document, "id", "1");
    put(document, "name", "1");
    end(document);
    end(document);
    end(document);
}

static void put_registrations(struct document *document, const struct v2v_volume_info *info)
{
    double size[3];
    char number[32];
    voxel_size(size, info);
    begin(document, "ViewRegistrations", NULL, NULL);
    for (int64_t t = 0; t < info->frames; t++) {
        snprintf(number, sizeof number, "%" PRId64, t);
        begin(document, "ViewRegistration", "timepoint", number);
        note(document,
             xmlTextWriterWriteAttribute(document->writer, BAD_CAST "setup", BAD_CAST "0"));
        begin(document, "ViewTransform", "type", "affine");
        put(document, "affine", "%.9g 0 0 0 0 %.9g 0 0 0 0 %.9g 0", size[0], size[1], size[2]);
        end(document);
        end(document);
    }
    end(document);
}

static void put_document(struct document *document, const char *path, const char *data,
                         const struct v2v_volume_info *info)
{
    note(document, xmlTextWriterSetIndent(document->writer, 1));
    note(document, xmlTextWriterStartDocument(document->writer, NULL, "UTF-8", NULL));
    begin(document, "SpimData", "version", "0.2");
    begin(document, "BasePath", "type", "relative");
    note(document, xmlTextWriterWriteString(document->writer, BAD_CAST "."));
    end(document);
    begin(document, "SequenceDescription", NULL, NULL);
    begin(document, "ImageLoader", "format", "bdv.hdf5");
    begin(document, "hdf5", "type", "relative");
    note(document, xmlTextWriterWriteString(document->writer, BAD_CAST last_part(data)));
    end(document);
    end(document);
    put_setups(document, path, info);
    begin(document, "Timepoints", "type", "range");
    put(document, "first", "0");
    put(document, "last", "%" PRId64, info->frames - 1);
    end(document);
    end(document);
    put_registrations(document, info);
    end(document);
    note(document, xmlTextWriterEndDocument(document->writer));
}

enum v2v_status v2v_bdv_write_xml(const char *path, const char *data,
                                  const struct v2v_volume_info *info)
{
    enum v2v_status rc = V2V_OK;
    xmlBufferPtr text = xmlBufferCreate();
    struct document document = {.writer = text != NULL ? xmlNewTextWriterMemory(text, 0) : NULL};
    if (document.writer != NULL) {
        put_document(&document, path, data, info);
        xmlFreeTextWriter(document.writer);
    }
    if (document.writer == NULL || document.failed) {
        V2V_TRY(V2V_FAIL(V2V_E_MEMORY, "%s: no memory for its text", path));
    }
    V2V_TRY(v2v_file_write_text(path, (const char *)xmlBufferContent(text)));
done:
    xmlBufferFree(text);
    return rc;
}
