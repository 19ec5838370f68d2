#!/usr/bin/env bash
# The demo, made tiny, leaves what it promises.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

works demo -c "$root/configs/tiny.yaml" -o shown --max-time 60s
says 'V2V3D'
[ "$(tail -1 stdout)" = 'pictures, volumes and results are in shown' ] ||
    fail "the last line names no folder: $(tail -1 stdout)"
for name in comparison.png results.txt results.json psf.h5 truth.h5 recording.h5 \
    volume.h5 rld.h5 rld_best.h5 run/weights.h5 run/metrics.jsonl config.yaml; do
    [ -s "shown/$name" ] || fail "no $name"
done
timed "$((limit * 10))" demo -c "$root/configs/tiny.yaml" -o shown
[ $? -eq 2 ] || fail "a second demo in the folder was not refused: $(cat stderr)"
finish
