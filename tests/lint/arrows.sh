#!/bin/bash
# A room includes itself and the rooms that its v2v_room() names; those are below it; outside
# headers stay in the rooms that own them and out of include/.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
{
    find src -name CMakeLists.txt -exec awk '{ printf "%s\t%d\t%s\n", FILENAME, FNR, $0 }' {} +
    c_files src include | xargs -r awk -v keep_strings=1 -f "$lint_folder/strip.awk"
} | awk -f "$lint_folder/arrows.awk" | verdict
