#!/usr/bin/env bash
# VCDNet, taught by true volumes, and DeepCAD, by other frames: their commands; what is refused.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

works psf simulate -c "$root/configs/tiny.yaml" -o psf.h5
works dataset --psf psf.h5 --seed 4 --size 64 --count 3 -o set
vcdnet=(train -c "$root/configs/vcdnet.yaml" --psf psf.h5 --set vcdnet.width=4)
works "${vcdnet[@]}" --input set/train/*_noisy.h5 --truth set/train/*_truth.h5 -o run --steps 4
[ "$(grep -c 'train.batch=1: 1 of 2 data ranks have no sample' stderr)" -eq $((ranks - 1)) ] ||
    fail "ranks without a sample: $(cat stderr)"
works weights info run/weights.h5
says '^vcdnet.width: 4$'
works reconstruct --psf psf.h5 --weights run/weights.h5 --input set/train/000000_noisy.h5 -o volume.h5
works info volume.h5
says 'volume, 1 frames, 7 slices of 64 x 64'
works "${vcdnet[@]}" --input set/train/*_noisy.h5 --truth set/train/*_truth.h5 -o run --steps 6 --resume

# A truth that can't be learnt from is told before the first step, wherever it is drawn.
cp set/train/000001_truth.h5 bad_truth.h5
"$V2V_POKE" bad_truth.h5 /volume 5000 nan || exit 1
refuses 65 'bad_truth.h5.*frame 0' "${vcdnet[@]}" --input set/train/00000[01]_noisy.h5 \
    --truth set/train/000000_truth.h5 bad_truth.h5 -o out
[ ! -s out/metrics.jsonl ] || fail 'steps were made'

refuses 2 "learns from true volumes: --truth FILE, one for each of 3 recordings, not 2" "${vcdnet[@]}" \
    --input set/train/*_noisy.h5 --truth set/train/00000[01]_truth.h5 -o out
refuses 2 "learns from recordings alone" train -c "$root/configs/fast.yaml" --psf psf.h5 \
    --input set/train/000000_noisy.h5 --truth set/train/000000_truth.h5 -o out
refuses 2 '--psf FILE is missing' train -c "$root/configs/vcdnet.yaml" \
    --input set/train/000000_noisy.h5 --truth set/train/000000_truth.h5 -o out
works simulate --scene cells --psf psf.h5 --size 48x64 -o low.h5 --truth low_truth.h5
refuses 65 'truth 1 has 1 frames of 7 x 48 x 64 voxels' "${vcdnet[@]}" --input set/train/000000_noisy.h5 \
    --truth low_truth.h5 -o out
refuses 65 "'vcdnet' makes volumes .v2v3d reconstruct., no views" denoise --weights run/weights.h5 \
    --input low.h5 -o out.h5

works simulate --scene neurons --psf psf.h5 --size 40x48 --frames 11 --motion 0.5 --noise gaussian:0.2 \
    -o film.h5 --clean clean.h5
deepcad=(train -c "$root/configs/deepcad.yaml" --set deepcad.width=2 --set deepcad.levels=2
    --set deepcad.frames=4 --set train.crop=32)
works "${deepcad[@]}" --input film.h5 -o frames --steps 4 --set model.align=false --set loss.tv=0 \
    --set loss.mse=1 --set vcdnet.width=4 --set train.decay=0.5
grep -q 'train.decay is not a setting of train.schedule linear' stderr || fail "not told: $(cat stderr)"
[ "$(grep -cE "(model.align|loss.tv|vcdnet.width) is not a setting of the network 'deepcad'" stderr)" -eq 3 ] ||
    fail "no word on settings of other networks: $(cat stderr)"
grep -q 'loss.mse is' stderr && fail "its own setting is said to be another's: $(cat stderr)"
works denoise --weights frames/weights.h5 --input film.h5 --clean clean.h5 -o denoised.h5
says '^PSNR of the views: [0-9.]* dB before, [0-9.]* dB after$'
# The same counts on another zero are as noisy.
for zero in 0 400; do
    works simulate --scene neurons --psf psf.h5 --size 40x48 --frames 11 --seed 2 \
        --noise camera:50:1:$zero:0 -o zero_$zero.h5 --clean clean_$zero.h5
    works denoise --weights frames/weights.h5 --input zero_$zero.h5 --clean clean_$zero.h5 \
        -o denoised_$zero.h5
    cp stdout zero_$zero.txt
done
cmp -s zero_0.txt zero_400.txt || fail "the zero counts as light: $(cat zero_0.txt zero_400.txt)"
# The zero that was subtracted is what the file states; a clean recording may have another one.
zero=(denoise --weights frames/weights.h5 --input zero_400.h5)
works "${zero[@]}" --clean clean_0.h5 -o other_zero.h5 --set recon.neighbours=2
cmp -s stdout zero_0.txt || fail "another zero of the clean views counts as noise: $(cat stdout)"
grep -q 'recon.neighbours is not a setting of denoise' stderr || fail "not told: $(cat stderr)"
works "${zero[@]}" -o told_zero.h5 --offset 300
works info told_zero.h5
says 'offset: 300'
works "${zero[@]}" -o no_zero.h5 --offset none
works info no_zero.h5
grep -q 'offset:' stdout && fail "a zero that was not subtracted: $(cat stdout)"
works denoise --weights frames/weights.h5 --input no_zero.h5 -o out.h5
grep -q 'hardly anywhere darker than' stderr || fail "no word of another zero: $(cat stderr)"
rm out.h5
works info denoised.h5
says 'recording, 11 frames, 5 views of 40 x 48'
works deconvolve --psf psf.h5 --input denoised.h5 -o rld.h5 --method rld --iterations 1 --frames 0:1
cp low.h5 low # other sizes, one frame, HDF5 whatever its name
works denoise --weights frames/weights.h5 --input low -o still.h5

refuses 65 '1 frames; learning from odd and even frames takes 8' "${deepcad[@]}" --input low.h5 -o out
refuses 65 "'deepcad' makes views .v2v3d denoise., no volume" reconstruct --psf psf.h5 \
    --weights frames/weights.h5 --input film.h5 -o out.h5
refuses 65 "'deepcad' makes views" evaluate --volume rld.h5 --psf psf.h5 --input film.h5 \
    --weights frames/weights.h5
refuses 65 'the clean recording has 1 frames' denoise --weights frames/weights.h5 --input film.h5 \
    --clean low.h5 -o out.h5
works convert --input volume.h5 -o pages.tif
refuses 2 'pages.tif: --views V is missing' denoise --weights frames/weights.h5 --input pages.tif -o out.h5
refuses 2 'denoised.h5: exists' denoise --weights frames/weights.h5 --input film.h5 -o denoised.h5
refuses 78 'deepcad.frames: 5 is no multiple of 2' "${deepcad[@]}" --set deepcad.frames=5 --input film.h5 -o out
finish
