#!/usr/bin/env bash
# Every broken input ends in a documented exit code, one clear line, no output, no hang.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

mkdir files
cd files || exit 1
"$V2V_MAKE_BAD" . || exit 1
cp "$root/configs/tiny.yaml" "$root/configs/unrolled.yaml" .
printf 'train:\n  learning_rat: 1\n' >unknown.yaml
printf 'model:\n  method: unrolled\ntrain:\n  crop: 64\n  halo: 0\n' >crop64.yaml
printf 'train:\n  steps: 3\n  steps: 4\n' >duplicate.yaml
printf 'train:\n  steps:\n' >missing.yaml
printf 'train:\n  steps: -1\n' >range.yaml
printf 'train:\n  learning_rate: 1e309\n' >infinite.yaml
printf 'train:\n  learning_rate: 0,5\n' >comma.yaml
printf 'trian:\n  steps: 3\n' >section.yaml
printf 'train:\n  steps: 3\0\n' >nul.yaml
printf 'train:\n\tsteps: 3\n' >tabs.yaml
head -c 2000000 /dev/zero | tr '\0' '#' >large.yaml

# What is good is read: a table in which everything is refused would prove little.
works weights init --psf psf.h5 --width 4 -o weights.h5
works weights init --psf psf.h5 --set model.method=unrolled --rule he -o unrolled.h5
works convert --input weights.h5 -o weights.safetensors
mkdir a_run && cp weights.h5 a_run
printf 'PK\3\4archive/data.pkl' >torch.pth
works reconstruct --psf psf.h5 --weights unrolled.h5 --input recording_dark.h5 -o dark.h5
grep -q 'no light to choose the strength' stderr || fail "a dark first frame: $(cat stderr)"
works preview good.tif -o fine.png
works preview volume.h5 -o fine.png --force
works psf info psf.h5
works init -c tiny.yaml
printf 'train:\r\n  steps: 3\r\n' >crlf.yaml
works init -c crlf.yaml
head -c 20000 weights.h5 >weights_cut.h5
head -c 20000 weights.safetensors >cut.safetensors
sed 's/unet2.conv_final.4.bias/unet2.conv_final.5.bias/g' weights.safetensors >renamed.safetensors
sed '1s/"slices":"7"/"slices":"8"/' weights.safetensors >slices.safetensors
(printf '\377\377\377\377\0\0\0\0' && tail -c +9 weights.safetensors) >long.safetensors
(head -c 80000 weights.safetensors && printf 'ABCD' && tail -c +80005 weights.safetensors) \
    >flipped.safetensors
printf '\2\0\0\0\0\0\0\0{}' >nothing.safetensors
cp weights.h5 weights_flipped.h5
# One byte inside the largest array, which begins at a fifth of the file and takes a quarter of it.
place=$(($(stat -c %s weights.h5) / 3))
printf '\125' | dd of=weights_flipped.h5 bs=1 seek="$place" conv=notrunc 2>/dev/null
cmp -s weights.h5 weights_flipped.h5 && printf '\252' |
    dd of=weights_flipped.h5 bs=1 seek="$place" conv=notrunc 2>/dev/null

# The table, and a TIFF file cut at every sixteenth.
cp "$here/bad_input.tsv" "$folder/table"
for i in $(seq -w 1 15); do
    echo "65 | cut_$i.tif: | preview cut_$i.tif -o out.png" >>"$folder/table"
done
rows_by_workers "$folder/table" 120 refuses
finish
