/** What the tests share: cmocka in the right order, errors in norm, golden files, data that may be
 *  absent. */
#ifndef V2V_TEST_SUPPORT_H
#define V2V_TEST_SUPPORT_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "v2v3d/base/status.h"
#include "v2v3d/par/comm.h"

/** |a - b| / |b| in double precision. */
double test_relative_l2(const float *a, const float *b, int64_t count);
double test_relative_l2_to_double(const float *a, const double *b, int64_t count);

/** Norm of the errors of float32 sums of `terms` products, in parts of the norm of the sums. Each
 *  addition rounds by 2^-24 of a partial sum at most: never more than terms * 2^-24 of the moduli;
 *  independent of each other (Higham, Accuracy and Stability, 2.8) sqrt(terms / 6) 2^-24 of sums
 *  that grow evenly, of which this is five times as much. */
double test_rounding(double terms);

/** Path of a file under V2V_SHARED (tests/README.md), or NULL (and a line that says so) when it is
 * absent: the test then calls skip(). The string lives until the next call. */
const char *test_shared(const char *name);

/** Skip the test that calls it, and say why. */
#define test_skip(reason)                                                                          \
    do {                                                                                           \
        print_message("%s\n", reason);                                                             \
        skip();                                                                                    \
    } while (0)

/** Every element of a numeric HDF5 dataset as double; count (may be NULL) its number. Fails the
 * test when it can't be read. Free with test_release. */
double *test_h5_read(const char *path, const char *dataset, int64_t *count);
double test_h5_attribute(const char *path, const char *object, const char *name);
void test_release(void *memory);

/** A fresh folder for the test's files (the same on all ranks of comm); removed at exit. */
const char *test_folder(const struct v2v_comm *comm);

/** Fail where two files are not the same, byte by byte. */
void assert_same_bytes(const char *one, const char *other);

/** Fail with the recorded message when rc is not V2V_OK. */
#define assert_ok(call)                                                                            \
    do {                                                                                           \
        enum v2v_status status_ = (call);                                                          \
        if (status_ != V2V_OK) {                                                                   \
            fail_msg("%s: %s", #call, v2v_status_message());                                       \
        }                                                                                          \
    } while (0)

/** Run a group of MPI tests: starts MPI, gives the world to tests through test_world(), ends MPI;
 *  only rank 0 prints; the exit code is non-zero when any rank failed. */
#define test_mpi_main(tests, argc, argv)                                                           \
    test_mpi_run(#tests, tests, sizeof(tests) / sizeof((tests)[0]), argc, argv)
int test_mpi_run(const char *name, const struct CMUnitTest *tests, size_t count, int argc,
                 char **argv);
struct v2v_comm *test_world(void);

/** Before test_mpi_main: rank r's plan of faults (V2V_FAULT) is plans[r], of four. It is read at
 *  the first passage of any fault point, before MPI says which rank this is: the launcher's word
 *  must do. */
void test_plan_faults(const char *const plans[4]);

#endif
