/** Where a volume's frames come from: which of which recording, less what, as its file says. */
#ifndef V2V_CLI_ORIGIN_H
#define V2V_CLI_ORIGIN_H

#include "cli/command.h"
#include "v2v3d/io/volume.h"

enum { V2V_ORIGIN_TEXT = 32, V2V_ORIGIN_ATTRIBUTES = 3 };

struct v2v_origin {
    int64_t first_frame;             /**< of the recording; -1: not known */
    char recording[V2V_ORIGIN_TEXT]; /**< a hash of its file; "": not known */
    double offset;                   /**< that was taken off its samples; NaN: not known */
    char psf[V2V_ORIGIN_TEXT];       /**< a checksum of the PSFs that made it; "": not known */
};

/** Of frames from `first_frame` on, the offset not known. @kind Collective(world), agreed.
 *  @return V2V_OK | V2V_E_IO | V2V_E_INPUT */
enum v2v_status v2v_origin_of(struct v2v_origin *origin, const char *recording, int64_t first_frame,
                              const struct v2v_session *session) V2V_MUST_CHECK;

/** What the file of a volume says, HDF5 or TIFF; of what others wrote nothing is known.
 *  @kind Collective(world), agreed. @return V2V_OK | V2V_E_INPUT | V2V_E_MEMORY */
enum v2v_status v2v_origin_read(struct v2v_origin *origin, const char *path,
                                const struct v2v_session *session) V2V_MUST_CHECK;

/** As attributes of a file, but for the PSFs, as far as it is known; their text is borrowed.
 *  @kind Local. @param item [V2V_ORIGIN_ATTRIBUTES] out @return how many */
int64_t v2v_origin_attributes(struct v2v_attribute *item, const struct v2v_origin *origin);

/** Do both show frames of one recording, as far as their files say? @kind Local. */
int v2v_origin_is_same(const struct v2v_origin *a, const struct v2v_origin *b);

#endif
