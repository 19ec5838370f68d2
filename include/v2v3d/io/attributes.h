#ifndef V2V3D_IO_ATTRIBUTES_H
#define V2V3D_IO_ATTRIBUTES_H

#include "v2v3d/base/status.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** What an HDF5 file says about itself: told one attribute of the root after the other. */
struct v2v_attribute_reader {
    void *context;
    void (*text)(void *context, const char *name, const char *text);
    void (*number)(void *context, const char *name, double number);
};

/** Attributes that are a text or a number, by name; others, and names of 256 bytes or more, are
 *  left out. @kind Local. @return V2V_OK | V2V_E_INPUT | V2V_E_MEMORY */
enum v2v_status v2v_attributes_read(const char *path,
                                    const struct v2v_attribute_reader *reader) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
