# shellcheck shell=bash
# What the scripts share. Each begins with:
#   . "$(dirname "$0")/lib.sh"
# and ends with `finish`. Called as NAME.sh PROGRAM RANKS.
set -u
program=$1
ranks=$2
limit=${V2V_CLI_LIMIT:-10} # seconds a failing command may take (src/README.md, invariants)
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
export root=${V2V_ROOT:-$here/../..}
folder=$(mktemp -d "${TMPDIR:-/tmp}/v2v3d-cli.XXXXXX")
trap 'rm -rf "$folder"' EXIT
cd "$folder" || exit 1
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
failures=0
for tool in h5diff h5dump; do
    if ! command -v $tool >/dev/null; then
        echo "skipped: $tool is not installed"
        exit 77
    fi
done

# What a command line begins with, before the program.
launch=()
[ "$ranks" -eq 1 ] || launch=(mpirun --oversubscribe --bind-to none -n "$ranks")

fail() {
    echo "FAILED: $*"
    failures=$((failures + 1))
}

# timed SECONDS words...: run the program with a limit; output in the files stdout and stderr.
timed() {
    local seconds=$1
    shift
    timeout -k 5 "$seconds" "${launch[@]}" "$program" "$@" >stdout 2>stderr </dev/null
}

# works words...: exit code 0, nothing left in memory.
works() {
    timed "$((limit * 10))" "$@"
    local code=$?
    if [ $code -ne 0 ]; then
        fail "v2v3d $* ended with $code: $(cat stderr)"
    elif grep -q 'still held' stderr; then
        fail "v2v3d $*: $(grep 'still held' stderr)"
    fi
}

# refuses CODE PATTERN words...: that exit code, within the limit, exactly one line of error, which
# matches PATTERN (extended), and no file whose name begins with "out".
refuses() {
    local wanted=$1 pattern=$2
    shift 2
    timed "$limit" "$@"
    local code=$? lines
    lines=$(grep -cE '^(v2v3d|error|warning)' stderr)
    if [ $code -eq 124 ] || [ $code -eq 137 ]; then
        fail "v2v3d $*: took longer than $limit s"
    elif [ $code -ne "$wanted" ]; then
        fail "v2v3d $*: exit code $code, not $wanted: $(cat stderr)"
    elif [ "$lines" -ne 1 ]; then
        fail "v2v3d $*: $lines lines of error: $(cat stderr)"
    elif ! grep -E '^v2v3d' stderr | grep -qE -- "$pattern"; then
        fail "v2v3d $*: no \"$pattern\" in: $(cat stderr)"
    fi
    if compgen -G 'out*' >/dev/null; then
        fail "v2v3d $*: left $(echo out*) behind"
        rm -rf out*
    fi
}

# says PATTERN: the last command printed it.
says() {
    grep -qE -- "$1" stdout || fail "no \"$1\" in: $(cat stdout)"
}

# same FIRST SECOND DATASET [BOUND]: no element differs (by more than BOUND); attributes may.
same() {
    local different
    different=$(h5diff -c ${4:+-d "$4"} "$1" "$2" "$3" "$3" 2>&1)
    [ -z "$different" ] || fail "$1 and $2 differ in $3: $different"
}

# rows_by_workers TABLE LEAST FUNCTION: FUNCTION OUTCOME EXPECTED words... for every row of the table,
# of which there are LEAST or more. Rows first, first + workers, .. in a copy of this folder: starting
# MPI is mostly waiting, so several go side by side.
workers=4
one_worker() { # FIRST FUNCTION
    local first=$1 each=$2 row=0 line words expected
    cp -a . "$folder/worker$first"
    cd "$folder/worker$first" || exit 1
    while IFS= read -r line; do
        row=$((row + 1))
        [ $((row % workers)) -eq "$first" ] || continue
        read -r -a words <<<"${line##* | }"
        expected=${line#* | }
        "$each" "${line%% | *}" "${expected% | *}" "${words[@]}"
    done <"$folder/rows"
    exit $((failures > 0))
}
rows_by_workers() {
    local count i job jobs=()
    count=$(grep -vE '^(#|$)' "$1" | tee "$folder/rows" | wc -l)
    [ "$count" -ge "$2" ] || fail "only $count rows"
    for ((i = 0; i < workers; i++)); do
        (trap - EXIT && one_worker "$i" "$3") &
        jobs+=($!)
    done
    for job in "${jobs[@]}"; do
        wait "$job" || failures=$((failures + 1))
    done
}

finish() {
    [ "$failures" -eq 0 ] && exit 0
    echo "$failures checks failed"
    exit 1
}
