"""Where the time of whole runs goes, as flame pictures.

    python benchmarks/flames.py --out DIR [--only husky,ground]

py-spy (`pip install py-spy`) looks at each run 200 times a second: the wider a box, the longer its function was at work
or waited for what it called, which stands below it. Functions of other languages are part of the Python function that
called them. Kernels are compiled before; what took less than 0.2 % is left out. Recordings: ``TRAILMARK_DATA``.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
_RATE_HZ = 200
_NARROW = re.compile(r'<g><title>[^<]*</title><rect x="[^"]*" y="[^"]*" width="0\.[01]\d*%".*?</g>')
_TITLE = re.compile(r'(<text id="title"[^>]*>)[^<]*<')  # py-spy shows its command line, with folders of this machine
_GROUND = """\
sources:
  robot: {plugin: sim, world: ground_course, route: indoor, sensors: [floor, wheels], duration_s: 20}
localizers: {wheels: {plugin: odometry}, floor: {plugin: ground_vo}}
estimator: {plugin: kalman}
"""
#: Name of the picture: what it shows, and the example that is run or the text of its config.
RUNS: dict[str, tuple[str, Path | str]] = {
    "husky": ("The Husky bag: wheels, an inertial unit and kalman", TOP / "examples/real/husky_bag.yaml"),
    "mrclam": ("MRCLAM: wheels and dead reckoning", TOP / "examples/real/mrclam_odometry.yaml"),
    "tum": ("TUM fr1_rpy: landmarks and ORB, decoded beside", TOP / "examples/real/tum_rgbd.yaml"),
    "ground": ("A simulated floor at 70 pictures a second: ground_vo, wheels and kalman", _GROUND),
}


def draw(name: str, spy: str, out: Path) -> str:
    """Run a config twice, the second time under py-spy; return the Markdown of its picture."""
    what, config = RUNS[name]
    picture = out / f"{name}.svg"
    with tempfile.TemporaryDirectory() as folder:
        if isinstance(config, str):
            Path(folder, "config.yaml").write_text(config, encoding="utf-8")
            config = Path(folder, "config.yaml")
        command = [sys.executable, str(Path(sys.executable).with_name("trailmark"))]
        command += ["run", str(config), "--no-report", "--out"]
        record = [spy, "record", "--function", "--rate", str(_RATE_HZ), "--output", str(picture), "--"]
        for ran in ([*command, str(Path(folder, "warm"))], [*record, *command, str(Path(folder, "run"))]):
            if code := subprocess.run(ran, cwd=TOP, stdout=subprocess.DEVNULL, check=False).returncode:
                sys.exit(f"{name}: {' '.join(ran)} ended with code {code}; what it said stands above")
    text = _NARROW.sub("", picture.read_text(encoding="utf-8"))
    picture.write_text(_TITLE.sub(rf"\g<1>{what}<", text), encoding="utf-8")
    return f"{what}:\n\n![{what}: how long each function took]({picture.name})\n"


def main() -> None:
    """Draw all pictures, and write the text that shows them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of the pictures and of flames.md")
    parser.add_argument("--only", default=",".join(RUNS), help="names, with commas")
    options = parser.parse_args()
    names = options.only.split(",")
    if unknown := sorted(set(names) - set(RUNS)):
        parser.error(f"--only: no run is called {', '.join(unknown)}; there are {', '.join(RUNS)}")
    if not os.environ.get("TRAILMARK_DATA"):
        parser.error("set TRAILMARK_DATA to the folder of the recordings")
    spy = shutil.which("py-spy", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
    if spy is None:
        parser.error("py-spy draws the pictures, and is not installed: pip install py-spy")
    options.out.mkdir(parents=True, exist_ok=True)
    text = "\n".join(draw(name, spy, options.out) for name in names)
    (options.out / "flames.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
