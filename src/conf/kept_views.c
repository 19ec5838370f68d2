#include "v2v3d/conf/kept_views.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char key[] = "input.without_views";

/* Of those that are listed: not to be kept. */
enum { LISTED = -1 };

static enum v2v_status mark_listed(int64_t *view, const char *without, int64_t views)
{
    enum v2v_status rc = V2V_OK;
    const char *list = without;
    const int64_t count = v2v_text_count_listed(list);
    for (int64_t i = 0; i < count; i++) {
        char number[32] = "";
        int64_t v = 0;
        int read = 0;
        (void)sscanf(list, " %31[^, ] %n", number, &read);
        if (read == 0 || (list[read] != ',' && list[read] != '\0')) {
            V2V_TRY(
                V2V_FAIL(V2V_E_CONFIG, "%s: is to be numbers, as 3, 7, not '%s'", key, without));
        }
        V2V_TRY(v2v_text_to_i64(&v, number, 0, views - 1, key, V2V_E_CONFIG));
        if (view[v] == LISTED) {
            V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s: has view %lld twice", key, (long long)v));
        }
        view[v] = LISTED;
        list += read + 1;
    }
done:
    return rc;
}

enum v2v_status v2v_kept_views_init(struct v2v_kept_views *kept, const char *without, int64_t views)
{
    enum v2v_status rc = V2V_OK;
    *kept = (struct v2v_kept_views){0};
    V2V_TRY(V2V_ALLOC(kept->view, "kept_views", views));
    for (int64_t v = 0; v < views; v++) {
        kept->view[v] = v;
    }
    V2V_TRY(mark_listed(kept->view, without, views));
    for (int64_t v = 0; v < views; v++) {
        if (kept->view[v] != LISTED) {
            kept->view[kept->count++] = v;
        }
    }
    if (kept->count == 0) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s: leaves none of %lld views", key, (long long)views));
    }
done:
    if (rc != V2V_OK) {
        v2v_kept_views_fini(kept);
    }
    return rc;
}

static int has(const char *without, int64_t number)
{
    while (*without != '\0') {
        if (strtoll(without, NULL, 10) == number) {
            return 0;
        }
        without += strcspn(without, ",");
        without += *without == ',';
    }
    return 1;
}

int64_t v2v_kept_views_number(const char *without, int64_t view)
{
    int64_t number = 0;
    for (int64_t kept = -1;; number++) {
        kept += has(without, number);
        if (kept == view) {
            return number;
        }
    }
}

void v2v_kept_views_fini(struct v2v_kept_views *kept)
{
    v2v_mem_free(kept->view);
    *kept = (struct v2v_kept_views){0};
}
