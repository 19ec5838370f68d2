#!/usr/bin/env bash
# The files that users have are read as what they are, to the bit, or refused in one line.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

mkdir files
cd files || exit 1
"$V2V_MAKE_INPUTS" . >"$folder/unwritable" || exit 1
works psf simulate --set optics.rings=0 --set optics.slices=3 --set optics.size=5 \
    --set optics.pixel_size_um=0.5 -o psf.h5

# reads REFERENCE[; WHAT INFO SAYS; ..] words...: converted, it is the reference.
reads() {
    local expected=$1 kind=(--kind recording) dataset=/views said phrases
    shift
    [[ " $* " == *" --kind "* ]] && kind=() dataset=/volume
    rm -f read.h5
    works convert "${kind[@]}" -o read.h5 --input "$@"
    same "${expected%%;*}" read.h5 "$dataset"
    said=${expected#"${expected%%;*}"}
    [ -n "$said" ] || return 0
    works info read.h5
    IFS=';' read -ra phrases <<<"${said#;}"
    for said in "${phrases[@]}"; do
        said=${said# }
        says "^${said% }\$"
    done
}

# one_input OUTCOME EXPECTED words...: it is read, or refused with that code.
# shellcheck disable=SC2317 # rows_by_workers calls it
one_input() {
    if [ "$1" != ok ]; then
        refuses "$@"
    elif grep -qxF -- "$3" "$folder/unwritable"; then
        echo "left out: libtiff here cannot write $3"
    else
        reads "${@:2}"
    fi
}
rows_by_workers "$here/inputs.tsv" 100 one_input
[ "$ranks" -eq 1 ] || finish

# Names with characters that shells, URLs and file systems make something of.
for name in 'a b' 'ünter µm' "it's & 100%" '#1 (copy)' '[x] *' 'a;b' '-dash'; do
    cp u16.tif "./$name.tif"
    cp u16.h5 "./$name.h5"
    cp -a by_view "./$name"
    reads plain.ref "./$name.tif" --views 3
    reads plain.ref "./$name.h5"
    reads plain.ref "./$name" --views 3
    works convert --input "./$name.h5" -o "./$name of it.h5"
    same plain.ref "./$name of it.h5" /views
done

works info ij_signed.tif
says '^value of a sample of 0: -32768$'
says '^step between values: 1$'
works info ij_curved.tif
says "^ImageJ's calibration of values: no straight line, not used$"

# PSFs and a recording of other pixels; PSF stacks with channels or frames.
works convert --kind recording --input ij_zt.tif --pixel-size 0.65 -o other_pixels.h5
works psf simulate --set optics.rings=1 --set optics.views_per_ring=2 --set optics.slices=3 \
    --set optics.size=5 --set optics.pixel_size_um=0.5 -o psf_3.h5
rl=(deconvolve --method rld --iterations 1 --psf psf_3.h5)
refuses 65 'says pixels of 0.65 um, but the PSFs are for 0.5 um; .*--pixel-size 0.5' \
    "${rl[@]}" --input other_pixels.h5 -o out.h5
works "${rl[@]}" --input other_pixels.h5 -o v.h5 --pixel-size 0.5 --slice-spacing 3 --frame-interval 2
works info v.h5
says '^pixel size: 0.5 um$'
says '^slice spacing: 3 um$'
says '^frame interval: 2 s$'
# 1 % of another size is none: 0.504 beside 0.5 is 0.8 %, 0.506 is 1.2 %
works convert --kind recording --input ij_zt.tif --pixel-size 0.504 -o near.h5
works "${rl[@]}" --input near.h5 -o near_volume.h5
works convert --kind recording --input ij_zt.tif --pixel-size 0.506 -o far.h5
refuses 65 'says pixels of 0.506 um, but the PSFs are for 0.5 um' "${rl[@]}" --input far.h5 -o out.h5
mkdir psf_channels
cp ij_czt.tif psf_channels/psf_1.tif
refuses 65 'psf_1.tif: has 2 channels, 3 slices and 4 frames; a PSF has slices' psf info psf_channels

# What goes into a run as a folder, a hyperstack or a dataset comes out as from the plain file.
works "${rl[@]}" --input plain.ref -o plain.h5
works "${rl[@]}" --input by_view -o folder.h5
same plain.h5 folder.h5 /volume
works "${rl[@]}" --input ome_xyztc.tif --channel 1 -o ome.h5 --pixel-size 0.5
same plain.h5 ome.h5 /volume
works "${rl[@]}" --input nested.h5 --dataset exchange/data -o nested_volume.h5
same plain.h5 nested_volume.h5 /volume
works "${rl[@]}" --input by_view -o folder.h5 --resume
grep -q 'folder.h5 is complete already' stderr || fail "not complete: $(cat stderr)"
cp by_frame/'part 8.tif' by_view/'part 11.tif'
refuses 65 'part 11.tif: has 3 pages' "${rl[@]}" --input by_view -o folder.h5 --resume

# Volumes under other names, compared with each other.
refuses 65 '/volume: there is no such dataset; it has /stack; --dataset NAME' \
    preview float_volume.h5 -o out.png
works preview float_volume.h5 --dataset stack -o picture.png
works simulate --psf psf.h5 --volume float_volume.h5 --dataset stack -o a.h5
works simulate --psf psf.h5 --volume f32.tif --slices 3 -o b.h5
same a.h5 b.h5 /views
works project --psf psf.h5 --volume f32.tif --slices 3 -o c.h5
finish
