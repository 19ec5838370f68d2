#!/usr/bin/env bash
# Training, reconstruction and projection on 1, 2 and 4 ranks of one thread, the same work on more
# ranks (strong) and as much more work (weak), measured in turn beside what bench_forecast
# predicts from figures of the same run; and its rows for ranks that are not here.
#   scaling.sh PROGRAM OUT.tsv [--quick] [NAME=VALUE...]
# Every run's seconds are left in OUT-runs.txt.
# NAMEs and their values are in the table below; --quick takes the second column. bench_projector is
# run if it is built.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
program=$(realpath "$1")
out=$(realpath -m "$2")
shift 2
projector=$(dirname "$program")/tests/bench/bench_projector
forecaster=$(dirname "$program")/tests/bench/bench_forecast

# name | value | with --quick | meaning
settings='
width|128|4|of the network
batch|2|2|samples of a step on one rank; strong: on all
crop|128|64|pixels of a sample
steps|3|3|of a run; the first one is not counted
frames|4|3|on one rank; strong: on all
side|192|64|pixels of a frame
turns|2|1|each runs everything once
psf|||file or folder; simulated if empty
projected|512|64|pixels of what is projected
'
column=2
# as `psf simulate` does by itself: the demo's own microscope is smaller
optics=(-c "$root/configs/paper.yaml" --set optics.rings=2 --set optics.views_per_ring=6
    --set optics.slices=39 --set optics.size=127 --set optics.slice_spacing_um=0.5)
if [[ ${1:-} == --quick ]]; then
    column=3
    optics=(-c "$root/configs/tiny.yaml")
    shift
fi
declare -A value=()
while IFS='|' read -r name usual quick _; do
    [[ -z $name ]] || value[$name]=$([[ $column -eq 2 ]] && echo "$usual" || echo "$quick")
done <<<"$settings"
for word in "$@"; do
    name=${word%%=*}
    if [[ $word != *=* || -z ${value[$name]+set} ]]; then
        echo "scaling.sh: no setting '$word'" >&2
        exit 2
    fi
    value[$name]=${word#*=}
done
[[ -z ${value[psf]} ]] || value[psf]=$(realpath "${value[psf]}")

folder=$(mktemp -d "${TMPDIR:-/tmp}/v2v3d-scaling.XXXXXX")
trap 'rm -rf "$folder"' EXIT
mkdir -p "$(dirname "$out")"
cd "$folder"
cores=$(nproc)
export OMP_NUM_THREADS=1 OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
counts=(1 2 4)
model=(--set "model.width=${value[width]}")
train=("${model[@]}" --set "train.crop=${value[crop]}" --set train.checkpoint_every_s=100000)
: >measured # what, kind, ranks, seconds: a line a run
: >predicted # what, kind, ranks, hosts, grid, seconds: a line a turn

# on RANKS PROGRAM WORD...: its standard error goes to the file log, and here when it fails.
on() {
    local ranks=$1
    shift
    if ! mpirun --oversubscribe --bind-to none -n "$ranks" "$@" 2>log; then
        cat log >&2
        return 1
    fi
}

median() {
    sort -g | awk '{ x[NR] = $1 } END { print (x[int((NR + 1) / 2)] + x[int(NR / 2) + 1]) / 2 }'
}

prepare() {
    local most=$((value[frames] * counts[-1])) size=${value[side]}
    # a frame has room for a sample
    [[ $size -ge ${value[crop]} ]] || size=${value[crop]}
    on 1 "$program" demo "${optics[@]}" --set model.width=1 --set train.steps=1 \
        --set train.crop=32 --set demo.rld_iterations=1 --set demo.frames=1 \
        --set "demo.size=$size" --quiet -o scene >/dev/null
    [[ -n ${value[psf]} ]] || value[psf]=$folder/scene/psf.h5
    on 1 "$program" simulate --quiet --psf "${value[psf]}" --volume scene/truth.h5 -o recording.h5 \
        --noise gaussian:0.2 --seed 5 --frames "$most"
    on 1 "$program" weights init --psf "${value[psf]}" --width "${value[width]}" --rule he \
        --seed 3 -o weights.h5 >/dev/null
}

# Seconds of a step: those after the first.
run_training() { # KIND RANKS BATCH
    on "$2" "$program" train --quiet "${train[@]}" --psf "${value[psf]}" --input recording.h5 -o run \
        --force --steps "${value[steps]}" --set "train.batch=$3"
    sed -n 's/.*"seconds": *\([0-9.e+-]*\).*/\1/p' run/metrics.jsonl | tail -n +2 |
        sed "s/^/training $1 $2 /" >>measured
}

# Seconds of all frames, from the rate that the program's last line of progress tells.
run_reconstruction() { # KIND RANKS FRAMES
    on "$2" "$program" reconstruct --psf "${value[psf]}" --weights weights.h5 \
        --input recording.h5 -o volume.h5 --force --frames "0:$3"
    sed -n 's|.* 100%, \([0-9.e+-]*\)/s, .*|\1|p' log | tail -n 1 |
        awk -v "name=recording $1 $2" -v "frames=$3" '{ print name, frames / $1 }' >>measured
}

run_forecast() {
    on "$((cores < 4 ? cores : 4))" "$forecaster" "${value[psf]}" "width=${value[width]}" \
        "batch=${value[batch]}" "crop=${value[crop]}" "frames=${value[frames]}" \
        "side=${value[side]}" scratch=. >forecast.txt
    awk '$2 == "strong" || $2 == "weak" { print $1, $2, $3, $4, $5, $7 }' forecast.txt >>predicted
}

# There and back, all views at once.
run_projector() { # RANKS
    on "$1" "$projector" "${value[psf]}" "${value[projected]}" 11 >projector.txt
    sed 's/([^)]*),//g' projector.txt | awk -v "ranks=$1" '
        /^(forward|adjoint), all views/ {
            for (i = 1; i <= NF; i++)
                if ($i == "slices" || $i == "slabs") {
                    measured[$i] += $(i + 1) / 1000
                    predicted[$i] += $(i + 3) / 1000
                }
        }
        END {
            for (split_ in measured) {
                print "projection", split_, ranks, measured[split_] >>"measured"
                print "projection", split_, ranks, 1, "-", predicted[split_] >>"predicted"
            }
        }'
}

turn() {
    local kind ranks times
    for kind in strong weak; do
        run_forecast
        for ranks in "${counts[@]}"; do
            times=$([[ $kind == strong ]] && echo 1 || echo "$ranks")
            [[ $kind == strong || $ranks -gt 1 ]] || continue # that is the same
            run_training "$kind" "$ranks" $((value[batch] * times))
            run_reconstruction "$kind" "$ranks" $((value[frames] * times))
        done
    done
}

# median_of FILE KEY: of the last words of the lines that begin with KEY.
median_of() {
    awk -v "key=$2 " 'index($0, key) == 1 { print $NF }' "$1" | median
}

report() {
    local what kind ranks hosts grid key seconds forecast ratio
    printf 'what\tkind\tranks\thosts\tgrid\tmeasured_s\tpredicted_s\tmeasured/predicted\n'
    while read -r what kind ranks hosts grid; do
        key="$what $kind $ranks"
        forecast=$(median_of predicted "$key")
        seconds=- ratio=-
        [[ $ranks -gt 1 || $what == projection ]] || key="$what strong 1"
        if grep -q "^$key " measured; then
            seconds=$(median_of measured "$key")
            ratio=$(awk -v "a=$seconds" -v "b=$forecast" 'BEGIN { printf "%.2f", a / b }')
        elif [[ $ranks -le ${counts[-1]} ]]; then
            echo "scaling.sh: $key was not measured" >&2
            return 1
        fi
        printf '%s\t%s\t%s\t%s\t%s\t%s\t%s\t%s\n' "$what" "$kind" "$ranks" "$hosts" "$grid" \
            "$seconds" "$forecast" "$ratio"
    done < <(awk '!seen[$1, $2, $3]++ { print $1, $2, $3, $4, $5 }' predicted)
}

prepare
for ((i = 1; i <= value[turns]; i++)); do
    echo "turn $i of ${value[turns]}" >&2
    turn
done
if [[ -x $projector ]]; then
    for ranks in "${counts[@]}"; do
        run_projector "$ranks"
    done
fi
report >"$out"
cat measured >"${out%.tsv}-runs.txt"
echo "width ${value[width]}; steps of ${value[batch]} x ${value[crop]}^2 and ${value[frames]} frames" \
    "of ${value[side]}^2 on one rank; $cores cores; medians of ${value[turns]} turns"
column -t -s $'\t' "$out" 2>/dev/null || cat "$out"
