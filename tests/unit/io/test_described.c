/* What the descriptions of programs say of the pages: OME-XML, and tifffile's shape in JSON. */
#include "support.h"
#include "tiff_bytes.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/io/tiff.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static char path[512];

static void make(int pages, const char *description)
{
    struct tiff_bytes file;
    tiff_bytes_make(&file, 0, pages, pages, 1, 2, description);
    assert_true(tiff_bytes_save(path, file.data, file.size));
}

/* Channels, slices and frames are these, and the pages of the file come in this order: "0 2 1". */
static void assert_order(int64_t channels, int64_t slices, int64_t frames, const char *order)
{
    struct v2v_tiff *tiff = NULL;
    char found[128] = "";
    assert_ok(v2v_tiff_open(&tiff, path));
    const struct v2v_tiff_info *info = v2v_tiff_info(tiff);
    assert_int_equal(info->channels, channels);
    assert_int_equal(info->slices, slices);
    assert_int_equal(info->frames, frames);
    for (int64_t p = 0; p < info->pages; p++) {
        float page[2];
        assert_ok(v2v_tiff_read(tiff, page, p, 1));
        const size_t used = strlen(found);
        snprintf(found + used, sizeof found - used, "%s%.0f", p > 0 ? " " : "",
                 (double)(page[0] - 1) / 2);
    }
    v2v_tiff_close(&tiff);
    assert_string_equal(found, order);
}

/* How a description of six pages is read. */
struct reading {
    const char *text;
    int64_t channels, slices, frames;
    const char *order;
};

static void assert_readings(const struct reading *cases, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        make(6, cases[i].text);
        assert_order(cases[i].channels, cases[i].slices, cases[i].frames, cases[i].order);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void assert_refused(const char *reason)
{
    struct v2v_tiff *tiff = NULL;
    assert_int_equal(v2v_tiff_open(&tiff, path), V2V_E_INPUT);
    assert_null(tiff);
    if (strstr(v2v_status_message(), path) == NULL ||
        strstr(v2v_status_message(), reason) == NULL ||
        strchr(v2v_status_message(), '\n') != NULL) {
        fail_msg("\"%s\" is not one line with %s and \"%s\"", v2v_status_message(), path, reason);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

#define OME_HEAD                                                                                   \
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!-- a comment -->\n"                             \
    "<OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\" UUID=\"urn:uuid:1\">"
#define OME_IMAGE(pixels, inside)                                                                  \
    "<Image ID=\"Image:0\"><Pixels ID=\"Pixels:0\" Type=\"uint16\" SizeX=\"2\" "                   \
    "SizeY=\"1\" " pixels ">" inside "</Pixels></Image>"
#define OME(pixels, inside) OME_HEAD OME_IMAGE(pixels, inside) "</OME>"
#define ORDER(order, c, z, t)                                                                      \
    "DimensionOrder=\"" order "\" SizeC=\"" c "\" SizeZ=\"" z "\" SizeT=\"" t "\""

static void ome_planes_come_in_the_order_c_z_t(void **state)
{
    (void)state;
    static const struct reading cases[] = {
        {OME(ORDER("XYCZT", "2", "3", "1"), "<TiffData/>"), 2, 3, 1, "0 1 2 3 4 5"},
        {OME(ORDER("XYCZT", "1", "3", "2"), ""), 1, 3, 2, "0 1 2 3 4 5"},
        {OME(ORDER("XYZCT", "2", "3", "1"), "<TiffData/>"), 2, 3, 1, "0 3 1 4 2 5"},
        {OME(ORDER("XYTZC", "1", "3", "2"), "<TiffData IFD=\"0\" PlaneCount=\"6\"/>"), 1, 3, 2,
         "0 2 4 1 3 5"},
        {OME(ORDER("XYTCZ", "3", "1", "2"), "<TiffData/>"), 3, 1, 2, "0 2 4 1 3 5"},
        {OME(ORDER("XYZTC", "2", "1", "3"), "<TiffData/>"), 2, 1, 3, "0 3 1 4 2 5"},
        {OME(ORDER("XYCTZ", "1", "3", "2"), "<TiffData/>"), 1, 3, 2, "0 2 4 1 3 5"},
        /* each plane on its own, a page after the other in another order */
        {OME(ORDER("XYZTC", "1", "3", "2"),
             "<TiffData IFD=\"0\" FirstT=\"1\" FirstZ=\"2\"/><TiffData IFD=\"1\" FirstZ=\"0\">"
             "<UUID FileName=\"a.tif\">urn:uuid:1</UUID></TiffData>"
             "<TiffData IFD=\"2\" FirstZ=\"1\" PlaneCount=\"4\"/>"),
         1, 3, 2, "1 2 3 4 5 0"},
    };
    assert_readings(cases, sizeof cases / sizeof cases[0]);
}

static void ome_lengths_are_micrometres_and_seconds(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        double pixel, spacing, interval;
    } cases[] = {
        {OME(ORDER("XYZCT", "1", "2", "1") " PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.5\" "
                                           "PhysicalSizeZ=\"2.5\" TimeIncrement=\"0.25\"",
             ""),
         0.5, 2.5, 0.25},
        {OME(ORDER("XYZCT", "1", "2",
                   "1") " PhysicalSizeX=\"500\" PhysicalSizeXUnit=\"nm\" "
                        "PhysicalSizeZ=\"0.002\" PhysicalSizeZUnit=\"mm\" TimeIncrement=\"250\" "
                        "TimeIncrementUnit=\"ms\"",
             ""),
         0.5, 2, 0.25},
        {OME(ORDER("XYZCT", "1", "2", "1") " TimeIncrement=\"250000\" "
                                           "TimeIncrementUnit=\"\xc2\xb5s\"",
             ""),
         0, 0, 0.25},
        {OME(ORDER("XYZCT", "1", "2", "1") " PhysicalSizeX=\"0.5\" PhysicalSizeXUnit=\"\xc2\xb5m\" "
                                           "PhysicalSizeZ=\"3\" PhysicalSizeZUnit=\"pixel\"",
             ""),
         0.5, 0, 0},
        {OME(ORDER("XYZCT", "1", "2", "1") " PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.6\"", ""), 0,
         0, 0}, /* not square */
        {OME(ORDER("XYZCT", "1", "2", "1") " PhysicalSizeX=\"nan\" PhysicalSizeZ=\"-1\"", ""), 0, 0,
         0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct v2v_tiff *tiff = NULL;
        make(2, cases[i].text);
        assert_ok(v2v_tiff_open(&tiff, path));
        const struct v2v_tiff_info *info = v2v_tiff_info(tiff);
        /* a product each: half an ulp of the decimal, of the factor and of the product */
        assert_true(fabs(info->pixel_size_um - cases[i].pixel) <= 2e-16 * cases[i].pixel);
        assert_true(fabs(info->slice_spacing_um - cases[i].spacing) <= 3e-16 * cases[i].spacing);
        assert_true(fabs(info->frame_interval_s - cases[i].interval) <= 3e-16 * cases[i].interval);
        v2v_tiff_close(&tiff);
    }
}

static void ome_that_is_not_read_rightly_is_refused(void **state)
{
    (void)state;
    static const struct {
        const char *text, *reason;
    } cases[] = {
        {OME(ORDER("XYZCT", "1", "3", "2"), ""), "6 planes (c 1, z 3, t 2), the file has 4 pages"},
        {OME(ORDER("XYZCT", "1", "1", "2"), ""), "2 planes"},
        {OME(ORDER("XYZZT", "1", "2", "2"), ""), "DimensionOrder 'XYZZT'"},
        {OME(ORDER("XYZC", "1", "2", "2"), ""), "DimensionOrder 'XYZC'"},
        {OME(ORDER("XYZCT", "2147483647", "2147483647", "2147483647"), ""), "sizes cannot be read"},
        {OME(ORDER("XYZCT", "1", "0", "2"), ""), "SizeZ"},
        {OME(ORDER("XYZCT", "1", "2", "2"), "<TiffData IFD=\"0\"/>"), "pages of 1 of 4 planes"},
        {OME(ORDER("XYZCT", "1", "2", "2"), "<TiffData IFD=\"2\" PlaneCount=\"3\"/>"),
         "there are 4"},
        {OME(ORDER("XYZCT", "1", "2", "2"), "<TiffData FirstZ=\"2\"/>"), "FirstZ=\"2\" is outside"},
        {OME(ORDER("XYZCT", "1", "2", "2"), "<TiffData/><TiffData IFD=\"1\"/>"),
         "plane 1 is page 1 and page 2"},
        {OME(ORDER("XYZCT", "1", "2", "4"),
             "<TiffData><UUID FileName=\"a.tif\">urn:uuid:1</UUID></TiffData>"
             "<TiffData FirstT=\"2\"><UUID FileName=\"b.tif\">urn:uuid:2</UUID></TiffData>"),
         "one of several files, such as b.tif"},
        {OME_HEAD "<BinaryOnly MetadataFile=\"all.ome.xml\" UUID=\"urn:uuid:3\"/></OME>",
         "one of several files, such as all.ome.xml"},
        {OME_HEAD OME_IMAGE(ORDER("XYZCT", "1", "2", "2"), "") "<Image/></OME>", "has 2 images"},
        {OME_HEAD "</OME>", "has 0 images"},
        {"<OME><Image><Pixels SizeX=\"3\" SizeY=\"1\"/></Image></OME>", "says 1 x 3 pixels"},
        {"<!DOCTYPE OME [<!ENTITY a \"aaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;\">]><OME>&b;</OME>",
         "declares a document type"},
        {"<!DOCTYPE OME SYSTEM \"http://127.0.0.1/ome.dtd\"><OME/>", "declares a document type"},
        {OME_HEAD "<Image>", "OME-XML: line 3: "},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        make(4, cases[i].text);
        assert_refused(cases[i].reason);
    }
    make(4, "<MetaData><Name>GENOME</Name></MetaData>"); /* another program's */
    assert_order(1, 4, 1, "0 1 2 3");
}

static void tifffiles_shape_tells_frames_and_views(void **state)
{
    (void)state;
    static const struct reading cases[] = {
        {"{\"shape\": [6, 1, 2]}", 1, 6, 1, "0 1 2 3 4 5"},
        {"{\"shape\": [2, 3, 1, 2]}", 1, 3, 2, "0 1 2 3 4 5"},
        {"{\"shape\": [2, 1, 3, 1, 1, 2]}", 1, 3, 2, "0 1 2 3 4 5"},
        {"{\"shape\": [2, 3, 1, 2, 1], \"axes\": \"TZYXS\"}", 1, 3, 2, "0 1 2 3 4 5"},
        {"{\"shape\": [2, 3, 1, 2], \"axes\": \"TZYX\"}", 1, 3, 2, "0 1 2 3 4 5"},
        {"{\"shape\": [3, 2, 1, 2], \"axes\": \"ZTYX\"}", 1, 3, 2, "0 2 4 1 3 5"},
        {"{\"shape\": [2, 3, 1, 2], \"axes\": \"CZYX\"}", 2, 3, 1, "0 3 1 4 2 5"},
        {"{\"shape\": [2, 3, 1, 2], \"axes\": \"TCYX\"}", 3, 1, 2, "0 1 2 3 4 5"},
        {"{\"shape\": [6, 1, 2], \"axes\": \"TYX\"}", 1, 1, 6, "0 1 2 3 4 5"},
        /* each frame written on its own, or each page */
        {"{\"shape\": [3, 1, 2]}", 1, 3, 2, "0 1 2 3 4 5"},
        {"{\"shape\": [1, 2]}", 1, 6, 1, "0 1 2 3 4 5"},
        /* other texts in braces */
        {"{\"shape\": \"round\"}", 1, 6, 1, "0 1 2 3 4 5"},
        {"{no JSON}", 1, 6, 1, "0 1 2 3 4 5"},
    };
    assert_readings(cases, sizeof cases / sizeof cases[0]);
}

static void a_shape_that_contradicts_the_pages_is_refused(void **state)
{
    (void)state;
    static const struct {
        const char *text, *reason;
    } cases[] = {
        {"{\"shape\": [3, 4, 1, 2]}", "[3,4,1,2], but it has 6 pages"},
        {"{\"shape\": [4, 1, 2]}", "but it has 6 pages"},
        {"{\"shape\": [6, 2, 1]}", "does not end with the y and x"},
        {"{\"shape\": [1, 2, 6], \"axes\": \"YXT\"}", "does not end with the y and x"},
        {"{\"shape\": [6, 1, 2], \"axes\": \"TZYX\"}", "not as many as names"},
        {"{\"shape\": [2]}", "has not from 2 to 8 axes"},
        {"{\"shape\": [-6, 1, 2]}", "are not counts"},
        {"{\"shape\": [4294967296, 4294967296, 4294967296, 1, 2]}", "but it has 6 pages"},
        {"{\"shape\": [3, 2, 1, 1, 2], \"axes\": \"QVZYX\"}", "cannot be told apart"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        make(6, cases[i].text);
        assert_refused(cases[i].reason);
    }
    make(8, "{\"shape\": [2, 2, 2, 1, 2]}");
    assert_refused("cannot be told apart: tifffile names them by metadata={'axes': 'TZCYX'}");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ome_planes_come_in_the_order_c_z_t),
        cmocka_unit_test(ome_lengths_are_micrometres_and_seconds),
        cmocka_unit_test(ome_that_is_not_read_rightly_is_refused),
        cmocka_unit_test(tifffiles_shape_tells_frames_and_views),
        cmocka_unit_test(a_shape_that_contradicts_the_pages_is_refused),
    };
    snprintf(path, sizeof path, "%s/described.tif", test_folder(NULL));
    return cmocka_run_group_tests(tests, NULL, NULL);
}
