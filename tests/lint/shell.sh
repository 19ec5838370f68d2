#!/bin/bash
# The scripts pass shellcheck.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
need shellcheck
{
    for script in tools/dev .ci/run; do
        [[ ! -f $script ]] || echo "$script"
    done
    for folder in tools jobs tests; do
        [[ ! -d $folder ]] || find "$folder" -type f \( -name '*.sh' -o -name '*.sbatch' \)
    done
} | sort | xargs -r shellcheck --external-sources --source-path=SCRIPTDIR
