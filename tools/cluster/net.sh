# Sourced: hosts on one machine. A host is a network namespace on one bridge, and, for what runs in
# it, a host name, an /etc/hosts, /dev/shm and a folder of temporary files of its own. Needs root.
#
#   hosts=(n1 n2)          their names; host i gets the address $net.i
#   bridge=NAME net=10.x.y the bridge has $net.254, known to the hosts as ctl
#   folder=DIR             for files; the namespace of a host is called $bridge-HOST
# shellcheck shell=bash
# shellcheck disable=SC2154 # the variables above are the caller's

# Says why there can be no hosts here; silent where they can be.
net_obstacle()
{
    local tool
    [[ $(id -u) -eq 0 ]] || { echo "only root can make network namespaces"; return; }
    for tool in ip unshare mount "$@"; do
        command -v "$tool" >/dev/null || { echo "$tool is not installed"; return; }
    done
    ip netns add "$bridge-probe" 2>/dev/null || { echo "no network namespaces here"; return; }
    ip netns del "$bridge-probe"
}

net_up()
{
    local i
    mkdir -p "$folder"
    ip link add "$bridge" type bridge
    ip addr add "$net.254/24" dev "$bridge"
    ip link set "$bridge" up
    printf '127.0.0.1 localhost\n%s.254 ctl\n' "$net" >"$folder/hosts"
    for ((i = 1; i <= ${#hosts[@]}; i++)); do
        local host=${hosts[i - 1]} space=$bridge-${hosts[i - 1]} outside=$bridge$i
        ip netns add "$space"
        ip link add "$outside" type veth peer name eth0 netns "$space"
        ip link set "$outside" master "$bridge" up
        ip -n "$space" addr add "$net.$i/24" dev eth0
        ip -n "$space" link set eth0 up
        ip -n "$space" link set lo up
        printf '%s.%d %s\n' "$net" "$i" "$host" >>"$folder/hosts"
        mkdir -p "$folder/tmp.$host"
    done
}

# Runs a command on a host, in place of this shell. BIND is a folder that is the host's own
# temporary one under the same name for all hosts, or '-' for none.
net_exec() # HOST BIND COMMAND...
{
    # shellcheck disable=SC2016 # expanded by the shell inside
    exec ip netns exec "$bridge-$1" unshare --uts --mount sh -c '
        host=$1 folder=$2 bind=$3
        shift 3
        hostname "$host"
        mount --bind "$folder/hosts" /etc/hosts
        mount -t tmpfs tmpfs /dev/shm
        [ "$bind" = - ] || mount --bind "$folder/tmp.$host" "$bind"
        exec "$@"' sh "$1" "$folder" "$2" "${@:3}"
}

# Ends every process of a host at once, as a crash of the machine does.
net_crash() # HOST
{
    local pids
    mapfile -t pids < <(ip netns pids "$bridge-$1" 2>/dev/null)
    [[ ${#pids[@]} -eq 0 ]] || kill -9 "${pids[@]}" 2>/dev/null || true
}

# Limits what every host sends: a rate of tc such as 1gbit, or full.
net_rate() # RATE
{
    local host
    for host in "${hosts[@]}"; do
        ip netns exec "$bridge-$host" tc qdisc del dev eth0 root 2>/dev/null || true
        [[ $1 == full ]] || ip netns exec "$bridge-$host" \
            tc qdisc add dev eth0 root tbf rate "$1" burst 256k latency 50ms
    done
}

net_down()
{
    local i host
    for host in "${hosts[@]}"; do
        net_crash "$host"
        ip netns del "$bridge-$host" 2>/dev/null || true
    done
    for ((i = 1; i <= ${#hosts[@]}; i++)); do
        ip link del "$bridge$i" 2>/dev/null || true
    done
    ip link del "$bridge" 2>/dev/null || true
}
