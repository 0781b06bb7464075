#!/usr/bin/env bash
# A quick pass of every benchmark: do they run, and are the figures of the right size. PYTHON names the interpreter.
set -euo pipefail
cd "$(dirname "$0")/.."
python=${PYTHON:-python}
export TRAILMARK_DATA=${TRAILMARK_DATA:-$(realpath -m ../shared/data)}

# Two at a time, each with its output in one piece; one that fails fails this script.
in_pairs() {
    xargs -P 2 -I '{}' bash -c '
        said=$("$0" benchmarks/{} 2>&1)
        code=$?
        printf "\n--- benchmarks/%s\n%s\n" "{}" "$said"
        exit "$code"' "$python"
}

in_pairs <<'END'
ground_vo.py --quick
ground_map.py --quick --what spoilt
omni_surf.py --quick
ground_accuracy.py --quick --what curve --methods refined klt
core_overhead.py --quick
bench_scale.py --quick
sim_ground.py --frames 70 --floor wood
sim_render.py --repeat 1
END
if [ -d "$TRAILMARK_DATA" ]; then
    in_pairs <<'END'
divs.py --quick
kinect_landmarks.py --quick
fusion.py --robots 1 --cases clean
END
else
    echo "no recordings at $TRAILMARK_DATA: the benchmarks on real data are left out"
fi

# The benches of configs, a corner of each: cells start, give figures, and end in tables and a report.
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
cells() {
    printf '\n--- benchmarks/%s\n' "$*"
    "$python" -m trailmark.cli bench "$1" --out "$out/$1" --jobs 2 "${@:2}"
}
cells grand --only matrix=ground --only source=wood --quick \
    --only localizer=ground_vo,klt,orb,phase_correlation,odometry --set bench.cells.0.sources.wood.robot.duration_s=1
cells benchmarks/speed.yaml --only matrix=ground --only seed=0 --set bench.cells.0.sources.wood.duration_s=1
