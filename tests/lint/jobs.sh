#!/bin/bash
# The job scripts start the program with the right words and requeue exactly what can go on:
# seen with a launcher, scontrol and sleep that only write down how they were called.
# jobs.sh [ROOT [SCRIPT...]]: train, reconstruct or array, or all of them, and what an array makes of
# its arguments.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
root=$PWD
fake=$(mktemp -d)
trap 'rm -rf "$fake"' EXIT

cat >"$fake/launch" <<'END'
#!/bin/bash
trap 'exit 85' USR1
printf '%s' "${0##*/}" >>calls
printf ' [%s]' "$@" >>calls
echo >>calls
[[ $FAKE_EXIT != 0 ]] || touch v2v3d-7.finished
[[ $FAKE_EXIT != nothing ]] || exit 0
[[ $FAKE_EXIT == on-usr1 ]] || exit "$FAKE_EXIT"
touch ready
for ((tick = 0; tick < 300; tick++)); do command -p sleep 0.1; done
exit 1
END
printf '#!/bin/bash\necho "scontrol $*" >>calls\n' >"$fake/scontrol"
printf '#!/bin/bash\n' >"$fake/sleep"
chmod +x "$fake"/*
cp "$fake/launch" "$fake/srun"
cp "$fake/launch" "$fake/mpirun"

failures=0
[[ $# -gt 1 ]] || set -- "$root" train reconstruct array

fail() # WHAT
{
    echo "jobs/$script.sbatch: $case_name: $1"
    failures=$((failures + 1))
}

# Runs the script in its own folder, as Slurm's job 7 (from a spool copy, as Slurm does it).
start() # FAKE_EXIT LAUNCHER ARGUMENT...
{
    cp "$root/jobs/$script.sbatch" "$fake/slurm_script"
    [[ $script != array ]] || set -- "$1" "$2" --each 5 "${@:3}" -o %a.h5
    PATH=$fake:$PATH SLURM_ARRAY_TASK_ID=3 FAKE_EXIT=$1 V2V3D_LAUNCHER=$2 V2V3D_HOME=$root V2V3D_PROGRAM=prog \
        SLURM_JOB_ID=7 exec bash "$fake/slurm_script" "${@:3}" >output 2>&1
}

# case | exit code of the program | times | the script's exit code | requeues
cases='
done|0|1|0|0
usage error|2|1|2|0
bad input|65|1|65|0
stopped after a checkpoint|85|1|85|1
stopped more often than the cap|85|7|85|7
killed rank|137|1|137|1
terminated|143|1|143|1
lost node|205|1|205|1
another run at work|75|1|75|1
launcher that starts nothing|nothing|1|71|1
killed again and again: five restarts|137|7|137|5
'

for script in "${@:2}"; do
    command=$script after=''
    [[ $script != array ]] || command=reconstruct after=' [-o] [3.h5] [--frames] [15:5]'
    while IFS='|' read -r case_name code times expected requeues; do
        [[ -n $case_name ]] || continue
        rm -rf "$fake/job" && mkdir "$fake/job"
        for ((i = 0; i < times; i++)); do
            rc=0
            (cd "$fake/job" && start "$code" srun -- --psf 'a b.h5') || rc=$?
            [[ $rc -eq $expected ]] || fail "exit code $rc, expected $expected"
        done
        seen=$(grep -c '^scontrol requeue 7$' "$fake/job/calls") || true
        [[ $seen -eq $requeues ]] || fail "$seen requeues, expected $requeues"
        words="srun [--mpi=pmix] [--kill-on-bad-exit=1] [prog] [$command] [--resume] [--proof] [v2v3d-7.finished] [--psf] [a b.h5]$after"
        grep -qxF "$words" "$fake/job/calls" ||
            fail "called as: $(head -n 1 "$fake/job/calls"), expected: $words"
    done <<<"$cases"

    case_name="mpirun"
    rm -rf "$fake/job" && mkdir "$fake/job"
    (cd "$fake/job" && start 0 mpirun -o out) || fail "exit code $?"
    words="mpirun [--bind-to] [none] [prog] [$command] [--resume] [--proof] [v2v3d-7.finished] [-o] [out]$after"
    grep -qxF "$words" "$fake/job/calls" ||
        fail "called as: $(head -n 1 "$fake/job/calls"), expected: $words"

    case_name="unknown launcher"
    rc=0
    (cd "$fake/job" && start 0 poe) || rc=$?
    [[ $rc -eq 78 ]] || fail "exit code $rc, expected 78"

    case_name="USR1 reaches the program, which stops with 85"
    rm -rf "$fake/job" && mkdir "$fake/job"
    (cd "$fake/job" && start on-usr1 srun) &
    job=$!
    for ((tick = 0; tick < 100; tick++)); do
        [[ ! -e $fake/job/ready ]] || break
        sleep 0.1
    done
    kill -USR1 "$job"
    rc=0
    wait "$job" || rc=$?
    [[ $rc -eq 85 ]] || fail "exit code $rc, expected 85"
    grep -qx 'scontrol requeue 7' "$fake/job/calls" || fail "not requeued"

    case_name="asks Slurm for warning, requeue and one log"
    for line in --signal=B:USR1@180 --requeue --open-mode=append; do
        grep -qx "#SBATCH $line" "$root/jobs/$script.sbatch" || fail "no #SBATCH $line"
    done
done

# What an array makes of its arguments: task | arguments | exit code | the program's arguments
script=array
mkdir "$fake/a.folder"
printf '%s\n' one.h5 'a folder/two.b.tif' "d&e/it's 100%a & \"%n\" \\*.h5" $'crlf.h5\r' \
    "$fake/a.folder/" >"$fake/list"
while IFS='|' read -r task arguments expected words; do
    [[ -n $task ]] || continue
    case_name="task $task of '$arguments'"
    rm -rf "$fake/job" && mkdir "$fake/job"
    read -ra given <<<"$arguments"
    rc=0
    (cd "$fake/job" && cp "$root/jobs/array.sbatch" "$fake/slurm_script" &&
        PATH=$fake:$PATH SLURM_ARRAY_TASK_ID=${task#none} FAKE_EXIT=0 V2V3D_HOME=$root \
            V2V3D_PROGRAM=prog SLURM_JOB_ID=7 bash "$fake/slurm_script" "${given[@]}" \
            >output 2>&1) || rc=$?
    [[ $rc -eq $expected ]] || fail "exit code $rc, expected $expected"
    if [[ $expected -eq 0 ]]; then
        grep -qF "[reconstruct] [--resume] [--proof] [v2v3d-7.finished] $words" "$fake/job/calls" ||
            fail "called as: $(<"$fake/job/calls"), expected: $words"
    fi
done <<'END'
0|--each 4 --input r.h5 -o v_%a.h5|0|[--input] [r.h5] [-o] [v_0.h5] [--frames] [0:4]
2|--each 4 -- --input r.h5 -o v_%a.h5|0|[--input] [r.h5] [-o] [v_2.h5] [--frames] [8:4]
1|--list ../list -o out/%n.h5|0|[-o] [out/two.b.h5] [--input] [a folder/two.b.tif]
2|--list ../list -o out/%n_%a.h5|0|[-o] [out/it's 100%a & "%n" \*_2.h5] [--input] [d&e/it's 100%a & "%n" \*.h5]
3|--list ../list -o out/%n.h5|0|[-o] [out/crlf.h5] [--input] [crlf.h5]
4|--list ../list -o out/%n.h5|0|[-o] [out/a.folder.h5] [--input]
5|--list ../list -o out/%n.h5|65|
0|--each 4 -o v_%n.h5|2|
1|--list ../nothing -o out/%n.h5|65|
0|--each 0 -o v_%a.h5|2|
0|--each 4 -o v.h5|2|
0|-o v_%a.h5|2|
none|--each 4 -o v_%a.h5|2|
END
[[ $failures -eq 0 ]]
