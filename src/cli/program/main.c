#include "cli/command.h"
#include "cli/threads.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/** All files are closed and MPI has ended: nothing is left to do at exit, where handlers of
 *  libraries take away what their threads may still stand on. */
static _Noreturn void leave(int code)
{
    if (fflush(stdout) != 0 && errno != EPIPE && code == 0) {
        fprintf(stderr, "v2v3d: standard output: %s\n", strerror(errno));
        code = v2v_status_exit_code(V2V_E_IO);
    }
#ifdef V2V_EXIT /* sanitizers look for leaks at exit, gcov writes its counts */
    exit(code);
#else
    _exit(code);
#endif
}

int main(int argc, char **argv)
{
    v2v_cli_settle_waiting(argv);
    leave(v2v_cli_main(argc, argv));
}
