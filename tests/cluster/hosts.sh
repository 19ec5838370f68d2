#!/usr/bin/env bash
# Training and reconstruction on two hosts over TCP have the bits of two ranks on one host, on a link
# of full speed, 1 Gbit/s and 100 Mbit/s. What the link costs is printed.
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source=tests/cluster/lib.sh
. "$here/lib.sh"
use_sandbox hosts

train=(-c "$root/configs/tiny.yaml" --set model.width=16 --set train.batch=2 --psf scene/psf.h5
    --input recording.h5 --steps 20)
reconstruct=(--psf scene/psf.h5 --weights one/weights.h5 --input recording.h5)

# on_hosts RATE NAME COMMAND...: run it on both hosts; its time, and the program's own word on what
# part of it was communication.
on_hosts() {
    local start rate=$1 name=$2 share
    shift 2
    start=$(seconds)
    "$sandbox" run "$folder/sandbox" -x OMP_NUM_THREADS -wdir "$folder" "$program" "$@" >log 2>&1 ||
        give_up "$name at $rate: $(tail -n 5 log)"
    share=$(grep -o 'communication: .*' log)
    echo "$name, $rate: $(since "$start") s; ${share:-no word on communication}"
    [ -n "$share" ] || fail "$name does not tell its communication"
}

make_scene 8 128
start=$(seconds)
mpirun --oversubscribe --bind-to none -n 2 "$program" train --quiet "${train[@]}" -o one ||
    give_up "training on one host"
echo "training, one host: $(since "$start") s"
start=$(seconds)
mpirun --oversubscribe --bind-to none -n 2 "$program" reconstruct --quiet "${reconstruct[@]}" \
    -o one.h5 || give_up "reconstruction on one host"
echo "reconstruction, one host: $(since "$start") s"
for rate in full 1gbit 100mbit; do
    "$sandbox" rate "$folder/sandbox" "$rate" || give_up "the link can't be set to $rate"
    for branches in 2 1; do
        # one branch a host, or one sample of the batch
        on_hosts "$rate" "training, $branches branch ranks" train "${train[@]}" \
            --set "parallel.branches=$branches" -o "run_${branches}_$rate"
        same one/weights.h5 "run_${branches}_$rate/weights.h5" /weights
    done
    on_hosts "$rate" reconstruction reconstruct "${reconstruct[@]}" -o "$rate.h5"
    same one.h5 "$rate.h5" /volume
done
finish
