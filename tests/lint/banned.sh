#!/bin/bash
# Calls that have a better, or exactly one, place.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
c_files src include | xargs -r awk -f "$lint_folder/strip.awk" |
    awk -f "$lint_folder/banned.awk" | verdict
