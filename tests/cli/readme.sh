#!/usr/bin/env bash
# Every ```sh block of the pages, in order, in one folder, with v2v3d in the PATH. Blocks that
# install or build, or hand jobs to Slurm, are left out by what they call. psf.h5 and recording.h5,
# the reader's own files, are the demo's, as is what recordings.txt names; fast.yaml is tiny.yaml and unrolled.yaml of few steps, for
# they take minutes.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

mkdir work bin
ln -s "$program" bin/v2v3d
PATH=$folder/bin:$PATH
export OMPI_MCA_rmaps_base_oversubscribe=1
cd work || exit 1
cp -r "$root/configs" "$root/jobs" .
cp configs/tiny.yaml configs/fast.yaml
sed -i 's/^  steps: .*/  steps: 20/; s/^  crop: .*/  crop: 32/' configs/unrolled.yaml
works demo -c configs/tiny.yaml -o own
mv own/psf.h5 own/recording.h5 .
cp recording.h5 rec_1.h5
echo rec_1.h5 >recordings.txt

run=0
for page in README.md configs/README.md jobs/README.md src/README.md src/io/README.md \
    tests/README.md tests/bench/README.md; do
    rm -f ../block_*
    awk '/^```sh$/ {inside = 1; n++; next}
         /^```/ {inside = 0}
         inside {print > sprintf("../block_%02d", n)}' "$root/$page"
    for block in ../block_*; do
        [ -e "$block" ] || break
        if grep -qE '(^|[ /])(tools/dev|cmake|ctest|git clone|apt-get|sbatch|srun)( |$)' "$block"; then
            echo "left out: $(head -1 "$block")"
            continue
        fi
        timeout -k 5 $((limit * 50)) bash -c "set -eu; . '$block'" >../stdout 2>../stderr </dev/null ||
            fail "$page: $(cat "$block"): $(tail -5 ../stderr)"
        run=$((run + 1))
    done
done
echo "$run blocks were run"
[ "$run" -ge 8 ] || fail "only $run blocks"
finish
