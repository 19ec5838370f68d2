# shellcheck shell=bash
# What the tests on the Slurm sandbox share: jobs and what is done to them.
# shellcheck source=tests/cluster/lib.sh
. "$here/lib.sh"
use_sandbox slurm
export SLURM_CONF=$folder/sandbox/slurm.conf
export V2V3D_HOME=$root V2V3D_PROGRAM=$program

# field JOB NAME: what Slurm says of a job.
field() {
    scontrol show job -o "$1" 2>/dev/null | grep -o "\b$2=[^ ]*" | head -n 1 | cut -d= -f2-
}

is_state() { # JOB STATE
    [ "$(field "$1" JobState)" = "$2" ]
}

log_of() {
    echo "$folder/slurm-$1.out"
}

attempts() {
    grep -c "^job $1: attempt " "$(log_of "$1")"
}

# broken JOB WHAT: the job did not get where it should.
broken() {
    fail "job $1: $2: $(scontrol show job -o "$1" 2>&1 | grep -oE '(JobState|Reason|Restarts|ExitCode)=[^ ]*' | xargs)"
    tail -n 30 "$(log_of "$1")"
    finish
}

# A requeued job waits two minutes for what is left of its last attempt. Here it starts earlier, but
# not before Slurm has done with that: it would take, and kill, the one for the other.
hurry() { # JOB
    case $(field "$1" JobState) in
    PENDING)
        sleep 5
        # a node that still holds the old attempt refuses the new one, which Slurm then holds
        [[ $(field "$1" Reason) != *held* ]] || scontrol release "$1"
        scontrol update jobid="$1" starttime=now timelimit=30 2>/dev/null # it may run by now
        ;;
    FAILED | CANCELLED | TIMEOUT | NODE_FAIL)
        broken "$1" "has ended"
        ;;
    esac
}

has_restarts() { # JOB COUNT
    [ "$(field "$1" Restarts)" -ge "$2" ] 2>/dev/null
}

# The next attempt of the job, or one after it, has written COUNT lines more than there were; an
# attempt that finds its node not ready yet is followed by another.
progress() { # JOB RESTARTS FILE LINES
    within 120 has_restarts "$1" "$2" || broken "$1" "was not requeued $2 times"
    within 240 has_progressed "$@" || broken "$1" "makes no progress"
}

has_progressed() { # JOB RESTARTS FILE LINES
    hurry "$1"
    [ "$(lines_of "$3")" -ge "$4" ]
}

completed() { # JOB
    hurry "$1"
    is_state "$1" COMPLETED
}

is_program() { # PID
    [ "$(readlink "/proc/$1/exe")" = "$(readlink -f "$program")" ]
}

# The processes of the program on a node, but for those that it has forked itself.
ranks_on() { # NODE
    local pid
    for pid in $(ip netns pids "v2vslurm-$1"); do
        if is_program "$pid" && ! is_program "$(awk '/^PPid:/ { print $2 }' "/proc/$pid/status")"
        then
            echo "$pid"
        fi
    done
}

kill_rank_on() { # NODE
    local pid
    pid=$(ranks_on "$1" | head -n 1)
    [ -n "$pid" ] && kill -9 "$pid"
}

# Ranks stand still, so that what comes next finds the job running however fast it is.
freeze() { # NODE...
    local node pid
    for node in "$@"; do
        for pid in $(ranks_on "$node"); do kill -STOP "$pid"; done
    done
}

thaw() { # NODE...
    local node pid
    for node in "$@"; do
        for pid in $(ranks_on "$node"); do kill -CONT "$pid"; done
    done
}

# The warning as Slurm sends it before a time limit.
warn() { # JOB
    freeze n1 n2
    scancel --batch --signal=USR1 "$1"
    sleep 2
    thaw n1 n2
}

# When each attempt of a job began, and its end.
report() { # JOB START
    echo "job $1, $(since "$2") s:"
    grep -E '^job|resuming' "$(log_of "$1")" | sed 's/^/  /'
}
