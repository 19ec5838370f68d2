#!/usr/bin/env bash
# Frames of a recording that are unlike the others, and PSFs and offsets that are off: said, once.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

cp "$root/configs/tiny.yaml" .
cat >blocked.yaml <<'EOF2'
height: 128
width: 128
views:
  - gain: 1
  - gain: 1
  - gain: 1
  - gain: 0.02
  - gain: 1
EOF2
sed -e 's/gain: 0.02/shift: [2, 1]/' blocked.yaml >displaced.yaml
works psf simulate -c tiny.yaml -o psf.h5
scene=(simulate --psf psf.h5 --scene neurons --size 128 --seed 3)
works "${scene[@]}" --noise gaussian:0.02 -o good.h5
works "${scene[@]}" --noise gaussian:0.02 -o blocked.h5 --calibration blocked.yaml
works "${scene[@]}" --noise gaussian:0.02 -o displaced.h5 --calibration displaced.yaml
works "${scene[@]}" --noise gaussian:300 -o noise.h5
for frame in good blocked displaced noise; do
    works convert --input $frame.h5 -o $frame.tif
done
mkdir late all moved shutter dark
cp blocked.tif shutter/frame_0.tif
cp good.tif shutter/frame_1.tif
cp noise.tif dark/frame_0.tif
cp noise.tif dark/frame_1.tif
cp noise.tif late/frame_0.tif
cp good.tif late/frame_1.tif
cp good.tif all/frame_0.tif
cp noise.tif all/frame_1.tif
cp good.tif all/frame_2.tif
cp blocked.tif all/frame_3.tif
cp blocked.tif all/frame_4.tif
cp good.tif moved/frame_0.tif
cp good.tif moved/frame_1.tif
cp displaced.tif moved/frame_2.tif
cp displaced.tif moved/frame_3.tif

# tells TEXT, misses TEXT: the last command's stderr does, does not.
tells() {
    grep -qe "$1" stderr || fail "no \"$1\" in: $(cat stderr)"
}
misses() {
    grep -qe "$1" stderr && fail "\"$1\" in: $(cat stderr)"
}

# What a recording is settled by, and what is told of it, is the first frame that shows something.
works deconvolve --psf psf.h5 --input late -o late.h5
tells 'by the first frame that shows something'
tells '^frame 1: residual of the views'
tells '1 of 2 frames, frame 0 the first of them, show nothing above their noise'
works deconvolve --psf psf.h5 --input good.tif -o good_volume.h5
misses warning
works deconvolve --psf psf.h5 --input late -o late_1.h5 --frames 1:1
misses warning
same late_1.h5 good_volume.h5 /volume

# A frame that lacks a view decides nothing, written or not.
works deconvolve --psf psf.h5 --input shutter -o shutter.h5
tells 'frame 0: view 3 is 0.0[0-9] times as bright as in frame 1'
works deconvolve --psf psf.h5 --input shutter -o shutter_1.h5 --frames 1:1
misses warning
same shutter_1.h5 good_volume.h5 /volume
works deconvolve --psf psf.h5 --input dark -o dark.h5
tells 'no frame of 2 shows anything above its noise'
works evaluate --volume dark.h5 --psf psf.h5 --input dark --frames 1
misses 'out of register'

# What a view's PSFs sum to, which --normalize view takes out.
cp psf.h5 uneven.h5
"$V2V_POKE" uneven.h5 /psf 0 2
works deconvolve --psf uneven.h5 --input good.tif -o uneven_volume.h5
tells 'uneven.h5: PSFs of some views sum to 3[.0-9]* times those of others'
works deconvolve --psf uneven.h5 --input good.tif -o as_they_are.h5 --normalize none
misses 'PSFs of some views'

# Views that are not used: neither what they show nor their PSFs matter.
cp good.h5 spoilt.h5
"$V2V_POKE" spoilt.h5 /views $((3 * 128 * 128 + 64 * 128 + 64)) 1e6
without=(--without-views '3,0' --set input.hot_pixels=keep)
works deconvolve --psf psf.h5 --input good.h5 "${without[@]}" -o without.h5
tells 'psf.h5: 3 views, without 3,0'
works deconvolve --psf uneven.h5 --input spoilt.h5 "${without[@]}" -o without_spoilt.h5
same without.h5 without_spoilt.h5 /volume
h5diff -q without.h5 good_volume.h5 /volume >/dev/null && fail "view 3 changed nothing"
works evaluate --volume without.h5 --psf psf.h5 --input spoilt.h5 "${without[@]}"
works convert --input good.h5 --without-views 3 -o four.h5
refuses 65 'four.h5: .views has 4 views, but 5 are asked for, those of --without-views among them' \
    deconvolve --psf psf.h5 --input four.h5 --without-views 3 -o out.h5
works convert --input psf.h5 --without-views 3 -o four_psf.h5
works deconvolve --psf four_psf.h5 --input four.h5 -o four_volume.h5 --quiet
works deconvolve --psf psf.h5 --input good.h5 --without-views 3 -o without_3.h5 --quiet
same four_volume.h5 without_3.h5 /volume
refuses 78 'input.without_views: 5 is outside \[0, 4\]' deconvolve --psf psf.h5 --input good.h5 \
    --without-views 5 -o out.h5

# They are called by the same numbers whether others are left out or not.
works deconvolve --psf psf.h5 --input blocked.h5 --without-views 1 -o blocked_volume.h5
tells 'frame 0: view 3 is 0.0[0-9] times as bright as the volume has it'
works evaluate --volume blocked_volume.h5 --psf psf.h5 --input blocked.h5 --without-views 1
tells 'view 3 is 0.0[0-9] times as bright as the volume has it'
awk '/^ view/ { print_it = 1; next } print_it { printf "%s ", $1 } /^ *4 / { exit }' stdout |
    grep -qx '0 2 3 4 ' || fail "not views 0, 2, 3, 4: $(cat stdout)"
works evaluate --volume blocked_volume.h5 --psf psf.h5 --input blocked.h5 --without-views 1 --json
grep -q '"view_numbers": *\[0, *2, *3, *4\]' stdout || fail "not views 0, 2, 3, 4: $(cat stdout)"
works deconvolve --psf psf.h5 --input all --without-views 1 -o all_without.h5
tells 'frame 3: view 3 is 0.0[0-9] times as bright as in frame 0'

# Nor does a calibration know them by their places; it may have more than are used.
works deconvolve --psf psf.h5 --input blocked.h5 --without-views 1 -o fitted.h5 --quiet \
    --calibration blocked.yaml
cat >four.yaml <<'EOF2'
views:
  - view: 0
  - view: 2
  - view: 3
    gain: 0.02
  - view: 4
height: 128
width: 128
EOF2
works deconvolve --psf psf.h5 --input blocked.h5 --without-views 1 -o fitted_4.h5 --quiet \
    --calibration four.yaml
same fitted.h5 fitted_4.h5 /volume
refuses 78 'four.yaml: has a view 2, but no view 1' deconvolve --psf psf.h5 --input good.h5 \
    --calibration four.yaml --without-views 3 -o out.h5

# A PSF that none could be deconvolved by is not looked at, where it is not used.
refuses 78 'four.yaml: has no view but those of --without-views 4,3,2,0' deconvolve --psf psf.h5 \
    --input good.h5 --calibration four.yaml --without-views 4,3,2,0 -o out.h5
cp psf.h5 nan_psf.h5
"$V2V_POKE" nan_psf.h5 /psf 0 nan
refuses 65 'nan_psf.h5: /psf: NaN or Inf at view 0' deconvolve --psf nan_psf.h5 --input good.h5 -o out.h5
works deconvolve --psf nan_psf.h5 --input spoilt.h5 "${without[@]}" -o without_nan.h5 --quiet
same without.h5 without_nan.h5 /volume
works convert --input nan_psf.h5 --without-views 0 -o seen_psf.h5
works info seen_psf.h5
grep -q 'PSFs, 4 views' stdout || fail "not 4 views: $(cat stdout)"
works info psf.h5 --without-views 0,1
grep -q 'PSFs, 3 views' stdout || fail "not 3 views: $(cat stdout)"

works deconvolve --psf psf.h5 --input all -o all.h5
tells '^frame 0: residual of the views'
tells '1 of 5 frames, frame 1 the first of them, show nothing above their noise'
tells 'frame 3: view 3 is 0.0[0-9] times as bright as in frame 0, beside the other views; 2 of 5'
[ "$(grep -c warning stderr)" -eq 2 ] || fail "not one warning of each, once: $(cat stderr)"
works deconvolve --psf psf.h5 --input all -o all_2.h5 --frames 2:2
tells 'frame 3: view 3 is 0.0[0-9] times as bright as in frame 2, .*; 1 of 2'
works deconvolve --psf psf.h5 --input all -o all.h5 --force --quiet
misses .

works deconvolve --psf psf.h5 --input moved -o moved.h5
tells 'frame 2: of means of 8 x 8 .* misses [1-9][.0-9]* times .* that of frame 0 [01][.0-9]* times'
tells 'did views move, or change places? 2 of 4 frames looked at are such'
[ "$(grep -c warning stderr)" -eq 1 ] || fail "not that alone: $(cat stderr)"
works deconvolve --psf psf.h5 --input moved -o moved.h5 --frames 0:2 --force
misses warning
works deconvolve --psf psf.h5 --input moved -o moved.h5 --skip auto --refresh 2 --force
tells 'did views move, or change places? 1 of 2 frames looked at are such'

# Another zero, and saturation, of frames that are neither the first nor the last.
mkdir zero clipped
for kind in 1:100 1:140 600:100; do
    works "${scene[@]}" --noise camera:200:$kind -o counts.h5 --force
    works convert --input counts.h5 -o "counts_${kind/:/_}.tif"
done
for frame in 0 3; do
    cp counts_1_100.tif zero/frame_$frame.tif
    cp counts_1_100.tif clipped/frame_$frame.tif
done
for frame in 1 2; do
    cp counts_1_140.tif zero/frame_$frame.tif
    cp counts_600_100.tif clipped/frame_$frame.tif
done
works deconvolve --psf psf.h5 --input zero --offset 100 -o zero.h5
tells 'frame 1 is hardly anywhere darker than [34][0-9.]* above its offset 100: .* 2 of 4 frames are such'
[ "$(grep -c warning stderr)" -eq 1 ] || fail "not that alone: $(cat stderr)"
works deconvolve --psf psf.h5 --input zero --offset 140 -o zero.h5 --force
tells 'frame 0 is [34][0-9.]* below its offset 140'
works deconvolve --psf psf.h5 --input clipped --offset 100 -o clipped.h5
tells 'frame 1: [0-9.]* % of its pixels are saturated: .* 2 of 4 frames are such'
[ "$(grep -c warning stderr)" -eq 1 ] || fail "not that alone: $(cat stderr)"

# Noise that total variation leaves in the dark as light, and slices that lie elsewhere.
works "${scene[@]}" --noise gaussian:1 -o grainy.h5 --truth grainy_truth.h5
works deconvolve --psf psf.h5 --input grainy.h5 -o grainy_volume.h5
tells 'the volume has [1-9][.0-9]* times the light of its views, by noise where it is dark'
works evaluate --volume grainy_volume.h5 --psf psf.h5 --input grainy.h5
tells 'times the light of its views in frame'
works evaluate --volume grainy_volume.h5 --psf psf.h5 --input grainy.h5 --quiet
misses 'times the light'
works deconvolve --psf psf.h5 --input good.h5 -o good_again.h5
misses 'times the light'
works project --psf psf.h5 --volume grainy_truth.h5 -o aside.h5 --slice-spacing 3
tells 'says slices every 3 um, but the PSFs are for'
# Less dark than the offset says; --offset none says that it is light.
works deconvolve --psf psf.h5 --input good.h5 -o haze.h5 --offset -0.1
tells 'frame 0 is hardly anywhere darker than 0\.[01][0-9]* above its offset -0.1'
works deconvolve --psf psf.h5 --input good.h5 -o haze.h5 --force --offset none
misses darker
misses 'below its offset'
# Darker than it: no light is below zero.
works deconvolve --psf psf.h5 --input good.h5 -o haze.h5 --force --offset 0.1
tells 'frame 0 is 0\.[01][0-9]* below its offset 0.1 where it is dark.* lower .--offset -\?[0-9.e-]*)'
works evaluate --volume haze.h5 --psf psf.h5 --input good.h5 --frames 0
tells 'where they are dark the views are 0\.[01][0-9]* below the offset 0.1: is it too high'
works project --psf psf.h5 --adjoint --input good.h5 -o back.h5
works project --psf psf.h5 --adjoint --input good.h5 -o back_less.h5 --offset 0.1
h5diff back.h5 back_less.h5 /volume >/dev/null && fail 'project --adjoint subtracts no offset'

# The camera's noise, in counts, is that of deconvolve and of the lessons of train; a wrong one is told.
cp "$root/configs/unrolled.yaml" .
works "${scene[@]}" --noise camera:200 -o camera.h5
noise_of() {
    grep -o 'frame 0: noise of photons, [0-9.e-]* of the brightness' stderr | head -1
}
camera=(--psf psf.h5 --input camera.h5 --verbose)
works deconvolve "${camera[@]}" -o camera_volume.h5 --electrons-per-count 1
misses 'noise, which is more than there is'
right=$(noise_of)
[ -n "$right" ] || fail "no noise of photons: $(cat stderr)"
works train -c unrolled.yaml "${camera[@]}" -o run --steps 1 --set recon.neighbours=0 \
    --set deconv.electrons_per_count=1
[ "$(noise_of)" = "$right" ] || fail "not $right: $(cat stderr)"
works deconvolve "${camera[@]}" -o camera_volume.h5 --electrons-per-count 0.05 --force
tells 'views and volume differ by 0.[1-7][0-9]* of the camera.s noise, which is more than there is'

# Views of noise calibrate nothing.
works calibrate --psf psf.h5 --input noise.h5 -o cal.yaml
tells 'nothing lowers the held-out residual'
[ "$(grep -c 'gain: 1$' cal.yaml)" -eq 5 ] || fail "moved by noise: $(cat cal.yaml)"

# Outputs in HDF5 do not take the name of another kind of file.
refuses 2 'x.tif: this output is written as HDF5' "${scene[@]}" -o x.tif
refuses 2 'x.tif: this output is written as HDF5' psf simulate -c tiny.yaml -o x.tif
[ ! -e x.tif ] || fail 'x.tif was written'
finish
