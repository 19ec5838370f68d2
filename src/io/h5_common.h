/** HDF5 without its noise: errors as one line, attributes, one way to open and create a file. */
#ifndef V2V_IO_H5_COMMON_H
#define V2V_IO_H5_COMMON_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/file.h"
#include <hdf5.h>
#include <stddef.h>
#include <stdint.h>

#define V2V_H5_REASON_BYTES 256

/** Stop HDF5 from printing its error stack; every entry into the library starts with it.
 *  @kind Local. */
void v2v_h5_quiet(void);

/** The innermost description on HDF5's error stack, as printable text. @kind Local. */
const char *v2v_h5_reason(char reason[V2V_H5_REASON_BYTES]);

/** Record "path: object: what: HDF5's reason" and hand the status back. */
#define V2V_H5_FAIL(status, path, object, what)                                                    \
    V2V_FAIL((status), "%s: %s: %s: %s", (path), (object), (what),                                 \
             v2v_h5_reason((char[V2V_H5_REASON_BYTES]){0}))

/** Close any kind of handle and mark it closed; accepts one that is not open (<= 0). */
void v2v_h5_close(hid_t *id);

/** Close a dataset that was written: its last data may go out, and fail, only now. Not open:
 * V2V_OK. `rc` is what happened before, handed back when it is a failure already.
 *  @kind Local. @return rc | V2V_E_IO */
enum v2v_status v2v_h5_close_written(enum v2v_status rc, hid_t *set, const char *path,
                                     const char *name) V2V_MUST_CHECK;

/** Open to read with the plain POSIX driver, without file locks: read-only folders must do.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT */
enum v2v_status v2v_h5_open(hid_t *file, const char *path) V2V_MUST_CHECK;

/** Create for one rank, replacing what is there. With `checksums` the newer format whose metadata
 *  carry checksums (HDF5 1.8 and later read it). @kind Local.
 *  @param chunks so many of a dataset shall lie one behind the other: up to 65534 do that, their
 *  index being one node made before them; 0: they need not
 *  @param bytes of such a chunk: those of whole pages begin at one
 *  @return V2V_OK | V2V_E_IO */
enum v2v_status v2v_h5_create(hid_t *file, const char *path, int checksums, int64_t chunks,
                              int64_t bytes) V2V_MUST_CHECK;

/** Open a dataset whose data lie in this very file and can be decoded here: links to other files,
 *  external and virtual storage and unknown filters are refused.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT */
enum v2v_status v2v_h5_open_dataset(hid_t *set, hid_t file, const char *path,
                                    const char *name) V2V_MUST_CHECK;

/** Is there anything of that name? @kind Local. */
int v2v_h5_has(hid_t file, const char *name);

/** What there is: "has /a, /b/c and 5 more", what may be images or PSFs before other datasets, and
 *  before what this program keeps beside its results. @kind Local. @param text V2V_H5_LIST_BYTES
 *  hold any */
enum { V2V_H5_LIST_BYTES = 640 };
void v2v_h5_list(char *text, size_t bytes, hid_t file);

/** The refusal of a file without a dataset: what it has instead, and `hint`. @kind Local. */
enum v2v_status v2v_h5_there_is_none(hid_t file, const char *path, const char *name,
                                     const char *hint) V2V_MUST_CHECK;

/** What is written as HDF5 does not take the name of another kind of file, as .tif. @kind Local.
 *  @return V2V_OK | V2V_E_USAGE */
enum v2v_status v2v_h5_check_name(const char *path) V2V_MUST_CHECK;

/** Begin a file of one rank under its temporary name; end it: close it, and move it into place when
 *  `rc` and the close are fine, else remove it. @kind Local. @return rc | V2V_E_IO */
enum v2v_status v2v_h5_begin(hid_t *file, char temporary[V2V_PATH_BYTES],
                             const char *path) V2V_MUST_CHECK;
enum v2v_status v2v_h5_end(enum v2v_status rc, hid_t *file, const char *temporary,
                           const char *path) V2V_MUST_CHECK;

/** `count` numbers of an attribute; *found = 0 when there is none, which is no failure.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (not numbers, another count, NaN or Inf) */
enum v2v_status v2v_h5_get_numbers(double *values, int *found, hid_t object, const char *path,
                                   const char *name, int64_t count) V2V_MUST_CHECK;

/** A length such as pixel_size_um: 0 when absent. @return V2V_OK | V2V_E_INPUT (negative) */
enum v2v_status v2v_h5_get_length(double *value, hid_t object, const char *path,
                                  const char *name) V2V_MUST_CHECK;

/** A whole number; *found as above. @return V2V_OK | V2V_E_INPUT */
enum v2v_status v2v_h5_get_integer(int64_t *value, int *found, hid_t object, const char *path,
                                   const char *name) V2V_MUST_CHECK;

/** Text shorter than `bytes`, of fixed or variable length. @return V2V_OK | V2V_E_INPUT */
enum v2v_status v2v_h5_get_text(char *text, size_t bytes, int *found, hid_t object,
                                const char *path, const char *name) V2V_MUST_CHECK;

/** Attributes of a file that one rank writes. @kind Local. @return V2V_OK | V2V_E_IO */
enum v2v_status v2v_h5_set_numbers(hid_t object, const char *path, const char *name,
                                   const double *values, int64_t count) V2V_MUST_CHECK;
enum v2v_status v2v_h5_set_integer(hid_t object, const char *path, const char *name,
                                   int64_t value) V2V_MUST_CHECK;
enum v2v_status v2v_h5_set_text(hid_t object, const char *path, const char *name,
                                const char *text) V2V_MUST_CHECK;

/** Text of any length as a scalar string dataset: attributes end at 64 KiB. @kind Local. */
enum v2v_status v2v_h5_put_text(hid_t file, const char *path, const char *name,
                                const char *text) V2V_MUST_CHECK;

#endif
