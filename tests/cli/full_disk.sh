#!/usr/bin/env bash
# A disk that fills up at any write ends a command with 74 and one line: HDF5 tries again, and then
# crashes, when MPI ends.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

"$V2V_MAKE_BAD" "$folder" || exit 1
deconvolve=(deconvolve --method rld --iterations 1 --psf psf.h5 --input recording.h5)
export LD_PRELOAD=$V2V_FULL
for from in $(seq 15); do
    export FULL_FROM=$from
    timed "$limit" "${deconvolve[@]}" -o "volume_$from.h5" # frames that are done stay, for --resume
    code=$?
    [ $code -eq 74 ] || fail "full from write $from on: exit code $code: $(cat stderr)"
    grep -q '^v2v3d deconvolve: .*No space left' stderr || fail "no word on it: $(cat stderr)"
    ((from > 10)) || refuses 74 'No space left' convert --input volume.h5 -o out.h5
    ((from > 10)) ||
        refuses 74 'No space left' convert --input volume.h5 -o out.h5 --output-type uint16
    ! grep -q ': writing failed: No space left' stderr || by_thread=1
done
[ -n "${by_thread:-}" ] || fail "no frame's data met the full disk"

# It is that of all recordings of a run.
export FULL_FROM=1
cp recording.h5 second.h5
timed "$limit" "${deconvolve[@]}" second.h5 -o %n_out.h5
code=$?
[ $code -eq 74 ] || fail "two recordings: exit code $code: $(cat stderr)"
grep -q '^v2v3d deconvolve: .*No space left' stderr || fail "two recordings: $(cat stderr)"
grep -q '^0 of 2 recordings' stderr || fail "two recordings: $(cat stderr)"
unset LD_PRELOAD FULL_FROM
works "${deconvolve[@]}" -o volume_out.h5
finish
