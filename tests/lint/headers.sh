#!/bin/bash
# Each public header compiles alone, twice in a row, as C17 and as C++17.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
need gcc g++
failures=0
while IFS= read -r header; do
    lines=$(printf '#include "%s"\n' "${header#include/}" "${header#include/}")
    for language in 'gcc -std=c17 -x c' 'g++ -std=c++17 -x c++'; do
        read -ra compile <<<"$language"
        if ! "${compile[@]}" -Wall -Wextra -Werror -fsyntax-only -Iinclude - <<<"$lines"; then
            echo "$header:1: does not compile alone: $language"
            failures=$((failures + 1))
        fi
    done
done < <(c_files include)
[[ $failures -eq 0 ]]
