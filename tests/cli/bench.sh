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
# another network
works bench --size 40 --repeat 1 -c tiny.yaml --set model.method=backconv
says '^backconv, '
refuses 78 "there is no network 'another'" bench --set model.method=another
refuses 2 '--repeat: ' bench --repeat 0
finish
