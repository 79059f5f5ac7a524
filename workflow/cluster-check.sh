#!/usr/bin/env bash
# `cargo xtask cluster`: a reconstruction on SLURM with two nodes on this machine, by a job array and by Snakemake's executor; a
# task and a node daemon are killed in the middle.
#
#   workflow/cluster-check.sh VAMVS FOLDER [BATCH]      FOLDER/set is what `vamvs synth` made; BATCH views a task (2)
set -euo pipefail

vamvs=$1 folder=$2 batch=${3:-2}
here=$(dirname "$(realpath "$0")")
host=$(hostname)
slurm=$folder/slurm
export VAMVS=$vamvs

for program in munged slurmctld slurmd sbatch; do
    command -v "$program" >/dev/null || { echo "$program is missing: apt install slurm-wlm munge" >&2; exit 1; }
done
if [[ -e /etc/slurm/slurm.conf ]]; then
    echo "/etc/slurm/slurm.conf is there already: this check sets up a SLURM of its own" >&2
    exit 1
fi

mkdir -p "$slurm"/{state,log} /etc/slurm
cat >"$slurm/slurm.conf" <<END
ClusterName=check
SlurmctldHost=$host(127.0.0.1)
AuthType=auth/munge
AuthInfo=socket=$slurm/munge.socket
SlurmUser=root
SlurmdUser=root
StateSaveLocation=$slurm/state
SlurmdSpoolDir=$slurm/spool-%n
SlurmctldLogFile=$slurm/log/slurmctld
SlurmdLogFile=$slurm/log/slurmd-%n
SlurmctldPidFile=$slurm/slurmctld.pid
SlurmdPidFile=$slurm/slurmd-%n.pid
SlurmctldPort=16817
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
SlurmdTimeout=10
MpiDefault=none
AccountingStorageType=accounting_storage/none
NodeName=n1 NodeAddr=127.0.0.1 NodeHostname=$host Port=16818 CPUs=1 RealMemory=4000
NodeName=n2 NodeAddr=127.0.0.1 NodeHostname=$host Port=16819 CPUs=1 RealMemory=4000
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
END
ln -s "$slurm/slurm.conf" /etc/slurm/slurm.conf

stop() {
    for daemon in slurmd-n1 slurmd-n2 slurmctld munge; do
        kill "$(cat "$slurm/$daemon.pid" 2>/dev/null)" 2>/dev/null || true
    done
    rm -f /etc/slurm/slurm.conf
}
trap stop EXIT

head -c 1024 /dev/urandom >"$slurm/munge.key"
chmod 600 "$slurm/munge.key"
munged --force --key-file="$slurm/munge.key" --socket="$slurm/munge.socket" --pid-file="$slurm/munge.pid" \
    --log-file="$slurm/log/munge" --seed-file="$slurm/munge.seed"
slurmctld
slurmd -N n1
slurmd -N n2
sleep 3

scene=$folder/set/scene-00000
settings=(--cams "$scene/cams" --images "$scene/images" --weights vis-corr --threads 1 --no-report --quiet)

tasks() { # OUT: plans a run
    rm -rf "${folder:?}/$1"
    "$vamvs" tasks "${settings[@]}" --max-memory 2GB --batch "$batch" --out "$folder/$1" >"$folder/$1.jsonl"
}

wait_for_jobs() {
    while [[ -n $(squeue --noheader) ]]; do sleep 1; done
}

expect_same() { # OUT NAME
    cmp "$folder/whole/fused.ply" "$folder/$1/fused.ply"
    echo "── $2: the cloud of one process, byte for byte, after $SECONDS s"
}

submit() { # OUT
    "$here/slurm.sh" "$folder/$1.jsonl" --output="$slurm/log/job-%A-%a"
}

"$vamvs" reconstruct "${settings[@]}" --max-memory 2GB --out "$folder/whole"

tasks array
SECONDS=0
submit array
wait_for_jobs
expect_same array "job arrays on two nodes"

tasks killed
SECONDS=0
submit killed
sleep 2
pkill -9 -f 'vamvs depth .*killed/run.toml' || { echo "no task was running" >&2; exit 1; }
wait_for_jobs
[[ ! -e $folder/killed/fused.ply ]] || { echo "a killed task was not missed" >&2; exit 1; }
submit killed
wait_for_jobs
expect_same killed "a task killed with -9, submitted again"

tasks node
SECONDS=0
submit node
sleep 2
kill -9 "$(cat "$slurm/slurmd-n2.pid")"
pkill -9 -f 'slurmstepd: ' || true
sleep 15
slurmd -N n2
wait_for_jobs
if [[ ! -e $folder/node/fused.ply ]]; then
    submit node
    wait_for_jobs
fi
expect_same node "a node's daemon killed in the middle"

tasks snakemake
SECONDS=0
(cd "$folder" && python3 -m snakemake --quiet all --snakefile "$here/Snakefile" --executor slurm --jobs 4 \
    --config tasks="$folder/snakemake.jsonl" vamvs="$vamvs" --default-resources slurm_partition=main runtime=10 \
    --slurm-no-account --slurm-status-command squeue --slurm-init-seconds-before-status-checks 2)
expect_same snakemake "Snakemake's SLURM executor"
