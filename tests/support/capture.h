/** What code does to its process: what it writes to stderr, how it ends. */
#ifndef V2V_TEST_CAPTURE_H
#define V2V_TEST_CAPTURE_H

#include <stddef.h>

/** From here on stderr goes into a hidden file. */
void test_capture_begin(void);

/** stderr is itself again; text[bytes] gets what was written, with a closing zero. */
void test_capture_end(char *text, size_t bytes);

/** Run `act` in a child process. Its exit code, or 128 + the signal that ended it; text[bytes] gets
 *  what it wrote to stderr. */
int test_in_child(void (*act)(void), char *text, size_t bytes);

/** Run this very program with one argument as a job of `ranks` ranks. The job's exit code; text
 *  gets all that it wrote. Skips the test when there is no mpirun; one rank goes without it. */
int test_own_job(int ranks, const char *argument, char *text, size_t bytes);

#endif
