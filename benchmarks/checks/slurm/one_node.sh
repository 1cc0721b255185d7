#!/bin/sh
# A Slurm cluster of one node, this machine, out of Debian's packages, without systemd and cgroups.
#   one_node.sh start FOLDER [CPUS]    configuration, key, state and logs in FOLDER
#   one_node.sh stop FOLDER            ends its jobs and its three daemons
# As root, after: apt-get install --yes --no-install-recommends slurm-wlm munge
# CPUS: cores that the node says it has (those of the machine). For trying things out: root runs the jobs.
# /etc/slurm/slurm.conf becomes a link to the configuration, since Snakemake's job steps look nowhere else;
# one that is already there is left alone, and nothing is started.
set -eu

stop() { printf 'one_node: %s\n' "$*" >&2; exit 2; }
[ $# -ge 2 ] || stop 'usage: one_node.sh start|stop FOLDER [CPUS]'
action=$1
mkdir -p "$2"
folder=$(cd "$2" && pwd -P)
cpus=${3:-$(nproc --all)}
conf="$folder/slurm.conf"
link=/etc/slurm/slurm.conf
is_ours() { [ "$(readlink "$link")" = "$conf" ]; }

need_programs() {
    [ "$(id -u)" = 0 ] || stop 'the daemons start as root only'
    [ ! -e "$link" ] || is_ours || stop "$link is there: this machine belongs to a cluster already"
    for program in munged slurmctld slurmd sbatch; do
        command -v "$program" >/dev/null ||
            stop "no $program here: apt-get install --yes --no-install-recommends slurm-wlm munge"
    done
}

write_configuration() {
    memory=$(slurmd -C | sed -n 's/.*RealMemory=\([0-9]*\).*/\1/p')
    cat >"$conf" <<CONF
ClusterName=one_node
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmctldPort=46817
SlurmdPort=46818
AuthInfo=socket=$folder/munge.socket
SlurmUser=root
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/linux
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SlurmdParameters=config_overrides
SchedulerParameters=batch_sched_delay=0,sched_interval=2,bf_interval=5
MpiDefault=none
MinJobAge=600
NodeName=$(hostname -s) NodeAddr=127.0.0.1 CPUs=$cpus RealMemory=$memory State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
    mkdir -p "${link%/*}"
    ln -sf "$conf" "$link"
}

start_munge() {
    mkdir -p "$folder/state" "$folder/spool"
    [ -s "$folder/munge.key" ] || (umask 077; head -c 1024 /dev/urandom >"$folder/munge.key")
    munged --force --key-file="$folder/munge.key" --socket="$folder/munge.socket" \
        --pid-file="$folder/munged.pid" --log-file="$folder/munged.log" --seed-file="$folder/munged.seed"
}

wait_for_node() {
    for _ in $(seq 30); do
        [ "$(sinfo --noheader --format=%T 2>/dev/null)" != idle ] || return 0
        sleep 1
    done
    stop "the node is not idle after 30 s: see $folder/slurmctld.log and slurmd.log"
}

end_daemon() { # name: of its pid file
    [ -s "$folder/$1.pid" ] || return 0
    kill "$(cat "$folder/$1.pid")" 2>/dev/null || true
}

case $action in
start)
    need_programs
    write_configuration
    start_munge
    slurmctld -c
    slurmd -c   # what it starts has its own priority
    wait_for_node
    ;;
stop)
    is_ours || stop "no cluster of $folder runs here"
    scancel --quiet --user="$(id -un)" 2>/dev/null || true
    for daemon in slurmd slurmctld munged; do end_daemon "$daemon"; done
    rm "$link"
    ;;
*) stop "unknown action '$action'" ;;
esac
