#!/usr/bin/env bash
# `v2v3d bench`: every variant with its time and its errors, for every network, and what it refuses.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

if [ "$ranks" -gt 1 ]; then
    refuses 2 "bench measures one rank; here are $ranks" bench
    finish
fi
cp "$root/configs/tiny.yaml" .
# The same rows on every processor: none in bf16.
export DNNL_MAX_CPU_ISA=AVX512_CORE

# All of them compute the same volumes: float32 is good for 1e-4 after the network's 18 layers. NaN
# and Inf are no number of the pattern.
variants=(exact 'as configured' 'winograd off' 'merging off' openblas)
works bench --size 64 --json -c tiny.yaml
for variant in "${variants[@]}"; do
    grep "\"variant\": \"$variant\"" stdout >line || fail "no $variant"
    for figure in forward_s forward_backward_s bytes; do
        grep -qE "\"$figure\": [0-9.e-]+," line || fail "$variant has no $figure"
    done
    errors=$(sed -n 's/.*"error": \[\([0-9.e, -]*\)\].*/\1/p' line)
    awk -v errors="$errors" 'BEGIN {
        n = split(errors, e, ", *")
        for (i = 1; i <= n; i++)
            if (!(e[i] <= 1e-4))
                exit 1
        exit n != 2
    }' || fail "$variant: errors are not within 1e-4: '$errors'"
done
grep '"as configured"' stdout | grep -qvF '"error": [0, 0]' ||
    fail 'equal volumes: nothing was compared'
[ "$(wc -l <stdout)" -eq ${#variants[@]} ] || fail "other variants: $(cat stdout)"

works bench --size 40 --repeat 1 -c tiny.yaml
says ' views of 64 x 64 pixels, '
for variant in "${variants[@]}"; do
    says "^$variant +[0-9]+\.[0-9]+ +[0-9]"
done
# the other networks, which take other images than views, and make others than volumes
for network in backconv unrolled vcdnet deepcad synthesis; do
    works bench --size 40 --repeat 1 -c tiny.yaml --set "model.method=$network"
    says "^$network, "
done

# Every method on a recording, as the commands of a user have it.
works demo -c tiny.yaml -o own
works simulate --psf own/psf.h5 --volume own/truth.h5 -o one.h5 --noise gaussian:0.2 --seed 5 --frames 1
methods=(bench --methods --psf own/psf.h5 --truth own/truth.h5 --weights own/run/weights.h5)
mkdir temporary
TMPDIR=$folder/temporary works "${methods[@]}" --input one.h5 --json
mv stdout rows
[ -z "$(find temporary -name 'v2v3d-bench.*')" ] || fail 'a volume was left behind'
of() { # METHOD FIGURE
    sed -n "/\"method\": \"$1\"/s/.*\"$2\": \([^,}]*\).*/\1/p" rows
}
for row in rl-30 rld-1 rld-heldout frl-10 tv-1.5e-2 weights weights-skip; do
    for figure in start_s frame_s psnr ssim heldout_residual heldout_sigmas; do
        of "$row" "$figure" | grep -qE '^[0-9.e-]+$' || fail "$row has no $figure: $(cat rows)"
    done
done
# neighbours where there are frames, bf16 where the processor has it
grep -q 'tv-neighbours\|bf16' rows && fail "rows that say nothing: $(cat rows)"
works deconvolve --method tv --psf own/psf.h5 --input one.h5 -o tv.h5
works evaluate --volume tv.h5 --truth own/truth.h5 --psf own/psf.h5 --input one.h5 --json
[ "$(of tv-1.5e-2 psnr)" = "$(sed -n 's/.*"psnr": \([^,]*\).*/\1/p' stdout)" ] ||
    fail "another PSNR than evaluate's: $(cat stdout)"
# Views 0 and 2 of five are left out, each by itself, as by evaluate.
sed -n 's/.*"heldout_residual_views": \[\([^]]*\)\].*/\1/p' stdout >views
awk -F ', *' -v "h=$(of tv-1.5e-2 heldout_residual)" '{
    low = $1 < $3 ? $1 : $3
    high = $1 < $3 ? $3 : $1
    exit !(h > low && h < high)
}' views || fail "$(of tv-1.5e-2 heldout_residual) is not between those of evaluate: $(cat views)"
works reconstruct --psf own/psf.h5 --weights own/run/weights.h5 --input one.h5 -o network.h5
works evaluate --volume network.h5 --truth own/truth.h5 --json
[ "$(of weights psnr)" = "$(sed -n 's/.*"psnr": \([^,]*\).*/\1/p' stdout)" ] ||
    fail "another PSNR of the network than evaluate's: $(cat stdout)"
works "${methods[@]}" --input own/recording.h5 --only tv-neighbours weights
says '^tv-neighbours( +[0-9.]+){6} *$'
says '^weights( +[0-9.]+){6} +own/run/weights.h5$'
[ "$(wc -l <stdout)" -eq 4 ] || fail "other rows than asked for: $(cat stdout)"
# what is known of single frames' noise is refused where they are averaged: no row
works bench --methods --psf own/psf.h5 --input own/recording.h5 --set deconv.electrons_per_count=2 \
    --only tv-5e-2 tv-neighbours rl-10
says '^tv-5e-2 '
grep -q 'tv-neighbours' stdout && fail "a row that is refused: $(cat stdout)"
refuses 2 '--methods needs --input' bench --methods --psf own/psf.h5
: >.v2v3d-part
refuses 2 "--only: there is no row 'tv'" "${methods[@]}" --input one.h5 --only tv
[ -e .v2v3d-part ] || fail "a file that is not the bench's was removed"
refuses 2 '--input needs --methods' bench --input one.h5

refuses 78 "there is no network 'another'" bench --set model.method=another
refuses 2 '--repeat: ' bench --repeat 0
finish
