#!/usr/bin/env bash
# Weights, training, reconstruction: the contracts of the network's commands on a tiny scene.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

"$V2V_MAKE_BAD" "$folder" || exit 1
cp "$root/configs/tiny.yaml" "$root/configs/golden.yaml" .

works weights init --psf psf.h5 --width 4 --rule hash --seed 7 -o w.h5
works weights info w.h5
says '^model.width: 4$'
works info w.h5
says '5 views .split even-odd. and 7 slices'
says '^unet1: -[0-9.]* to [0-9.]*, mean [-0-9.e]*, standard deviation [0-9.]*$'

works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o volumes.h5 --branches \
    --offset none --gain none --normalize none --precision f32 --skip off
works info volumes.h5
says 'volume, 2 frames, 7 slices of 64 x 64'
says '^frames done: 2$'
says '^weights_crc32c: [0-9a-f]{8}$'
says '^configuration: [0-9]* lines, which --json shows$'
for name in /volume /branch1 /branch2; do
    h5dump -H -d "$name" volumes.h5 >/dev/null 2>&1 || fail "volumes.h5 has no $name"
done
timed "$limit" reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o volumes.h5 --resume \
    --offset none --gain none --normalize none --precision f32 --skip off
[ $? -eq 65 ] || fail "a volume of other datasets is gone on with: $(cat stderr)"
grep -q 'volumes.h5: is of another task' stderr || fail "not another task: $(cat stderr)"
for name in configuration command_line psf_crc32c weights_crc32c offset gain ranks; do
    h5dump -a "/$name" volumes.h5 >/dev/null 2>&1 || fail "volumes.h5 has no attribute $name"
done
works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o volumes.tif
! grep -q 'other PSFs' stderr || fail "the same PSFs: $(cat stderr)"
works psf simulate -c tiny.yaml -o others.h5
# Samples that see nothing are left out, or it is said that they aren't.
cp recording.h5 masked.h5
for pixel in $(seq 0 63); do
    "$V2V_POKE" masked.h5 /views $(((2 * 64 + pixel / 8) * 64 + pixel % 8)) -0.5 || exit 1
done
nothing='frame 0: view 2: 64 samples of one value see nothing and are'
works deconvolve --method rld --psf psf.h5 --input masked.h5 -o masked_rld.h5
grep -q "^$nothing left out\$" stderr || fail "no word on a mask: $(cat stderr)"
missed=$(sed -n 's/.*residual of the views \([0-9.e-]*\),.*/\1/p' stderr)
works evaluate --volume masked_rld.h5 --psf psf.h5 --input masked.h5 --json
found=$(sed -n 's/.*"residual_frames": \[\([0-9.e-]*\).*/\1/p' stdout)
awk -v missed="$missed" -v found="$found" 'BEGIN { off = found / missed - 1; exit !(off * off < 1e-4) }' ||
    fail "of masked views evaluate misses $found, deconvolve $missed"
works reconstruct --psf psf.h5 --weights w.h5 --input masked.h5 -o masked_volumes.h5
grep -q "$nothing taken for dark by this method" stderr || fail "no word on a mask: $(cat stderr)"
works reconstruct --psf others.h5 --weights w.h5 --input recording.h5 -o others_volumes.h5
grep -q 'w.h5: its network was trained with other PSFs' stderr || fail "other PSFs: $(cat stderr)"

# Weight files know their network, and networks what they do not offer.
works weights init --psf psf.h5 --set model.method=backconv --rule he --seed 3 -o backconv.h5
works reconstruct --psf psf.h5 --weights backconv.h5 --input recording.h5 -o backconv_volumes.h5
works info backconv_volumes.h5
says 'volume, 2 frames, 7 slices of 64 x 64'
refuses 78 "'backconv' skips nothing" reconstruct --psf psf.h5 --weights backconv.h5 \
    --input recording.h5 -o out.h5 --skip auto

# Through safetensors and back to the same arrays and attributes; of another program's file the
# names and shapes tell the network.
for name in w backconv; do
    works convert --input "$name.h5" -o "$name.safetensors"
    works convert --input "$name.safetensors" -o "$name-back.h5"
    same "$name.h5" "$name-back.h5" /
    works info "$name.safetensors"
    tail -n +2 stdout >safetensors.txt # but for the name
    works info "$name.h5"
    tail -n +2 stdout | cmp - safetensors.txt || fail "info of $name.safetensors: $(cat safetensors.txt)"
done
sed 's/"method":"v2v"/"mothed":"v2v"/' w.safetensors >strange.safetensors
refuses 2 '--channel is of .*, and strange.safetensors is taken for weights' convert --input strange.safetensors --channel 1 -o none.h5
works convert --input strange.safetensors -o strange.h5
grep -q 'by its names the network v2v, by its shapes of 5 views and 7 slices' stderr ||
    fail "no word on what shapes tell: $(cat stderr)"
same w.h5 strange.h5 /weights # but for the PSFs, which such files do not tell
works info strange.safetensors
says 'strange.safetensors: 104 arrays of another program, [0-9]* numbers, under names of the network v2v$'
says '^unet2.conv_final.4.bias: F32 .7., -[0-9.e-]* to [0-9.e-]*, mean '
# Of however many arrays: each in JSON, for people the first 1000 lines.
header=$(for i in {0..1499}; do
    printf ',"a%d":{"dtype":"F32","shape":[1],"data_offsets":[%d,%d]}' "$i" $((4 * i)) $((4 * i + 4))
done)
header="{${header:1}}"
{
    for shift in 0 8 16 24 32 40 48 56; do
        # shellcheck disable=SC2059
        printf "\\x$(printf %02x $((${#header} >> shift & 255)))"
    done
    printf %s "$header"
    head -c 6000 /dev/zero
} >many.safetensors
works info many.safetensors --json
[ "$(grep -o '"a[0-9]*": "F32' stdout | wc -l)" -eq 1500 ] || fail 'arrays are missing in JSON'
works info many.safetensors
says '^501 more, which --json shows$'
sed 's/"method"/"mothed"/' backconv.safetensors >strange.safetensors
refuses 2 'do not tell its views: give --views' convert --input strange.safetensors -o out.h5
works convert --input strange.safetensors --views 5 -o strange-backconv.h5
same backconv.h5 strange-backconv.h5 /weights
works reconstruct --psf psf.h5 --weights strange.h5 --input recording.h5 -o strange-volumes.h5 \
    --offset none --gain none --normalize none --precision f32 --skip off
same volumes.h5 strange-volumes.h5 /volume

# The example for PyTorch's files, in configs/README.md, with a stub of what it calls that loads our
# own weights under a prefix.
if command -v python3 >/dev/null; then
    awk '/^```python$/ {inside = 1; next} /^```/ {inside = 0} inside' "$root/configs/README.md" >example.py
    mkdir stub
    cat >stub/torch.py <<'EOF'
import json, struct

class Array:
    def __init__(self, shape, raw):
        self.shape, self.raw = shape, raw

    float = contiguous = numpy = lambda self: self
    tobytes = lambda self: self.raw

def load(path, map_location):
    content = open(path, "rb").read()
    end = 8 + struct.unpack("<Q", content[:8])[0]
    header, state = json.loads(content[8:end]), {}
    header.pop("__metadata__", None)
    for name, of in header.items():
        first, last = of["data_offsets"]
        state["module." + name] = Array(tuple(of["shape"]), content[end + first:end + last])
    return {"state_dict": state}
EOF
    PYTHONPATH=stub python3 example.py w.safetensors example.safetensors 2>stderr ||
        fail "the example of configs/README.md: $(cat stderr)"
    works convert --input example.safetensors -o example.h5
    same w.h5 example.h5 /weights
else
    echo "left out: there is no python3 to run the example of configs/README.md"
fi

# Frames with a side below the network's crop are learnt from as far as they go.
works train -c "$root/configs/unrolled.yaml" --psf psf.h5 --input recording_small.h5 --steps 3 \
    -o small-run
grep -q 'samples of 24 x 40' stderr || fail "other samples of small frames: $(cat stderr)"
grep -q '^  crop: auto$' small-run/config.yaml || fail 'the run does not say that its crop was open'
works reconstruct --psf psf.h5 --weights small-run/weights.h5 --input recording_small.h5 -o small.h5
works info small.h5
says 'volume, 2 frames, 7 slices of 24 x 40'

# A correction of no strength is total variation; of all strength it is not, with any weights.
works weights init --psf psf.h5 --set model.method=unrolled --rule he --seed 3 -o unrolled.h5
works deconvolve --psf psf.h5 --input recording.h5 -o tv.h5
for strength in 0 1; do
    works reconstruct --psf psf.h5 --weights unrolled.h5 --input recording.h5 \
        -o "strength-$strength.h5" --set recon.neighbours=0 --strength "$strength"
done
same strength-0.h5 tv.h5 /volume
works reconstruct --psf psf.h5 --weights unrolled.h5 --input recording.h5 -o taken_over.h5 \
    --set recon.neighbours=0 --strength 1 --skip auto --refresh 2 --set model.winograd=false
grep -q 'computed .* of the frames; the rest changed by' stderr || fail "no word on skipping: $(cat stderr)"
works reconstruct --psf psf.h5 --weights unrolled.h5 --input recording.h5 -o all.h5 \
    --set recon.neighbours=0 --strength 1 --skip 0
same strength-1.h5 all.h5 /volume
# What the network is made for goes before what is given, and says so where that is something else.
works weights init --psf psf.h5 --set model.method=unrolled --set recon.neighbours=1 --rule he \
    -o neighbours.h5
neighbours=(reconstruct --psf psf.h5 --weights neighbours.h5 --input recording.h5 -o neighbours_1.h5
    --force --frames 0:1 --strength 0)
taken='^warning.*neighbours.h5: its network is made for recon.neighbours=1, which is taken, not 0'
works "${neighbours[@]}" --neighbours 0
[ "$(grep -c "$taken" stderr)" -eq 1 ] || fail "no word on what is taken: $(cat stderr)"
works "${neighbours[@]}" --neighbours 1
grep -q 'made for' stderr && fail "a warning of what is as it was given: $(cat stderr)"
works "${neighbours[@]}"
grep -q 'made for' stderr && fail "a warning of what was not given: $(cat stderr)"
printf 'recon:\n  neighbours: 2\n' >neighbours.yaml
works "${neighbours[@]}" -c neighbours.yaml
grep -q "${taken%0}2" stderr || fail "no word on what goes before a file: $(cat stderr)"
if h5diff strength-1.h5 tv.h5 /volume >/dev/null; then
    fail 'a correction of strength 1 corrects nothing'
fi
works evaluate --volume tv.h5 --psf psf.h5 --input recording.h5 --json
mv stdout uncorrected.json
works evaluate --volume tv.h5 --psf psf.h5 --input recording.h5 --weights unrolled.h5 \
    --set recon.strength=1 --json --uncertainty corrected.h5
cmp -s stdout uncorrected.json && fail 'evaluate does not correct by the weights'
refuses 78 'parallel.shards: 2 ranks cannot share a frame, 1 at most' evaluate --volume tv.h5 \
    --psf psf.h5 --input recording.h5 --weights unrolled.h5 --set parallel.shards=2
works info corrected.h5
says '^weights_crc32c: [0-9a-f]{8}$'
refuses 65 "w.h5: the network 'v2v' cannot do without some of its views" evaluate --volume tv.h5 \
    --psf psf.h5 --input recording.h5 --weights w.h5

# A homogeneous network takes brightness out: another gain, divided out again, changes nothing.
for way in true false; do
    works weights init --psf psf.h5 --width 4 --rule hash --seed 7 \
        --set "model.homogeneous=$way" -o "homogeneous-$way.h5"
    works weights info "homogeneous-$way.h5"
    says "model.homogeneous: $way"
    for gain in 0.03 3; do
        works reconstruct --psf psf.h5 --weights "homogeneous-$way.h5" --input recording.h5 \
            -o "$gain-$way.h5" --gain "$gain" --set model.homogeneous=false
    done
done
# 1e-4 of the largest value, 18
same 0.03-true.h5 3-true.h5 /volume 1.8e-3
if h5diff -d 1.8e-3 0.03-false.h5 3-false.h5 /volume >/dev/null; then
    fail 'a network that is not homogeneous does not see brightness'
fi

# A range of frames has the bits of the whole, and ends where the recording ends.
works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o whole.h5
works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o second.h5 --frames 1:5
works info second.h5
says 'volume, 1 frames'
h5dump -b LE -o whole.bin -d /volume -s 1,0,0,0 -c 1,7,64,64 whole.h5 >/dev/null
h5dump -b LE -o second.bin -d /volume second.h5 >/dev/null
cmp whole.bin second.bin || fail 'a range of frames is not what the whole recording gives'
refuses 65 'there is no frame 2: it has 2, from 0' reconstruct --psf psf.h5 --weights w.h5 \
    --input recording.h5 -o out.h5 --frames 2:1

refuses 2 '--skip needs model.winograd: true' reconstruct --psf psf.h5 --weights w.h5 \
    --input recording.h5 -o out.h5 --skip auto --set model.winograd=false
works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o skipped.h5 --skip auto --strength 1 \
    --set deconv.noise=poisson
for key in recon.strength deconv.noise; do
    [ "$(grep -c "$key is not a setting of this network" stderr)" -eq 1 ] ||
        fail "no word on $key, of another network: $(cat stderr)"
done
grep -q 'computed [0-9.]* % of the tiles' stderr || fail "no word on skipped tiles: $(cat stderr)"
works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o unskipped.h5 --skip 0
works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o off.h5 --skip off
same unskipped.h5 off.h5 /volume 0
refuses 78 'parallel.reproducible with parallel.shards: 2: .*slabs' reconstruct --psf psf.h5 \
    --weights w.h5 --input recording.h5 -o out.h5 --set parallel.reproducible=true \
    --set parallel.shards=2
timed "$limit" reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o large.h5 --max-mem 0.001
[ $? -eq 70 ] || fail "--max-mem did not end with 70: $(cat stderr)"
grep -q 'of the limit of 1000000 bytes' stderr || fail "--max-mem: $(cat stderr)"
weigh() { # FILE
    works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o "$1" --set recon.combine=learned
}
weigh weighted.h5
! h5diff weighted.h5 whole.h5 /volume /volume >/dev/null 2>&1 || fail 'learned weights are the mean'
works evaluate --volume whole.h5 --psf psf.h5 --input recording.h5 --frames 0 --json
cp stdout of_mean.json
works evaluate --volume weighted.h5 --psf psf.h5 --input recording.h5 --frames 0 --json
residual() { sed 's/.* "residual": \([0-9.]*\),.*/\1/' "$1"; }
awk -v "mean=$(residual of_mean.json)" -v "learned=$(residual stdout)" 'BEGIN { exit !(learned < mean) }' ||
    fail "learned weights explain the views no better: $(cat of_mean.json stdout)"
if [ "$ranks" -gt 1 ]; then
    # Branches on different ranks compute what one rank computes; only the mean is added elsewhere.
    mv volumes.h5 many.h5
    (ranks=1 && works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o volumes.h5 \
        --branches --offset none --gain none --normalize none && weigh alone.h5; exit "$failures") ||
        failures=$((failures + 1))
    same volumes.h5 many.h5 /volume 1e-5
    same weighted.h5 alone.h5 /volume 1e-5
fi

# The golden configuration takes the network from the weight file.
works train -c golden.yaml --psf psf.h5 --input recording.h5 --weights w.h5 -o golden
[ "$(wc -l <golden/metrics.jsonl)" -eq 3 ] || fail 'golden: not 3 lines of metrics'
for key in step mse fft pos dc tv total grad_norm seconds communication; do
    grep -q "\"$key\": " golden/metrics.jsonl || fail "metrics.jsonl has no $key"
done
works weights info golden/weights.h5
says 'step 3'

# A run is not overwritten; it goes on with --resume; several recordings follow one --input.
works train -c tiny.yaml --psf psf.h5 --input recording.h5 recording.h5 -o run
works weights info run/weights.h5
says 'step 4'
timed "$((limit * 10))" train -c tiny.yaml --psf psf.h5 --input recording.h5 -o run
[ $? -eq 2 ] || fail "a second run in the folder was not refused: $(cat stderr)"
works train -c tiny.yaml --psf psf.h5 --input recording.h5 -o run --resume --steps 6 \
    --set model.features=8
[ "$(grep -c 'run: its network is made for model.features=[0-9]*, which is taken, not 8' stderr)" -eq 1 ] ||
    fail "no word on its network: $(cat stderr)"
[ "$(grep -c 'was trained on other frames until here' stderr)" -eq 1 ] ||
    fail "no word on its recordings: $(cat stderr)"
works weights info run/weights.h5
says 'step 6'
[ "$(wc -l <run/metrics.jsonl)" -eq 6 ] || fail 'resumed run: not 6 lines of metrics'
works train -c tiny.yaml --psf psf.h5 --input recording.h5 -o run --resume --steps 6
grep -q '^run: 6 steps are done, 6 were asked for$' stderr || fail "a finished run: $(cat stderr)"
grep -q -e 'other frames' -e 'made for' stderr && fail "the same is called other: $(cat stderr)"
# Without -c it goes on by its own settings; with others it says which.
cp -r run again
grep -v -e '^  steps:' again/config.yaml >config_before
works train --psf psf.h5 --input recording.h5 -o again --resume --steps 7
grep -v -e '^  steps:' again/config.yaml | diff config_before - >/dev/null ||
    fail 'a run went on by other settings'
grep -q 'goes on with' stderr && fail "the same is called other: $(cat stderr)"
works train --psf psf.h5 --input recording.h5 -o again --resume --steps 8 --set train.learning_rate=0.002
[ "$(grep -c 'goes on with train.learning_rate: 0.002, which was' stderr)" -eq 1 ] ||
    fail "no word on another learning rate: $(cat stderr)"
cp again/config.yaml config_before
works train --psf psf.h5 --input recording.h5 -o again --resume --steps 2 --seed 77
grep -q '8 steps are done, 2 were asked for' stderr || fail "$(cat stderr)"
cmp again/config.yaml config_before || fail 'no step was made of settings that were written'
rm again/weights*.h5
works train --psf psf.h5 --input recording.h5 -o again --resume --steps 2
grep -q 'has a log of steps and no checkpoint: begins anew' stderr ||
    fail "no word on lost checkpoints: $(cat stderr)"
# Of a sum over the slices and of their mean one at least is not what the network was trained with.
works reconstruct --psf psf.h5 --weights run/weights.h5 --input recording.h5 -o sum.h5
cp stderr of_sum
works reconstruct --psf psf.h5 --weights run/weights.h5 --input recording.h5 -o mean.h5 --set psf.reduce=mean
[ "$(cat of_sum stderr | grep -c 'times the light of its views: .* is psf.reduce what')" -ge 1 ] ||
    fail "light times the number of slices in silence: $(cat of_sum stderr)"
# Weights of `unrolled` serve other PSFs; a run that goes on with others says so.
corrected=(train -c tiny.yaml --set model.method=unrolled --input recording.h5 -o corrected)
works "${corrected[@]}" --psf psf.h5 --steps 2
works "${corrected[@]}" --psf psf.h5 --steps 3 --resume
grep -q 'other PSFs' stderr && fail "the same PSFs are called other: $(cat stderr)"
works "${corrected[@]}" --psf others.h5 --steps 4 --resume
[ "$(grep -c 'was trained with other PSFs, or another calibration of them, until here' stderr)" -eq 1 ] ||
    fail "no word on its PSFs: $(cat stderr)"
# What their training had chosen for its PSFs is not taken over: without a correction it is total
# variation as it is by itself, or as it is told to be.
of_others=(reconstruct --psf others.h5 --input recording.h5 --weights corrected/weights.h5)
for told in '' --set=deconv.lambda=0.2; do
    works train -c tiny.yaml --set model.method=unrolled --input recording.h5 -o corrected --psf psf.h5 \
        --steps 2 --force
    works "${of_others[@]}" --strength 0 --set recon.neighbours=0 $told -o of_others.h5 --force
    grep -q 'weights.h5: was trained with other PSFs, or another calibration of them: its deconv.lambda' stderr ||
        fail "no word on its lambda: $(cat stderr)"
    grep -q 'deconv.lambda=.*which is taken' stderr && fail "it is not taken: $(cat stderr)"
    works deconvolve --psf others.h5 --input recording.h5 $told -o by_tv.h5 --force
    same of_others.h5 by_tv.h5 /volume
done
# Judged with those of its training, they are what its volumes were made by.
works reconstruct --psf psf.h5 --input recording.h5 --weights corrected/weights.h5 -o of_its_own.h5
works evaluate --volume of_its_own.h5 --psf psf.h5 --input recording.h5 --weights corrected/weights.h5 --verbose
grep -q 'by the noise' stderr && fail "its lambda is chosen once more: $(cat stderr)"
# A run doesn't forget the weights that it is to start from.
cp corrected/weights.h5 kept.h5
refuses 2 'corrected/weights.h5' train -c tiny.yaml --psf psf.h5 --input recording.h5 -o corrected --force \
    --weights corrected/weights.h5
cmp -s corrected/weights.h5 kept.h5 || fail 'a refused run took its weights'
works train -c tiny.yaml --psf psf.h5 --input recording.h5 -o begun_anew --force --weights kept.h5 --steps 1
# A run goes on by its own weights, though those that it began with are gone; one without an average
# does not begin to have one, and keeps its newest checkpoint.
cp kept.h5 gone.h5
works train -c tiny.yaml --psf psf.h5 --input recording.h5 -o begun_with --weights gone.h5 --steps 1
rm gone.h5
works train -c tiny.yaml --psf psf.h5 --input recording.h5 -o begun_with --weights gone.h5 --steps 2 --resume
grep -q 'by its own weights, not gone.h5' stderr || fail "no word on its weights: $(cat stderr)"
cp begun_with/weights.h5 newest.h5
timed "$limit" train --psf psf.h5 --input recording.h5 -o begun_with --steps 3 --resume --set train.average=0.9
[ $? -eq 78 ] || fail "a run began to average: $(cat stderr)"
grep -q 'goes on with train.average=0 alone' stderr || fail "no word on its average: $(cat stderr)"
cmp -s begun_with/weights.h5 newest.h5 || fail 'the newest checkpoint is another'
# What is damaged steps aside for the older one, also where it is the average's.
averaged=(train -c tiny.yaml --psf psf.h5 --input recording.h5 -o averaged --set train.average=0.9)
works "${averaged[@]}" --steps 2 --set train.checkpoint_every_s=0
"$V2V_POKE" averaged/weights.h5 "/last/$(h5ls averaged/weights.h5/last | awk 'NR == 1 { print $1 }')" 0 7 ||
    fail 'nothing was damaged'
works "${averaged[@]}" --steps 3 --resume
grep -q 'cannot resume from averaged/weights.h5: .*is damaged' stderr || fail "no word on it: $(cat stderr)"
grep -q 'resuming after step 1' stderr || fail "the older one isn't taken: $(cat stderr)"
# Where the learning rate goes by the time, it is that of all attempts.
by_time=(train -c tiny.yaml --psf psf.h5 --input recording.h5 -o by_time --steps 100000
    --set train.schedule=linear)
works "${by_time[@]}" --max-time 2s
before=$(wc -l <by_time/metrics.jsonl)
works "${by_time[@]}" --max-time 2s --resume
[ "$(wc -l <by_time/metrics.jsonl)" -le $((before + 1)) ] || fail 'a run was given its time twice'
# Losses that aren't finite replace no checkpoint, and are no success where they are the last.
works train -c tiny.yaml --psf psf.h5 --input recording.h5 -o ruined --steps 4
for steps in 30 8; do
    timed "$limit" train -c tiny.yaml --psf psf.h5 --input recording.h5 -o ruined --resume --steps $steps \
        --set train.learning_rate=1 --set train.checkpoint_every_s=0
    [ $? -eq 70 ] || fail "a ruined run is no failure: $(cat stderr)"
    grep -q 'not finite; the checkpoint is of step 5, before them' stderr ||
        fail "no word on the checkpoint: $(cat stderr)"
    works weights info ruined/weights.h5
    says 'step 5'
done
# Of two runs begun at once in one new folder one is refused, and leaves the other's files alone.
both=(train -c tiny.yaml --psf psf.h5 --input recording.h5 -o both)
"$program" "${both[@]}" >/dev/null 2>other_stderr &
other=$!
"$program" "${both[@]}" >/dev/null 2>stderr
one=$?
wait $other
other=$?
[ $((one == 0)) -ne $((other == 0)) ] || fail "ended with $one and $other: $(cat stderr other_stderr)"
works weights info both/weights.h5
says 'step 4'
# Weights go before the network that a file asks for, and say so.
works train -c tiny.yaml --set model.method=unrolled --psf psf.h5 --input recording.h5 -o both \
    --weights w.h5 --force --steps 1
[ "$(grep -c 'w.h5: its network is made for model.method=v2v, which is taken, not unrolled' stderr)" -eq 1 ] ||
    fail "no word on another network: $(cat stderr)"
works info run
says '^run: run folder, network v2v, 6 of 6 steps logged$'
says '^last total: [0-9.e+]*$'
says '^trained frames: 2$'
works info run --json
says '^[{]"file": "run", "kind": "run", "last_step_logged": 6, .*"step": 6, '
works info run/config.yaml
says 'settings .all of them: v2v3d init -c run/config.yaml.$'

# Frames unlike those of the training are named, where brightness tells the network anything.
quiet_on() { # WEIGHTS OPTIONS...
    works reconstruct --psf psf.h5 --weights "$1" --input recording.h5 -o level.h5 --force "${@:2}"
    grep -q 'outside of what' stderr && fail "reconstruct with $*: $(cat stderr)"
}
outside='frame 0 is outside of what the network was trained on: [a-z]* [0-9.e+]*, there [0-9.e-]* to'
works weights info run/weights.h5
says '^trained frames: 2$'
says '^trained noise over mean: [0-9.]* to [0-9.]*$'
quiet_on run/weights.h5
quiet_on w.h5 --gain 1000 # which was not trained
works reconstruct --psf psf.h5 --weights run/weights.h5 --input recording.h5 -o level.h5 --force \
    --gain 1000
grep -q "$outside" stderr || fail "no warning of the level: $(cat stderr)"
for gain in auto 1000; do
    works evaluate --volume level.h5 --psf psf.h5 --input recording.h5 --frames 0 \
        --weights run/weights.h5 --set "input.gain=$gain" --json
    grep -q "$outside" stdout && known=1000 || known=auto
    [ "$gain" = "$known" ] || fail "evaluate with the gain $gain: $(cat stdout)"
done
# Ablations: settings that weights carry, and that reconstruction takes from them.
for setting in model.view_split=all model.view_split=random model.align=false loss.fft=0 loss.dc=0; do
    works train -c tiny.yaml --psf psf.h5 --input recording.h5 -o ablated --force --set "$setting" \
        --set model.view_seed=3
    works reconstruct --psf psf.h5 --weights ablated/weights.h5 --input recording.h5 -o ablated.h5 --force
    works weights info ablated/weights.h5
    case $setting in model.*) says "${setting/=/: }" ;; esac
    says 'model.view_seed: 3'
done
works reconstruct --psf psf.h5 --weights run/weights.h5 --input recording.h5 -o larger.h5 --set recon.combine=max
works train -c tiny.yaml --psf psf.h5 --input recording.h5 -o levelled --set model.homogeneous=true
quiet_on levelled/weights.h5 --gain 1000

# The time limit ends a run resumably.
timed "$((limit * 10))" train -c tiny.yaml --psf psf.h5 --input recording.h5 -o limited --steps 1000000 \
    --max-time 1s
[ $? -eq 85 ] || fail "--max-time did not end with 85: $(cat stderr)"
works reconstruct --psf psf.h5 --weights limited/weights.h5 --input recording.h5 -o limited.h5

# What computes in bf16 is what the processor has and DNNL_MAX_CPU_ISA leaves: as check says.
offers() # WORDS OF CHECK
{
    works check
    grep -q "convolutions in bf16: .*$1" stdout
}
bf16_by() # WORDS OF THE LOG
{
    works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o bf16.h5 --force \
        --precision bf16
    grep -q "convolutions in bf16: $1" stderr || fail "not in bf16 $1: $(cat stderr)"
    works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o bf16.h5 --force \
        --precision bf16 --skip auto
    grep -q 'computed [0-9.]* % of the tiles' stderr || fail "no word on skipped tiles: $(cat stderr)"
}
if offers 'by the tile unit'; then
    bf16_by 'by the tile unit'
fi
if grep -qw avx512_bf16 /proc/cpuinfo; then
    DNNL_MAX_CPU_ISA=AVX512_CORE_BF16 bf16_by 'by oneDNN'
fi

# Without the instructions bf16 is float32, to its bits, after one warning.
export DNNL_MAX_CPU_ISA=AVX512_CORE
works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o plain.h5
works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o asked.h5 --precision bf16
[ "$(grep -c 'precision bf16: .* all go on in float32' stderr)" -eq 1 ] ||
    fail "not one warning: $(cat stderr)"
same plain.h5 asked.h5 /volume
works train -c tiny.yaml --set train.precision=bf16 --psf psf.h5 --input recording.h5 -o asked
[ "$(grep -c 'precision bf16: .* all go on in float32' stderr)" -eq 1 ] ||
    fail "not one warning: $(cat stderr)"
if grep -qw avx512bw /proc/cpuinfo; then
    works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o emulated.h5 \
        --precision bf16-always
    grep -q 'convolutions in bf16: emulated' stderr || fail "no bf16: $(cat stderr)"
    works reconstruct --psf psf.h5 --weights w.h5 --input recording.h5 -o unskipped16.h5 \
        --precision bf16-always --skip auto
    grep -q 'nothing is skipped where bf16 is emulated' stderr || fail "no warning: $(cat stderr)"
    same emulated.h5 unskipped16.h5 /volume
fi
export DNNL_MAX_CPU_ISA=AVX2
refuses 78 'bf16-always: the processors of' reconstruct --psf psf.h5 --weights w.h5 \
    --input recording.h5 -o out.h5 --precision bf16-always
finish
