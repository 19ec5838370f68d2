#ifndef V2V_CLI_PATHS_H
#define V2V_CLI_PATHS_H

#include "cli/command.h"

/** With this word the program tries one way to compute, and ends: `v2v3d --try-path NUMBER`. */
#define V2V_CLI_TRY_PATH "--try-path"

/** Try every way to convolve that this build and processor have, each in a process of its own on
 *  every rank, and print what became of it: instructions that a processor announces can be illegal
 *  all the same. @param failed += those that died or erred and that the settings use
 *  @kind Collective(world) */
void v2v_cli_try_paths(int *failed, const struct v2v_session *session);

/** What such a process does. MPI was not started. @kind Local. @return the exit code */
int v2v_cli_try_path(const char *number);

#endif
