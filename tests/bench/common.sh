# What pareto.sh and table.sh share: names, the lines of results.tsv, JSON. They set `program`,
# `results` and `volumes`.
# shellcheck shell=bash disable=SC2154

say() {
    printf '%s: %s\n' "${0##*/}" "$*" >&2
}

matches() { # NAME PATTERN,PATTERN...: as in file names
    local pattern IFS=,
    set -f
    for pattern in $2; do
        # shellcheck disable=SC2053 # it is a pattern
        [[ $1 != $pattern ]] || { set +f && return 0; }
    done
    set +f
    return 1
}

volume_of() { # SCENE
    local file
    for file in "$volumes/$1.tif" "$volumes/$1.h5"; do
        [[ ! -e $file ]] || { echo "$file" && return; }
    done
    say "there is no $volumes/$1.tif or .h5"
    return 1
}

volume_names() {
    find "$volumes" \( -name '*.tif' -o -name '*.h5' \) -printf '%f\n' | sed 's/\.[^.]*$//' | sort
}

slices_of() { # PSF
    "$program" info "$1" --json | sed -n 's/.*"slices": \([0-9]*\).*/\1/p'
}

# A text as it is, a number shortened.
value_of() { # NAME JSON
    sed -n "s/.*\"$1\": \"\{0,1\}\([^\",}]*\).*/\1/p" <<<"$2" |
        awk '/^-?[0-9.]+(e[-+]?[0-9]+)?$/ { $0 = sprintf("%.6g", $0) } { print }'
}

# Seconds of the whole training, with its start. That it is to go on where its time is over (85) is
# fine.
timed_training() { # COMMAND...
    local began=$EPOCHREALTIME code=0
    "$@" || code=$?
    [[ $code -eq 0 || $code -eq 85 ]] || return "$code"
    awk -v "a=$began" -v "b=$EPOCHREALTIME" 'BEGIN { printf "%.2f", b - a }'
}

# What the table is of: some columns of results.tsv, whose head names them.
describe() {
    awk -F '\t' '
        function add(list, word) {
            return index(", " list ", ", ", " word ", ") ? list : list (list == "" ? "" : ", ") word
        }
        NR == 1 {
            for (i = 1; i <= NF; i++)
                at[$i] = i
            next
        }
        $4 != "-" {
            scenes = add(scenes, $1)
            threads = add(threads, (at["ranks"] && $at["ranks"] > 1 ? $at["ranks"] " x " : "") $at["threads"])
            commits = add(commits, $at["commit"])
            processors = add(processors, $at["processor"])
            load = $at["load"]
            least = least == "" || load < least ? load : least
            most = load > most ? load : most
        }
        END {
            printf "Commit %s; %s; threads: %s; load %s to %s. Scenes: %s.\n", commits, processors,
                threads, least, most, scenes
        }' "$results"
}
