/** Settings of the command line that a method, or a command, leaves aside. */
#ifndef V2V_CLI_UNUSED_SETTINGS_H
#define V2V_CLI_UNUSED_SETTINGS_H

#include "cli/command.h"
#include "v2v3d/method/estimator.h"
#include "v2v3d/method/networks.h"

/** Warn of each: of section deconv, of those of section recon that only some methods go by, and the
 *  gain. @kind Rank-0 */
void v2v_unused_settings_warn(const struct v2v_estimator_ops *ops,
                              const struct v2v_session *session);

/** Likewise where a network is trained; also of what is another network's. @kind Rank-0 */
void v2v_unused_settings_warn_training(const struct v2v_network_ops *ops,
                                       const struct v2v_session *session);

/** Likewise of what a command leaves aside. @kind Rank-0 @param command calibrate or evaluate */
void v2v_unused_settings_warn_command(const char *command, const struct v2v_session *session);

#endif
