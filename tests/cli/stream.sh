#!/usr/bin/env bash
# A long recording beside computing alone (tests/bench/stream.sh): that all of it runs; what it
# measures at this size says nothing.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

"$V2V_MAKE_BAD" "$folder" || exit 1
stream() { # NAME=VALUE...
    timeout -k 5 $((limit * 10)) bash "$root/tests/bench/stream.sh" "$program" psf.h5 volume.h5 \
        times.tsv "$@" >stdout 2>stderr
}

stream frames=2 turns=1 "ranks=1 $ranks" 'method=rld --iterations 1' || fail "stream.sh: $(cat stderr)"
awk -F '\t' 'NR > 1 { seen[$1 " " $2] = NF == 5 && $3 > 0 && $4 > 0 && $5 > 0 }
    END {
        for (ranks = 1; ranks <= 2; ranks++)
            good += seen[ranks " whole"] + seen[ranks " syncs"] + seen[ranks " writes"]
        exit !(good == 6 && NR == 7)
    }' times.tsv || fail "not six lines with figures: $(cat times.tsv)"
stream turn=1
[ $? -eq 2 ] || fail "a setting that there is not was taken: $(cat stderr)"
grep -q "no setting 'turn=1'" stderr || fail "no word on it: $(cat stderr)"
finish
