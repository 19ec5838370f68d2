#!/usr/bin/env bash
# `v2v3d bench --quick`: every variant with its errors, the files, and what it refuses.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

if [ "$ranks" -gt 1 ]; then
    refuses 2 "bench measures one rank; here are $ranks" bench --quick -o out
    finish
fi
cp "$root/configs/tiny.yaml" .
# The same rows on every processor: none in bf16.
export DNNL_MAX_CPU_ISA=AVX512_CORE
"$V2V_MAKE_BAD" "$folder" || exit 1

# The issue's bar for float32 is 1e-4; NaN and Inf are no number of the pattern.
variants=(default winograd_off merging_off both_off openblas_winograd_off width_32)
works bench --quick -c tiny.yaml -o quick
if [ ! -s quick/bench.json ]; then
    fail 'no bench.json'
    finish
fi
for variant in "${variants[@]}"; do
    says "^${variant//_/.+} +(16|32) +[0-9]"
    for figure in error_1 error_2; do
        error=$(grep -oE "\"$variant\.$figure\": [0-9.]+(e[-+]?[0-9]+)?" quick/bench.json)
        awk -v error="${error##* }" 'BEGIN { exit !(error != "" && error > 0 && error <= 1e-4) }' ||
            fail "$variant: $figure is not within 1e-4: '$error'"
    done
    for figure in forward_s forward_floor_s step_s step_forward_s step_floor_s macs bytes model_bytes; do
        grep -qE "\"$variant\.$figure\": [0-9]" quick/bench.json ||
            fail "bench.json has no $variant.$figure"
    done
done
[ "$(grep -o '\.forward_s"' quick/bench.json | wc -l)" -eq $((${#variants[@]} + 1)) ] ||
    fail 'bench.json has more variants, or fewer'
for key in processor instructions threads gemm_onednn_macs_per_s copy_bytes_per_s \
    peak_resident_bytes; do
    grep -q "\"$key\": " quick/bench.json || fail "bench.json has no $key"
done
grep -qE '"skip.computed_part": (0|1)' quick/bench.json || fail 'no skip.computed_part'
says '^skip auto +(16|32) +[0-9]'
says 'no row in bf16: this processor has no instructions for it'
[ "$(head -c 4 quick/bench.png | tail -c 3)" = PNG ] || fail 'no PNG'
refuses 2 'bench.json: exists' bench --quick -o quick

# A weight file of five views, its recording and the truth: the change of PSNR.
works weights init --psf psf.h5 --width 4 --rule he --seed 3 -o w.h5
works bench --quick --psf psf.h5 --weights w.h5 --input recording.h5 --truth volume.h5 -o quick \
    --force
says "the twin's PSNR is [0-9.]+ dB"
says '^default +4 .* [-+]0\.00[0-9]+ +100.0 +[0-9]+$'
says '^width 16 .* - +100.0 +[0-9]+$'

refuses 2 '--size 48, --step-size 32: both must be multiples of 32' bench --quick --size 48 -o out
refuses 2 '--step-size 96 is larger than --size 64' bench --quick --step-size 96 -o out
refuses 2 '--truth needs --input and --weights' bench --quick --truth volume.h5 -o out
refuses 2 '--repeat: ' bench --quick --repeat 2 -o out
finish
