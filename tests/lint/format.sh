#!/bin/bash
# clang-format 14, Debian 12's, has nothing to say; other versions differ in small things.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
need clang-format
if ! clang-format --version | grep -q 'version 14\.'; then
    echo "skipped: $(clang-format --version), 14 is needed"
    exit 77
fi
report=$(c_files src include tests | xargs -r clang-format --dry-run -Werror 2>&1) && exit 0
awk -F: '
    /: error: code should be clang-formatted/ {
        if (places[$1]++ == 0)
            first[$1] = $2
        next
    }
    /error/ { print }
    END {
        for (file in places)
            printf "%s:%d: the first of %d places for tools/dev format\n", file, first[file],
                places[file]
    }' <<<"$report" | sort
exit 1
