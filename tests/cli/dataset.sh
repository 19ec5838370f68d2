#!/usr/bin/env bash
# Data sets of scenes: which files, the same on any ranks, gone on with, refused.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

works psf simulate -c "$root/configs/tiny.yaml" -o psf.h5
common=(dataset --psf psf.h5 --seed 4 --size 40x48)

# matches FOLDER OTHER: the other has its files, to the bit: a scene is of one rank, whatever their number.
matches() {
    local file name set
    for file in "$1"/*/*.h5; do
        name=$2/${file#*/}
        set=/views
        [[ $file == *_truth.h5 ]] && set=/volume
        [ -e "$name" ] || fail "$name is missing"
        same "$file" "$name" $set
    done
}

works "${common[@]}" --count 21 -o set
says 'set: 21 scenes made, 0 kept'
listed=$(cd set && echo */*_noisy.h5)
wanted=$(printf 'test/%06d_noisy.h5 ' 9 19
    printf 'train/%06d_noisy.h5 ' 0 1 2 3 4 5 6 7 10 11 12 13 14 15 16 17 20
    printf 'validation/%06d_noisy.h5 ' 8 18)
[ "$listed" = "${wanted% }" ] || fail "other files: $listed"
[ "$(find set -name '*.h5' | wc -l)" -eq 63 ] || fail "not three files a scene: $(find set)"
works info set/train/000003_truth.h5
says 'volume, 1 frames, 7 slices of 40 x 48'
works info set/validation/000008_clean.h5
says 'recording, 1 frames, 5 views of 40 x 48'
"$program" "${common[@]}" --count 21 -o alone >stdout 2>stderr || fail "$(cat stderr)"
matches set alone

# A scene is that of `simulate`, to the round-off of sums over ranks' slices of views of at most 1; scene 12 is of the kind (12 + 1) mod 8.
works simulate --scene filaments --psf psf.h5 --seed 4000012 --size 40x48 --noise gaussian:0.2 -o scene.h5
same scene.h5 set/train/000012_noisy.h5 /views 1e-5

# Gone on with: what is missing is made, what is there is left alone, more can be asked for.
rm set/test/000009_noisy.h5 set/train/000002_*.h5 set/train/000003_truth.h5
touch -d 2001-01-01 set/train/000001_noisy.h5
works "${common[@]}" --count 23 -o set --resume
says 'set: 5 scenes made, 18 kept'
[ "$(stat -c %Y set/train/000001_noisy.h5)" -lt 1000000000 ] || fail 'a complete scene was made again'
matches alone set
refuses 2 'set: holds a data set already; --resume' "${common[@]}" --count 21 -o set
for words in '--seed 5' '--size 48' '--noise gaussian:0.1' '--scenes cells' '--pixel-size 1'; do
    read -r -a words <<<"$words"
    refuses 2 'set: holds a data set of other settings: .*"seed": 4' "${common[@]}" --count 21 \
        "${words[@]}" -o set --resume
done
works dataset --psf psf.h5 --count 2 --scenes beads cells --noise camera:800 --size 64 -o set --force
works info set/train/000001_noisy.h5 --json
says '"offset": 100'

# Never scenes of other settings than dataset.json says: not after --force with a smaller count, not
# after one that was stopped, not where dataset.json is gone.
works "${common[@]}" --count 12 -o mixed
works "${common[@]}" --seed 5 --count 3 -o mixed --force
[ "$(find mixed -name '*.h5' | wc -l)" -eq 9 ] || fail "scenes of another seed are left: $(find mixed)"
works "${common[@]}" --seed 5 --count 12 -o mixed --resume
says 'mixed: 9 scenes made, 3 kept'
rm mixed/dataset.json
refuses 2 'mixed: holds scenes of unknown settings' "${common[@]}" --count 2 -o mixed
refuses 2 'mixed: holds scenes of unknown settings' "${common[@]}" --count 2 -o mixed --resume
mkdir empty
echo mine >empty/mine
refuses 65 'scene 0, beads: noise is relative.*; another --seed' dataset --psf psf.h5 --count 2 \
    --scenes beads --size 512 --pixel-size 0.15 --slice-spacing 0.15 -o out
refuses 2 'would have .* structures' dataset --psf psf.h5 --count 2 --pixel-size 1000 -o empty
refuses 2 'would have .* structures' simulate --psf psf.h5 --scene beads --slice-spacing 1000000 -o out.h5
refuses 2 'input.slices says how a --volume is read' simulate --psf psf.h5 --scene beads --slices 9 -o out.h5
[ "$(ls -A empty)" = mine ] || fail "a refused run left $(ls -A empty)"

echo mine >file
refuses 2 'file: is a file' "${common[@]}" --count 1 -o file
refuses 2 "scene 'axons' is none of" "${common[@]}" --count 1 --scenes axons -o out
refuses 2 '--count: ' "${common[@]}" --count 0 -o out
refuses 65 'none.h5: ' dataset --psf none.h5 --count 1 -o out
refuses 74 'out/dataset.json: needs .* GB, the disk has' dataset --psf psf.h5 --size 4096 \
    --count 1000000 -o out

# SIGTERM ends it after a scene.
if [ "$ranks" -eq 1 ]; then
    "$program" "${common[@]}" --count 20000 -o long 2>log &
    pid=$!
    for _ in $(seq 100); do
        compgen -G 'long/train/*_noisy.h5' >/dev/null && break
        sleep 0.1
    done
    kill -TERM $pid
    wait $pid
    code=$?
    [ $code -eq 85 ] || fail "SIGTERM: exit code $code, not 85: $(cat log)"
    grep -q 'stopped on request; go on with --resume' log || fail "no word of how to go on: $(cat log)"
    [ -z "$(find long -name '*.v2v3d-*')" ] || fail "left behind: $(find long -name '*.v2v3d-*')"
fi
finish
