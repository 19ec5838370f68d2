#!/usr/bin/env bash
# Run time against error, of every method on simulated recordings of real volumes.
#   pareto.sh PROGRAM FOLDER [OPTION...]
#     --quick            a few methods, two scenes, one noise: 15 minutes on two idle cores
#     --scenes A,B       volumes of this name; all if not given
#     --noises A,B       of `v2v3d simulate --noise`
#     --methods A,B      rows of the table below, * and ? as in file names
#     --minutes N        every training takes N minutes instead
#     --psf P            PSFs; those of the shared data if not given
#     --volumes FOLDER   NAME.tif or NAME.h5, true volumes, of a time-lapse the frames in turn; those of
#                        the shared data if not given
#     --threads N        as of the program
#     --report           nothing is measured; table and picture of what was
# Each run is a line of FOLDER/results.tsv; what has its line there is not run again, so that hours of
# runs can be interrupted and continued. A recording has 6 frames by seed 5, and its first frame is
# judged. At the end FOLDER/table.txt and FOLDER/pareto.png show all lines of the file.
# The shared data are in the folder that V2V_SHARED names, in the environment or to CMake.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
program=$(realpath "$1")
folder=$(realpath -m "$2")
shift 2
shared=${V2V_SHARED:-$(sed -n 's/^V2V_SHARED:PATH=//p' "$(dirname "$program")/CMakeCache.txt" 2>/dev/null || true)}
results=$folder/results.tsv
# shellcheck source=tests/bench/common.sh
. "$root/tests/bench/common.sh"

# name | in --quick | minutes of training | arguments of train | row of `v2v3d bench --methods`
methods='
rl-10||||rl-10
rl-30|quick|||rl-30
rl-heldout||||rl-heldout
rld-1|quick|||rld-1
rld-3||||rld-3
rld-10|quick|||rld-10
rld-heldout||||rld-heldout
frl-1|quick|||frl-1
frl-3||||frl-3
frl-heldout||||frl-heldout
tv-5e-2|quick|||tv-5e-2
tv-1.5e-2|quick|||tv-1.5e-2
tv-5e-3||||tv-5e-3
tv-1e-3||||tv-1e-3
tv-neighbours|quick|||tv-neighbours
diner-100||||diner-100
diner-1000||||diner-1000
unrolled-1m|quick|1|-c configs/unrolled.yaml|weights
unrolled-2m||2|-c configs/unrolled.yaml|weights
unrolled-10m||10|-c configs/unrolled.yaml|weights
width16-2m|quick|2|-c configs/fast.yaml|weights
width16-10m||10|-c configs/fast.yaml|weights
width16-10m-skip||10|-c configs/fast.yaml|weights-skip
width32-10m||10|-c configs/fast.yaml --set model.width=32|weights
width64-10m||10|-c configs/fast.yaml --set model.width=64|weights
width64-10m-skip||10|-c configs/fast.yaml --set model.width=64|weights-skip
width128-10m||10|-c configs/fast.yaml --set model.width=128|weights
width128-10m-skip||10|-c configs/fast.yaml --set model.width=128|weights-skip
width128-10m-bf16||10|-c configs/fast.yaml --set model.width=128|weights-bf16
width128-10m-bf16-skip||10|-c configs/fast.yaml --set model.width=128|weights-bf16-skip
'
columns='scene noise method training_s start_s frame_s psnr ssim heldout heldout_sigmas threads commit processor load'
row_seconds=40 # of an estimate: a row on one scene, views left out included

usage() {
    sed -n '3,/^# Each run/{/^# Each run/d;s/^# \{0,3\}//;p}' "${BASH_SOURCE[0]}" >&2
    exit 2
}

quick='' scenes='' noises='' wanted='*' minutes_instead='' report='' options=()
psf=$shared/psf/2psam volumes=$shared/volumes
while [[ $# -gt 0 ]]; do
    case $1 in
        --quick) quick=1 && shift && continue ;;
        --report) report=1 && shift && continue ;;
    esac
    [[ $# -gt 1 ]] || usage
    case $1 in
        --scenes) scenes=${2//,/ } ;;
        --noises) noises=${2//,/ } ;;
        --methods) wanted=$2 ;;
        --minutes) minutes_instead=$2 ;;
        --psf) psf=$(realpath "$2") ;;
        --volumes) volumes=$(realpath "$2") ;;
        --threads) options=(--threads "$2") ;;
        *) usage ;;
    esac
    shift 2
done
if [[ -z $noises ]]; then
    noises='gaussian:0.05 gaussian:0.2 gaussian:0.5 poisson:25'
    [[ -z $quick ]] || noises=gaussian:0.2
fi

is_wanted() { # NAME, and its word for --quick
    [[ -z $quick || $2 == quick ]] && matches "$1" "$wanted"
}

is_done() { # SCENE NOISE METHOD
    awk -F '\t' -v "s=$1" -v "n=$2" -v "m=$3" '$1 == s && $2 == n && $3 == m { found = 1 }
        END { exit !found }' "$results"
}

# Rows to run on a recording, those of one training after each other: name|minutes|arguments|row.
missing() { # SCENE NOISE
    local name word minutes arguments row
    while IFS='|' read -r name word minutes arguments row; do
        if [[ -n $name ]] && is_wanted "$name" "$word" && ! is_done "$1" "$2" "$name"; then
            [[ -z $minutes ]] || minutes=${minutes_instead:-$minutes}
            echo "$name|$minutes|$arguments|$row"
        fi
    done <<<"$methods"
}

# Minutes of all that is to do: each training once, and the rows.
estimate() {
    local scene noise
    for scene in $scenes; do
        for noise in $noises; do
            missing "$scene" "$noise" | awk -F '|' -v "row=$row_seconds" '
                { all += row / 60 }
                $2 != "" && !seen[$2, $3]++ { all += $2 }
                END { print all + 0 }'
        done
    done | awk '{ all += $1 } END { printf "%d", all + 0.5 }'
}

# The configuration's files are named from the repository's root.
train() { # MINUTES ARGUMENTS
    local words
    read -r -a words <<<"$2"
    cd "$root" && timed_training "$program" train "${words[@]}" --max-time \
        "$(awk -v "m=$1" 'BEGIN { printf "%ds", m * 60 }')" --psf "$psf" \
        --input "$folder/recording.h5" -o "$folder/run" --force --quiet "${options[@]}"
}

# Rows of one training, or without any: standard input, as `missing` prints them.
run_rows() { # SCENE NOISE
    local scene=$1 noise=$2 name minutes arguments row training=0 line key words commit weights=()
    local -A name_of=()
    mapfile -t words
    for line in "${words[@]}"; do
        IFS='|' read -r name minutes arguments row <<<"$line"
        name_of[$row]=$name
    done
    if [[ -n $minutes ]]; then
        say "$scene, $noise: $minutes minutes of training for ${name_of[*]}"
        training=$(train "$minutes" "$arguments") || return 1
        weights=(--weights "$folder/run/weights.h5")
    fi
    commit=$(git -C "$root" rev-parse --short HEAD 2>/dev/null || echo unknown)
    say "$scene, $noise: ${name_of[*]}"
    rm -rf "$folder/volumes" # what was killed left
    mkdir "$folder/volumes"
    TMPDIR=$folder/volumes "$program" bench --methods --json --quiet "${options[@]}" --psf "$psf" \
        --input "$folder/recording.h5" --truth "$folder/truth.h5" "${weights[@]}" \
        --only "${!name_of[@]}" >"$folder/rows.json" || return 1
    while read -r line; do
        row=$(value_of method "$line")
        words=("$scene" "$noise" "${name_of[$row]}" "$training")
        for key in start_s frame_s psnr ssim heldout_residual heldout_sigmas threads; do
            words+=("$(value_of "$key" "$line")")
        done
        words+=("$commit" "$(value_of processor "$line")" "$(cut -d ' ' -f 1 /proc/loadavg)")
        (IFS=$'\t' && echo "${words[*]}") >>"$results"
        unset "name_of[$row]"
    done <"$folder/rows.json"
    for name in "${name_of[@]}"; do # not on this machine, or the same as another row
        printf '%s\t%s\t%s\t-\n' "$scene" "$noise" "$name" >>"$results"
    done
    rm -rf "$folder/run" "$folder/volumes"
}

run_recording() { # SCENE NOISE
    local scene=$1 noise=$2 todo training failed=0
    todo=$(missing "$scene" "$noise")
    [[ -n $todo ]] || return 0
    "$program" convert --quiet --input "$(volume_of "$scene")" --slices "$slices" \
        -o "$folder/truth.h5" --force || return 1
    "$program" simulate --quiet --psf "$psf" --volume "$folder/truth.h5" --noise "$noise" \
        --seed 5 --frames 6 -o "$folder/recording.h5" --force || return 1
    while read -r training; do
        awk -F '|' -v "t=$training" '$2 "|" $3 == t' <<<"$todo" | run_rows "$scene" "$noise" ||
            { say "$scene, $noise: failed" && failed=1; }
    done < <(awk -F '|' '!seen[$2, $3]++ { print $2 "|" $3 }' <<<"$todo")
    rm -f "$folder/recording.h5" "$folder/truth.h5" "$folder/rows.json"
    return "$failed"
}

run_all() {
    local scene noise slices failed=0
    if [[ ! -d $volumes || ! -e $psf ]]; then
        say "no shared data: V2V_SHARED in the environment, or --volumes and --psf"
        return 1
    fi
    if [[ -z $scenes ]]; then
        scenes=$(volume_names)
        [[ -z $quick ]] || scenes='nuclei fibres'
    fi
    slices=$(slices_of "$psf")
    say "about $(estimate) minutes to go"
    for noise in $noises; do
        for scene in $scenes; do
            if run_recording "$scene" "$noise"; then
                say "$scene, $noise: done; about $(estimate) minutes to go"
            else
                failed=1
            fi
        done
    done
    return "$failed"
}

# Table and points. Times are geometric means, the rest means over recordings; where a method has
# not all recordings that others have, its means say so, and it is not in the picture.
summarize() {
    awk -F '\t' -v "points=$folder/points.tsv" '
        function time_of(s) { return s >= 90 ? sprintf("%.1f min", s / 60) : sprintf("%.1f s", s) }
        NR == 1 || $4 == "-" { next }
        !((m = $3) in runs) { name[++count] = m }
        !($2 in scenes_of) { noise[++noises] = $2 }
        !seen[$1, $2]++ { scenes_of[$2]++; recordings++ }
        {
            runs[m]++
            has[m, $2]++
            psnr[m, $2] += $7
            ssim[m, $2] += $8
            mean[m] += $7
            heldout[m] += $10
            training[m] += $4 > 0 ? log($4) : 0
            learnt[m] += $4 > 0
            start[m] += log($5)
            frame[m] += log($6)
            all[m] += log($4 + $5 + $6)
            alone[m] += log($5 + $6)
        }
        END {
            for (i = 1; i <= count; i++) {
                m = name[i]
                n = runs[m]
                all[m] = exp(all[m] / n)
                mean[m] /= n
            }
            printf "| method | training | start | a frame |"
            for (k = 1; k <= noises; k++)
                printf " %s |", noise[k]
            printf " held out, of noise | front |\n|---|---|---|---|"
            for (k = 1; k <= noises; k++)
                printf "---|"
            printf "---|---|\n"
            for (i = 1; i <= count; i++) {
                m = name[i]
                n = runs[m]
                front = n == recordings
                for (j = 1; j <= count; j++) {
                    o = name[j]
                    if (runs[o] == recordings && (mean[o] > mean[m] && all[o] <= all[m] ||
                                                  mean[o] >= mean[m] && all[o] < all[m]))
                        front = 0
                }
                printf "| %s | %s | %s | %s |", m,
                    learnt[m] ? time_of(exp(training[m] / n)) : "none",
                    time_of(exp(start[m] / n)), time_of(exp(frame[m] / n))
                for (k = 1; k <= noises; k++) {
                    h = has[m, noise[k]]
                    if (h)
                        printf " %.2f / %.3f%s |", psnr[m, noise[k]] / h, ssim[m, noise[k]] / h,
                            h < scenes_of[noise[k]] ? sprintf(" (%d of %d)", h,
                                                              scenes_of[noise[k]]) : ""
                    else
                        printf " |"
                }
                printf " %.4f | %s |\n", heldout[m] / n, front ? "yes" : ""
                if (n == recordings)
                    print m, all[m], exp(alone[m] / n), mean[m], front >points
            }
        }' "$results"
}

main() {
    mkdir -p "$folder"
    [[ -s $results ]] || tr ' ' '\t' <<<"$columns" >"$results"
    local failed=0
    if [[ -z $report ]]; then
        exec 9>"$folder/lock"
        flock -n 9 || { say "$folder is in use" && exit 75; }
        run_all || failed=1
    fi
    if [[ $(wc -l <"$results") -lt 2 ]]; then
        say "nothing was measured"
        exit 1
    fi
    rm -f "$folder/points.tsv"
    {
        describe
        echo
        summarize
    } >"$folder/table.txt"
    cat "$folder/table.txt"
    if [[ ! -s $folder/points.tsv ]]; then
        say "no method has all recordings: no picture"
    else
        "$(dirname "$program")/tests/bench/draw_pareto" "$folder/points.tsv" "$folder/pareto.png" \
            "PSNR, dB, mean of $(awk -F '\t' 'NR > 1 && $4 != "-" && !s[$1, $2]++ { n++ } END { print n }' \
                "$results") recordings"
        say "table and picture: $folder/table.txt, $folder/pareto.png"
    fi
    exit "$failed"
}

main # all of it was read: what changes this file meanwhile changes no run
