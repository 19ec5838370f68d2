#!/usr/bin/env bash
# A recording reconstructed on two nodes through a signal, a killed rank and the crash of the node
# that runs the script goes on from the frames that are done, and ends with the volume of a run that
# nobody touched; and an array of ranges of its frames ends with the pieces of it.
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source=tests/cluster/slurm_lib.sh
. "$here/slurm_lib.sh"

# Enough that every attack finds some still to do: two fast cores do 37 in a second.
frames=960
each=256
reconstruct=(--psf scene/psf.h5 --weights weights.h5 --input recording.h5)

# Frames that the unfinished file says are done.
done_frames() { # FILE
    h5dump -y -w 0 -d /done "$1.v2v3d-part" 2>/dev/null | sed -n '/DATA {/,/}/p' | grep -ow 1 | wc -l
}

# The job's current attempt has done some frames. Sets `restarts` and `before`.
some_frames() { # JOB FILE WHAT
    within 120 has_restarts "$1" "$restarts" || broken "$1" "was not requeued after $3"
    within 240 has_more_frames "$1" "$2" || broken "$1" "makes no progress"
    freeze n1 n2
    before=$(done_frames "$2")
    restarts=$(field "$1" Restarts)
    echo "$V2V3D_LAUNCHER: $before frames are done after $3, $(since "$start") s"
    restarts=$((restarts + 1))
}

# shellcheck disable=SC2317 # called by `within`
has_more_frames() { # JOB FILE
    hurry "$1"
    [ "$(done_frames "$2")" -ge $((before + 4)) ]
}

scenario() { # LAUNCHER
    local job start restarts=0 before=0
    start=$(seconds)
    export V2V3D_LAUNCHER=$1
    job=$(sbatch --parsable --nodes=2 --time=10 "$root/jobs/reconstruct.sbatch" \
        "${reconstruct[@]}" -o "$1.h5") || give_up "sbatch"
    some_frames "$job" "$1.h5" 'the start'
    warn "$job"
    some_frames "$job" "$1.h5" 'a signal'
    kill_rank_on n2 || broken "$job" "there is no rank on n2"
    some_frames "$job" "$1.h5" 'a killed rank'
    "$sandbox" crash "$folder/sandbox" n1
    within 120 has_restarts "$job" "$restarts" || broken "$job" "was not requeued"
    echo "$1: requeued after the crash of n1, $(since "$start") s"
    "$sandbox" node "$folder/sandbox" n1 || broken "$job" "the node does not come back"
    within 300 completed "$job" || broken "$job" "did not end well"
    report "$job" "$start"
    [ "$(attempts "$job")" -ge 4 ] || fail "the log shows $(attempts "$job") attempts, not 4"
    [ "$(grep -cE "resuming: [1-9][0-9]* of $frames frames are done" "$(log_of "$job")")" -ge 3 ] ||
        fail "the log does not show three resumed attempts"
    same volume.h5 "$1.h5" /volume
    if compgen -G "$1.h5.*" >/dev/null; then
        fail "$(echo "$1".h5.*) is left"
    fi
}

# `v2v3d slurm` fills the script in; four tasks, the last one of fewer frames.
array() {
    local job k start
    start=$(seconds)
    "$program" slurm array --array 0-3 --each "$each" --time 5m --launcher srun -- "${reconstruct[@]}" \
        -o 'piece_%a.h5' >array.sbatch || give_up "v2v3d slurm"
    V2V3D_LAUNCHER='' job=$(sbatch --parsable --wait array.sbatch) ||
        { cat slurm-*_*.out; give_up "the array did not end well"; }
    echo "array $job: $(since "$start") s"
    for k in 0 1 2 3; do
        h5dump -b LE -o piece -d /volume "piece_$k.h5" >/dev/null
        h5dump -b LE -o part -d /volume -s "$((each * k)),0,0,0" \
            -c "$((k < 3 ? each : frames - 3 * each)),7,128,128" volume.h5 >/dev/null
        if [ ! -s part ] || ! cmp piece part; then
            fail "task $k is not that part of the whole volume"
        fi
        rm -f piece part
    done
}

make_scene "$frames" 128
"$program" weights init --psf scene/psf.h5 --width 16 -o weights.h5 >/dev/null || give_up "weights"
start=$(seconds)
mpirun --oversubscribe --bind-to none -n 2 "$program" reconstruct --quiet "${reconstruct[@]}" \
    -o volume.h5 || give_up "reconstruction without Slurm"
echo "untouched: $(since "$start") s"
scenario srun
scenario mpirun
array
finish
