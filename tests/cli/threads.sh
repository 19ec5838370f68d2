#!/usr/bin/env bash
# Threads that wait for others sleep soon, so that they do not take the core from whom they wait for;
# who says how they shall wait is obeyed.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"
unset GOMP_SPINCOUNT

# waits PATTERN: so says libgomp, of the last start of the program.
waits() {
    local said
    said=$(env OMP_DISPLAY_ENV=VERBOSE "$program" --version 2>&1 | grep -E 'GOMP_SPINCOUNT|WAIT_POLICY')
    printf '%s\n' "$said" | tail -n 2 | grep -qE -- "$1" || fail "no \"$1\" in: $said"
}
waits "GOMP_SPINCOUNT = '1000'"
GOMP_SPINCOUNT=77 waits "GOMP_SPINCOUNT = '77'"
OMP_WAIT_POLICY=ACTIVE waits "WAIT_POLICY = 'ACTIVE'"

"$V2V_MAKE_BAD" "$folder" || exit 1
deconvolve=(deconvolve --method rld --iterations 1 --psf psf.h5 --input recording.h5 --threads 2)
works "${deconvolve[@]}" -o first.h5
grep -q "$ranks ranks x 2 threads, GOMP_SPINCOUNT 1000" stderr || fail "not said: $(cat stderr)"
export OMP_WAIT_POLICY=passive
works "${deconvolve[@]}" -o second.h5
grep -q "$ranks ranks x 2 threads, OMP_WAIT_POLICY passive" stderr || fail "not said: $(cat stderr)"
same first.h5 second.h5 /volume

# Ranks of unequal threads decide alike what they share, whatever memory their threads take.
if [ "$ranks" -eq 2 ]; then
    deconvolve=(deconvolve --psf psf.h5 --input recording.h5 --frames 0:1 --iterations 3)
    works "${deconvolve[@]}" --threads 1 -o equal.h5
    unequal() { # words...
        timeout -k 5 $((limit * 10)) mpirun --oversubscribe --bind-to none \
            -n 1 -x OMP_NUM_THREADS=1 "$program" "$@" : -n 1 -x OMP_NUM_THREADS=3 "$program" "$@" \
            >stdout 2>stderr </dev/null || fail "unequal threads, $*: exit code $?, $(cat stderr)"
    }
    unequal "${deconvolve[@]}" -o unequal.h5
    grep -q '2 shard ranks' stderr || fail "the frame is not shared: $(cat stderr)"
    same equal.h5 unequal.h5 /volume
    unequal "${deconvolve[@]}" -o bounded.h5 --max-mem 0.02
    same equal.h5 bounded.h5 /volume
fi
finish
