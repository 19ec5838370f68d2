#!/usr/bin/env bash
# A node that is cut off the network keeps its ranks, while Slurm starts the job again elsewhere: the
# new attempt finds the run locked, touches nothing (75) and is tried again; once the old ranks are
# gone it goes on, to the weights of a run that nobody touched.
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source=tests/cluster/slurm_lib.sh
. "$here/slurm_lib.sh"

# The test hurries: attempts that find the node or the run not ready follow each other at once.
export V2V3D_MAX_CRASHES=100
steps=300 # many times what passes while the node is found and cut off
train=(-c "$root/configs/tiny.yaml" --psf scene/psf.h5 --input recording.h5
    --set train.checkpoint_every_s=1 --steps "$steps")

make_scene 4 64
"$program" train --quiet "${train[@]}" -o run || give_up "training without Slurm"
start=$(seconds)
job=$(sbatch --parsable --nodes=1 --time=10 "$root/jobs/train.sbatch" "${train[@]}" \
    -o cut) || give_up "sbatch"
progress "$job" 0 cut/metrics.jsonl 4
within 60 [ -e cut/weights.h5 ] || broken "$job" "wrote no checkpoint"
node=$(field "$job" BatchHost)
freeze "$node" # it holds the lock
"$sandbox" cut "$folder/sandbox" "$node"
echo "$node is cut off, $(since "$start") s"
within 120 has_restarts "$job" 1 || broken "$job" "was not requeued"
echo "requeued, $(since "$start") s"
# shellcheck disable=SC2317 # called by `within`
found_busy() {
    hurry "$job"
    grep -q 'another run works in this folder' "$(log_of "$job")"
}
within 90 found_busy || broken "$job" "did not find the run locked"
lines=$(lines_of cut/metrics.jsonl)
echo "found the run locked, $(since "$start") s"
"$sandbox" join "$folder/sandbox" "$node"
# Slurm finds the old rank when the node reports itself, and kills it.
# Attempts in quick succession before that would only make it hold the job.
sleep 30
within 300 completed "$job" || broken "$job" "did not end well"
report "$job" "$start"
grep -qE 'resuming after step [0-9]' "$(log_of "$job")" || fail "nothing was resumed"
[ "$lines" -lt "$steps" ] || fail "the run was at its end before it was cut off"
same run/weights.h5 cut/weights.h5
[ "$(lines_of cut/metrics.jsonl)" -eq "$steps" ] ||
    fail "cut/metrics.jsonl has $(lines_of cut/metrics.jsonl) lines for $steps steps"
finish
