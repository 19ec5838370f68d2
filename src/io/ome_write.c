#include "io/tiff_internal.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"

#include <inttypes.h>
#include <string.h>

/* Lengths, each with its unit; what is not known is left out. */
static enum v2v_status format_lengths(char *text, size_t bytes, const struct v2v_tiff_info *info)
{
    enum v2v_status rc = V2V_OK;
    const struct {
        const char *name, *unit;
        double value;
    } lengths[] = {{"PhysicalSizeX", "&#181;m", info->pixel_size_um},
                   {"PhysicalSizeY", "&#181;m", info->pixel_size_um},
                   {"PhysicalSizeZ", "&#181;m", info->slice_spacing_um},
                   {"TimeIncrement", "s", info->frame_interval_s}};
    text[0] = '\0';
    for (size_t i = 0; i < sizeof lengths / sizeof lengths[0]; i++) {
        const size_t used = strlen(text);
        if (lengths[i].value > 0.0) {
            V2V_TRY(v2v_text_format(text + used, bytes - used, " %s=\"%.9g\" %sUnit=\"%s\"",
                                    lengths[i].name, lengths[i].value, lengths[i].name,
                                    lengths[i].unit));
        }
    }
done:
    return rc;
}

static enum v2v_status format_channels(char *text, size_t bytes, int64_t channels)
{
    enum v2v_status rc = V2V_OK;
    for (int64_t c = 0; c < channels; c++) {
        const size_t used = strlen(text);
        V2V_TRY(v2v_text_format(text + used, bytes - used,
                                "<Channel ID=\"Channel:0:%" PRId64 "\" SamplesPerPixel=\"1\"/>",
                                c));
    }
done:
    return rc;
}

int v2v_tiff_is_ome_name(const char *path)
{
    return v2v_text_ends_in(path, ".ome.tif") || v2v_text_ends_in(path, ".ome.tiff");
}

int64_t v2v_ome_bytes(const struct v2v_tiff_info *info)
{
    const int64_t most_of_a_channel = 80, most_of_the_rest = 2048;
    return v2v_mem_product(info->channels, most_of_a_channel, 1) + most_of_the_rest;
}

enum v2v_status v2v_ome_format(char *text, size_t bytes, const struct v2v_tiff_info *info)
{
    enum v2v_status rc = V2V_OK;
    const uint16_t one = 1;
    const int is_big_endian = *(const uint8_t *)&one == 0;
    char lengths[512], step[128] = "";
    V2V_TRY(format_lengths(lengths, sizeof lengths, info));
    if (info->step > 0.0) {
        V2V_TRY(v2v_text_format(step, sizeof step,
                                "<Description>value = %.9g * stored number</Description>",
                                info->step));
    }
    V2V_TRY(v2v_text_format(
        text, bytes,
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
        "<OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\" "
        "xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" "
        "xsi:schemaLocation=\"http://www.openmicroscopy.org/Schemas/OME/2016-06 "
        "http://www.openmicroscopy.org/Schemas/OME/2016-06/ome.xsd\" Creator=\"v2v3d\">"
        "<Image ID=\"Image:0\">%s<Pixels ID=\"Pixels:0\" DimensionOrder=\"XYCZT\" Type=\"%s\" "
        "BigEndian=\"%s\" SizeX=\"%" PRId64 "\" SizeY=\"%" PRId64 "\" SizeC=\"%" PRId64
        "\" SizeZ=\"%" PRId64 "\" SizeT=\"%" PRId64 "\"%s>",
        step, info->bits == 16 ? "uint16" : "float", is_big_endian ? "true" : "false", info->width,
        info->height, info->channels, info->slices, info->frames, lengths));
    V2V_TRY(format_channels(text, bytes, info->channels));
    const size_t used = strlen(text);
    V2V_TRY(v2v_text_format(text + used, bytes - used,
                            "<TiffData IFD=\"0\" PlaneCount=\"%" PRId64 "\"/></Pixels></Image>"
                            "</OME>\n",
                            info->pages));
done:
    return rc;
}
