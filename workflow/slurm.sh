#!/usr/bin/env bash
# Submits the tasks of `vamvs tasks` to SLURM: one job array for each kind of task, which begins when those before it are
# done. What follows the file goes to sbatch.
#
#   vamvs tasks --colmap sparse/0 --images images --out out --threads 4 > tasks.jsonl
#   workflow/slurm.sh tasks.jsonl --partition=compute
#
# The photographs, the output folder and this file must be at the same paths on all nodes. VAMVS names a command that is not
# in PATH.
set -euo pipefail

# A job of an array: the task at that place among those of its kind, which begin after some lines.
if [[ ${1:-} == --line ]]; then
    mapfile -t argv < <(sed -n "$(($3 + $4))p" "$2" | python3 -c 'import json, sys; print(*json.load(sys.stdin)["argv"], sep="\n")')
    exec "${VAMVS:-vamvs}" "${argv[@]:1}"
fi

if [[ $# -lt 1 || ! -r $1 ]]; then
    echo "usage: $0 tasks.jsonl [options of sbatch]" >&2
    exit 1
fi
tasks=$(realpath "$1")
shift

# For each kind of task: its first and last line, cores, megabytes, and whether it wants a GPU.
kinds=$(python3 - "$tasks" <<'END'
import json, sys

kinds = {}
for line, text in enumerate(open(sys.argv[1]), 1):
    task = json.loads(text)
    kinds.setdefault(task["id"].split("-")[0], []).append((line, task))
for name, tasks in kinds.items():
    first, task = tasks[0]
    print(name, first, tasks[-1][0], task["cores"], -(-task["memory"] // 10**6), int(task["gpu"]))
END
)

after=()
while read -r name first last cores megabytes gpu; do
    options=(--parsable --job-name="vamvs-$name" --array="1-$((last - first + 1))" --cpus-per-task="$cores" --mem="${megabytes}M")
    [[ $gpu == 1 ]] && options+=(--gres=gpu:1)
    job=$(sbatch "${options[@]}" "${after[@]}" "$@" --export=ALL \
        --wrap "$(printf '%q --line %q %q' "$(realpath "$0")" "$tasks" $((first - 1))) \$SLURM_ARRAY_TASK_ID")
    echo "$name: job ${job%%;*}, $((last - first + 1)) task(s)"
    after=(--dependency="afterok:${job%%;*}" --kill-on-invalid-dep=yes)
done <<<"$kinds"
