#!/usr/bin/env bash
# Several recordings in one run: which they are, where their volumes go, and that one that fails
# keeps none of the others from its volumes.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

"$V2V_MAKE_BAD" "$folder" || exit 1
common=(deconvolve --psf psf.h5 --method rld --iterations 1 --offset none)
mkdir in
# names with a space, with a star, with what means a list, and with what means a name
for name in 'rec 1.h5' 'rec*.h5' '@rec.h5' 'rec%n.b.h5'; do
    works simulate --psf psf.h5 --volume volume.h5 -o "in/$name" --noise gaussian:0.2 --frames 3 \
        --seed "${#name}"
    works "${common[@]}" --input "in/$name" -o 'alone %n.h5'
done

# made FOLDER COUNT: so many volumes, each as its recording gave alone; nothing else.
made() {
    local file count=0
    for file in "$1"/*; do
        [ -e "$file" ] || continue
        cp "$file" found.h5 # h5diff 1.10 takes names for formats
        cp "alone ${file##*/}" alone.h5
        same found.h5 alone.h5 /volume
        count=$((count + 1))
    done
    [ $count -eq "$2" ] || fail "$count volumes in $1, not $2: $(ls "$1")"
}

# tells PATTERN: the last command's log.
tells() { grep -qE -- "$1" stderr || fail "no \"$1\" in: $(cat stderr)"; }

works "${common[@]}" --input 'in/*.h5' -o all/
made all 4
tells '4 of 4 recordings, 12 of 12 frames$'
tells '^all/rec 1.h5: 3 frames of .*; 3 now in .* s a frame; .* GB on the largest rank'

# What is complete stays.
works "${common[@]}" --input 'in/*.h5' -o all/ --resume
made all 4
tells 'all/rec\*.h5 is complete already'
tells '4 of 4 recordings, 12 of 12 frames$'

# A recording that is no recording, and one that is not there.
echo junk >in/bad.h5
for words in '' --resume; do
    # shellcheck disable=SC2086
    timed "$((limit * 10))" "${common[@]}" --input 'in/*.h5' gone.h5 -o some/ $words
    code=$?
    [ $code -eq 65 ] || fail "exit code $code, not 65: $(cat stderr)"
    made some 4
    tells 'in/bad.h5: is not an HDF5 file'
    tells 'gone.h5: '
    tells '4 of 6 recordings, 12 of 12 frames'
    tells '^v2v3d deconvolve: 2 of 6 recordings failed, the first one: in/bad.h5'
done
rm in/bad.h5

# One that another run is at work on.
mkdir busy
exec 9>'busy/rec 1.h5.v2v3d-lock'
flock 9
timed "$((limit * 10))" "${common[@]}" --input 'in/*.h5' -o busy/
code=$?
exec 9>&-
rm 'busy/rec 1.h5.v2v3d-lock'
[ $code -eq 75 ] || fail "exit code $code, not 75: $(cat stderr)"
made busy 3
tells '3 of 4 recordings, 9 of 12 frames'
tells '^v2v3d deconvolve: 1 of 4 recordings failed, the first one: busy.rec 1.h5.v2v3d-lock: another run holds'
[ "$ranks" -eq 1 ] || finish

mkdir words
works "${common[@]}" --input in/rec?1.h5 'in/rec*.h5' -o words # a folder that is there; a file's own name
made words 2
# As Windows' editors write it: a mark in front, other ends of lines, the last without one.
printf '\xef\xbb\xbfin/rec 1.h5\r\n\r\nin/@rec.h5' >list.txt
mkdir list
works "${common[@]}" --input @list.txt -o list/%n.h5
made list 2
works "${common[@]}" --input in/@rec.h5 -o one_%n.h5
same one_@rec.h5 'alone @rec.h5' /volume
works "${common[@]}" --input @list.txt -o 'tiff_%n.tif'
[[ -e 'tiff_rec 1.tif' && -e tiff_@rec.tif ]] || fail "no volumes of a pattern: $(ls)"

# Refused before anything is made.
cp 'in/rec 1.h5' 'rec 1.h5'
refuses 2 'would both become out/rec 1.h5' "${common[@]}" --input 'in/rec 1.h5' 'rec 1.h5' -o out/
refuses 2 'need a folder, or %n' "${common[@]}" --input 'in/*.h5' -o out.h5
refuses 65 'in/no.: there is no such file' "${common[@]}" --input 'in/no*' -o out/
ln -s loop loop
refuses 65 'loop/.*h5: a folder on the way: Too many levels' "${common[@]}" --input 'loop/*.h5' -o out/
refuses 65 'none/.*h5: there is no such file' "${common[@]}" --input 'none/*.h5' -o out/
refuses 65 'none.txt: No such file' "${common[@]}" --input @none.txt -o out/
: >empty.txt
refuses 65 'empty.txt: names no recording' "${common[@]}" --input @empty.txt -o out/
rm 'all/rec 1.h5'
refuses 2 'all/.*exists; give --force' "${common[@]}" --input 'in/*.h5' -o all/
[ ! -e 'all/rec 1.h5' ] || fail 'something was made all the same'
# One recording's output is another recording, the last of so many that are none.
cp 'in/@rec.h5' '@rec.b.h5'
before=$(cksum <@rec.b.h5)
for words in --force --resume; do
    refuses 2 '@rec.b.h5: the output would overwrite the input @rec.b.h5' \
        "${common[@]}" --input in/@rec.h5 none_{1..70}.h5 @rec.b.h5 -o '%n.b.h5' $words
done
[ "$before" = "$(cksum <@rec.b.h5)" ] || fail 'a recording was overwritten'

# What is wrong with all of them is said once, and leaves no folder.
refuses 65 'none.h5' "${common[@]}" --psf none.h5 --input 'in/*.h5' -o out/
[ "$(grep -c 'none.h5' stderr)" -eq 1 ] || fail "not said once: $(cat stderr)"
finish
