#!/bin/bash
# What comments, messages and pages refer to is in this repository: documents, links, sections of
# src/REFERENCE.md; no discussion elsewhere. The front page is short.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
files=$(find . \( -name .git -o -name build -o -name demo-out \) -prune -o -type f -print | sort)
# shellcheck disable=SC2016 # awk expands, not the shell
{
    printf '%s\n==\n' "$files"
    # the lints' own cases cite what is not there
    grep -E '^\./((src|include|tests|tools|jobs|configs|\.ci|\.github)/|[^/]*\.(md|txt|json)$)' \
        <<<"$files" | grep -vE '\.png$|^\./tests/lint/' |
        xargs -d '\n' awk '{ printf "%s\t%d\t%s\n", substr(FILENAME, 3), FNR, $0 }'
} | awk -v most=130 -f "$lint_folder/citations.awk" | verdict
