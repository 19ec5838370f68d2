/** Look at an untrusted HDF5 file in a child process first. */
#ifndef V2V_IO_H5_GUARD_H
#define V2V_IO_H5_GUARD_H

#include "v2v3d/base/status.h"

/** Run `look(argument)` in a child with limits of time (10 s) and memory; its verdict and message
 *  become the caller's. A child that crashes or takes too long is V2V_E_INPUT. Needed because of
 *  400 damaged files 7 made HDF5 1.10.8 hang or crash (RELIABILITY.md 2). `look` may open, read
 *  and allocate; it may not communicate. Nothing of what it does outlives the child.
 *  @kind Local. @return what look returned | V2V_E_INPUT (crash, limit)
 *  @cost one fork; where the system refuses to fork, a warning, and the look is skipped */
enum v2v_status v2v_h5_guard(const char *path, enum v2v_status (*look)(const void *),
                             const void *argument) V2V_MUST_CHECK;

#endif
