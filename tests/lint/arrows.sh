#!/bin/bash
# Outside headers stay in the rooms that own them and out of include/: a compiler finds those of
# /usr/include everywhere. What rooms include of each other the build decides (rooms.sh).
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
c_files src include | xargs -r awk -v keep_strings=1 -f "$lint_folder/strip.awk" |
    awk -f "$lint_folder/arrows.awk" | verdict
