#!/usr/bin/env bash
# `v2v3d check --scaling`: what it measures, and a table whose rows add up.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

cp "$root/configs/tiny.yaml" .
export OMP_NUM_THREADS=1
works check --scaling -c tiny.yaml --set train.batch=3 --frames 5 --side 64 --scratch . \
    --link-rate 0.125
says '^scaling, by figures of this run: forward pass of width 4 on 64 x 64 [0-9]'
says '^between hosts: 0\.125 GB/s a host, message 20 us; given, not measured$'
says '^files: [0-9.e+]+ GB/s by all ranks together$'
if [ "$ranks" -eq 1 ]; then
    says '^inside a host: not measured, for a rank alone; taken as free$'
else
    says '^inside a host: message [0-9.e-]+ us, exchange '
fi
! compgen -G 'v2v3d-check*' >left || fail "$(cat left) is still there"

# Each share is rounded to a tenth of a percent: six of them are off by less than 0.3 together.
awk '
$2 == "strong" || $2 == "weak" {
    rows++
    items = ($1 == "training" ? 3 : 5) * ($2 == "weak" ? $3 : 1)
    split($5, grid, "x")
    sum = $12 + $13 + $14 + $15 + $16 + $17
    if ($6 != items || grid[1] * grid[2] * grid[3] > $3 || !($7 > 0) || !(sum > 99.6 && sum < 100.4)) {
        print
        bad = 1
    }
    if ($3 == 1 && ($5 != "1x1x1" || $8 != 1))
        bad = 1
}
END { exit rows != 24 || bad }' stdout || fail "rows that do not add up: $(cat stdout)"

works check --scaling -c tiny.yaml --frames 2 --side 32
says '^files: not measured .--scratch., taken as free$'
refuses 2 '--link-rate: ' check --scaling --link-rate 0
refuses 74 'nowhere' check --scaling -c tiny.yaml --side 32 --scratch nowhere
finish
