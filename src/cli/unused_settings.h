/** Settings of the command line that a method leaves aside. */
#ifndef V2V_CLI_UNUSED_SETTINGS_H
#define V2V_CLI_UNUSED_SETTINGS_H

#include "cli/command.h"
#include "v2v3d/method/estimator.h"

/** Warn of each: of section deconv, of a method that needs no weights (weights have their own), of
 *  those of section recon that only some methods go by, and the gain. @kind Rank-0 */
void v2v_unused_settings_warn(const struct v2v_estimator_ops *ops,
                              const struct v2v_session *session);

#endif
