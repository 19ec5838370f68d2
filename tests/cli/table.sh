#!/usr/bin/env bash
# The paper's table (tests/bench/table.sh): what it measures and does not measure again, what table
# and picture say, and what it hands to Slurm.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

table() { # FOLDER OPTION...
    timeout -k 5 $((limit * 15)) bash "$root/tests/bench/table.sh" "$program" "$@" >stdout 2>stderr
}

works demo -c "$root/configs/tiny.yaml" -o own
mkdir volumes
mv own/truth.h5 volumes/scene.h5
given=(--psf own/psf.h5 --volumes volumes --noises gaussian:0.1 --threads 1)
few=("${given[@]}" --budget quick --seconds 1 --scenes 'scene,drawn-beads'
    --methods 'rld-best,tv,v2v3d,v2v3d-max,tv-crop')

# two methods of one training, two without, one on the middle; views are left out for two of them
table runs "${few[@]}" || fail "table.sh: $(cat stderr)"
[ "$(wc -l <runs/results.tsv)" -eq 11 ] || fail "other lines: $(cat runs/results.tsv)"
awk -F '\t' 'NR > 1 && !(NF == 18 && $5 > 0 && $6 > 0 && $7 > 5 && $8 < 1 &&
                         ($3 ~ /^v2v3d/ ? $4 > 0.5 && $11 > 1000 : $4 == 0 && $11 == "-") &&
                         ($3 ~ /^v2v3d/ ? $18 > 0 : $18 == "-") &&
                         ($3 ~ /^(tv|v2v3d)$/ ? $9 > 0 && $10 > 0 : $9 == "-")) { exit 1 }' \
    runs/results.tsv || fail "no good lines: $(cat runs/results.tsv)"
[ "$(awk -F '\t' '$3 ~ /^v2v3d/ { print $4 }' runs/results.tsv | sort -u | wc -l)" -eq 1 ] ||
    fail "not one training: $(cat runs/results.tsv)"
[ "$(compgen -G 'runs/pictures/*/v2v3d.h5' | wc -l)" -eq 2 ] || fail "pictures: $(ls runs/pictures/*)"
# six cells of 192 pixels and gaps of 8; two scenes with a truth, a view and five methods take two
# rows each, of 192 pixels, 12 of label and 8
[ "$(od -An -tu1 -j16 -N8 runs/table.png | xargs)" = '0 0 4 184 0 0 3 88' ] ||
    fail "no picture of 1208 x 856 pixels: $(od -An -tu1 -j16 -N8 runs/table.png)"

# once more: nothing, without a line: that one; another budget: refused
cp runs/results.tsv first
table runs "${few[@]}" || fail "table.sh again: $(cat stderr)"
cmp -s first runs/results.tsv || fail 'what was done was run again'
grep -v 'beads.*tv-crop' first >runs/results.tsv
table runs "${few[@]}" || fail "table.sh, one line: $(cat stderr)"
grep -v 'beads.*tv-crop' runs/results.tsv | cmp -s - <(grep -v 'beads.*tv-crop' first) ||
    fail 'other rows were run'
[ "$(grep -c 'beads.*tv-crop' runs/results.tsv)" -eq 1 ] || fail 'the missing row was not run'
table runs "${few[@]}" --seconds 2 && fail 'two budgets in one folder'
grep -q 'was begun otherwise' stderr || fail "no word of the other budget: $(cat stderr)"

# known lines
mkdir known
line() { # SCENE METHOD TRAINING FRAME PSNR HELDOUT PARAMETERS LOAD STEPS
    printf '%s\tgaussian:0.2\t%s\t%s\t9\t%s\t%s\t0.5\t%s\t1\t%s\t9 x 9\t2\t1\tabc\tbox\t%s\t%s\n' "$@" >>known/results.tsv
}
head -1 first >known/results.tsv
line a v2v3d 100 0.5 30 0.25 1000 0.5 600
line b v2v3d 100 1.5 33 0.75 1000 3 600
line a tv 0 4 28 - - 0.5 -
table known --report || fail "--report: $(cat stderr)"
says '^Commit abc; box; threads: 2; load 0.5 to 3. Scenes: a, b.$'
says '^\| tv \|  \| 28.00 / 0.500 \(1 of 2\) \| - \| - \| - \| 4 \| - \|$'
says '^\| v2v3d \| 39.05 / 0.898 \| 31.50 / 0.500 \| 0.500 \| 100 \| 600 \| 1 \| 1000 \|$'

# a cluster: what learns once is handed over, the rest goes on
sed 's/|809|512|512|512|100|/|4|64|64|64|8|/' "$root/tests/bench/table.sh" >table.sh
mkdir -p tests/bench configs
mv table.sh tests/bench
cp "$root/tests/bench/common.sh" tests/bench
cp "$root"/configs/*.yaml configs
timeout -k 5 $((limit * 15)) bash tests/bench/table.sh "$program" slurm "${given[@]}" \
    --budget cluster --scenes scene --methods tv,v2v3d,v2v3d-max >stdout 2>stderr ||
    fail "a cluster: $(cat stderr)"
[ "$(cut -f 3 slurm/results.tsv | xargs)" = 'method tv' ] || fail "rows: $(cat slurm/results.tsv)"
[ "$(grep -c '^sbatch --job-name=v2v3d jobs/train.sbatch -c configs/fast.yaml .*train.steps=160000 .*_noisy.h5' \
    slurm/jobs.sh)" -eq 1 ] || fail "jobs: $(cat slurm/jobs.sh)"

table runs "${given[@]}" --scenes other --budget quick --seconds 1 && fail 'a scene that there is not was taken'
grep -q "no scene 'other'" stderr || fail "no word of the missing scene: $(cat stderr)"
table runs --unknown 3 && fail 'an unknown option was taken'
finish
