#!/usr/bin/env bash
# Good files that strain a method - dark, of one pixel, of one view, below the kernels - end in a
# finite volume and in a line that says what is known, and nothing else.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

"$V2V_MAKE_BAD" "$folder" || exit 1
cp "$root/configs/unrolled.yaml" .

# sane words...: it works - volumes that hold NaN are refused - and no figure is NaN.
sane() {
    works "$@" -o volume_out.h5 --force
    grep -qwiE '[-+]?(nan|inf)' stdout stderr && fail "v2v3d $*: $(cat stdout stderr)"
}
# tells PATTERN: the last command's line of quality.
tells() {
    grep -qE "^frame 0: $1" stderr || fail "no \"frame 0: $1\" in: $(cat stderr)"
}

for method in tv rl rld frl; do
    sane deconvolve --method $method --psf psf.h5 --input recording_dark.h5
    tells 'the views are dark$'
    sane deconvolve --method $method --psf psf.h5 --input recording_pixel.h5
    tells 'residual of the views [0-9.]+; flux [0-9.e-]+ of theirs$'
    sane deconvolve --method $method --psf psf_large.h5 --input recording_small.h5
    sane deconvolve --method $method --psf psf_one_view.h5 --input recording_one_view.h5
done
# In the least memory that a method runs in, to 250 KB, there is no room for two sets of views (2600
# KB) beside it: the line of quality is the same.
works simulate --psf psf.h5 --scene cells --size 256 --noise gaussian:0.1 -o wide.h5
for method in tv rl; do
    deconvolve=(deconvolve --method "$method" --lambda 0.05 --noise gaussian --iterations 3
        --psf psf.h5 --input wide.h5 --force)
    works "${deconvolve[@]}" -o ample.h5
    line=$(grep '^frame 0: residual' stderr)
    short=0 enough=128000 # KB
    while [ $((enough - short)) -gt 250 ]; do
        middle=$(((short + enough) / 2))
        timed "$limit" "${deconvolve[@]}" -o tight.h5 --max-mem "$(printf '0.%06d' $middle)"
        case $? in
        0) enough=$middle ;;
        70) short=$middle ;;
        *) fail "--max-mem: $(cat stderr)" && break ;;
        esac
    done
    works "${deconvolve[@]}" -o tight.h5 --max-mem "$(printf '0.%06d' $enough)"
    grep -qxF "${line:-none}" stderr || fail "$method in $enough KB: no \"$line\" in: $(cat stderr)"
    same ample.h5 tight.h5 /volume
done
sane deconvolve --lambda auto --psf psf.h5 --input recording_dark.h5
grep -q 'the frame has no light to choose lambda by' stderr || fail "no word on it: $(cat stderr)"
sane deconvolve --lambda auto --psf psf.h5 --input recording_late.h5
grep -q 'no light to choose lambda by' stderr && fail "the dark frame decides: $(cat stderr)"
lambda=$(grep '^lambda ' stderr)
works evaluate --lambda auto --frames 2 --volume volume_out.h5 --psf psf.h5 --input recording_late.h5
grep -qxF "${lambda:-none}" stderr || fail "evaluate has not \"$lambda\": $(cat stderr)"

# A camera's counts end at 65535: of 1000 photons, 65 counts each, the brightest are cut off.
works simulate --psf psf.h5 --volume volume.h5 --noise camera:1000:65 -o full.h5
sane deconvolve --psf psf.h5 --input full.h5
grep -q "of the views' pixels are saturated" stderr || fail "no warning: $(cat stderr)"
works simulate --psf psf.h5 --volume volume.h5 --noise camera:1000:20 -o fitting.h5
sane deconvolve --psf psf.h5 --input fitting.h5
grep -q 'saturated' stderr && fail "a false warning: $(cat stderr)"

# PSFs that end steeply leave voxels at the border that hardly any view sees.
works psf simulate --set optics.size=63 --set optics.slices=15 --set optics.slice_spacing_um=1.5 \
    --set optics.rings=1 --set optics.beam_radius=0.6 -o steep_psf.h5
works simulate --scene cells --psf steep_psf.h5 --size 80x97 --noise gaussian:0.05 -o steep.h5 \
    --truth steep_truth.h5
for method in frl rld rl; do
    works deconvolve --method $method --psf steep_psf.h5 --input steep.h5 -o steep_$method.h5
    works evaluate --volume steep_$method.h5 --truth steep_truth.h5 --json
    says '"psnr": (1[89]|2[0-9])'
done

works deconvolve --psf psf.h5 --input recording_dark.h5 -o dark.h5
works evaluate --volume dark.h5 --psf psf.h5 --input recording_dark.h5
grep -qwiE 'nan|inf' stdout && fail "the table of what is dark: $(cat stdout)"
works evaluate --volume dark.h5 --psf psf.h5 --input recording_dark.h5 --json
says '"residual": null, "flux": null'

# Weights that were learnt from one view serve any set of PSFs, and frames with odd sides.
works train -c unrolled.yaml --steps 2 --psf psf_one_view.h5 --input recording_one_view.h5 -o run
for set in 'psf.h5 recording.h5' 'psf.h5 recording_odd.h5' 'psf_8_slices.h5 recording.h5' \
    'psf.h5 recording_dark.h5' 'psf.h5 recording_pixel.h5' 'psf_large.h5 recording_small.h5' \
    'psf_one_view.h5 recording_one_view.h5'; do
    sane reconstruct --weights run/weights.h5 --psf "${set% *}" --input "${set#* }"
done
works train -c unrolled.yaml --steps 1 --psf psf.h5 --input recording_late.h5 -o late \
    --set recon.neighbours=0 --seed 2
grep -q 'is dark: there is nothing to learn' stderr || fail "no warning: $(cat stderr)"
finish
