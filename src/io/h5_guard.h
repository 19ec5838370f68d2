/** Look at an untrusted HDF5 file in a process of its own first. */
#ifndef V2V_IO_H5_GUARD_H
#define V2V_IO_H5_GUARD_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/file.h"

/** Refuse a file on which HDF5 crashes or runs for ever: of 1200 recordings damaged at random as in
 *  tests/property/io, HDF5 1.10.8 ran for more than 10 s on four; of 400 files of other kinds seven
 *  hung or crashed it. A child with limits of processor time (10 s an object, 60 s in all) and of
 *  memory opens the file, reads its attributes and the ends of its datasets. What else is wrong
 *  with the file is the caller's to find. The helper of v2v_file_guard_start forks the child;
 *  without it this process does. A file that is seconds old is not looked at again until it
 *  changes.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (crash, limit, unreadable) | V2V_E_IO (for 60 s
 *  nothing of it was read, or in 300 s not all)
 *  @cost one fork, of a helper that holds next to nothing; where the system refuses to fork, a
 *  warning, and the look is skipped */
enum v2v_status v2v_h5_guard(const char *path) V2V_MUST_CHECK;

/** Before a file is opened to read: is it one, what is it now (v2v_file_unchanged after reading),
 *  and the look. @kind Local. @return likewise (also: no readable regular file) */
enum v2v_status v2v_h5_guard_input(struct v2v_file_state *state, const char *path) V2V_MUST_CHECK;

/** v2v_h5_guard with this look, in a child of this process. */
enum v2v_status v2v_h5_guard_with(const char *path, void (*look)(const char *path)) V2V_MUST_CHECK;

#endif
