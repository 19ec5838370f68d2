#!/usr/bin/env bash
# consumer.sh BUILD: what `cmake --install` leaves is all that a program outside needs, with the
# libraries found by CMake's modules and by pkg-config; what neither finds is named.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=$1
folder=$(mktemp -d "${TMPDIR:-/tmp}/v2v3d-install.XXXXXX")
trap 'rm -rf "$folder"' EXIT
cd "$folder"

fail()
{
    echo "FAILED: $*"
    exit 1
}

cmake --install "$build" --prefix "$folder/prefix" >log || fail "$(cat log)"
mv prefix elsewhere # nothing may remember where it was installed
prefix=$folder/elsewhere
"$prefix/bin/v2v3d" --version | grep -q '^v2v3d ' || fail 'the installed program does not start'
for path in share/v2v3d/jobs/train.sbatch share/v2v3d/configs/tiny.yaml include/v2v3d/op/conv.h; do
    [[ -f $prefix/$path ]] || fail "$path was not installed"
done
export V2V3D_HOME=$prefix/share/v2v3d
# shellcheck disable=SC2016 # expanded there
found=$(bash -c '. "$V2V3D_HOME/jobs/common.sh" && echo "$program"')
[[ $found -ef $prefix/bin/v2v3d ]] || fail "the installed jobs would run '$found'"
cp -r "$here" source

# configure FOLDER WORD...
configure()
{
    cmake -S source -B "$1" -DCMAKE_PREFIX_PATH="$prefix" "${@:2}" >log 2>&1
}

# links FOLDER: both programs build and run
links()
{
    cmake --build "$1" >log 2>&1 || fail "$(cat log)"
    for program in consumer_c consumer_cxx; do
        "$1/$program" "$prefix/share/v2v3d/configs/tiny.yaml" || fail "$1/$program"
    done
}

no_modules=()
for package in MPI HDF5 TIFF PNG ZLIB; do
    no_modules+=("-DCMAKE_DISABLE_FIND_PACKAGE_$package=ON")
done
PKG_CONFIG_LIBDIR=/nonexistent configure by_modules || fail "$(cat log)"
links by_modules
configure by_pkg_config "${no_modules[@]}" || fail "$(cat log)"
links by_pkg_config
if PKG_CONFIG_LIBDIR=/nonexistent configure by_nothing "${no_modules[@]}"; then
    fail 'configured without MPI'
fi
for text in 'MPI (Debian: libopenmpi-dev)' 'HDF5 built with MPI (Debian: libhdf5-openmpi-dev)'; do
    grep -qF "$text" log || fail "no \"$text\" in: $(cat log)"
done
