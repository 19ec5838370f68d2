#!/usr/bin/env bash
# A long recording on 1, 2, .. ranks of one thread: seconds a frame beside those of computing alone,
# what making it durable costs, and whether memory grows.
#   stream.sh PROGRAM PSF VOLUME OUT.tsv [NAME=VALUE...]
# Computing alone: the same run with a library in front whose writes and syncs of the output do
# nothing (stream_nothing.c); without durability: whose syncs alone do nothing. All three in turn,
# `turns` times; the medians and, since other work on the machine counts in none of them, processor
# seconds. NAMEs and their values are in the table below.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
program=$(realpath "$1")
psf=$(realpath "$2")
volume=$(realpath "$3")
out=$(realpath -m "$4")
shift 4
declare -A value=([frames]=20 [ranks]='1 2' [turns]=3 [method]='rl --iterations 1')
for word in "$@"; do
    name=${word%%=*}
    if [[ $word != *=* || -z ${value[$name]+set} ]]; then
        echo "stream.sh: no setting '$word': ${!value[*]}" >&2
        exit 2
    fi
    value[$name]=${word#*=}
done
read -ra method <<<"${value[method]}"
folder=$(mktemp -d "${TMPDIR:-/tmp}/v2v3d-stream.XXXXXX")
trap 'rm -rf "$folder"' EXIT
cd "$folder"
export OMP_NUM_THREADS=1 OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
"${CC:-cc}" -O2 -D_GNU_SOURCE -shared -fPIC -o nothing.so "$here/stream_nothing.c"
"$program" simulate --quiet --psf "$psf" --volume "$volume" --noise gaussian:0.1 \
    --frames "${value[frames]}" -o rec.h5

# run RANKS HOW: a line "seconds a frame, processor seconds a frame, GB of the largest rank".
run() {
    local ranks=$1 words=()
    [[ $2 == whole ]] || words=(env "LD_PRELOAD=$folder/nothing.so" "STREAM_NOTHING=$2")
    local TIMEFORMAT='%U %S'
    if ! { time mpirun --oversubscribe --bind-to none -n "$ranks" "${words[@]}" "$program" \
        deconvolve --threads 1 --psf "$psf" --input rec.h5 -o out.h5 --force \
        --method "${method[@]}" 2>log; } 2>seconds; then
        cat log >&2
        exit 1
    fi
    awk -v frames="${value[frames]}" 'NR == FNR { cpu = $1 + $2; next }
        match($0, /[0-9.e+-]+ s a frame/) { s = substr($0, RSTART) + 0; found = 1 }
        match($0, /[0-9.]+ GB on the largest/) { gb = substr($0, RSTART) + 0 }
        END { if (!found) exit 1; print s, cpu / frames, gb }' seconds log
}

median() {
    sort -g | awk '{ x[NR] = $1 } END { print (x[int((NR + 1) / 2)] + x[int(NR / 2) + 1]) / 2 }'
}

printf 'ranks\thow\tseconds\tprocessor\tGB\n' >"$out"
for ((turn = 0; turn < value[turns]; turn++)); do
    for ranks in ${value[ranks]}; do
        for how in whole syncs writes; do
            run "$ranks" $how >>"$folder/$ranks.$how"
        done
    done
done
for ranks in ${value[ranks]}; do
    for how in whole syncs writes; do
        file=$folder/$ranks.$how
        printf '%s\t%s\t%.4g\t%.4g\t%.4g\n' "$ranks" $how "$(cut -d' ' -f1 "$file" | median)" \
            "$(cut -d' ' -f2 "$file" | median)" "$(cut -d' ' -f3 "$file" | median)" >>"$out"
    done
done
cat "$out"
