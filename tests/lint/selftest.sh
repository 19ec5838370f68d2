#!/bin/bash
# Every lint passes a small clean tree and fails, with the right line, once a violation is planted.
# shellcheck disable=SC2016 # the planted scripts expand, not this one
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
root=$PWD
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
failures=0

# A tree with two rooms, one function each, and the real job scripts.
clean_tree()
{
    rm -rf "$scratch/tree"
    mkdir -p "$scratch"/tree/{src/{base,par},include/v2v3d/{base,par},tests/unit/base,tools,.ci}
    cd "$scratch/tree"
    cp "$root/.clang-format" .
    cp -r "$root/jobs" .
    rm -f jobs/README.md
    printf '# Facts\n## 1. Data\nSee [the page](../README.md).\n' >src/REFERENCE.md
    printf '# Front\nSrc: src/REFERENCE.md 1, [facts](src/REFERENCE.md#1-data)\n' >README.md
    printf '#ifndef A_H\n#define A_H\nint a(int x);\n#endif\n' >include/v2v3d/base/a.h
    printf '#ifndef B_H\n#define B_H\n#include "v2v3d/base/a.h"\n#endif\n' >include/v2v3d/par/b.h
    {
        printf '#include "v2v3d/base/a.h"\n\n'
        printf '/* exit(1), malloc(2),\n#include <mpi.h>\nin a comment are no calls */\n'
        printf 'int a(int x)\n{\n    return x + (int)sizeof "system(\\"printf(\\")";\n}\n'
    } >src/base/a.c
    printf '#include <mpi.h>\n\n#include "v2v3d/par/b.h"\n' >src/par/b.c
    printf '#!/bin/bash\necho "$1"\n' | tee tools/dev >.ci/run
    printf 'int b;\n' >tests/unit/base/test_a.c
}

lines() # COUNT [FORMAT]: numbered lines of code
{
    seq -f "${2:-    x += %g;}" "$1"
}

plant() # VIOLATION [WORD]
{
    case $1 in
    spaces) echo 'int   c;' >>tests/unit/base/test_a.c ;;
    outside_header) echo '# include <mpi.h>' >>src/base/a.c ;;
    outside_in_public) echo '#include <mpi.h>' >>include/v2v3d/par/b.h ;;
    needs_another) echo 'size_t c(void);' >include/v2v3d/base/c.h ;;
    no_guard) echo 'struct c { int d; };' >include/v2v3d/base/c.h ;;
    not_cxx) printf '#pragma once\nint c(int new);\n' >include/v2v3d/base/c.h ;;
    call) printf 'int c(void)\n{\n    /* */ %s (1);\n}\n' "$2" >src/base/c.c ;;
    long_file) lines 651 'int x%g;' >src/base/c.c ;;
    long_function) { printf 'void c(int x)\n{\n'; lines 81; echo '}'; } >src/base/c.c ;;
    long_line) printf '/* %095d */\n' 0 >>tests/unit/base/test_a.c ;;
    copied_block) { lines 8; printf '\n/* */ }\n'; lines 8 ' x  +=  %g;'; } >src/base/c.c ;;
    copied_into_test) { lines 8 >src/base/c.c; lines 8 >tests/unit/base/test_c.c; } ;;
    no_document) echo "/* see ATTIC.""md 3 */" >>src/base/a.c ;;
    no_file) echo '/* see tests/unit/base, src/base/a.c and src/base/cellar.c. */' >>src/base/a.c ;;
    no_section) echo '/* REFERENCE.md 1 and 2 */' >>src/base/a.c ;;
    bare_document) echo '/* (ATTIC 3) */' >>src/base/a.c ;;
    no_link) echo '[plan](src/plan.txt)' >>README.md ;;
    no_test) echo '`ctest -R unit.base.a`, `ctest -R unit.base.b`' >>README.md ;;
    an_issue) echo '# the bar of issue 3' >>tools/dev ;;
    a_session) echo '# found in the last session' >>tools/dev ;;
    outside_folder) echo '# lies in ../shared' >>jobs/common.sh ;;
    long_front) lines 131 'line %g' >README.md ;;
    unquoted) echo 'rm $1' >>.ci/run ;;
    unquoted_job) echo 'rm $1' >>jobs/train.sbatch ;;
    no_requeue) sed -i 's/^    85)/    86)/' jobs/common.sh ;;
    no_cap) sed -i 's/crashes <=/0 <=/' jobs/common.sh ;;
    no_forward) sed -i '/^    trap .*kill -USR1/d' jobs/common.sh ;;
    no_resume) sed -i 's/ --resume / /' jobs/common.sh ;;
    no_fault) printf 'int c = V2V_FAULT_POINT("c.d");\n' >src/base/c.c ;;
    late_signal) sed -i 's/@180/@1/' "jobs/$2.sbatch" ;;
    *) echo "no plant $1" && exit 2 ;;
    esac
}

# lint | violation | what its report must say (a part of it). A violation's second word is the lint's
# argument, too: jobs.sh looks at that script alone.
cases='
format|spaces|tests/unit/base/test_a.c:2
arrows|outside_header|src/base/a.c:10: <mpi.h> belongs to
arrows|outside_in_public|include/v2v3d/par/b.h:5: <mpi.h> belongs to
headers|needs_another|include/v2v3d/base/c.h:1: does not compile alone: gcc
headers|no_guard|include/v2v3d/base/c.h:1: does not compile alone: gcc
headers|not_cxx|include/v2v3d/base/c.h:1: does not compile alone: g++
sizes|long_file|src/base/c.c:651: 650 lines
sizes|long_function|src/base/c.c:84: a function of 81 lines
sizes|long_line|tests/unit/base/test_a.c:2: 101 columns
duplicates|copied_block|src/base/c.c:11: 8 lines stand at src/base/c.c:1 already
duplicates|copied_into_test|tests/unit/base/test_c.c:1: 8 lines stand at src/base/c.c:1 already
citations|no_document|src/base/a.c:10: no document ATTIC
citations|no_file|src/base/a.c:10: no file src/base/cellar.c
citations|no_section|src/base/a.c:10: src/REFERENCE.md has no section 2
citations|bare_document|src/base/a.c:10: no document ATTIC 3
citations|no_link|README.md:3: a link to nowhere: src/plan.txt
citations|no_test|README.md:3: no test unit.base.b
citations|an_issue|tools/dev:3: cites an issue
citations|a_session|tools/dev:3: cites a session
citations|outside_folder|cites ../shared
citations|long_front|README.md:131: more than 130 lines
faults|no_fault|src/base/c.c:1: no test fires the fault point c.d
shell|unquoted|.ci/run
shell|unquoted_job|jobs/train.sbatch
jobs|no_requeue train|jobs/train.sbatch: stopped after a checkpoint: 0 requeues
jobs|no_cap train|killed again and again: five restarts: 7 requeues
jobs|no_forward train|jobs/train.sbatch: USR1 reaches the program
jobs|no_resume train|[train] [--proof]
jobs|late_signal reconstruct|jobs/reconstruct.sbatch: asks Slurm
'
calls='atoi atol atof strcpy strcat sprintf vsprintf gets rand srand strtok system popen exit printf
    malloc calloc free MPI_Abort'
for call in $calls; do
    cases+="banned|call $call|src/base/c.c:3: $call():"$'\n'
done

run() # LINT [ARGUMENT...]: its exit code; its report goes to a file
{
    local rc=0
    bash "$lint_folder/$1.sh" "$PWD" "${@:2}" >"$scratch/report" 2>&1 || rc=$?
    return "$rc"
}

clean_tree
for lint in format arrows headers banned sizes duplicates citations faults shell jobs; do
    rc=0
    run "$lint" || rc=$?
    if [[ $rc -eq 77 ]]; then
        echo "$lint: $(cat "$scratch/report")"
        cases=$(grep -v "^$lint|" <<<"$cases")
    elif [[ $rc -ne 0 ]]; then
        echo "$lint fails on a clean tree:"
        cat "$scratch/report"
        failures=$((failures + 1))
    fi
done

while IFS='|' read -r lint violation words; do
    [[ -n $lint ]] || continue
    clean_tree
    read -ra named <<<"$violation"
    plant "${named[@]}"
    rc=0
    run "$lint" "${named[@]:1}" || rc=$?
    if [[ $rc -eq 0 ]] || ! grep -qF -- "$words" "$scratch/report"; then
        echo "$lint, $violation: exit code $rc, expected a failure with \"$words\":"
        cat "$scratch/report"
        failures=$((failures + 1))
    fi
done <<<"$cases"
[[ $failures -eq 0 ]]
