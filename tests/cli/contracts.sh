#!/usr/bin/env bash
# The commands that others call, from optics to scores, without the network.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

cp "$root/configs/tiny.yaml" .
"$V2V_MAKE_BAD" "$folder" || exit 1
mkdir one many
mv volume.h5 one/truth.h5

works psf simulate -c tiny.yaml -o one/psf.h5
works psf info one/psf.h5
says '5 views, 7 slices of 31 x 31 pixels'
grep -q 'off-centre\|alike' stdout && fail "a centred set of different views: $(cat stdout)"
works psf info one/psf.h5 --picture psf.png
[ "$(head -c 4 psf.png | tail -c 3)" = PNG ] || fail 'psf.png is no picture'
refuses 2 'psf.jpg: pictures are PNG' psf info one/psf.h5 --picture psf.jpg
refuses 2 'psf.png: exists' psf info one/psf.h5 --picture psf.png
works psf simulate -c tiny.yaml --set optics.shift=2 --set 'optics.tilts=0 0, 0.2 0, 0.2 0' -o one/odd.h5
works psf info one/odd.h5
says 'off-centre: the light of all views is centred \+[12].[0-9]*, \+2.[0-9]* pixels'
says 'views 1 and 2 are alike .correlation 1.0000'
works info one/psf.h5
says 'PSFs, 5 views'
works psf fit --psf one/psf.h5 -c tiny.yaml -o fitted.yaml
says 'largest distance of centroids'
works psf simulate -c fitted.yaml -o one/fitted.h5
works psf info one/fitted.h5
says '5 views, 7 slices of 31 x 31 pixels'
refuses 2 '--modes: 99 is outside' psf fit --psf one/psf.h5 --modes 99 -o other.yaml
refuses 78 'optics.tilts: view 1 is not a pair' psf simulate --set 'optics.tilts=0 0, 1' -o other.h5
refuses 78 'optics.zernike: mode 4 is given twice' psf simulate --set 'optics.zernike=4:0.1, 4:0.3' -o other.h5
works psf simulate -c tiny.yaml --set optics.size=9 --set optics.slice_spacing_um=8 -o one/cut.h5 \
    --set optics.depth_um=5 --set optics.pinhole_defocus_um=2
for word in 'the PSFs are cut off' 'depth_um is of an interface' 'pinhole_defocus_um is of a pinhole'; do
    grep -q "warning.*: .*$word" stderr || fail "no word of \"$word\": $(cat stderr)"
done
refuses 78 'lies outside the pupil' psf simulate --set 'optics.tilts=0.9 0.9' -o other.h5

works project --psf one/psf.h5 --volume one/truth.h5 -o lfi.h5 --reduce sum --normalize none
works info lfi.h5
says 'recording, 2 frames, 5 views of 64 x 64'
works project --psf one/psf.h5 --volume one/truth.h5 -o mean.h5 --reduce mean --normalize none
works project --psf one/psf.h5 --input lfi.h5 --adjoint -o adjoint.h5 --normalize none
works info adjoint.h5
says 'volume, 2 frames, 7 slices of 64 x 64'

# Slabs over these ranks against one rank, which the split leaves alone.
works project --psf one/psf.h5 --volume one/truth.h5 -o slabs.h5 --set parallel.split=slabs \
    --set parallel.transform=own
"$program" project --psf one/psf.h5 --volume one/truth.h5 -o alone.h5 2>stderr ||
    fail "$(cat stderr)"
same slabs.h5 alone.h5 /views
works project --psf one/psf.h5 --input lfi.h5 --adjoint -o slabs_adjoint.h5 --normalize none \
    --set parallel.split=slabs --set parallel.transform=own
same slabs_adjoint.h5 adjoint.h5 /volume
works project --psf one/psf.h5 --volume one/truth.h5 -o fftw.h5 --set parallel.split=slabs \
    --set parallel.transform=fftw3-mpi
same fftw.h5 alone.h5 /views
works project --psf one/psf.h5 --input lfi.h5 --adjoint -o fftw_adjoint.h5 --normalize none \
    --set parallel.split=slabs --set parallel.transform=fftw3-mpi
same fftw_adjoint.h5 adjoint.h5 /volume
refuses 2 '--stride needs --adjoint' project --psf one/psf.h5 --volume one/truth.h5 -o out.h5 --stride 7
refuses 2 'of a recording' project --psf one/psf.h5 --volume one/truth.h5 --input lfi.h5 --adjoint \
    -o out.h5
refuses 78 'parallel.split.*slices' project --psf one/psf.h5 --volume one/truth.h5 -o out.h5 \
    --set parallel.split=rows

works simulate --psf one/psf.h5 --volume one/truth.h5 -o rec.h5 --noise gaussian:0.2 --seed 5 \
    --frames 3
works info rec.h5
says 'recording, 3 frames'
says '^frame: 0$'
says '^values: -[0-9.]* to [0-9.]*, mean [0-9.]*, standard deviation [0-9.]*$'
says '^noise: 0.[0-9]*$'
works info rec.h5 --frame 2 --json
says '"kind": "recording", "frames": 3, "views": 5, .*"frame": 2, "values": .*, "noise": 0.'
refuses 2 '--frame 3: rec.h5 has frames 0 .. 2' info rec.h5 --frame 3
works simulate --psf one/psf.h5 --volume one/truth.h5 -o photons.h5 --noise poisson:1000 --seed 5
works simulate --psf one/psf.h5 --volume one/truth.h5 -o clean.h5
grep -q 'says pixels of' stderr && fail "the PSFs' own pixels: $(cat stderr)"
works simulate --psf one/psf.h5 --volume one/truth.h5 -o other_size.h5 --pixel-size 5
[ "$(grep -c 'truth.h5: says pixels of 5 um, but the PSFs are for' stderr)" -eq 1 ] ||
    fail "no word on pixels of another size: $(cat stderr)"

# Scenes: every kind that the help names; the same on any ranks; still or moving; a camera.
kinds=$("$program" simulate --help | grep -oE 'drawn: [a-z, ]*')
kinds=${kinds#drawn: }
read -r -a kinds <<<"${kinds//,/}"
[ "${#kinds[@]}" -eq 8 ] || fail "other kinds of scenes in the help than eight: ${kinds[*]}"
for kind in "${kinds[@]}"; do
    works simulate --scene "$kind" --psf one/psf.h5 --seed 3 --size 40x48 -o "scene_$kind.h5"
    works info "scene_$kind.h5"
    says 'recording, 1 frames, 5 views of 40 x 48'
done
works simulate --scene neurons --psf one/psf.h5 --seed 3 --frames 4 --noise gaussian:0.2 --size 64 \
    -o still.h5 --truth still_truth.h5
works info still_truth.h5
says 'volume, 1 frames, 7 slices of 64 x 64'
works simulate --scene neurons --psf one/psf.h5 --seed 3 --frames 4 --noise camera:500 --size 64 \
    --motion 1 -o moving.h5 --truth moving_truth.h5 --clean moving_clean.h5
works info moving_truth.h5
says 'volume, 4 frames'
works info moving.h5 --json
says '"offset": 100'
works evaluate --truth moving_truth.h5 --volume moving_truth.h5 --psf one/psf.h5 --input moving.h5

residual_of_volume() { sed 's/.*"residual": \([0-9.]*\),.*/\1/' "$1"; }

# Some frames of a recording or a volume; what does not apply to it is refused.
for of in moving:/views moving_truth:/volume; do
    name=${of%%:*}
    works convert --input "$name.h5" --frames 1:3 -o "${name}_three.h5"
    works convert --input "${name}_three.h5" --frames 1:9 -o "${name}_two.h5"
    works convert --input "$name.h5" --frames 2:2 -o "${name}_last.h5"
    same "${name}_two.h5" "${name}_last.h5" "${of#*:}"
    works info "${name}_two.h5"
    says ' 2 frames'
    refuses 65 'there is no frame 4: it has 4' convert --input "$name.h5" --frames 4:1 -o none.h5
done
refuses 2 '--frames: one/psf.h5 has none' convert --input one/psf.h5 --frames 0:1 -o none.h5
refuses 2 '--frame-interval is of volumes and recordings, and one/psf.h5 is taken for PSFs' convert --input one/psf.h5 --frame-interval 2 -o none.h5
refuses 2 '--views is of recordings and weights, and .* for PSFs' convert --input one/psf.h5 --views 2 -o none.h5
refuses 2 '--slices is of volumes and weights, and moving.h5 is taken for a recording' convert --input moving.h5 --slices 2 -o none.h5
refuses 2 '--frame: one/psf.h5 has none' info one/psf.h5 --frame 1
refuses 2 '--stride is of recordings, and moving_truth.h5 is taken for a volume' convert --input moving_truth.h5 --stride 1 -o none.h5

# A zero of 0 is stated too, so that none is guessed.
works simulate --scene neurons --psf one/psf.h5 --noise camera:500:1:0 --size 64 -o zero.h5
works info zero.h5
says '^offset: 0$'

# What a camera cut off tells against no prediction: evaluate finds what the line of quality says.
works simulate --scene neurons --psf one/psf.h5 --seed 3 --noise camera:500:150 --size 64 -o cut_off.h5
works deconvolve --psf one/psf.h5 --input cut_off.h5 -o cut_off_volume.h5
grep -q 'pixels are saturated' stderr || fail "nothing is saturated: $(cat stderr)"
said=$(sed -n 's/.*residual of the views \([0-9.]*\),.*/\1/p' stderr)
works evaluate --volume cut_off_volume.h5 --psf one/psf.h5 --input cut_off.h5 --frames 0 --json
awk -v "said=$said" -v "found=$(residual_of_volume stdout)" \
    'BEGIN { exit !(said > 0 && found > 0.995 * said && found < 1.005 * said) }' || # three digits are said
    fail "residual $said, by evaluate: $(cat stdout)"

# In a sliding window neighbours share no page: every fifth frame is one of those of whole frames.
works convert --input still.h5 -o still.tif
works deconvolve --psf one/psf.h5 --input still.h5 -o whole_frame.h5 --frames 1:1 --neighbours 1 --offset none
works deconvolve --psf one/psf.h5 --input still.tif --stride 1 -o slid.h5 --frames 5:1 --neighbours 1 --offset none
same whole_frame.h5 slid.h5 /volume

# Views left out are predicted by averages of frames where volumes are made of such.
works deconvolve --psf one/psf.h5 --input still.h5 -o still_tv.h5 --iterations 5 --frames 0:1
heldout=(evaluate --volume still_tv.h5 --psf one/psf.h5 --input still.h5 --json)
residual_of() { sed 's/.*"heldout_residual": \([0-9.]*\),.*/\1/' "$1"; }
works "${heldout[@]}"
cp stdout of_one.json
works "${heldout[@]}" --set recon.neighbours=3 --set deconv.iterations=5
[ "$(grep -c 'is not a setting of evaluate' stderr)" -eq 1 ] || fail "no word on it: $(cat stderr)"
awk -v "one=$(residual_of of_one.json)" -v "four=$(residual_of stdout)" \
    'BEGIN { exit !(four > 0 && four < one) }' ||
    fail "averages predict no better: $(cat of_one.json stdout)"

# A camera's zero that nothing states is noticed, once a command, unless an offset is given.
works convert --input moving.h5 -o bare.tif
grep -q 'bare.tif cannot say that its zero is 100: read it with --offset 100' stderr ||
    fail "the offset is lost: $(cat stderr)"
bare=(deconvolve --psf one/psf.h5 --input bare.tif --iterations 2 -o bare.h5 --force)
works "${bare[@]}"
[ "$(grep -c 'bare.tif is hardly anywhere darker than 10[0-9.]*: if' stderr)" -eq 1 ] ||
    fail "the camera's zero: $(cat stderr)"
works "${bare[@]}" --offset 100
grep -q darker stderr && fail "the offset was given: $(cat stderr)"
# evaluate takes off what its volume states
works evaluate --volume bare.h5 --psf one/psf.h5 --input bare.tif --frames 0 --json
stated=$(grep -o '"residual": [^,]*' stdout)
grep -q darker stderr && fail "the volume states its offset: $(cat stderr)"
works evaluate --volume bare.h5 --psf one/psf.h5 --input bare.tif --frames 0 --json --offset 100
[ "$(grep -o '"residual": [^,]*' stdout)" = "$stated" ] || fail "another offset: $stated, $(cat stdout)"
works convert --input bare.h5 -o kept.h5 --force
works evaluate --volume kept.h5 --psf one/psf.h5 --input bare.tif --frames 0 --json
grep -q 'made of another' stderr && fail "it is its own recording: $(cat stderr)"
[ "$(grep -o '"residual": [^,]*' stdout)" = "$stated" ] || fail "convert lost the offset: $(cat stdout)"
works "${bare[@]}" --offset none
grep -q darker stderr && fail "there is none: $(cat stderr)"
works deconvolve --psf one/psf.h5 --input moving.h5 --iterations 2 -o bare.h5 --force
grep -q darker stderr && fail "the recording states it: $(cat stderr)"
works evaluate --volume kept.h5 --psf one/psf.h5 --input moving.h5 --frames 0
[ "$(grep -c 'the volume was made of another recording' stderr)" -eq 1 ] ||
    fail "no word on the recording: $(cat stderr)"
# A volume of frames 1 and 2 is judged by these of the truth, of the recording and of other volumes.
judged() { # VOLUME FIRST: a line of figures of two frames, from that frame on
    works evaluate --truth moving_truth.h5 --volume "$1" --psf one/psf.h5 --input moving.h5 --frames 0
    awk -v "first=$2" '/^$/ { exit }
        /^ +[0-9]/ && $1 >= first && $1 < first + 2 { $1 -= first; print }' stdout
}
works deconvolve --method rld --psf one/psf.h5 --input moving.h5 -o every.h5 --iterations 2
works deconvolve --method rld --psf one/psf.h5 --input moving.h5 -o two.h5 --iterations 2 --frames 1:2
judged every.h5 1 >of_every
judged two.h5 0 >of_two
[ "$(wc -l <of_two)" -eq 2 ] || fail "no two frames: $(cat of_two)"
cmp -s of_every of_two || fail "a range is judged otherwise: $(cat of_every of_two)"
works convert --input two.h5 -o copy.h5
works convert --input two.h5 -o copy.tif
works convert --input copy.tif -o back.h5
works deconvolve --method rld --psf one/psf.h5 --input moving.h5 -o two.ome.tif --iterations 2 --frames 1:2
works deconvolve --method rld --psf one/psf.h5 --input moving.h5 -o zeroth.tif --iterations 2 --frames 0:1
for file in copy.tif back.h5 two.ome.tif; do # they keep which frames they show
    judged "$file" 0 >of_file
    cmp -s of_two of_file || fail "$file is judged otherwise: $(cat of_two of_file)"
done
works evaluate --volume zeroth.tif --psf one/psf.h5 --input moving.h5
for words in 'every.h5 two.h5' 'two.h5 two.h5' 'two.h5 copy.h5' 'copy.h5 two.h5' 'two.h5 copy.tif'; do
    works evaluate --truth "${words% *}" --volume "${words#* }"
    says '^ mean +inf +1 '
done
refuses 65 'every.h5 shows frames 0 to 3 of its recording, two.h5 1 to 2' evaluate --truth two.h5 \
    --volume every.h5
# A truth of fewer frames, but more than one, is taken over and over, with a word.
works simulate --psf one/psf.h5 --volume two.h5 --frames 3 -o thrice.h5
works deconvolve --method rld --psf one/psf.h5 --input thrice.h5 -o of_thrice.h5 --iterations 2
for row in 'two.h5 1' 'zeroth.tif 0'; do
    works evaluate --truth "${row% *}" --volume of_thrice.h5
    [ "$(grep -c 'fewer than the volume shows' stderr)" -eq "${row#* }" ] ||
        fail "a truth of fewer frames, ${row% *}: $(cat stderr)"
done
# A phantom is counted from its own first frame, whatever recording its light once came from.
works simulate --psf one/psf.h5 --volume two.h5 --frames 2 -o phantom.h5
works deconvolve --method rld --psf one/psf.h5 --input phantom.h5 -o of_phantom.h5 --iterations 20
works evaluate --truth two.h5 --volume of_phantom.h5 --json
psnr() { sed 's/^{"psnr": \([-0-9.]*\),.*/\1/' stdout; }
straight=$(psnr)
works deconvolve --method rld --psf one/psf.h5 --input phantom.h5 -o last.h5 --iterations 20 --frames 1:1
works convert --input last.h5 -o last.tif
works evaluate --truth two.h5 --volume last.tif --json
awk -v "a=$straight" -v "b=$(psnr)" 'BEGIN { exit !(a > b) }' ||
    fail "frame 0 of a phantom is not frame 0 of its recording: $straight dB"
works evaluate --volume two.h5 --psf one/psf.h5 --input moving.h5 --frames 1 --uncertainty range.h5
mv range.h5 range # HDF5, whatever its name
works info range
says '^first_frame: 1$'
rm last.h5
"$program" simulate --scene neurons --psf one/psf.h5 --seed 3 --frames 4 --noise gaussian:0.2 \
    --size 64 -o still_alone.h5 --truth still_truth_alone.h5 2>stderr || fail "$(cat stderr)"
same still_truth.h5 still_truth_alone.h5 /volume
# Views are at most 1 or so: sums over slices in another order, of transforms of ten levels.
same still.h5 still_alone.h5 /views 1e-5
refuses 2 'either --volume or --scene' simulate --psf one/psf.h5 -o out.h5
refuses 2 'either --volume or --scene' simulate --psf one/psf.h5 --volume one/truth.h5 \
    --scene cells -o out.h5
refuses 2 "scene 'axons' is none of: neurons" simulate --psf one/psf.h5 --scene axons -o out.h5
refuses 2 '--size HxW' simulate --psf one/psf.h5 --scene cells --size 40x -o out.h5
refuses 2 '--truth, --size and --motion' simulate --psf one/psf.h5 --volume one/truth.h5 \
    --motion 1 -o out.h5
refuses 2 'out.h5: named for two' simulate --psf one/psf.h5 --scene cells -o out.h5 --truth out.h5

works deconvolve --method rld --psf one/psf.h5 --input rec.h5 -o rld.h5 --iterations 2 --stop fixed
works deconvolve --method rld --psf one/psf.h5 --input rec.h5 -o rld_slabs.h5 --iterations 2 \
    --set parallel.split=slabs --set parallel.transform=own
"$program" deconvolve --method rld --psf one/psf.h5 --input rec.h5 -o rld_alone.h5 --iterations 2 2>stderr ||
    fail "$(cat stderr)"
same rld_slabs.h5 rld_alone.h5 /volume
works deconvolve --method rld --psf one/psf.h5 --input rec.h5 -o rld_fftw.h5 --iterations 2 \
    --set parallel.split=slabs --set parallel.transform=fftw3-mpi
same rld_fftw.h5 rld_alone.h5 /volume
works deconvolve --psf one/psf.h5 --input rec.h5 -o frl.h5 --method frl --iterations 2 \
    --weight 0.5 --set deconv.depth=1 --set recon.precision=bf16 --set input.gain=3
for key in deconv.depth recon.precision input.gain; do
    [ "$(grep -c "$key is not a setting of --method frl" stderr)" -eq 1 ] ||
        fail "no word on $key, of another method: $(cat stderr)"
done
grep -q 'deconv.weight is' stderr && fail "its own setting is said to be another's: $(cat stderr)"
works deconvolve --psf one/psf.h5 --input rec.h5 -o tv.h5 --method tv
grep -q 'frame 0: residual of the views .*flux' stderr || fail "no line of quality: $(cat stderr)"
grep -q -e unexplained -e 'the views lie' stderr && fail "a warning of views that the volume explains: $(cat stderr)"
# The noise is decided by the first frame; the volume says which.
grep -q 'noise gaussian, by the first frame' stderr || fail "no word on the noise: $(cat stderr)"
works psf simulate -c tiny.yaml --set optics.shift=6 -o one/elsewhere.h5
works deconvolve --psf one/elsewhere.h5 --input lfi.h5 -o elsewhere.h5 --method rl --iterations 5
grep -q 'frame 0: the views lie [0-9.]* pixels from where the volume has them' stderr ||
    fail "no warning of another microscope's PSFs: $(cat stderr)"
works info tv.h5 --json
says '\\n  noise: gaussian\\n'
works deconvolve --psf one/psf.h5 --input rec.h5 -o tv_gaussian.h5 --noise gaussian
same tv.h5 tv_gaussian.h5 /volume
works deconvolve --psf one/psf.h5 --input rec.h5 -o tv_camera.h5 --electrons-per-count 100 \
    --read-noise 2 --verbose
grep -q 'noise poisson, by a frame: 0.01 counts an electron, as given' stderr ||
    fail "no word on the camera: $(cat stderr)"
works info tv_camera.h5 --json
says '\\n  noise: poisson\\n  electrons_per_count: 100\\n  read_noise: 2\\n'
refuses 78 'deconv.read_noise is in electrons' deconvolve --psf one/psf.h5 --input rec.h5 -o out.h5 \
    --read-noise 2
refuses 78 'electrons_per_count is of the noise of photons, which deconv.noise gaussian leaves out' \
    deconvolve --psf one/psf.h5 --input rec.h5 -o out.h5 --electrons-per-count 100 --noise gaussian
refuses 78 'single frames, which recon.skip averages' deconvolve --psf one/psf.h5 --input rec.h5 \
    -o out.h5 --electrons-per-count 100 --skip auto
"$program" deconvolve --psf one/psf.h5 --input rec.h5 -o tv_alone.h5 2>stderr || fail "$(cat stderr)"
same tv.h5 tv_alone.h5 /volume
works deconvolve --psf one/psf.h5 --input rec.h5 -o tv_unskipped.h5 --skip 0 --refresh 2
same tv_unskipped.h5 tv_alone.h5 /volume 0
works deconvolve --psf one/psf.h5 --input rec.h5 -o tv_skipped.h5 --skip auto
grep -q 'computed [0-9.]* % of the frames; the rest changed by' stderr ||
    fail "no word on what was taken over: $(cat stderr)"
"$program" deconvolve --psf one/psf.h5 --input rec.h5 -o tv_skipped_alone.h5 --skip auto 2>stderr ||
    fail "$(cat stderr)"
same tv_skipped.h5 tv_skipped_alone.h5 /volume
refuses 78 "'rld' skips nothing" deconvolve --method rld --psf one/psf.h5 --input rec.h5 -o out.h5 \
    --skip auto
works deconvolve --psf one/psf.h5 --input rec.h5 -o tv_smooth.h5 --lambda 0.5
works deconvolve --psf one/psf.h5 --input rec.h5 -o tv_auto.h5 --lambda auto
"$program" deconvolve --psf one/psf.h5 --input rec.h5 -o tv_auto_alone.h5 --lambda auto 2>stderr ||
    fail "$(cat stderr)"
same tv_auto.h5 tv_auto_alone.h5 /volume
works deconvolve --psf one/psf.h5 --input rec.h5 -o tv_last.h5 --lambda auto --frames 2:1
h5dump -pH tv_last.h5 | grep -q 'CHUNKED ( 1, 1, 64, 64 )' || fail 'a chunk is not a slice'
h5dump -b LE -o whole.bin -d /volume -s 2,0,0,0 -c 1,7,64,64 tv_auto.h5 >/dev/null
h5dump -b LE -o last.bin -d /volume tv_last.h5 >/dev/null
cmp whole.bin last.bin || fail 'a range has another lambda than the whole recording'

# Neighbouring frames beyond a range count, also for the weight that the first frame decides.
works deconvolve --psf one/psf.h5 --input rec.h5 -o tv_off.h5 --neighbours 0
same tv_off.h5 tv.h5 /volume
works deconvolve --psf one/psf.h5 --input rec.h5 -o tv_fused.h5 --lambda auto --neighbours 1
"$program" deconvolve --psf one/psf.h5 --input rec.h5 -o tv_fused_alone.h5 --lambda auto --neighbours 1 \
    2>stderr || fail "$(cat stderr)"
same tv_fused.h5 tv_fused_alone.h5 /volume
works deconvolve --psf one/psf.h5 --input rec.h5 -o tv_fused_last.h5 --lambda auto --neighbours 1 \
    --frames 2:1
h5dump -b LE -o whole.bin -d /volume -s 2,0,0,0 -c 1,7,64,64 tv_fused.h5 >/dev/null
h5dump -b LE -o last.bin -d /volume tv_fused_last.h5 >/dev/null
cmp whole.bin last.bin || fail 'a range of fused frames is not what the whole recording gives'
h5dump -b LE -o last.bin -d /volume tv_last.h5 >/dev/null
cmp -s whole.bin last.bin && fail '--neighbours 1 changes nothing'
refuses 78 'stop heldout is for Richardson-Lucy' deconvolve --psf one/psf.h5 --input rec.h5 \
    -o out.h5 --stop heldout
works deconvolve --psf one/psf.h5 --input rec.h5 -o heldout.h5 --method rld --stop heldout --iterations 20

# A range of frames has the bits of the whole; a complete output is not made again.
works deconvolve --method rld --psf one/psf.h5 --input rec.h5 -o last.h5 --iterations 2 --frames 2:5 \
    --set parallel.split=slabs --set parallel.transform=own
works info last.h5
says 'volume, 1 frames'
h5dump -b LE -o whole.bin -d /volume -s 2,0,0,0 -c 1,7,64,64 rld_slabs.h5 >/dev/null
h5dump -b LE -o last.bin -d /volume last.h5 >/dev/null
cmp whole.bin last.bin || fail 'a range of frames is not what the whole recording gives'
before=$(cksum <last.h5)
works deconvolve --method rld --psf one/psf.h5 --input rec.h5 -o last.h5 --iterations 2 --frames 2:5 --resume
[ "$before" = "$(cksum <last.h5)" ] || fail '--resume made a complete volume again'
works evaluate --truth one/truth.h5 --volume rld.h5 --json
for key in psnr ssim background_truth background_volume; do
    says "\"$key\": -?[0-9]"
done
says '"fit_scale": 0'
for key in heldout_residual flux disagreement resolution_um; do
    says "\"$key\": null"
done
[ "$(wc -l <stdout)" -eq 1 ] || fail "more than one line of JSON: $(cat stdout)"
works evaluate --truth one/truth.h5 --volume rld.h5 --psf one/psf.h5 --input rec.h5 --fit-scale
says 'residual'
says 'least-squares scale'
works evaluate --volume rld.h5 --psf one/psf.h5 --input rec.h5
says 'held-out residual 0.[0-9]'
works evaluate --volume rld.h5 --psf one/psf.h5 --input rec.h5 --json --frames 2 --uncertainty error.h5
for key in residual heldout_residual flux disagreement; do
    says "\"$key\": [0-9]"
done
says '"resolution_um": ([0-9]|null)'
says '"heldout_frames": 2'
works preview error.h5 -o error.png # frame 0 isn't one of them
works evaluate --volume rld.h5 --psf one/psf.h5 --input rec.h5 --json --frames 0
says '"heldout_residual": null'
says '"flux": [0-9]'
works evaluate --truth one/truth.h5 --volume one/truth.h5
says '^ mean +inf +1 '

# There and back, and as an input like any other.
works convert --input one/truth.h5 -o truth.tif
works convert --input truth.tif -o again.h5
same one/truth.h5 again.h5 /volume
works evaluate --truth truth.tif --volume one/truth.h5
says '^ mean +inf +1 '
works convert --input last.h5 -o row.tif # of one frame: a row of pages
works convert --input row.tif --slices 1 -o pages.h5
works evaluate --truth row.tif --volume pages.h5
says '^ mean +inf +1 '
works evaluate --truth one/truth.h5 --truth-dataset volume --volume one/truth.h5 --volume-dataset volume
refuses 65 '/branch1: there is no such dataset' evaluate --truth one/truth.h5 --volume one/truth.h5 \
    --volume-dataset branch1
refuses 65 '/views: there is no such dataset' evaluate --truth one/truth.h5 --volume one/truth.h5 \
    --truth-dataset views

# Integers are half a step from it at most: the scene's brightest voxel is less than 1.
for words in 'small.h5 --output-type uint16 --compression gzip:4' 'small.tif --output-type uint16' \
    'small.ome.tif --output-type uint16'; do
    read -ra words <<<"$words"
    works convert --input one/truth.h5 -o "${words[@]}"
    works convert --input "${words[0]}" -o back.h5 --force
    same one/truth.h5 back.h5 /volume 7.7e-6
done
works convert --input one/truth.h5 -o small.h5 --force --compression gzip
same one/truth.h5 small.h5 /volume
works convert --input one/truth.h5 -o small.h5 --force --output-type uint16 --output-peak 1e-3
grep -q '^warning.*small.h5: uint16 .*[1-9][0-9]* voxels were beyond' stderr ||
    fail "no word of the voxels that were clipped: $(cat stderr)"
works convert --input one/truth.h5 -o truth.ome.tif
works evaluate --truth truth.ome.tif --volume one/truth.h5
says '^ mean +inf +1 '
works convert --input one/truth.h5 -o truth.xml --compression gzip
grep -q '<hdf5 type="relative">truth.bdv.h5</hdf5>' truth.xml || fail 'the XML names no data'
refuses 65 'truth.xml: is for BigDataViewer and not read; .* in truth.bdv.h5' info truth.xml
[ -s truth.bdv.h5 ] || fail 'there are no data for BigDataViewer'
refuses 65 'there is no such dataset' convert --kind recording --input rec.h5 -o out.h5 \
    --dataset "$(printf 'a%.0s' {1..300})"
works convert --input rec.h5 -o rec.ome.tif
works convert --input rec.ome.tif -o rec_again.h5
same rec.h5 rec_again.h5 /views
rm rec_again.h5
works convert --input rec.h5 -o rec.tif
works convert --input rec.tif --views 5 -o rec_again.h5
same rec.h5 rec_again.h5 /views
works info rec.tif
says 'TIFF, 15 pages'
says '^page: 1$'
works deconvolve --method rld --psf one/psf.h5 --input rec.tif -o from_tiff.h5 --iterations 2
same rld.h5 from_tiff.h5 /volume
works deconvolve --method rld --psf one/psf.h5 --input rec.tif -o rld.tif --iterations 2
refuses 2 'picture.jpg: pictures are PNG' preview rld.h5 -o picture.jpg
works preview rld.h5 --frame 2 -o picture.png
[ "$(head -c 4 picture.png | tail -c 3)" = PNG ] || fail 'preview wrote no PNG'
for kind in projections montage depth; do
    works preview rld.h5 --kind $kind --frames 1:9 -o $kind.png
    grep -aq acTL $kind.png || fail "preview --kind $kind --frames wrote no animation"
    works preview rld.h5 --kind $kind --frames 2:9 -o $kind.png --force
    grep -aq acTL $kind.png && fail "preview --kind $kind --frames animates one frame"
done
refuses 2 '--frames from 3: rld.h5 has frames 0 .. 2' preview rld.h5 --frames 3:1 -o out.png
refuses 2 '--frame 3: rld.h5 has frames 0 .. 2' preview rld.h5 --frame 3 -o out.png
# A range of which one end is given, and which is 0.
works preview rld.h5 -o plain.png
works preview rld.h5 -o low.png --low 0
cmp plain.png low.png || fail '--low 0 is not what is taken without it'
works preview rld.h5 -o black.png --low 1e20
works preview rld.h5 -o low.png --low 1e-9 --force
cmp -s low.png black.png && fail '--low alone draws black'

# The same numbers from one rank: some hundred float32 additions and transforms of values up to 1
# (6e-8 each) in another order. Deconvolution divides by the sensitivity and by the predicted view,
# which fall to some thousandths in the corners of the frame: 1e-7 grows to 1e-4 there.
if [ "$ranks" -gt 1 ]; then
    mv lfi.h5 mean.h5 adjoint.h5 rec.h5 rld.h5 many
    ranks=1
    works project --psf one/psf.h5 --volume one/truth.h5 -o lfi.h5 --reduce sum --normalize none
    works project --psf one/psf.h5 --input many/lfi.h5 --adjoint -o adjoint.h5 --normalize none
    works simulate --psf one/psf.h5 --volume one/truth.h5 -o rec.h5 --noise gaussian:0.2 --seed 5 \
        --frames 3
    works deconvolve --method rld --psf one/psf.h5 --input many/rec.h5 -o rld.h5 --iterations 2
    same lfi.h5 many/lfi.h5 /views 1e-5
    same adjoint.h5 many/adjoint.h5 /volume 1e-5
    same rec.h5 many/rec.h5 /views 1e-5
    same rld.h5 many/rld.h5 /volume 1e-3
fi

# Nothing is overwritten unasked.
before=$(cksum <rec.h5)
refuses 2 'rec.h5: exists' simulate --psf one/psf.h5 --volume one/truth.h5 -o rec.h5
[ "$before" = "$(cksum <rec.h5)" ] || fail 'a refused command changed rec.h5'
works simulate --psf one/psf.h5 --volume one/truth.h5 -o rec.h5 --force
finish
