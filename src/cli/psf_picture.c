#include "cli/psf_picture.h"

#include "cli/picture.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/eval/preview.h"
#include <inttypes.h>
#include <math.h>
#include <stdio.h>

enum { LABEL = 32 };

static enum v2v_status draw_view(struct v2v_canvas *canvas, const struct v2v_psf_file *psf,
                                 int64_t v)
{
    enum v2v_status rc = V2V_OK;
    const float *own = psf->data + v * psf->slices * psf->height * psf->width;
    const struct v2v_volume_info sizes = {.pixel_size_um = psf->pixel_size_um,
                                          .slice_spacing_um = psf->slice_spacing_um};
    struct v2v_preview preview = {.kind = V2V_PREVIEW_PROJECTIONS,
                                  .slices = psf->slices,
                                  .height = psf->height,
                                  .width = psf->width,
                                  .z_zoom = v2v_picture_z_zoom(&sizes),
                                  .low = NAN,
                                  .high = NAN};
    V2V_TRY(v2v_preview_widen(&preview, own));
    V2V_TRY(v2v_preview_draw(canvas, &preview, own));
done:
    return rc;
}

enum v2v_status v2v_psf_picture(const char *path, const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_canvas *parts = NULL, canvas = {0};
    char(*text)[LABEL] = NULL;
    const char **labels = NULL;
    const int64_t columns = (int64_t)ceil(sqrt((double)psf->views));
    V2V_TRY(V2V_ALLOC(parts, "psf.pictures", psf->views));
    V2V_TRY(V2V_ALLOC(text, "psf.pictures", psf->views));
    V2V_TRY(V2V_ALLOC(labels, "psf.pictures", psf->views));
    for (int64_t v = 0; v < psf->views; v++) {
        snprintf(text[v], LABEL, "view %" PRId64, v);
        labels[v] = text[v];
        V2V_TRY(draw_view(&parts[v], psf, v));
    }
    V2V_TRY(v2v_picture_grid(&canvas, parts, labels, psf->views, columns, 1));
    V2V_TRY(v2v_png_write(path, canvas.rgb, canvas.height, canvas.width, 3));
done:
    for (int64_t v = 0; v < psf->views && parts != NULL; v++) {
        v2v_canvas_fini(&parts[v]);
    }
    v2v_canvas_fini(&canvas);
    v2v_mem_free(labels);
    v2v_mem_free(text);
    v2v_mem_free(parts);
    return rc;
}
