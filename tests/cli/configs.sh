#!/usr/bin/env bash
# Every configuration in configs/ loads, and what is written from it loads to the same.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

count=0
for file in "$root"/configs/*.yaml; do
    name=$(basename "$file")
    works init -c "$file" -o "$name"
    works init -c "$name" -o "again_$name"
    cmp "$name" "again_$name" || fail "$name changes when it is read again"
    count=$((count + 1))
done
[ "$count" -ge 5 ] || fail "only $count configurations"
# The published setting, number by number (REFERENCE.md 5).
for line in 'width: 128' 'steps: 160000' 'crop: 128' 'batch: 1' 'learning_rate: 8e-05' \
    'decay: 0.3' 'decay_at: 120000' 'profile: paper'; do
    grep -q "^  $line " paper.yaml || fail "paper.yaml: no $line"
done
# Those of optics make PSFs.
for optics in '2psam 13 views, 39 slices of 128' 'fourier 7 views, 39 slices of 95' \
    'widefield 1 views, 21 slices of 95'; do
    works psf simulate -c "${optics%% *}.yaml" -o psf.h5 --force
    works psf info psf.h5
    says "${optics#* }"
done
finish
