#!/bin/bash
# Files of src up to 650 lines, functions up to 80, lines up to 100 columns.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
c_files src include tests | xargs -r awk -f "$lint_folder/sizes.awk" | verdict
