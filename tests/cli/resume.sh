#!/usr/bin/env bash
# --resume: what is taken for done, what is gone on with, and what is never thrown away unasked.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

"$V2V_MAKE_BAD" "$folder" || exit 1
works simulate --psf psf.h5 --volume volume.h5 -o rec.h5 --noise gaussian:0.2 --seed 5 --frames 3
works simulate --psf psf.h5 --volume volume.h5 -o other.h5 --noise gaussian:0.2 --seed 6 --frames 3
# the offset is none: to guess it, the whole recording would be read first
common=(deconvolve --psf psf.h5 --method rld --iterations 2 --offset none)

# stays FILE: the last command left it as it was.
keep() { cp -p "$1" kept; }
stays() {
    cmp -s "$1" kept || fail "$1 was changed"
    if compgen -G '*.v2v3d-*' >/dev/null; then
        fail "left behind: $(echo ./*.v2v3d-*)"
    fi
}

# A complete output stays, also where its inputs were copied; nothing else is taken for it.
plain=("${common[@]}")
for volume in done.h5 done.tif packed.h5 integers.tif; do
    case $volume in
    packed.h5) common=("${plain[@]}" --output-type uint16 --compression gzip) ;;
    integers.tif) common=("${plain[@]}" --output-type uint16) ;;
    *) common=("${plain[@]}") ;;
    esac
    works "${common[@]}" --input rec.h5 -o $volume
    keep $volume
    cp rec.h5 copy.h5
    works "${common[@]}" --input copy.h5 -o $volume --resume
    grep -q 'is complete already' stderr || fail "$volume is made again: $(cat stderr)"
    stays $volume
    refuses 65 "$volume: .*another task" "${common[@]}" --input other.h5 -o $volume --resume
    refuses 65 "$volume: .*another task" "${common[@]}" --input rec.h5 -o $volume --resume \
        --iterations 3
    refuses 65 "$volume: .*another task" "${common[@]}" --input rec.h5 -o $volume --resume \
        --frames 0:2
    stays $volume
    works "${common[@]}" --input other.h5 -o $volume --resume --force
    cmp -s $volume kept && fail "--force did not make $volume anew"
    for content in '' 'no volume at all'; do
        printf '%s' "$content" >$volume
        keep $volume
        refuses 65 "$volume: " "${common[@]}" --input rec.h5 -o $volume --resume
        stays $volume
    done
    rm $volume
done
common=("${plain[@]}")

works "${common[@]}" --input rec.h5 -o begun.tif --resume
grep -q '^warning.*begun.tif: a TIFF is begun anew' stderr || fail "no word of a TIFF: $(cat stderr)"
rm begun.tif

# A complete output of another type is none that was asked for.
works "${common[@]}" --input rec.h5 -o done.h5
refuses 65 'done.h5: .*stored with another type.*--force makes it anew' "${common[@]}" \
    --input rec.h5 -o done.h5 --resume --output-type uint16
works "${common[@]}" --input rec.h5 -o done.h5 --resume --force --output-type uint16
refuses 65 'done.h5: .*stored with another type' "${common[@]}" --input rec.h5 -o done.h5 --resume
refuses 65 'done.h5: .*stored with another type, peak' "${common[@]}" --input rec.h5 -o done.h5 --resume \
    --output-type uint16 --output-peak 1e4
rm done.h5

# Damage is seen: a voxel, a mark.
works "${common[@]}" --input rec.h5 -o done.h5
cp done.h5 whole.h5
"$V2V_POKE" done.h5 /volume 30000 1 || exit 1
refuses 65 'done.h5: frame 1 is missing or damaged' "${common[@]}" --input rec.h5 -o done.h5 --resume
cp whole.h5 done.h5
"$V2V_POKE" done.h5 /done 2 0 || exit 1
refuses 65 'done.h5: frame 2 is missing or damaged' "${common[@]}" --input rec.h5 -o done.h5 --resume
for type in float32 uint16; do
    common=("${plain[@]}" --output-type "$type")
    works "${common[@]}" --input rec.h5 -o page.tif
    printf 'X' | dd of=page.tif bs=1 seek=20000 conv=notrunc 2>/dev/null
    refuses 65 'page.tif: page .*checksum' "${common[@]}" --input rec.h5 -o page.tif --resume
    refuses 65 'page.tif: page .*checksum' preview page.tif -o out.png
    rm page.tif
done
common=("${plain[@]}")

# A frame that cannot be computed costs none of the others; they stay until --force discards them.
cp rec.h5 broken.h5
"$V2V_POKE" broken.h5 /views 42000 nan || exit 1
timed "$limit" "${common[@]}" --input broken.h5 -o long.h5
[ $? -eq 65 ] || fail "a NaN is no exit code 65: $(cat stderr)"
grep -q 'long.h5: 2 of 3 frames are done; --resume goes on' stderr ||
    fail "no word of the frames that are done: $(cat stderr)"
[ ! -e long.h5 ] || fail 'a volume without all its frames has its name'
[ -e long.h5.v2v3d-part ] || fail 'the finished frames were thrown away'
cp long.h5.v2v3d-part left
for words in '' '--iterations 3 --resume' '--frames 0:2 --resume' '--resume'; do
    case $words in
    '') code=2 pattern='2 of 3 frames; its command goes on with --resume, --force discards' ;;
    *) code=65 pattern='2 of 3 frames .*another task.*--force discards' ;;
    esac
    # shellcheck disable=SC2086
    refuses $code "long.h5: .*$pattern" "${common[@]}" --input rec.h5 -o long.h5 $words
    cmp -s long.h5.v2v3d-part left || fail "finished frames were touched ($words)"
done
# Nor are those that another user left, which only --force discards.
if [ "$ranks" -eq 1 ] && command -v setpriv >/dev/null; then
    mkdir -m 777 shared
    cp left shared/long.h5.v2v3d-part
    chmod 000 shared/long.h5.v2v3d-part
    cp rec.h5 psf.h5 shared
    chmod 755 . shared/rec.h5 shared/psf.h5
    another=()
    [ "$(id -u)" -ne 0 ] || another=(setpriv --reuid=65534 --regid=65534 --clear-groups)
    for words in '' '--resume'; do
        # shellcheck disable=SC2086
        (cd shared && timeout "$limit" env HOME=/ "${another[@]}" "$program" "${common[@]}" --input rec.h5 \
            -o long.h5 $words) 2>stderr
        [ $? -eq 74 ] || fail "what another user left is no exit code 74 ($words): $(cat stderr)"
        grep -q 'long.h5.v2v3d-part: Permission denied' stderr || fail "no word on it: $(cat stderr)"
    done
    chmod 644 shared/long.h5.v2v3d-part
    cmp -s shared/long.h5.v2v3d-part left || fail "another user's frames were touched"
fi
timed "$limit" "${common[@]}" --input broken.h5 -o long.h5 --resume
[ $? -eq 65 ] || fail "resumed, a NaN is no exit code 65: $(cat stderr)"
grep -q 'resuming: 2 of 3 frames are done' stderr || fail "nothing was gone on with: $(cat stderr)"
grep -q '^deconvolve [01]/1 ' stderr || fail "the progress did not end with the failure: $(cat stderr)"
refuses 2 '2 of 3 frames; its command' project --psf psf.h5 --input rec.h5 --adjoint -o long.h5
works "${common[@]}" --input rec.h5 -o long.h5 --force
same long.h5 whole.h5 /volume
[ ! -e long.h5.v2v3d-part ] || fail 'something is left behind'

# SIGTERM and SIGINT let the frame end and say how to go on.
if [ "$ranks" -eq 1 ]; then
    works simulate --psf psf.h5 --volume volume.h5 -o many.h5 --noise gaussian:0.2 --frames 400
    for signal in TERM INT; do
        # a shell without jobs would have its children ignore SIGINT
        env --default-signal=INT "$program" deconvolve --psf psf.h5 --input many.h5 -o many_out.h5 \
            --resume --method rld --iterations 500 2>log.$signal &
        pid=$!
        for _ in $(seq 600); do
            [ -s log.$signal ] && grep -q 'deconvolve [0-9]' log.$signal && break
            sleep 0.1
        done
        kill -$signal $pid
        wait $pid
        code=$?
        [ $code -eq 85 ] || fail "SIG$signal: exit code $code, not 85: $(cat log.$signal)"
        grep -qE 'many_out.h5: [0-9]+ of 400 frames are done; --resume' log.$signal ||
            fail "SIG$signal: no word of the frames: $(cat log.$signal)"
    done
    rm -f ./*.v2v3d-*
fi

# Names beside the output are nobody's but the program's: links are not followed, pipes not waited
# for, a user's own files not touched.
echo mine >victim
echo mine >far.h5.tmp
echo mine >far.h5.lock
for name in far.h5 far.tif far.png; do
    words=("${common[@]}" --input rec.h5 -o "$name")
    [ $name = far.png ] && words=(preview whole.h5 -o "$name")
    ln -s victim $name.v2v3d-part
    works "${words[@]}" --force
    rm -f $name.v2v3d-part
    mkfifo $name.v2v3d-part
    works "${words[@]}" --force
    rm -f $name.v2v3d-part
done
for name in far.h5 far.tif; do
    ln -s victim $name.v2v3d-lock
    refuses 74 'v2v3d-lock: is a link' "${common[@]}" --input rec.h5 -o $name --force
    rm -f $name.v2v3d-lock
    mkfifo $name.v2v3d-lock
    refuses 74 'v2v3d-lock: .*regular' "${common[@]}" --input rec.h5 -o $name --force
    rm -f $name.v2v3d-lock
done
for name in victim far.h5.tmp far.h5.lock; do
    [ "$(cat $name)" = mine ] || fail "$name was overwritten"
done
finish
