#include "v2v3d/conf/cameras.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"

enum { USUAL_VIEWS = 9 };

/* Units of baseline. */
static const double farthest_off = 1e4;

static void stand_in_grid(struct v2v_cameras *cameras)
{
    int64_t columns = 1;
    while (columns * columns < cameras->views) {
        columns++;
    }
    const int64_t rows = v2v_parts(cameras->views, columns);
    for (int64_t v = 0; v < cameras->views; v++) {
        cameras->at[v][0] = (double)(v / columns) - 0.5 * (double)(rows - 1);
        cameras->at[v][1] = (double)(v % columns) - 0.5 * (double)(columns - 1);
    }
}

enum v2v_status v2v_cameras_init(struct v2v_cameras *cameras,
                                 const struct v2v_synthesis_settings *settings, int64_t views)
{
    enum v2v_status rc = V2V_OK;
    const int64_t listed = v2v_text_count_listed(settings->cameras);
    *cameras = (struct v2v_cameras){.views = views > 0 ? views : listed > 0 ? listed : USUAL_VIEWS};
    if (listed > 0 && listed != cameras->views) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "synthesis.cameras: has %lld cameras for %lld views",
                         (long long)listed, (long long)cameras->views));
    }
    V2V_TRY(V2V_ALLOC(cameras->at, "cameras", cameras->views));
    if (listed == 0) {
        stand_in_grid(cameras);
    } else {
        V2V_TRY(v2v_text_to_pairs(cameras->at, settings->cameras, -farthest_off, farthest_off,
                                  "synthesis.cameras", "view"));
    }
done:
    if (rc != V2V_OK) {
        v2v_cameras_fini(cameras);
    }
    return rc;
}

void v2v_cameras_fini(struct v2v_cameras *cameras)
{
    v2v_mem_free(cameras->at);
    *cameras = (struct v2v_cameras){0};
}
