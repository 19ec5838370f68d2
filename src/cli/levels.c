#include "cli/levels.h"

#include <inttypes.h>
#include <stdio.h>

/* Times beyond the trained range that are worth a warning. A network of minutes still gives bright
 * voxels their due within 1 % there and moves its volume by 2 % of its norm; one of longer training
 * gave them 0.57 of it at 0.3 of the light. */
static const double out_of_range = 1.5;

enum v2v_status v2v_levels_compare(char text[V2V_LEVELS_TEXT], const struct v2v_level_range *range,
                                   int is_homogeneous, struct v2v_recording *recording,
                                   const struct v2v_scaling *scaling, int64_t first,
                                   const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_level_outlier outlier;
    text[0] = '\0';
    V2V_TRY(v2v_level_judge(&outlier, range, is_homogeneous, recording, scaling, session->world));
    if (outlier.factor > out_of_range) {
        snprintf(text, V2V_LEVELS_TEXT,
                 "frame %" PRId64 " is outside of what the network was trained on: %s %.3g, there "
                 "%.3g to %.3g",
                 first + outlier.frame, v2v_level_name(outlier.figure), outlier.value,
                 range->least[outlier.figure], range->most[outlier.figure]);
    }
done:
    return rc;
}
