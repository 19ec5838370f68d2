#!/usr/bin/env bash
# Training on two nodes through a time limit, a signal, the crash of a node and a killed rank ends
# with the weights of a run that nobody touched, under srun and under mpirun.
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source=tests/cluster/slurm_lib.sh
. "$here/slurm_lib.sh"

train=(-c "$root/configs/tiny.yaml" --psf scene/psf.h5 --input recording.h5
    --set train.checkpoint_every_s=1)

# Every attempt shall end before the last step: steps for some 25 s, as fast as this machine is now,
# but not fewer than five attempts of a fast one take.
count_steps() {
    local start took
    start=$(seconds)
    mpirun --oversubscribe --bind-to none -n 2 "$program" train --quiet "${train[@]}" -o timed \
        --steps 40 || give_up "training without Slurm"
    took=$(since "$start")
    steps=$(awk -v took="$took" 'BEGIN { n = 40 * 25 / took; printf "%d", (n > 200 ? n : 200) }')
    echo "40 steps in $took s: $steps steps"
}

# Slurm looks at time limits every 30 s, and sends the warning when less than 30 s and those of
# --signal are left: 10 to 40 s after the start.
wait_for_the_time_limit() { # JOB RUN
    within 60 is_state "$1" RUNNING || broken "$1" "does not run"
    progress "$1" 0 "$2/metrics.jsonl" 8
    freeze n1 n2
    sleep 43
    thaw n1 n2
}

# after JOB RUN WHAT: the job was requeued and has done steps since. Sets `restarts` for the next.
after() {
    local lines
    within 120 has_restarts "$1" $((restarts + 1)) || broken "$1" "was not requeued after $3"
    lines=$(lines_of "$2/metrics.jsonl")
    progress "$1" $((restarts + 1)) "$2/metrics.jsonl" $((lines + 8))
    freeze n1 n2
    restarts=$(field "$1" Restarts)
    echo "$V2V3D_LAUNCHER: on its way again after $3, $(since "$start") s"
}

scenario() { # LAUNCHER
    local run=run_$1 job start restarts=0
    start=$(seconds)
    export V2V3D_LAUNCHER=$1
    job=$(sbatch --parsable --nodes=2 --time=1 --signal=B:USR1@20 "$root/jobs/train.sbatch" \
        "${train[@]}" -o "$run" --steps "$steps") || give_up "sbatch"
    wait_for_the_time_limit "$job" "$run"
    after "$job" "$run" 'the time limit'
    warn "$job"
    after "$job" "$run" 'a signal'
    "$sandbox" crash "$folder/sandbox" n2
    within 120 has_restarts "$job" $((restarts + 1)) || broken "$job" "was not requeued"
    echo "$V2V3D_LAUNCHER: requeued after the crash of n2, $(since "$start") s"
    "$sandbox" node "$folder/sandbox" n2 || broken "$job" "the node does not come back"
    after "$job" "$run" 'the crash of a node'
    kill_rank_on n2 || broken "$job" "there is no rank on n2"
    after "$job" "$run" 'a killed rank'
    thaw n1 n2
    within 300 completed "$job" || broken "$job" "did not end well"
    report "$job" "$start"
    [ "$(field "$job" ExitCode)" = 0:0 ] || fail "exit code $(field "$job" ExitCode)"
    [ "$(attempts "$job")" -ge 5 ] || fail "the log shows $(attempts "$job") attempts, not 5"
    [ "$(grep -c 'resuming after step' "$(log_of "$job")")" -ge 4 ] ||
        fail "the log does not show four resumed attempts"
    same run/weights.h5 "$run/weights.h5"
    [ "$(lines_of "$run/metrics.jsonl")" -eq "$steps" ] ||
        fail "$run/metrics.jsonl has $(lines_of "$run/metrics.jsonl") lines for $steps steps"
}

make_scene 4 64
count_steps
start=$(seconds)
mpirun --oversubscribe --bind-to none -n 2 "$program" train --quiet "${train[@]}" -o run \
    --steps "$steps" || give_up "training without Slurm"
echo "untouched: $(since "$start") s"
scenario srun
scenario mpirun
finish
