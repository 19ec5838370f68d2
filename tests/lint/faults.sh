#!/bin/bash
# Every fault point of the sources is named by a test.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
points=$(c_files src | xargs grep -noE 'V2V_FAULT_POINT\("[^"]+' /dev/null || true)
while IFS=: read -r file line point; do
    [[ -n $file ]] || continue # there is none
    grep -rqE "${point#*(}[\":]" tests || echo "$file:$line: no test fires the fault point ${point#*\"}"
done <<<"$points" | verdict
