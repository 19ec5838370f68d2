#!/usr/bin/env bash
# Run time against error (tests/bench/pareto.sh): what it measures and does not measure again, and
# what table and picture say of lines that are known.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

pareto() { # FOLDER OPTION...
    timeout -k 5 $((limit * 10)) bash "$root/tests/bench/pareto.sh" "$program" "$@" >stdout 2>stderr
}

works demo -c "$root/configs/tiny.yaml" -o own
mkdir volumes
mv own/truth.h5 volumes/scene.h5
given=(--psf own/psf.h5 --volumes volumes --noises gaussian:0.1 --threads 1)

# without training, and two rows of one training of three seconds
given+=(--methods 'frl-1,tv-5e-2,width16-10m*' --minutes 0.05)
pareto runs "${given[@]}" || fail "pareto.sh: $(cat stderr)"
[ "$(wc -l <runs/results.tsv)" -eq 5 ] || fail "other lines: $(cat runs/results.tsv)"
awk -F '\t' 'NR > 1 && !(NF == 14 && $5 > 0 && $6 > 0 && $7 > 5 && $8 < 1 && $10 > 0 &&
                         ($3 ~ /^width/ ? $4 > 2 : $4 == 0)) { exit 1 }' runs/results.tsv ||
    fail "no good lines: $(cat runs/results.tsv)"
[ "$(awk -F '\t' '$3 ~ /^width/ { print $4 }' runs/results.tsv | sort -u | wc -l)" -eq 1 ] ||
    fail "not one training: $(cat runs/results.tsv)"

# once more: nothing; without a line: that one
cp runs/results.tsv first
pareto runs "${given[@]}" || fail "pareto.sh again: $(cat stderr)"
cmp -s first runs/results.tsv || fail 'what was done was run again'
grep -v 'tv-5e-2' first >runs/results.tsv
pareto runs "${given[@]}" || fail "pareto.sh, one line: $(cat stderr)"
grep -v 'tv-5e-2' runs/results.tsv | cmp -s - <(grep -v 'tv-5e-2' first) || fail 'other rows were run'
[ "$(grep -c 'tv-5e-2' runs/results.tsv)" -eq 1 ] || fail 'the missing row was not run'

# known lines: slow is twice as slow as good and worse, partial has one recording of two; the
# geometric mean of 2 s and 8 s (start and frame) is 4 s
mkdir known
line() { # SCENE METHOD TRAINING START FRAME PSNR, LOAD
    printf '%s\tgaussian:0.2\t%s\t%s\t%s\t%s\t%s\t0.5\t0.7\t1.01\t2\tabc\tbox\t%s\n' "$@" >>known/results.tsv
}
head -1 first >known/results.tsv
line a quick-1 0 0.5 0.5 20 0.5
line b quick-1 0 0.5 0.5 22 0.5
line a good 0 1 1 30 0.5
line b good 0 4 4 26 3
line a slow 0 2 2 27 0.5
line b slow 0 8 8 27 0.5
line a learnt 100 1 1 31 0.5
line b learnt 400 1 1 29 0.5
line a partial 0 0.1 0.1 40 0.5
printf 'b\tgaussian:0.2\tpartial\t-\n' >>known/results.tsv
pareto known --report || fail "--report: $(cat stderr)"
says '^Commit abc; box; threads: 2; load 0.5 to 3. Scenes: a, b.$'
says '^\| quick-1 \| none \| 0.5 s \| 0.5 s \| 21.00 / 0.500 \| 1.0100 \| yes \|$'
says '^\| good \| none \| 2.0 s \| 2.0 s \| 28.00 / 0.500 \| 1.0100 \| yes \|$'
says '^\| slow \| none \| 4.0 s \| 4.0 s \| 27.00 / 0.500 \| 1.0100 \|  \|$'
says '^\| learnt \| 3.3 min \| 1.0 s \| 1.0 s \| 30.00 / 0.500 \| 1.0100 \| yes \|$'
says '^\| partial \| none \| 0.1 s \| 0.1 s \| 40.00 / 0.500 \(1 of 2\) \| 1.0100 \|  \|$'
awk '$1 == "good" && $2 > 3.999 && $2 < 4.001 && $3 == $2 { found++ }
     $1 == "learnt" && $2 > 202.4 && $2 < 202.5 && $3 == 2 { found++ }
     $1 == "partial" { found = -9 }
     END { exit found != 2 }' known/points.tsv || fail "points: $(cat known/points.tsv)"
# width and height stand after the signature and the head of the first chunk
[ "$(od -An -tu1 -j16 -N8 known/pareto.png | xargs)" = '0 0 4 216 0 0 2 248' ] ||
    fail 'no picture of 1240 x 760 pixels'

pareto runs --scenes other "${given[@]}" && fail 'a scene that there is not was taken'
grep -q 'there is no .*/other' stderr || fail "no word of the missing scene: $(cat stderr)"
pareto runs --unknown 3 && fail 'an unknown option was taken'
finish
