#!/usr/bin/env bash
# Every ```sh block of README.md, in order, in one folder, with v2v3d in the PATH. Blocks that
# install or build, or hand jobs to Slurm, are left out by what they call; blocks that need the
# shared data are left out where those are absent.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

readme=$root/README.md
if [ ! -e "$readme" ]; then
    echo "there is no README.md yet"
    exit 77
fi
mkdir work bin
ln -s "$program" bin/v2v3d
for name in configs jobs; do
    ln -s "$root/$name" "work/$name"
done
[ -d "${V2V_SHARED:-}" ] && ln -s "$V2V_SHARED" shared
PATH=$folder/bin:$PATH
cd work || exit 1

awk '/^```sh$/ {inside = 1; n++; next}
     /^```/ {inside = 0}
     inside {print > sprintf("../block_%02d", n)}' "$readme"
run=0
for block in ../block_*; do
    [ -e "$block" ] || break
    if grep -qE '(^|[ /])(tools/dev|cmake|git clone|apt-get|sbatch|srun)( |$)' "$block"; then
        echo "left out: $(head -1 "$block")"
        continue
    fi
    if grep -q '\.\./shared' "$block" && [ ! -d ../shared ]; then
        echo "left out, no shared data: $(head -1 "$block")"
        continue
    fi
    timeout -k 5 $((limit * 50)) bash -c "set -eu; . '$block'" >../stdout 2>../stderr </dev/null ||
        fail "README.md: $(cat "$block"): $(tail -5 ../stderr)"
    run=$((run + 1))
done
echo "$run blocks were run"
finish
