#!/usr/bin/env bash
# Views made of other views: the scene of planes, training without PSFs, denoise; what is refused.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

small=(-c "$root/configs/synthesis.yaml" --set train.crop=32 --set synthesis.width=4
    --set synthesis.planes=4 --set synthesis.nearest=4 --set synthesis.farthest=0.5
    --set synthesis.levels=2)
works simulate --scene planes --size 40x48 --seed 3 --noise gaussian:0.2 "${small[@]}" -o views.h5 \
    --clean clean.h5 --frames 2
works info views.h5
says 'recording, 2 frames, 9 views of 40 x 48'
works simulate --scene planes --size 40x48 --seed 3 --noise gaussian:0.2 "${small[@]}" -o again.h5 \
    --frames 2
same views.h5 again.h5 /views
works simulate --scene planes --size 40x48 --set 'synthesis.cameras=0 0, 0 1, 1 0' -o three.h5
works info three.h5
says '3 views of 40 x 48'

works train "${small[@]}" --input views.h5 -o run --steps 20
works denoise --weights run/weights.h5 --input views.h5 --clean clean.h5 -o denoised.h5
says '^PSNR of the views: [0-9.]* dB before, [0-9.]* dB after$'
works info denoised.h5
says 'recording, 2 frames, 9 views of 40 x 48'
works weights info run/weights.h5
says '^synthesis.planes: 4$'
works denoise --weights run/weights.h5 --input three.h5 -o three_denoised.h5
grep -q 'taught by 9 views, not 3: are the cameras of these' stderr || fail "no word: $(cat stderr)"

# Cameras that are told are the weights'.
told=(--set 'synthesis.cameras=0 0, 0 1, 1 0')
works train "${small[@]}" "${told[@]}" --input three.h5 -o told --steps 2
works weights info told/weights.h5
says '^synthesis.cameras: 0 0, 0 1, 1 0$'
refuses 78 'has 3 cameras for 9 views' denoise --weights told/weights.h5 --input views.h5 -o out.h5
refuses 78 'has 3 cameras for 9 views' train "${small[@]}" "${told[@]}" --input views.h5 -o out

for words in '--truth out.h5' '--psf psf.h5' '--motion 1' '--calibration c.yaml'; do
    # shellcheck disable=SC2086
    refuses 2 'no --psf, --truth, --calibration or --motion' simulate --scene planes $words -o out_.h5
done
refuses 2 'either --volume or --scene' simulate --scene planes --volume v.h5 -o out.h5
refuses 2 '--psf FILE is missing' simulate --scene cells -o out.h5
refuses 78 'synthesis.cameras: view 1 is not a pair' simulate --scene planes \
    --set 'synthesis.cameras=0 0, 1' -o out.h5
finish
