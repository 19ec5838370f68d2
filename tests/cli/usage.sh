#!/usr/bin/env bash
# What is printed and returned for help, versions and slips of the fingers.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

works --version
says '^v2v3d [0-9]+\.[0-9]+\.[0-9]+$'
[ "$(wc -l <stdout)" -eq 1 ] || fail "--version printed on more than one rank"
works --help
says 'Usage: v2v3d COMMAND'
# Every command that the help lists has its own help, and names its usage in it.
commands=0
while read -r first second _; do
    commands=$((commands + 1))
    case $first in
    psf | weights) command_line=("$first" "$second") ;;
    *) command_line=("$first") ;;
    esac
    works "${command_line[@]}" --help
    says "Usage: v2v3d ${command_line[*]} "
    [ "$ranks" -gt 1 ] && break # the same text at any rank count
done < <(sed -n 's/^  \([a-z]\)/\1/p' stdout)
[ "$ranks" -gt 1 ] || [ "$commands" -ge 22 ] || fail "--help lists $commands commands"
works project -h
works init
says '^  learning_rate: '
works check
says 'sum over ranks +ok'
says '13 views at a time: by slices .* ms, by slabs .* ms; taken: (slices|slabs)'

refuses 2 'a command is missing .see v2v3d --help'
refuses 2 "unknown command 'projcet'; did you mean 'project'" projcet
refuses 2 "unknown command 'psf nonsense'" psf nonsense
refuses 2 'psf needs one more word' psf
refuses 2 'unknown option --vloume; did you mean --volume.*see v2v3d project --help' \
    project --vloume x
# What follows happens on every rank alike, before anything is communicated.
[ "$ranks" -eq 1 ] || finish
refuses 2 'unknown option -x' project -x
refuses 2 '--fit-scale needs --truth' bench --methods --psf p.h5 --input r.h5 --fit-scale
refuses 2 '--methods needs --psf' bench --methods --input r.h5
refuses 2 '--repeat: --methods runs each .* once' bench --methods --psf p.h5 --input r.h5 --repeat 2
refuses 2 '--size: --methods' bench --methods --psf p.h5 --input r.h5 --size 64
refuses 2 '--offset is of a recording: --methods is missing' bench --offset 3
refuses 2 '--set is of a recording: --methods is missing' bench --set input.views=3
refuses 2 '--z-zoom is of --kind projections' preview v.h5 -o p.png --kind depth --z-zoom 2
refuses 2 'unknown option --frame-interval' preview v.h5 -o p.png --frame-interval 2
refuses 2 'input.pixel_size_um is of the recording' evaluate --volume v.h5 --truth t.h5 --pixel-size 1
refuses 2 '--psf FILE is missing' project --volume v.h5 -o out.h5
refuses 2 '--volume FILE is missing' project --psf p.h5 -o out.h5
refuses 2 '--output FILE is missing' project --psf p.h5 --volume v.h5
refuses 2 '--psf needs a value: FILE' project --volume v.h5 -o out.h5 --psf
refuses 2 '--psf needs a value: FILE' project --psf --volume v.h5
refuses 2 '--psf: empty value' project --psf ''
refuses 2 '--input: empty value' deconvolve --psf p.h5 --input '' -o v.h5
refuses 78 '1 is outside .0, 0.9999999.' train --psf p.h5 --input r.h5 -o run --set train.beta1=1
refuses 2 '--json takes no value' evaluate --json=yes
refuses 2 "'stray' is one word too many" project --psf p.h5 stray
refuses 2 "--reduce: 'max' is not sum or mean" project --psf p --volume v -o out.h5 --reduce max
refuses 2 "--rule: 'magic' is none of kaiming.hash" weights init --rule magic
refuses 2 '--threads: -1 is outside' init --threads=-1
deconvolve=(deconvolve --psf p --input r -o out.h5)
refuses 2 '--iterations: ' "${deconvolve[@]}" --iterations -1
refuses 2 '--lambda: ' "${deconvolve[@]}" --lambda 1e9
refuses 2 '--neighbours: ' "${deconvolve[@]}" --neighbours -1
refuses 2 '--iterations: ' "${deconvolve[@]}" --iterations 1e3
refuses 2 '--weight: ' "${deconvolve[@]}" --weight 0,5
refuses 2 '--weight: ' "${deconvolve[@]}" --weight nan
refuses 2 "--stop: 'soon' is not fixed or heldout" "${deconvolve[@]}" --stop soon
refuses 78 "deconv.method: 'lucy' is none of rl.rld.frl.tv" "${deconvolve[@]}" --method lucy
refuses 2 '--method learned takes weights: v2v3d reconstruct' "${deconvolve[@]}" --method learned
refuses 2 "--frames FIRST:COUNT: '3' is none such as 3:1" "${deconvolve[@]}" --frames 3
refuses 2 '--skip: 1.5 is outside' "${deconvolve[@]}" --skip 1.5
refuses 2 '--refresh: 0 is outside' "${deconvolve[@]}" --skip auto --refresh 0
refuses 2 '--frames: ' simulate --frames 0
refuses 2 '--seed: ' simulate --seed -1
refuses 2 "--max-time: 'soon' is no duration" train --max-time soon
refuses 2 '--skip: 1.5 is outside' \
    reconstruct --psf p --weights w --input r -o out.h5 --skip 1.5
for frames in 3 3: :4 -1:2 0:0 a:b 1:2:3 "$(printf "1%.0s" {1..40}):1"; do
    refuses 2 '--frames FIRST:COUNT: ' \
        reconstruct --psf p --weights w --input r -o out.h5 "--frames=$frames"
done
refuses 2 "--precision: 'f16' is not f32 or bf16 or bf16-always" \
    reconstruct --psf p --weights w --input r -o out.h5 --precision f16
refuses 2 '--branches needs an HDF5 output' \
    reconstruct --psf p --weights w --input r -o out.tif --branches
refuses 2 '--compression needs an HDF5 output' \
    reconstruct --psf p --weights w --input r -o out.tif --compression gzip
for compression in zip gzip:0 gzip:10 gzip: gzip:2x; do
    refuses 2 '--compression' deconvolve --psf p --input r -o out.h5 --compression $compression
done
refuses 2 '--output-peak needs --output-type uint16' \
    deconvolve --psf p --input r -o out.h5 --output-peak 3
refuses 2 "--output-type: 'uint8' is none of" \
    deconvolve --psf p --input r -o out.h5 --output-type uint8
refuses 2 '--truth FILE.* is missing' evaluate --volume v.h5
refuses 2 '--psf needs --input' evaluate --volume v.h5 --psf p
refuses 2 '--input needs --psf' evaluate --volume v.h5 --input r.h5
for words in --dataset=views '--set input.dataset=views' --offset=100 --views=9 --normalize=none; do
    # shellcheck disable=SC2086
    refuses 2 '[a-z]*[.][a-z]* is of the recording: --input FILE is missing' \
        evaluate --volume v.h5 --truth t.h5 $words
done
refuses 2 '--weights needs --psf' evaluate --volume v.h5 --truth t.h5 --weights w.h5
refuses 2 '--fit-scale needs --truth' evaluate --volume v.h5 --psf p --input r.h5 --fit-scale
refuses 2 '--truth-dataset needs --truth' evaluate --volume v.h5 --psf p --input r.h5 --truth-dataset x
refuses 2 '--uncertainty needs --psf' evaluate --volume v.h5 --truth t.h5 --uncertainty u.h5
refuses 2 '--uncertainty needs --frames above 0' \
    evaluate --volume v.h5 --psf p --input r.h5 --uncertainty u.h5 --frames 0
for words in '--frames 1' '--lambda 0.1' '--calibration c.yaml'; do
    # shellcheck disable=SC2086
    refuses 2 "${words% *} needs --psf" evaluate --volume v.h5 --truth t.h5 $words
done
for words in '--input r.h5' '--truth t.h5' '--weights w.h5' '--only tv'; do
    # shellcheck disable=SC2086
    refuses 2 "${words% *} needs --methods" bench --psf p $words
done
refuses 2 '--methods needs --input' bench --psf p --methods
refuses 2 '--input needs --adjoint' project --psf p --volume v.h5 --input r.h5 -o out.h5
refuses 2 '--offset needs --adjoint' project --psf p --volume v.h5 --offset 100 -o out.h5
refuses 2 '--uncertainty needs an HDF5' evaluate --volume v.h5 --psf p --input r.h5 --uncertainty u.tif
refuses 2 'end in .h5, .tif, .xml or .safetensors' convert --input a.tif -o out.xyz
touch there.bdv.h5
refuses 2 'there.bdv.h5: exists' convert --input v.h5 --kind volume -o there.xml
refuses 2 'only volumes are written for BigDataViewer' \
    convert --input v.h5 --kind recording -o out.xml
refuses 2 'output-type float32: BigDataViewer .out.xml. reads uint16' \
    convert --input v.h5 --kind volume -o out.xml --output-type float32
for kind in recording psf weights; do
    stored=(convert --input r.h5 --kind "$kind" -o out.h5)
    refuses 2 'output-type uint16: only volumes are stored so, which r.h5 is not' \
        "${stored[@]}" --output-type uint16
    refuses 2 'output-peak: only volumes' "${stored[@]}" --output-peak 3
    refuses 2 'compression: only volumes' "${stored[@]}" --compression gzip:3
    refuses 2 'compression foo: none, gzip' "${stored[@]}" --compression foo
    refuses 65 'r.h5: ' "${stored[@]}" --compression none --output-type float32
done
refuses 2 '--frames FIRST:COUNT' preview v.h5 -o out.png --frames 3
refuses 2 '--frame and --frames do not go together' preview v.h5 -o out.png --frame 0 --frames 3:1
refuses 2 '--frame: -1 is outside' preview v.h5 -o out.png --frame=-1
refuses 2 '--high 1 is not above --low 2' preview v.h5 -o out.png --low 2 --high 1
refuses 2 '--high 0 is not above --low 0' preview v.h5 -o out.png --high 0
refuses 2 '--low: ' preview v.h5 -o out.png --low black
refuses 2 "--kind: 'film' is none of" preview v.h5 -o out.png --kind film
refuses 2 'noise .salt. is none of' simulate --psf p --volume v -o out.h5 --noise salt
refuses 78 "unknown section 'nonsense'" init --set nonsense.key=1
refuses 78 'train.step' init --set train.step=1
refuses 78 'optics.numerical_aperture: 1.4 is not below' init --set optics.numerical_aperture=1.4
works init --set optics.numerical_aperture=1.4 --set optics.refractive_index=1.515

# The name of a program may hold spaces; a closed standard output is no failure.
mkdir 'a folder'
works init -o 'a folder/ünder a name.yaml'
works init --proof ended
[ -e ended ] || fail '--proof made no file'
works init --proof ended
echo mine >mine
refuses 65 'no.h5' info no.h5 --proof ended
[ -e ended ] && fail 'a run that failed is proved by the one before'
refuses 2 'mine: exists, and is no proof' init --proof mine
[ "$(cat mine)" = mine ] || fail '--proof replaced a file'
refuses 74 'nowhere' init --proof nowhere/ended
refuses 2 'own.yaml: exists, and is no proof' init -o own.yaml --proof own.yaml
[ -s own.yaml ] || fail '--proof replaced the output'
refuses 78 'train.step' init --proof out --set train.step=1
[ -s 'a folder/ünder a name.yaml' ] || fail 'init -o wrote nothing'
timeout 60 "${launch[@]}" "$program" init 2>stderr | head -1 >stdout
[ "${PIPESTATUS[0]}" -eq 0 ] || fail "a closed pipe made init fail: $(cat stderr)"
# A reader that went away is no failure, however much was still to be printed.
for _ in 1 2 3 4 5; do
    "$program" init 2>stderr | true
    [ -s stderr ] && fail "init | true: $(cat stderr)"
done
finish
