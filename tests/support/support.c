#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"

#include <ftw.h>
#include <hdf5.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { MOST_FOLDERS = 128, PATH_BYTES = 512 };

/* Before CTest kills an MPI test without a word. */
#define GROUP_SECONDS (0.9 * V2V_TEST_SECONDS)

static struct v2v_comm *the_world;

/* Folders to remove at exit, by the process that made them. */
static char folder[MOST_FOLDERS][PATH_BYTES];
static int folders;

double test_relative_l2(const float *a, const float *b, int64_t count)
{
    double difference = 0.0, norm = 0.0;
    for (int64_t i = 0; i < count; i++) {
        double d = (double)a[i] - (double)b[i];
        difference += d * d;
        norm += (double)b[i] * (double)b[i];
    }
    return norm > 0.0 ? sqrt(difference / norm) : sqrt(difference);
}

double test_relative_l2_to_double(const float *a, const double *b, int64_t count)
{
    double difference = 0.0, norm = 0.0;
    for (int64_t i = 0; i < count; i++) {
        double d = (double)a[i] - b[i];
        difference += d * d;
        norm += b[i] * b[i];
    }
    return norm > 0.0 ? sqrt(difference / norm) : sqrt(difference);
}

double test_rounding(double terms)
{
    return fmin(terms, 2.0 * sqrt(terms)) * 0x1p-24;
}

const char *test_shared(const char *name)
{
    static char path[PATH_BYTES];
    const char *root = getenv("V2V_SHARED");
    int length = snprintf(path, sizeof path, "%s/%s", root != NULL ? root : "", name);
    if (root == NULL || length >= (int)sizeof path || access(path, R_OK) != 0) {
        print_message("no %s: V2V_SHARED names the folder of the golden files\n", path);
        return NULL;
    }
    return path;
}

double *test_h5_read(const char *path, const char *dataset, int64_t *count)
{
    double *values = NULL;
    hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    hid_t set = file >= 0 ? H5Dopen2(file, dataset, H5P_DEFAULT) : -1;
    hid_t space = set >= 0 ? H5Dget_space(set) : -1;
    hssize_t elements = space >= 0 ? H5Sget_simple_extent_npoints(space) : -1;
    if (elements >= 0) {
        values = malloc((size_t)elements * sizeof *values + 1);
    }
    if (values != NULL &&
        H5Dread(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) < 0) {
        free(values);
        values = NULL;
    }
    if (space >= 0) {
        H5Sclose(space);
    }
    if (set >= 0) {
        H5Dclose(set);
    }
    if (file >= 0) {
        H5Fclose(file);
    }
    if (values == NULL) {
        fail_msg("%s: can't read dataset %s", path, dataset);
    }
    if (count != NULL) {
        *count = (int64_t)elements;
    }
    return values;
}

double test_h5_attribute(const char *path, const char *object, const char *name)
{
    double value = NAN;
    herr_t done = -1;
    hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    hid_t attribute =
        file >= 0 ? H5Aopen_by_name(file, object, name, H5P_DEFAULT, H5P_DEFAULT) : -1;
    if (attribute >= 0) {
        done = H5Aread(attribute, H5T_NATIVE_DOUBLE, &value);
        H5Aclose(attribute);
    }
    if (file >= 0) {
        H5Fclose(file);
    }
    if (done < 0) {
        fail_msg("%s: can't read attribute %s of %s", path, name, object);
    }
    return value;
}

void test_release(void *memory)
{
    free(memory);
}

static int remove_entry(const char *path, const struct stat *status, int kind, struct FTW *place)
{
    (void)status;
    (void)kind;
    (void)place;
    return remove(path);
}

static void remove_folders(void)
{
    for (int i = 0; i < folders; i++) {
        nftw(folder[i], remove_entry, 16, FTW_DEPTH | FTW_PHYS);
    }
}

/** Make a folder and see to its removal; path is "" when that fails. */
static void make_folder(char *path)
{
    const char *root = getenv("TMPDIR");
    snprintf(path, PATH_BYTES, "%s/v2v3d-test-XXXXXX", root != NULL ? root : "/tmp");
    if (folders == MOST_FOLDERS || mkdtemp(path) == NULL) {
        path[0] = '\0';
        return;
    }
    if (folders == 0) {
        atexit(remove_folders);
    }
    memcpy(folder[folders++], path, PATH_BYTES);
}

const char *test_folder(const struct v2v_comm *comm)
{
    static char path[MOST_FOLDERS][PATH_BYTES];
    static int given;
    char *fresh = path[given++ % MOST_FOLDERS];
    if (v2v_comm_rank(comm) == 0) {
        make_folder(fresh);
    }
    v2v_par_broadcast(comm, fresh, PATH_BYTES, 0);
    if (fresh[0] == '\0') {
        fail_msg("can't make a folder for the test");
    }
    return fresh;
}

void assert_same_bytes(const char *one, const char *other)
{
    FILE *files[] = {fopen(one, "rb"), fopen(other, "rb")};
    assert_true(files[0] != NULL && files[1] != NULL);
    int bytes[2];
    do {
        bytes[0] = fgetc(files[0]);
        bytes[1] = fgetc(files[1]);
        assert_int_equal(bytes[0], bytes[1]);
    } while (bytes[0] != EOF);
    assert_int_equal(fclose(files[0]), 0);
    assert_int_equal(fclose(files[1]), 0);
}

struct v2v_comm *test_world(void)
{
    return the_world;
}

/** What cmocka wrote on this rank, when something failed. */
static void show_report(FILE *report, int rank)
{
    char line[PATH_BYTES];
    rewind(report);
    while (fgets(line, sizeof line, report) != NULL) {
        dprintf(STDERR_FILENO, "[rank %d] %s", rank, line);
    }
}

void test_plan_faults(const char *const plans[4])
{
    const char *rank = getenv("OMPI_COMM_WORLD_RANK");
    if (rank != NULL && rank[0] >= '0' && rank[0] <= '3' && rank[1] == '\0') {
        setenv("V2V_FAULT", plans[rank[0] - '0'], 1);
    }
}

int test_mpi_run(const char *name, const struct CMUnitTest *tests, size_t count, int argc,
                 char **argv)
{
    FILE *report = NULL;
    if (v2v_par_init(&the_world, &argc, &argv) != V2V_OK) {
        fprintf(stderr, "%s\n", v2v_status_message());
        return 1;
    }
    int rank = v2v_comm_rank(the_world);
    if (rank > 0) {
        /* cmocka writes to these two streams; the log and the watchdog write to the descriptor and
         * stay visible. */
        report = tmpfile();
        if (report != NULL) {
            stdout = report;
            stderr = report;
        }
    }
    v2v_watchdog_arm(GROUP_SECONDS, "a group of tests");
    int64_t failures = _cmocka_run_group_tests(name, tests, count, NULL, NULL);
    if (report != NULL && failures != 0) {
        show_report(report, rank);
    }
    /* A rank that failed between two collectives leaves the others waiting; the watchdog then ends
     * them all. */
    v2v_watchdog_arm(GROUP_SECONDS / 4.0, "the end of a group of tests");
    v2v_par_max_i64(the_world, &failures, 1);
    v2v_watchdog_disarm();
    v2v_par_finalize(&the_world);
    return failures != 0;
}
