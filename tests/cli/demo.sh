#!/usr/bin/env bash
# The demo, made tiny, leaves what it promises.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

# Skipping is the network's: RLD, which skips nothing, makes its volume all the same.
works demo -c "$root/configs/tiny.yaml" -o shown --max-time 60s --set recon.skip=auto --set deconv.method=tv
grep -q 'deconv.method is not a setting of demo' stderr || fail "a method that is not run: $(cat stderr)"
says 'V2V3D'
[ "$(tail -1 stdout)" = 'pictures, volumes and results are in shown' ] ||
    fail "the last line names no folder: $(tail -1 stdout)"
for name in comparison.png results.txt results.json psf.h5 truth.h5 recording.h5 \
    volume.h5 rld.h5 rld_best.h5 run/weights.h5 run/metrics.jsonl config.yaml; do
    [ -s "shown/$name" ] || fail "no $name"
done
works info shown
says '^shown: folder of a demo, its training in run/, network v2v, '
timed "$((limit * 10))" demo -c "$root/configs/tiny.yaml" -o shown
[ $? -eq 2 ] || fail "a second demo in the folder was not refused: $(cat stderr)"
# Nor does it take what others have there for its own.
mkdir foreign
echo 'my notes' >foreign/results.txt
for name in foreign 'of%n'; do
    timed "$((limit * 10))" demo -c "$root/configs/tiny.yaml" -o "$name"
    [ $? -eq 2 ] || fail "a demo in $name was not refused: $(cat stderr)"
done
[ ! -e 'of%n' ] || fail 'a refused demo made its folder'
[ "$(cat foreign/results.txt)" = 'my notes' ] || fail "a demo wrote over results.txt"
[ "$(ls foreign)" = results.txt ] || fail "a refused demo left something: $(ls foreign)"
# While another one works there, whatever it is asked.
exec 9>shown/config.yaml.v2v3d-lock
flock 9
for force in '' --force; do
    timed "$((limit * 10))" demo -c "$root/configs/tiny.yaml" --set demo.size=96 -o shown $force
    [ $? -eq 75 ] || fail "two demos in a folder: $(cat stderr)"
done
exec 9>&-
rm shown/config.yaml.v2v3d-lock
finish
