#!/usr/bin/env bash
# The paper's table: its methods, trained and judged on the same scenes.
#   table.sh PROGRAM FOLDER [OPTION...]
#     --budget B         small (the default): an hour on two idle cores; full: a night; cluster: what is
#                        trained once is trained by Slurm; quick: for a look
#     --seconds N        every training takes N seconds instead
#     --scenes A,B       of this name; all if not given; * and ? as in file names
#     --noises A,B       of `v2v3d simulate --noise`
#     --methods A,B      rows of the tables below
#     --psf P            PSFs; those of the shared data if not given
#     --volumes FOLDER   NAME.tif or NAME.h5, true volumes; those of the shared data if not given
#     --ranks N          the program's commands under mpirun, but for what is held out
#     --threads N        as of the program
#     --report           nothing is measured; table and picture of what was
# Each method on a scene at a noise is a line of FOLDER/results.tsv; what has its line there is not run
# again, and a training that ended is kept with its seconds: what was killed goes on, but for the
# command that it was in. At the end FOLDER/table.txt and FOLDER/table.png show all lines of the file.
#
# Scenes: the volumes, and five drawn ones by seeds that are in no data set. A recording has 6 frames
# by seed 5, and its whole first frame is judged; DeepCAD's has as many frames as the budget says. What
# ends with -crop sees the middle of the scene alone, recorded for itself. A training learns from one
# of: `views`, noisy views of drawn scenes, half of them at each of the two noises; `truths`, their
# volumes as well; `recording`, the one that is judged; `film`, the longer one.
# A budget cluster: FOLDER/jobs.sh submits what learns from views or truths (jobs/train.sbatch), to as
# many steps as in the paper; the next call, in an allocation with --ranks, takes what has ended there,
# leaves out what has not, and does the rest.
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

# budget | s of a training | s of one on the recording | scenes of a data set (eight of ten are
# trained on), their pixels | pixels of drawn scenes, of a volume's sides at most | frames of a film |
# iterations of DINER | scenes, of which views are left out and that slow methods take: two or all
budgets='
quick|2|2|4|64|64|64|16|5|all
small|75|15|20|256|256|256|64|400|two
full|1500|180|60|256|512|512|100|2000|all
cluster|none|600|809|512|512|512|100|10000|all
'
cluster_steps=160000

# training | learns from | arguments of train; @ half of the frames of a film, 32 at most
trainings='
v2v3d|views|-c configs/fast.yaml
v2v3d-all-views|views|-c configs/fast.yaml --set model.view_split=all
v2v3d-random-halves|views|-c configs/fast.yaml --set model.view_split=random
v2v3d-no-alignment|views|-c configs/fast.yaml --set model.align=false
v2v3d-no-fft|views|-c configs/fast.yaml --set loss.fft=0
v2v3d-no-dc|views|-c configs/fast.yaml --set loss.dc=0
vcdnet|truths|-c configs/vcdnet.yaml
unrolled|recording|-c configs/unrolled.yaml
deepcad|film|-c configs/deepcad.yaml --set deepcad.frames=@
'

# method | PSNR / SSIM in the paper | training | looks at | slow | seconds on 256 x 256 pixels, of an
# estimate | command; % is each of $tries, the best of which is kept; @ the budget's iterations of
# DINER | row of `v2v3d bench --methods` that leaves views out
methods='
rld-10|32.19 / 0.721||recording||5|deconvolve --method rld --iterations 10|rld-10
rld-best|32.19 / 0.721||recording||7|deconvolve --method rld --iterations %|
rl-heldout|||recording||6|deconvolve --method rl --stop heldout|rl-heldout
tv|||recording||5|deconvolve|tv-1.5e-2
tv-neighbours|||recording||5|deconvolve --neighbours 5|tv-neighbours
unrolled||unrolled|recording||10|reconstruct|weights
vcdnet|37.71 / 0.792|vcdnet|recording||3|reconstruct|weights
v2v3d|39.05 / 0.898|v2v3d|recording||3|reconstruct|weights
v2v3d-max||v2v3d|recording||3|reconstruct --set recon.combine=max|
v2v3d-learned||v2v3d|recording||4|reconstruct --set recon.combine=learned|
v2v3d-all-views|30.81|v2v3d-all-views|recording||3|reconstruct|
v2v3d-random-halves||v2v3d-random-halves|recording||3|reconstruct|weights
v2v3d-no-alignment|38.25|v2v3d-no-alignment|recording||3|reconstruct|weights
v2v3d-no-fft|37.23|v2v3d-no-fft|recording||3|reconstruct|weights
v2v3d-no-dc|36.09|v2v3d-no-dc|recording||3|reconstruct|weights
deepcad+rld-10|35.41 / 0.861|deepcad|denoised|slow|5|deconvolve --method rld --iterations 10|
deepcad+rld-best|35.41 / 0.861|deepcad|denoised|slow|7|deconvolve --method rld --iterations %|
deepcad+tv||deepcad|denoised|slow|5|deconvolve|
tv-crop|||recording-crop||2|deconvolve|
diner-crop|29.60 / 0.547||recording-crop|slow|60|deconvolve --method diner --iterations @|
deepcad+diner-crop|35.63 / 0.885|deepcad|denoised-crop|slow|60|deconvolve --method diner --iterations @|
'
tries=(1 2 4)
drawn=(neurons vessels cells beads filaments)      # scene drawn-KIND, seeds 101, 102 ..
taught=(neurons vessels cells microglia filaments) # of data sets, by seeds from a million on
taught_noises='gaussian:0.2 poisson:25'
frames=6 crop_side=96
columns='scene noise method training_s command_s frame_s psnr ssim heldout heldout_sigmas parameters pixels threads ranks commit processor load steps'

usage() {
    sed -n '3,/^# Each method on/{/^# Each method on/d;s/^# \{0,3\}//;p}' "${BASH_SOURCE[0]}" >&2
    exit 2
}

budget=small seconds='' scenes='*' noises=${taught_noises// /,} wanted='*' report='' ranks=1
options=() psf=$shared/psf/2psam volumes=$shared/volumes
while [[ $# -gt 0 ]]; do
    [[ $1 != --report ]] || { report=1 && shift && continue; }
    [[ $# -gt 1 ]] || usage
    case $1 in
        --budget) budget=$2 ;;
        --seconds) seconds=$2 ;;
        --scenes) scenes=$2 ;;
        --noises) noises=$2 ;;
        --methods) wanted=$2 ;;
        --psf) psf=$(realpath "$2") ;;
        --volumes) volumes=$(realpath "$2") ;;
        --ranks) ranks=$2 ;;
        --threads) options=(--threads "$2") ;;
        *) usage ;;
    esac
    shift 2
done
row=$(grep "^$budget|" <<<"$budgets") || usage
IFS='|' read -r _ once_s own_s count data_size drawn_size most_size film_frames diner reach <<<"$row"
once_s=${seconds:-$once_s} own_s=${seconds:-$own_s}

# mpirun refuses root without the two variables, and more ranks than cores without --oversubscribe.
launched() { # COMMAND...
    if [[ $ranks -eq 1 ]]; then
        "$program" "$@" "${options[@]}"
    else
        OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 mpirun --oversubscribe \
            --bind-to none -n "$ranks" "$program" "$@" "${options[@]}"
    fi
}

# What a method needs and the program has not, nothing where it has all.
lacks() { # TRAINING LOOKS_AT COMMAND; `help` is the program's
    local file
    file=$(awk -F '|' -v "t=$1" '$1 == t { split($3, word, " "); print word[2] }' <<<"$trainings")
    [[ -z $file || -e $root/$file ]] || echo "$file"
    [[ $2 != denoised* ]] || grep -q '^  denoise ' <<<"$help" || echo 'v2v3d denoise'
    if [[ $3 == *--method* ]]; then
        file=${3#*--method } && file=${file%% *}
        grep -qw -- "$file" <<<"$help" ||
            echo "deconvolve --method $file"
    fi
}

# Rows of the methods that are wanted and that this program has; the others are told.
known_methods() {
    local name paper training looks slow rest without help
    help=$("$program" --help && "$program" deconvolve --help)
    while IFS='|' read -r name paper training looks slow rest; do
        if [[ -z $name ]] || ! matches "$name" "$wanted"; then
            continue
        fi
        without=$(lacks "$training" "$looks" "$rest")
        if [[ -n $without ]]; then
            say "$name: left out, this program has no ${without//$'\n'/, no }"
        else
            echo "$name|$paper|$training|$looks|$slow|$rest"
        fi
    done <<<"$methods"
}

scene_names() {
    local name
    for name in $(volume_names) "${drawn[@]/#/drawn-}"; do
        ! matches "$name" "$scenes" || echo "$name"
    done
}

# Views are left out of it, slow methods take it, and the picture shows it: the first scene, and the
# first that is drawn; or any.
is_shown() { # SCENE
    [[ $1 == "${list[0]}" ]] || [[ $1 == "$(printf '%s\n' "${list[@]}" | grep -m 1 '^drawn-')" ]]
}

# Rows of methods that have no line yet.
missing() { # SCENE NOISE
    local slow=1
    [[ $reach == all ]] || is_shown "$1" || slow=''
    awk -v "s=$1" -v "n=$2" -v "slow=$slow" '
        NR == FNR {
            split($0, f, "\t")
            if (f[1] == s && f[2] == n)
                done[f[3]] = 1
            next
        }
        split($0, f, "|") && !(f[1] in done) && (f[5] == "" || slow)' "$results" - <<<"$known"
}

learns_once() { # TRAINING
    grep -qE "^$1\|(views|truths)\|" <<<"$trainings"
}

# Minutes of all that is to do; the shared volumes have 96,000 pixels on average.
estimate() {
    local each level name training leave
    {
        for level in ${noises//,/ }; do
            for each in "${list[@]}"; do
                leave=3
                [[ $reach == all ]] || is_shown "$each" || leave=0
                missing "$each" "$level" | awk -F '|' -v "own=$own_s" -v "drawn=$drawn_size" \
                    -v "most=$most_size" -v "scene=$each" -v "diner=$diner" -v "leave=$leave" '
                    BEGIN {
                        pixels = scene ~ /^drawn-/ ? drawn * drawn : most < 310 ? most * most : 96000
                    }
                    { t = $6 * ($7 ~ /@/ ? diner / 500 : pixels / 65536) }
                    { all += t * (1 + ($8 != "" ? leave : 0)) }
                    ($3 == "unrolled" || $3 == "deepcad") && !seen[$3]++ { all += own }
                    END { print all + 0 }'
            done
        done
        while IFS='|' read -r name _ training _; do
            if learns_once "$training" && [[ ! -e $folder/trainings/$training.seconds ]]; then
                echo "$training"
            fi
        done <<<"$known" | sort -u | sed "s/.*/${once_s/none/0}/"
    } | awk '{ all += $1 } END { printf "%d", all / 60 + 0.5 }'
}

make_data() {
    local noise place seed=0
    for noise in $taught_noises; do
        seed=$((seed + 1)) place=$folder/data/${noise/:/-}
        [[ ! -e $place.whole ]] || continue
        mkdir -p "$folder/data"
        launched dataset --psf "$psf" --count "$count" --seed $seed --scenes "${taught[@]}" \
            --noise "$noise" --size "$data_size" -o "$place" --resume --quiet || return
        touch "$place.whole"
    done
}

# What a training reads, as words of train.
lesson() { # LEARNS_FROM
    case $1 in
        views) printf '%s\n' --input "$folder"/data/*/train/*_noisy.h5 ;;
        truths) lesson views && printf '%s\n' --truth "$folder"/data/*/train/*_truth.h5 ;;
        *) printf '%s\n' --input "$work/$1.h5" ;;
    esac
}

# A training that Slurm does: kept where it has ended, else a line of jobs.sh.
look_for_job() { # TRAINING ARGUMENTS PLACE WORD...
    local name=$1 words=() step
    step=$(value_of step "$("$program" weights info "$3/weights.h5" --json 2>/dev/null || true)")
    if [[ $step == "$cluster_steps" ]]; then
        sed 's/.*"seconds": \([^,]*\).*/\1/' "$3/metrics.jsonl" |
            awk '{ s += $1 } END { printf "%.2f", s }' >"$3.seconds"
        return
    fi
    read -r -a words <<<"$2"
    words+=(--set train.schedule=linear --set "train.steps=$cluster_steps" --psf "$psf" -o "$3" "${@:4}")
    printf 'sbatch --job-name=%s jobs/train.sbatch%s\n' "$name" "$(printf ' %q' "${words[@]}")" \
        >>"$folder/jobs.sh"
    say "$name: not trained yet; $folder/jobs.sh submits it"
    return 1
}

# Weights in $place/weights.h5 and seconds in $place.seconds.
need_training() { # TRAINING
    local from arguments words=() lesson_words
    IFS='|' read -r _ from arguments <<<"$(grep "^$1|" <<<"$trainings")"
    place=$work/$1
    if learns_once "$1"; then
        place=$folder/trainings/$1
        [[ -e $place.seconds ]] || make_data || return
    fi
    [[ ! -e $place.seconds ]] || return 0
    learns_once "$1" || need "$from" || return
    mkdir -p "$(dirname "$place")"
    mapfile -t lesson_words < <(lesson "$from")
    if learns_once "$1" && [[ $once_s == none ]]; then
        look_for_job "$1" "$arguments" "$place" "${lesson_words[@]}"
        return
    fi
    local limit=$own_s
    ! learns_once "$1" || limit=$once_s
    say "$1: $limit s of training"
    read -r -a words <<<"${arguments//@/$((film_frames < 64 ? film_frames / 2 : 32))}"
    (cd "$root" && timed_training launched train "${words[@]}" --set train.schedule=linear \
        --set train.steps=1000000 --max-time "${limit}s" --psf "$psf" "${lesson_words[@]}" \
        -o "$place" --force --quiet >"$place.part") && mv "$place.part" "$place.seconds"
}

simulate() { # TRUTH FRAMES NAME
    launched simulate --quiet --psf "$psf" --volume "$work/$1.h5" --noise "$noise" --seed 5 \
        --frames "$2" -o "$work/$3.h5" --force
}

crop() { # NAME SIDE NAME
    "$(dirname "$program")/tests/bench/crop_volume" "$work/$1.h5" "$2" "$work/$3.h5"
}

make_truth() {
    local kind seed=100
    if [[ $scene == drawn-* ]]; then
        for kind in "${drawn[@]}"; do
            seed=$((seed + 1))
            [[ $scene != "drawn-$kind" ]] || break
        done
        launched simulate --quiet --psf "$psf" --scene "$kind" --seed "$seed" --size "$drawn_size" \
            --truth "$work/truth.h5" -o "$work/clean.h5" --force
    else
        "$program" convert --quiet --input "$(volume_of "$scene")" --slices "$(slices_of "$psf")" \
            -o "$work/whole.h5" --force && crop whole "$most_size" truth
    fi
}

denoise() { # FILM NAME; seconds of a frame in work/NAME.seconds
    local began
    need "$1" && need_training deepcad || return
    began=$EPOCHREALTIME
    launched denoise --weights "$place/weights.h5" --input "$work/$1.h5" -o "$work/$2.h5" --force \
        --quiet || return
    awk -v "a=$began" -v "b=$EPOCHREALTIME" -v "n=$film_frames" 'BEGIN { print (b - a) / n }' \
        >"$work/$2.seconds"
}

# A file of the recording in work, made where it is missing.
need() { # NAME
    [[ ! -e $work/$1.h5 ]] || return 0
    case $1 in
        truth) make_truth ;;
        truth-crop) need truth && crop truth "$crop_side" "$1" ;;
        recording) need truth && simulate truth "$frames" "$1" ;;
        recording-crop) need truth-crop && simulate truth-crop "$frames" "$1" ;;
        film) need truth && simulate truth "$film_frames" "$1" ;;
        film-crop) need truth-crop && simulate truth-crop "$film_frames" "$1" ;;
        denoised) denoise film "$1" ;;
        denoised-crop) denoise film-crop "$1" ;;
    esac
}

# The volume of the first frame, of the best try where there are some.
make_volume() { # COMMAND WORD...: sets psnr ssim command_s frame_s
    local words try began figures better
    psnr=''
    for try in "${tries[@]}"; do
        read -r -a words <<<"${1//%/$try}"
        began=$EPOCHREALTIME
        launched "${words[@]}" "${@:2}" --psf "$psf" --frames 0:1 -o "$work/try.h5" --force \
            2>"$work/log" || { tail -1 "$work/log" >&2 && return 1; }
        figures=$(awk -v "a=$began" -v "b=$EPOCHREALTIME" 'BEGIN { printf "%.2f", b - a }')
        figures+=" $(sed -n 's/.* now in .* s, \([^ ]*\) s a frame.*/\1/p' "$work/log")"
        better=$("$program" evaluate --quiet --json --volume "$work/try.h5" --truth "$truth") || return
        figures+=" $(value_of psnr "$better") $(value_of ssim "$better")"
        if awk -v "b=$psnr" -v "f=$figures" 'BEGIN { split(f, x, " "); exit !(b == "" || x[3] > b) }'; then
            mv "$work/try.h5" "$work/volume.h5"
            read -r command_s frame_s psnr ssim <<<"$figures"
        fi
        [[ $1 == *%* ]] || break
    done
}

# What views miss that the method does not see: a number, and in units of noise; or none.
leave_out() { # ROW INPUT WORD...
    local line=''
    if [[ -n $1 ]] && { [[ $reach == all ]] || is_shown "$scene"; }; then
        line=$(TMPDIR=$work "$program" bench --methods --json --quiet "${options[@]}" --psf "$psf" \
            --input "$2" --only "$1" "${@:3}") || return
    fi
    printf '%s %s\n' "$(value_of heldout_residual "$line")" "$(value_of heldout_sigmas "$line")"
}

run_method() { # ROW OF METHODS
    local name training looks command bench place='' weights=() training_s=0 parameters='' steps=''
    local about truth input psnr ssim command_s frame_s heldout sigmas words
    IFS='|' read -r name _ training looks _ _ command bench <<<"$1"
    need truth && need "$looks" || return
    truth=$work/truth.h5 input=$work/$looks.h5
    [[ $looks != *-crop ]] || truth=$work/truth-crop.h5
    if [[ -n $training ]]; then
        need_training "$training" || return
        training_s=$(<"$place.seconds")
        about=$("$program" weights info "$place/weights.h5" --json)
        parameters=$(value_of parameters "$about") steps=$(value_of step "$about")
        [[ $command != reconstruct* ]] || weights=(--weights "$place/weights.h5")
    fi
    say "$scene, $noise: $name"
    make_volume "${command//@/$diner}" --input "$input" "${weights[@]}" || return
    if [[ -e $work/$looks.seconds ]]; then
        frame_s=$(awk -v "f=$frame_s" 'BEGIN { getline s; print f + s }' <"$work/$looks.seconds")
    fi
    leave_out "$bench" "$input" "${weights[@]}" >"$work/heldout" || return
    read -r heldout sigmas <"$work/heldout" || true
    words=("$scene" "$noise" "$name" "$training_s" "$command_s" "$frame_s" "$psnr" "$ssim"
        "${heldout:--}" "${sigmas:--}" "${parameters:--}"
        "$("$program" info "$work/volume.h5" | sed -n 's/.* of \(.* x .*\) pixels.*/\1/p')"
        "${options[1]:-$(($(nproc) / ranks))}" "$ranks" "$commit" "$processor"
        "$(cut -d ' ' -f 1 /proc/loadavg)" "${steps:--}")
    keep_picture "$name"
    (IFS=$'\t' && echo "${words[*]//null/-}") >>"$results"
}

# At one noise, the first.
keep_picture() { # METHOD
    local shown=$folder/pictures/$scene
    is_shown "$scene" || return 0
    mkdir -p "$shown"
    [[ -e $shown/noise ]] || echo "$noise" >"$shown/noise"
    [[ $noise == "$(<"$shown/noise")" ]] || return 0
    mv "$work/volume.h5" "$shown/$1.h5"
    [[ ! -e $work/recording.h5 ]] || cp "$work/recording.h5" "$shown/view.h5"
    cp "$work/truth.h5" "$shown/truth.h5"
}

run_recording() {
    local row failed=0 rows
    mapfile -t rows < <(missing "$scene" "$noise")
    [[ ${#rows[@]} -gt 0 ]] || return 0
    work=$folder/work/${scene}_${noise/:/-}
    mkdir -p "$work"
    for row in "${rows[@]}"; do
        run_method "$row" || { say "$scene, $noise: ${row%%|*} failed" && failed=1; }
    done
    [[ $failed -ne 0 ]] || rm -r "$work"
    say "$scene, $noise: about $(estimate) minutes to go"
    return "$failed"
}

# Without the methods whose training Slurm has not ended.
drop_untrained() {
    local training
    printf 'cd %q\n' "$root" >"$folder/jobs.sh"
    while read -r training; do
        if learns_once "$training" && ! need_training "$training" </dev/null; then
            known=$(awk -F '|' -v "t=$training" '$3 != t' <<<"$known")
        fi
    done < <(awk -F '|' '{ print $3 }' <<<"$known" | sort -u)
}

# The budget, and what it is spent on: a folder has but one.
settle() {
    local plan
    plan="Budget $budget: each training $once_s s, on a recording $own_s s; data sets of $count scenes"
    plan+=" at each of $taught_noises, $data_size x $data_size pixels, eight of ten trained on; drawn"
    plan+=" scenes of $drawn_size x $drawn_size pixels, sides of volumes up to $most_size; films of"
    plan+=" $film_frames frames; DINER $diner iterations on $crop_side x $crop_side pixels. What is slow"
    plan+=" is run, and views are left out, on $reach scenes."
    plan=${plan/none s/$cluster_steps steps}
    if [[ -s $folder/plan.txt && $plan != "$(<"$folder/plan.txt")" ]]; then
        say "$folder was begun otherwise: $(<"$folder/plan.txt")"
        return 1
    fi
    echo "$plan" >"$folder/plan.txt"
    say "$plan"
}

run_all() {
    local scene noise known list work='' commit processor failed=0
    if [[ ! -d $volumes || ! -e $psf ]]; then
        say "no shared data: V2V_SHARED in the environment, or --volumes and --psf"
        return 1
    fi
    settle || return
    mapfile -t list < <(scene_names)
    known=$(known_methods)
    if [[ ${#list[@]} -eq 0 || -z $known ]]; then
        say "there is no scene '$scenes', or no method '$wanted'"
        return 1
    fi
    commit=$(git -C "$root" rev-parse --short HEAD 2>/dev/null || echo unknown)
    processor=$(sed -n '/^model name/{s/.*: //p;q}' /proc/cpuinfo)
    [[ $once_s != none ]] || drop_untrained
    say "about $(estimate) minutes to go"
    for noise in ${noises//,/ }; do
        for scene in "${list[@]}"; do
            run_recording || failed=1
        done
    done
    return "$failed"
}

# Means over recordings; where a method has not all of them, its means say so.
summarize() {
    awk '
        function mean_of(sum, n, format) { return n ? sprintf(format, sum / n) : "-" }
        NR == FNR {
            if (split($0, f, "|") > 1) {
                name[++count] = f[1]
                paper[f[1]] = f[2]
            }
            next
        }
        FNR == 1 { next }
        {
            split($0, f, "\t")
            m = f[3]
            if (!(f[2] in recordings))
                noise[++noises] = f[2]
            if (!seen[f[1], f[2]]++)
                recordings[f[2]]++
            runs[m]++
            has[m, f[2]]++
            psnr[m, f[2]] += f[7]
            ssim[m, f[2]] += f[8]
            training[m] += f[4]
            steps[m] += f[18]
            frame[m] += f[6]
            if (f[9] != "-") {
                heldout[m] += f[9]
                left[m]++
            }
            parameters[m] = f[11]
        }
        END {
            printf "| method | the paper |"
            for (k = 1; k <= noises; k++)
                printf " %s |", noise[k]
            printf " held out | training, s | steps | a frame, s | parameters |\n|---|---|"
            for (k = 1; k <= noises; k++)
                printf "---|"
            printf "---|---|---|---|---|\n"
            for (i = 1; i <= count; i++) {
                m = name[i]
                if (!runs[m])
                    continue
                printf "| %s | %s |", m, paper[m]
                for (k = 1; k <= noises; k++) {
                    h = has[m, noise[k]]
                    if (h)
                        printf " %.2f / %.3f", psnr[m, noise[k]] / h, ssim[m, noise[k]] / h
                    if (h && h < recordings[noise[k]])
                        printf " (%d of %d)", h, recordings[noise[k]]
                    printf " |"
                }
                printf " %s | %s | %s | %s | %s |\n", mean_of(heldout[m], left[m], "%.3f"),
                    training[m] ? mean_of(training[m], runs[m], "%.0f") : "-",
                    training[m] ? mean_of(steps[m], runs[m], "%.0f") : "-",
                    mean_of(frame[m], runs[m], "%.2g"), parameters[m]
            }
        }' <(echo "$methods") "$results"
}

# A scene a list: truth, a noisy view, the methods in the order of their table, with their PSNR.
draw() {
    local shown lists=() name rest
    for shown in "$folder"/pictures/*/; do
        [[ -e $shown/truth.h5 ]] || continue
        {
            printf 'truth\t%s\t%s\n' "$shown/truth.h5" "$(basename "$shown")"
            [[ ! -e $shown/view.h5 ]] || printf 'view\t%s\tnoisy view\n' "$shown/view.h5"
            while IFS='|' read -r name rest; do
                [[ -z $name || ! -e $shown/$name.h5 ]] || printf 'volume\t%s\t%s %s\n' \
                    "$shown/$name.h5" "$name" "$(psnr_of "$(basename "$shown")" "$name")"
            done <<<"$methods"
        } >"$shown/list.tsv"
        lists+=("$shown/list.tsv")
    done
    [[ ${#lists[@]} -eq 0 ]] ||
        "$(dirname "$program")/tests/bench/draw_table" "$folder/table.png" "${lists[@]}"
}

psnr_of() { # SCENE METHOD
    awk -F '\t' -v "s=$1" -v "n=$(<"$folder/pictures/$1/noise")" -v "m=$2" '
        $1 == s && $2 == n && $3 == m { printf "%.1f", $7 }' "$results"
}

main() {
    mkdir -p "$folder"
    local failed=0
    if [[ -z $report ]]; then
        exec 9>"$folder/lock"
        flock -n 9 || { say "$folder is in use" && exit 75; }
        [[ -s $results ]] || tr ' ' '\t' <<<"$columns" >"$results"
        run_all || failed=1
    fi
    if [[ ! -s $results || $(wc -l <"$results") -lt 2 ]]; then
        say "nothing was measured"
        exit 1
    fi
    {
        describe
        [[ ! -s $folder/plan.txt ]] || cat "$folder/plan.txt"
        echo
        summarize
    } >"$folder/table.txt"
    cat "$folder/table.txt"
    draw || failed=1
    say "table and picture: $folder/table.txt, $folder/table.png"
    exit "$failed"
}

main # all of it was read: what changes this file meanwhile changes no run
