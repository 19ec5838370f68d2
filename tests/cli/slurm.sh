#!/usr/bin/env bash
# Scripts for Slurm: what they ask for, what they run, and what is refused before it waits in a queue.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

cp "$root/configs/tiny.yaml" .
train=(-c tiny.yaml --psf psf/ --input "it's a.h5" -o run/)

# is_script: what was printed parses, is clean, and holds these lines, whole.
is_script() { # LINE...
    local line
    bash -n stdout || fail "no script: $(cat stdout)"
    if command -v shellcheck >/dev/null; then
        shellcheck stdout >found || fail "shellcheck: $(cat found)"
    fi
    for line in "$@"; do
        grep -qxF -- "$line" stdout || fail "no line \"$line\" in: $(cat stdout)"
    done
}

works slurm train --nodes 2 --ranks 4 --threads 8 --time 90m --partition long --account me \
    -- "${train[@]}" --max-mem 8
# 4 ranks of 8 GB and a tenth
is_script '#!/bin/bash' '#SBATCH --nodes=2' '#SBATCH --ntasks-per-node=4' \
    '#SBATCH --cpus-per-task=8' '#SBATCH --time=0-01:30' '#SBATCH --mem=33569M' \
    '#SBATCH --partition=long' '#SBATCH --account=me' '#SBATCH --signal=B:USR1@180' \
    '#SBATCH --requeue' '#SBATCH --open-mode=append'
[ "$ranks" -eq 1 ] || finish

# As Slurm would start it, with a launcher that only tells how it was called.
mkdir bin
# shellcheck disable=SC2016 # expanded when it runs
printf '#!/bin/sh\ntouch v2v3d-7.finished\nprintf "[%%s]" "$@"\n' >bin/srun
chmod +x bin/srun
runs() { # EXPECTED
    local said
    said=$(PATH=$folder/bin:$PATH V2V3D_HOME=$root V2V3D_PROGRAM=prog SLURM_JOB_ID=7 \
        SLURM_ARRAY_TASK_ID=2 bash stdout | tail -n 1)
    [ "$said" = "[--mpi=pmix][--kill-on-bad-exit=1][prog]$1" ] || fail "it runs $said, not $1"
}
runs "[train][--resume][--proof][v2v3d-7.finished][-c][tiny.yaml][--psf][psf/][--input][it's a.h5][-o][run/][--max-mem][8]"

works slurm reconstruct --time 4m --mem 10 --launcher mpirun --home '/a b' \
    -- --psf p --weights w --input r.h5 -o v.h5
is_script '#SBATCH --time=0-00:04' '#SBATCH --mem=9537M' '#SBATCH --signal=B:USR1@60' \
    "V2V3D_HOME=\${V2V3D_HOME:-'/a b'}" "V2V3D_LAUNCHER=\${V2V3D_LAUNCHER:-mpirun}" \
    'run_job reconstruct -- --psf p --weights w --input r.h5 -o v.h5'
grep -qE 'partition|account|array' stdout && fail "asks for more than it was told: $(cat stdout)"

# Its own threads are the cores that a rank is given.
works slurm train -- "${train[@]}" --threads 6
is_script '#SBATCH --cpus-per-task=6'

works slurm array --array 0-9%2 --each 100 -- --psf p --weights w --input r.h5 -o v_%a.h5
is_script '#SBATCH --array=0-9%2'
runs '[reconstruct][--resume][--proof][v2v3d-7.finished][--psf][p][--weights][w][--input][r.h5][-o][v_2.h5][--frames][200:100]'
printf '%s\n' a.h5 b.h5 "d&/it's %a & c.h5" >'my list.txt'
works slurm array --array 0-2 --list 'my list.txt' -- --psf 'a & "b"' --weights 'w$' -o v/%n_%a.h5
is_script '#SBATCH --array=0-2'
runs "[reconstruct][--resume][--proof][v2v3d-7.finished][--psf][a & \"b\"][--weights][w$][-o][v/it's %a & c_2.h5][--input][d&/it's %a & c.h5]"

refuses 2 'train.reconstruct.array is missing' slurm
refuses 2 '-- ARGUMENT... is missing' slurm train
refuses 2 "'demo' is none of train" slurm demo -- x
refuses 2 '--nodes: 0 is outside' slurm train --nodes 0 -- "${train[@]}"
refuses 2 "shortest is a minute" slurm train --time 30s -- "${train[@]}"
refuses 2 "--partition: 'a b' holds other" slurm train --partition 'a b' -- "${train[@]}"
refuses 2 'are for an array' slurm train --each 3 -- "${train[@]}"
refuses 2 'needs --array TASKS' slurm array --each 3 -- -o v_%a.h5
refuses 2 'needs --each N or --list FILE' slurm array --array 1 -- -o v_%a.h5
refuses 2 'needs --each N or --list FILE' slurm array --array 1 --each 3 --list l -- -o v_%a.h5
for tasks in foo 9-0 1- -3 1-4:0 '1,,' 0-9% 0-9%0 0-9%2%2 1-2-3 99999999999; do
    refuses 2 "'$tasks' is none such as" slurm array "--array=$tasks" --each 3 -- -o v_%a.h5
done
for tasks in 7 0-9:3%2 1,3,5-8; do
    works slurm array --array $tasks --each 100 -- --psf p --weights w --input r.h5 -o v_%a.h5
    is_script "#SBATCH --array=$tasks"
done
task=(--psf p --weights w)
refuses 2 "the output's name needs %a" slurm array --array 1 --each 3 -- "${task[@]}" --input r_%a.h5 -o v.h5
refuses 2 "the output's name needs %a" slurm array --array 1 --each 3 -- "${task[@]}" --input r.h5 -o v_%n.h5
refuses 2 '--frames: each task has its own' slurm array --array 1 --each 3 -- "${task[@]}" --input r.h5 \
    --frames 2:7 -o v_%a.h5
refuses 2 '--input: each task has its own' slurm array --array 1 --list l -- "${task[@]}" --input r.h5 -o v_%n.h5
refuses 2 'holds a line break' slurm train -- "${train[@]}" --psf $'two\nlines'
# The arguments of the job itself.
refuses 2 'v.tif: a job that its time limit ends' slurm reconstruct -- --psf p --weights w \
    --input r -o v.tif
refuses 2 '--input FILE... is missing' slurm train -- --psf p -o run
refuses 2 'unknown option --wieghts; did you mean --weights' slurm reconstruct -- --wieghts w
refuses 78 'train.step' slurm train -- "${train[@]}" --set train.step=1
refuses 78 'none.yaml' slurm train -- -c none.yaml --psf p --input r -o run
finish
