# shellcheck shell=bash
# What the cluster tests share. Each begins with
#   . "$(dirname "$0")/lib.sh"
#   use_sandbox slurm|hosts
# and ends with `finish`. Called as NAME.sh PROGRAM. Whatever happens, nothing keeps running.
set -u
program=$1
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=${V2V_ROOT:-$here/../..}
folder=$(mktemp -d "${TMPDIR:-/tmp}/v2v3d-cluster.XXXXXX")
chmod 755 "$folder"
cd "$folder" || exit 1
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMP_NUM_THREADS=1
# a file that a running job writes can be looked at
export HDF5_USE_FILE_LOCKING=FALSE
failures=0
sandbox=''

clean_up() {
    [ -z "$sandbox" ] || "$sandbox" down "$folder/sandbox" >/dev/null 2>&1
    cd / && rm -rf "$folder"
}
trap clean_up EXIT
trap 'exit 143' TERM INT HUP PIPE

fail() {
    echo "FAILED: $*"
    failures=$((failures + 1))
}

# For what the rest of the test builds on.
give_up() {
    fail "$@"
    finish
}

finish() {
    [ "$failures" -eq 0 ] && exit 0
    echo "$failures checks failed"
    exit 1
}

# use_sandbox NAME: start tools/cluster/NAME, or skip with the reason why it can't be started.
use_sandbox() {
    local obstacle
    obstacle=$("$root/tools/cluster/$1" obstacle "$folder/sandbox")
    command -v h5diff >/dev/null || obstacle='h5diff is not installed'
    if [ -n "$obstacle" ]; then
        echo "skipped: $obstacle"
        exit 77
    fi
    sandbox=$root/tools/cluster/$1
    "$sandbox" up "$folder/sandbox" || give_up "the sandbox did not start"
}

seconds() {
    date +%s.%N
}

# since START: seconds since then, with one decimal.
since() {
    awk -v a="$1" -v b="$(seconds)" 'BEGIN { printf "%.1f", b - a }'
}

# within SECONDS COMMAND...: wait until the command succeeds.
within() {
    local end=$((SECONDS + $1))
    shift
    until "$@"; do
        [ $SECONDS -lt $end ] || return 1
        sleep 0.2
    done
}

# Optics, a recording of FRAMES frames, and weights, in scene/.
make_scene() { # FRAMES SIZE
    "$program" demo -c "$root/configs/tiny.yaml" --set "demo.size=$2" --quiet -o scene \
        >scene.log 2>&1 || give_up "no scene: $(tail -n 3 scene.log)"
    "$program" simulate --quiet --psf scene/psf.h5 --volume scene/truth.h5 -o recording.h5 \
        --noise gaussian:0.2 --seed 5 --frames "$1" || give_up "no recording"
}

lines_of() {
    if [ -e "$1" ]; then wc -l <"$1"; else echo 0; fi
}

# same FIRST SECOND [DATASET]: no bit differs, but for how long it took.
same() {
    local different
    different=$(h5diff "$1" "$2" ${3:+"$3" "$3"} 2>&1 |
        grep -v -e '^attribute: <seconds of </>>' -e ' differences found$')
    [ -z "$different" ] || fail "$1 and $2 differ: $(head -n 5 <<<"$different")"
}
