"""What the first command costs in CPU time: the demo with no kernel compiled yet, and with all of them kept.

    python benchmarks/first_command.py                       # this checkout: the demo's first seconds, cold and cached
    python benchmarks/first_command.py --before ../old       # and beside it a checkout with ../old/.venv of its own
    python benchmarks/first_command.py --whole               # the whole demo, which takes some minutes

Cold, numba's cache is an empty folder, which the cached run then finds filled. CPU time of all threads, by the
operating system's account: what else the machine does moves it by a third at most, so that the checkouts take turns.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

#: What is simulated of the demo unless all of it is asked for [s].
_SECONDS = 4.0


def measure(checkout: Path, whole: bool) -> dict[str, float]:
    """Return the CPU time of the first and of a later start [s].

    Parameters
    ----------
    checkout : Path
        Of the repository, with its environment in ``.venv``.
    whole : bool
        Run the demo to its end, with its report.
    """
    costs = {}
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": f"{folder}/kernels", "PYTHONPATH": ""}
        for kind in ("cold", "cached"):
            before = _children_s()
            for arguments in _commands(checkout, Path(folder) / kind, whole):
                command = [str(checkout / ".venv" / "bin" / "trailmark"), *arguments]
                subprocess.run(command, env=environment, check=True, capture_output=True)
            costs[kind] = _children_s() - before
    return costs


def _commands(checkout: Path, out: Path, whole: bool) -> list[list[str]]:
    if whole:
        return [["demo", "--out", str(out)]]
    config = str(checkout / "plugins" / "sim" / "trailmark_sim" / "starters" / "demo.yaml")
    common = ["--store", f"{out}.trail", "--no-report", "--set", f"sources.robot.duration_s={_SECONDS}"]
    return [[mode, config, *common, "--out", str(out / mode)] for mode in ("teach", "replay")]


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--before", type=Path, help="a checkout to compare with")
    parser.add_argument("--whole", action="store_true", help="the demo to its end")
    parser.add_argument("--repeat", type=int, default=1, help="the least of so many")
    arguments = parser.parse_args()
    here = Path(__file__).resolve().parent.parent
    checkouts = {"now": here} if arguments.before is None else {"before": arguments.before.resolve(), "now": here}
    least: dict[str, dict[str, float]] = {}
    for _ in range(arguments.repeat):
        for name, checkout in checkouts.items():
            costs = measure(checkout, arguments.whole)
            least[name] = {kind: min(cost, least.get(name, costs)[kind]) for kind, cost in costs.items()}
    print(f"{'CPU [s]':8} {'cold':>7} {'cached':>7} {'compiling':>10}")
    for name, costs in least.items():
        print(f"{name:8} {costs['cold']:7.1f} {costs['cached']:7.1f} {costs['cold'] - costs['cached']:10.1f}")
    if "before" in least:
        old, new = least["before"], least["now"]
        compiling = (new["cold"] - new["cached"]) / (old["cold"] - old["cached"])
        print(f"{'ratio':8} {new['cold'] / old['cold']:7.2f} {new['cached'] / old['cached']:7.2f} {compiling:10.2f}")


if __name__ == "__main__":
    sys.exit(main())
