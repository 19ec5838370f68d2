#!/bin/bash
# No block of 8 lines that say something stands twice.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
c_files src include tests | xargs -r awk -v keep_strings=1 -f "$lint_folder/strip.awk" |
    awk -v block=8 -f "$lint_folder/duplicates.awk" | verdict
