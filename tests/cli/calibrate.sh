#!/usr/bin/env bash
# Views out of register: simulated, found by calibrate, and taken by every command that knows PSFs.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

cp "$root/configs/tiny.yaml" .
"$V2V_MAKE_BAD" "$folder" || exit 1
mkdir work
mv volume.h5 tiny.yaml work
cd work || exit 1
works psf simulate -c tiny.yaml -o psf.h5 # 5 views, 7 slices
cat >spoil.yaml <<'EOF'
height: 64
width: 64
views:
  - {gain: 1.25, shift: [1, 0.5]}
  - {gain: 0.05, shift: [-1, -0.5]} # shows little of what the others show
  - gain: 1
  - gain: 1
  - gain: 1
EOF
works simulate --psf psf.h5 --volume volume.h5 -o rec.h5 --noise gaussian:0.05 --calibration spoil.yaml
works calibrate --psf psf.h5 --input rec.h5 -o cal.yaml --json
if [ "$(grep -c 'a gain of' stderr)" -ne 1 ] || ! grep -q 'view 1: a gain of 0\.0' stderr; then
    fail "what is said of gains: $(cat stderr)"
fi
grep -q 'views: by so few' stderr && fail 'five views are few'
for key in heldout_before heldout_after heldout_frame_before heldout_frame_after shifts gains slopes \
    has_fields has_slopes is_gains_alone is_in_vain rounds lambda square; do
    grep -q "\"$key\": " stdout || fail "no $key in $(cat stdout)"
done
works psf simulate -c tiny.yaml --set 'optics.tilts=0 0, 0 0.5, 0 -0.5' -o few.h5
sed -e '/gain: 1$/d' -e 's/gain: 0.05/gain: 0.9/' -e 's/64/128/' spoil.yaml >few.yaml
echo '  - gain: 1' >>few.yaml
works simulate --psf few.h5 --scene neurons --size 128 -o few_rec.h5 --noise gaussian:0.02 \
    --calibration few.yaml
works calibrate --psf few.h5 --input few_rec.h5 -o few_cal.yaml
grep -q '3 views: by so few others' stderr || fail "what is said of three views: $(cat stderr)"
works simulate --psf few.h5 --scene neurons --size 48 --seed 2 -o small.h5 --noise gaussian:0.02 \
    --calibration few.yaml
works calibrate --psf few.h5 --input small.h5 -o small.yaml
grep -q '48 x 48 pixels: by so few' stderr || fail "what is said of a small frame: $(cat stderr)"
works simulate --psf few.h5 --scene neurons --size 128 -o cut_off.h5 --noise camera:600:100 \
    --calibration few.yaml
works calibrate --psf few.h5 --input cut_off.h5 -o cut_off.yaml
grep -q 'saturated samples, up to [0-9.]* % of a view, are left out' stderr || fail "$(cat stderr)"
works simulate --psf psf.h5 --scene neurons --size 64 -o seen.h5 --noise gaussian:0.05 \
    --calibration spoil.yaml
works deconvolve --psf psf.h5 --input seen.h5 -o dim.h5
grep -q 'frame 0: view 1 is 0\.0[0-9]* times as bright' stderr || fail "$(cat stderr)"
works evaluate --psf psf.h5 --input seen.h5 --volume dim.h5
grep -q 'view 1 is 0\.0[0-9]* times as bright' stderr || fail "$(cat stderr)"
sed -e 's/64/128/; s/gain: 1.25, shift: .1, 0.5/gain: 1, shift: [2, 1/' \
    -e 's/gain: 0.05, shift: .-1, -0.5/gain: 1, shift: [-2, -1/' spoil.yaml >moved.yaml
works simulate --psf psf.h5 --scene neurons --size 128 --seed 3 -o moved.h5 --noise gaussian:0.02 \
    --calibration moved.yaml
works deconvolve --psf psf.h5 --input moved.h5 -o displaced.h5
grep -q 'frame 0: the views lie [0-9.]* pixels from where the volume has them' stderr ||
    fail "out of register in silence: $(cat stderr)"
tilts='0 0, 0 0.5, 0.35 0.35, 0.5 0, 0.35 -0.35, 0 -0.5, -0.35 -0.35, -0.5 0, -0.35 0.35'
works psf simulate -c tiny.yaml --set optics.slices=9 --set "optics.tilts=$tilts" -o nine.h5
works psf simulate -c tiny.yaml --set optics.slices=9 -o exchanged.h5 \
    --set "optics.tilts=${tilts/0.35 0.35, 0.5 0/0.5 0, 0.35 0.35}"
works simulate --psf nine.h5 --scene mixed --size 96 --seed 1 --noise gaussian:0.01 -o nine_rec.h5
works deconvolve --psf nine.h5 --input nine_rec.h5 -o nine_tv.h5
grep -q unexplained stderr && fail "views in their places are called unexplained: $(cat stderr)"
works deconvolve --psf exchanged.h5 --input nine_rec.h5 -o nine_tv.h5 --force
grep -q 'leaves more of view [23] unexplained than of the others' stderr ||
    fail "neighbours in each other's place in silence: $(cat stderr)"
works calibrate --psf nine.h5 --input nine_rec.h5 -o nine.yaml
grep -q "each other's place" stderr && fail "views in their places are exchanged: $(cat stderr)"
works calibrate --psf exchanged.h5 --input nine_rec.h5 -o nine.yaml --force
grep -q "views 2 and 3 change with depth as each other's PSFs do" stderr || fail "$(cat stderr)"
works deconvolve --psf psf.h5 --input moved.h5 -o one.h5 --iterations 1
grep -q 'by noise where it is dark' stderr && fail "light of one iteration is not noise: $(cat stderr)"
[ "$(grep -c -e "- view:" cal.yaml)" -eq 5 ] || fail "not five views: $(cat cal.yaml)"
works info cal.yaml
says 'calibration of 5 views, of frames of 64 x 64 pixels'
says '^gain: [0-9.]* to [0-9.]*$'
says '^largest shift: [0-9.e-]* pixels$'
works calibrate --psf psf.h5 --input rec.h5 -o text.yaml --frame 1 \
    --set deconv.electrons_per_count=100 --set recon.neighbours=0 # which have no part in it
[ "$(grep -cE '(electrons_per_count|neighbours) is not a setting of calibrate' stderr)" -eq 2 ] ||
    fail "no word on settings of others: $(cat stderr)"
says 'held-out residual: .* before, .* after'

works project --psf psf.h5 --volume volume.h5 -o spoilt.h5 --calibration spoil.yaml
works simulate --psf psf.h5 --volume volume.h5 -o clean.h5 --calibration spoil.yaml
same spoilt.h5 clean.h5 /views
sed 's/64/128/' spoil.yaml >larger.yaml # without fields of any frame's size
works project --psf psf.h5 --volume volume.h5 -o larger.h5 --calibration larger.yaml
same spoilt.h5 larger.h5 /views
works simulate --psf psf.h5 --volume volume.h5 -o clean.h5 --force --calibration larger.yaml
same spoilt.h5 clean.h5 /views

# The adjoint, of a calibration with fields: what a voxel sends to a pixel the pixel sends back.
field() { # SIX NUMBERS: the first of 65 terms
    printf '[%s%s]' "$1" "$(printf ', 0%.0s' {1..59})"
}
bent="distortion_y: $(field '0, 0.7, -0.4, 0.2, 0, 0'), distortion_x: $(field '0.3, -0.5, 0.8, 0, 0, 0')"
sed "s/gain: 1.25/&, $bent, shading: $(field '0.3, -0.2, 0, 0, 0, 0')/" spoil.yaml >bent.yaml
element() { # FILE DATASET PLACE
    h5dump -y -m %.9g -d "$2" -s "$3" -c 1,1,1,1 "$1" | awk '/^ *-?[0-9.]/ { print $1; exit }'
}
voxel=0,3,30,20 pixel=0,0,29,20
works project --psf psf.h5 --volume volume.h5 -o bent.h5 --calibration bent.yaml
works project --psf psf.h5 --input bent.h5 -o back.h5 --calibration bent.yaml --adjoint
cp volume.h5 lit.h5
cp bent.h5 lit_view.h5
"$V2V_POKE" lit.h5 /volume $((3 * 4096 + 30 * 64 + 20)) 1e6
"$V2V_POKE" lit_view.h5 /views $((29 * 64 + 20)) 1e6
works project --psf psf.h5 --volume lit.h5 -o bent_lit.h5 --calibration bent.yaml
works project --psf psf.h5 --input lit_view.h5 -o back_lit.h5 --calibration bent.yaml --adjoint
awk -v a="$(element bent.h5 /views $pixel)" -v b="$(element bent_lit.h5 /views $pixel)" \
    -v c="$(element back.h5 /volume $voxel)" -v d="$(element back_lit.h5 /volume $voxel)" \
    'BEGIN { there = b - a; back = d - c; exit !(there > 1 && (there - back)^2 < 1e-6 * there^2) }' ||
    fail "$(element bent_lit.h5 /views $pixel) there, $(element back_lit.h5 /volume $voxel) back"

more='since volumes miss more of the views than noise'
works deconvolve --psf psf.h5 --input rec.h5 -o tv.h5
grep -q "lambda [0-9.]*, by views left out of a frame, $more" stderr || fail "lambda: $(cat stderr)"
works deconvolve --psf psf.h5 --input rec.h5 -o tv.h5 --calibration spoil.yaml --force
grep -q "$more" stderr && fail "lambda is searched for in vain: $(cat stderr)"
works deconvolve --psf psf.h5 --input rec.h5 -o tv.h5 --calibration cal.yaml --force
works evaluate --volume tv.h5 --psf psf.h5 --input rec.h5 --calibration cal.yaml --json
grep -q 'was made by other PSFs' stderr && fail "its own PSFs are called other: $(cat stderr)"
works evaluate --volume tv.h5 --psf psf.h5 --input rec.h5
grep -q 'was made by other PSFs, or by these calibrated' stderr ||
    fail "no word on a calibration that is left out: $(cat stderr)"
works train -c tiny.yaml --steps 1 --psf psf.h5 --input rec.h5 -o run --calibration cal.yaml
works reconstruct --psf psf.h5 --weights run/weights.h5 --input rec.h5 -o net.h5 --calibration cal.yaml

# Distortion that is undone takes noise away: views that have none are not explained the better. With
# their noise taken away by half a pixel's interpolation residuals were 0.8 of what they are.
half="distortion_y: $(field '0, 0.6, 0, 0, 0, 0'), distortion_x: $(field '0.6, 0, 0, 0, 0, 0')"
{
    sed '/gain/d' spoil.yaml
    for _ in {1..5}; do echo "  - {gain: 1, $half}"; done
} >half.yaml
works simulate --psf psf.h5 --scene neurons --size 64 -o noisy.h5 --noise gaussian:0.5
works deconvolve --psf psf.h5 --input noisy.h5 -o straight_tv.h5
works deconvolve --psf psf.h5 --input noisy.h5 -o half_tv.h5 --calibration half.yaml
grep -o 'residual of the views [0-9.]*' stderr >told
works evaluate --volume straight_tv.h5 --psf psf.h5 --input noisy.h5 --json
cp stdout straight.json
works evaluate --volume half_tv.h5 --psf psf.h5 --input noisy.h5 --calibration half.yaml --json
figure() { # FILE NAME
    grep -o "\"$2\": [0-9.]*" "$1" | sed 's/.* //'
}
for name in residual heldout_residual; do
    awk -v a="$(figure straight.json $name)" -v b="$(figure stdout $name)" \
        'BEGIN { exit !(a > 0.3 && b > 0.97 * a) }' ||
        fail "$name: $(figure straight.json $name) straight, $(figure stdout $name) undistorted"
done
awk -v a="$(figure stdout residual)" '{ like = ($5 - a)^2 < 1e-4 * a^2 } END { exit !like }' told ||
    fail "deconvolve: $(cat told), evaluate: $(figure stdout residual)"

sed 's/^  - gain: 1$//' spoil.yaml >fewer.yaml
refuses 65 'a calibration of 2 views, but the PSFs have 5' deconvolve --psf psf.h5 --input rec.h5 \
    -o out.h5 --calibration fewer.yaml
sed 's/gain: 1.25/gian: 1.25/' spoil.yaml >typing.yaml
refuses 78 "typing.yaml:4: 'gian' is not one of the keys" deconvolve --psf psf.h5 --input rec.h5 \
    -o out.h5 --calibration typing.yaml
shading="[0.1$(printf ', 0%.0s' $(seq 64))]"
sed "s/0.5]}/0.5], shading: $shading}/; s/64/32/" spoil.yaml >small.yaml
refuses 65 'made from 5 of 32 x 32' deconvolve --psf psf.h5 --input rec.h5 -o out.h5 \
    --calibration small.yaml
refuses 2 'cal.yaml.*--force' calibrate --psf psf.h5 --input rec.h5 -o cal.yaml
printf 'deconv:\n  iterations: 3\n' >settings.yaml
cp settings.yaml kept.yaml
refuses 2 'settings.yaml: the output would overwrite the input' calibrate -c settings.yaml \
    --psf psf.h5 --input rec.h5 -o settings.yaml --force
cmp settings.yaml kept.yaml || fail 'settings that were to be overwritten have changed'
refuses 65 'there is no frame 7' calibrate --psf psf.h5 --input rec.h5 -o out.yaml --frame 7
finish
