# Sourced by the job scripts: runs v2v3d on the job's ranks, hands Slurm's warning on, and puts the
# job back into the queue when the run can go on later.
#
#   V2V3D_PROGRAM        the program; default: build/release/v2v3d, the one that was installed with
#                        these scripts, v2v3d of the PATH
#   V2V3D_LAUNCHER       srun (default) or mpirun
#   V2V3D_LAUNCHER_ARGS  more words for the launcher
#   V2V3D_MAX_CRASHES    restarts after killed runs in a row, then the job is given up; default 5
#
# A run that was killed, by Slurm or with its node, goes on from its last checkpoint or frame; one
# that finds another run at work on its output (75) is tried again later.
# shellcheck shell=bash
set -uo pipefail

default_program=$V2V3D_HOME/build/release/v2v3d
[[ -x $default_program ]] || default_program=$V2V3D_HOME/../../bin/v2v3d
[[ -x $default_program ]] || default_program=v2v3d
program=${V2V3D_PROGRAM:-$default_program}

# The words that start the program on every rank.
launcher_words()
{
    local more=()
    read -ra more <<<"${V2V3D_LAUNCHER_ARGS:-}"
    case ${V2V3D_LAUNCHER:-srun} in
    srun)
        # a killed rank ends the others too
        launcher=(srun --mpi=pmix --kill-on-bad-exit=1 "${more[@]}")
        ;;
    mpirun)
        # unbound: by default every rank would have one core for all its threads
        launcher=(mpirun --bind-to none "${more[@]}")
        ;;
    *)
        echo "V2V3D_LAUNCHER is '$V2V3D_LAUNCHER': srun or mpirun" >&2
        exit 78
        ;;
    esac
}

# Since Slurm 22.05 srun doesn't take the CPUs of a task over from sbatch by itself.
thread_settings()
{
    if [[ -n ${SLURM_CPUS_PER_TASK:-} ]]; then
        export SRUN_CPUS_PER_TASK=$SLURM_CPUS_PER_TASK
        export OMP_NUM_THREADS=${OMP_NUM_THREADS:-$SLURM_CPUS_PER_TASK}
    fi
    if [[ $(id -u) -eq 0 ]]; then
        export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
    fi
}

# Back into the queue. Slurm kills this script for it, so that nothing may follow; the sleep waits
# for that.
requeue() # REASON
{
    echo "job ${SLURM_JOB_ID:-?}: $1; back into the queue"
    scontrol requeue "$SLURM_JOB_ID" && sleep 60
}

# Killed runs in a row, one line each, beside Slurm's own output file. Fails if it can't count.
count_crash() # EXIT_CODE
{
    printf '%s exit %d restart %d\n' "$(date -u +%FT%TZ)" "$1" "${SLURM_RESTART_COUNT:-0}" \
        >>"$crash_list" && crashes=$(wc -l <"$crash_list")
}

# v2v3d COMMAND --resume ARGUMENT...: a first run has nothing to resume and starts.
run_job() # COMMAND [--] [ARGUMENT...]
{
    local command=$1 launcher=() pid='' forwarded rc crashes
    local crash_list=v2v3d-${SLURM_JOB_ID:-0}.crashes proof=v2v3d-${SLURM_JOB_ID:-0}.finished
    shift
    [[ ${1:-} != -- ]] || shift
    launcher_words
    thread_settings
    echo "job ${SLURM_JOB_ID:-?}: attempt $((${SLURM_RESTART_COUNT:-0} + 1)) on" \
        "${SLURM_JOB_NODELIST:-$(hostname)}, $(date -u +%FT%TZ)"

    # Slurm sends USR1 to this script alone; both launchers hand it on to the ranks, which write a
    # checkpoint and exit with 85.
    trap 'forwarded=1; [[ -z $pid ]] || kill -USR1 "$pid"' USR1
    rm -f "$proof"
    "${launcher[@]}" "$program" "$command" --resume --proof "$proof" "$@" &
    pid=$!
    # a trapped USR1 ends wait with 128 + 10 while the launcher still runs
    while :; do
        forwarded=0
        wait "$pid"
        rc=$?
        ((forwarded && rc == 138)) || break
    done
    trap '' USR1
    # srun 22.05 ends with 0 when it could not start its only task
    if ((rc == 0)) && [[ ! -e $proof ]]; then
        echo "job ${SLURM_JOB_ID:-?}: the launcher has ended, the program has not" >&2
        rc=71
    fi
    rm -f "$proof"

    case $rc in
    85) # stopped after a checkpoint
        rm -f "$crash_list"
        requeue "stopped, resumable"
        ;;
    # not started, busy, KILL, USR1 before the program could catch it, TERM, a lost node
    71 | 75 | 137 | 138 | 143 | 205)
        if ! count_crash "$rc"; then
            echo "cannot write $crash_list: not requeued" >&2
        elif ((crashes <= ${V2V3D_MAX_CRASHES:-5})); then
            requeue "exit $rc, crash $crashes in a row"
        else
            echo "job ${SLURM_JOB_ID:-?}: $crashes crashes in a row: given up" >&2
        fi
        ;;
    *)
        rm -f "$crash_list"
        ;;
    esac
    exit "$rc"
}

# WORD with the task's number for %a and the recording's name for %n, whatever that holds, in $REPLY.
fill_word() # WORD TASK NAME
{
    local rest=$1 head
    REPLY=
    while [[ $rest == *%[an]* ]]; do
        head=${rest%%%[an]*}
        rest=${rest#"$head"}
        REPLY+=$head
        if [[ $rest == %a* ]]; then REPLY+=$2; else REPLY+=$3; fi
        rest=${rest:2}
    done
    REPLY+=$rest
}

# One task of an array: `reconstruct` on a range of frames, or on one recording of a list. In the
# arguments %a is the task's number, %n the recording's name without folder and ending, which --each
# has not.
run_array() # --each FRAMES | --list FILE, [--] [ARGUMENT...]
{
    local task=${SLURM_ARRAY_TASK_ID:-} kind=${1:-} value=${2:-} recording='' name='' word
    local own=() words=() needed='%a or %n' pattern='%[an]'
    if [[ -z $task ]]; then
        echo "not a task of an array: sbatch --array=0-9" >&2
        exit 2
    fi
    case $kind in
    --each)
        if [[ ! $value =~ ^[1-9][0-9]*$ ]]; then
            echo "--each '$value': a number of frames is needed" >&2
            exit 2
        fi
        own=(--frames "$((task * value)):$value")
        needed='%a' pattern='%a'
        ;;
    --list)
        recording=$(sed -n -e "$((task + 1))p" -- "$value") || exit 65
        recording=${recording%$'\r'} # a list from Windows
        if [[ -z $recording ]]; then
            echo "$value: no line $((task + 1)) for task $task" >&2
            exit 65
        fi
        name=${recording%/}
        name=${name##*/}
        [[ -d $recording ]] || name=${name%.*}
        own=(--input "$recording")
        ;;
    *)
        echo "an array needs --each FRAMES or --list FILE first" >&2
        exit 2
        ;;
    esac
    shift 2
    [[ ${1:-} != -- ]] || shift
    # shellcheck disable=SC2053 # a pattern
    if [[ $* != *$pattern* ]]; then
        echo "all tasks would write one file: the output's name needs $needed" >&2
        exit 2
    fi
    for word in "$@"; do
        fill_word "$word" "$task" "$name"
        words+=("$REPLY")
    done
    run_job reconstruct -- "${words[@]}" "${own[@]}"
}
