#!/bin/bash
# tools/cmake/rooms.cmake gives a room the headers of the rooms that it names and its own private
# ones: a small house of three rooms builds, and each forbidden include planted in it does not.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
need cmake
root=$PWD
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
failures=0
mkdir -p "$scratch"/src/{base,par,io} "$scratch"/include/v2v3d/{base,par,io}
cd "$scratch"
cat >CMakeLists.txt <<END
cmake_minimum_required(VERSION 3.25)
project(house VERSION 1 LANGUAGES C)
add_library(OpenMP::OpenMP_C INTERFACE IMPORTED)
include($root/tools/cmake/rooms.cmake)
foreach(room base par io)
  add_subdirectory(src/\${room})
endforeach()
END

room() # NAME WORD...: WORDs go to v2v_room()
{
    local name=$1
    echo "v2v_room($name ${*:2})" >"src/$name/CMakeLists.txt"
    echo "int $name(void);" | tee "include/v2v3d/$name/public.h" >"src/$name/private.h"
    printf '#include "v2v3d/%s/public.h"\n#include "%s/private.h"\nint %s(void) { return 0; }\n' \
        "$name" "$name" "$name" >"src/$name/$name.c"
}

build() # [FILE LINE]: with this line added to the file
{
    room base
    room par ROOMS base
    room io ROOMS par HEADERS par/private.h
    [[ $# -eq 0 ]] || echo "$2" >>"$1"
    cmake -S . -B build >report 2>&1 && cmake --build build >>report 2>&1
}

build || { echo 'the house does not build as it is:' && cat report && exit 1; }
build src/io/io.c '#include "par/private.h"' ||
    { echo 'a shared private header is not found:' && cat report && failures=1; }
build src/par/par.c '#include "v2v3d/base/public.h"' ||
    { echo 'the header of a room below is not found:' && cat report && failures=1; }

# file | line | what the report must say
while IFS='|' read -r file line words; do
    if build "$file" "$line" || ! grep -qF -- "$words" report; then
        echo "$file, $line: expected a failure with \"$words\":"
        cat report
        failures=1
    fi
done <<'END'
src/base/base.c|#include "v2v3d/par/public.h"|v2v3d/par/public.h: No such file
include/v2v3d/par/public.h|#include "v2v3d/io/public.h"|v2v3d/io/public.h: No such file
src/io/io.c|#include "v2v3d/base/public.h"|v2v3d/base/public.h: No such file
src/par/par.c|#include "base/private.h"|base/private.h: No such file
src/io/io.c|#include "base/private.h"|base/private.h: No such file
src/base/CMakeLists.txt|v2v_room(attic ROOMS io)|names io, which is not below it
END
exit "$failures"
