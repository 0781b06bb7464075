"""The targets: each makes one case in a folder, and returns the command to give it to."""

from __future__ import annotations

import json
from collections.abc import Callable
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tests.datasets.conftest import Recording
from tests.trust.storm.arguments import commands, grown_arguments
from tests.trust.storm.box import FILES, Box
from tests.trust.storm.damage import spoil_file, spoil_store
from tests.trust.storm.grammar import Grower, as_toml, as_yaml, spoil_document
from tests.trust.storm.messages import good_recording, spoil_messages
from tests.trust.storm.oracle import GOOD_STORE

__all__ = ["TARGETS", "Case"]

Rng = np.random.Generator
#: Makes an input in a folder and returns arguments, and what the surroundings are to be.
Case = Callable[[Rng, Path, Box], tuple[list[str], dict[str, str | None]]]

_SOURCES: dict[str, dict[str, Any]] = {
    "wheels": {"plugin": "csv_odometry", "path": "wheels.csv"},
    "floor": {
        "plugin": "image_folder",
        "path": "pictures",
        "rate_hz": 10,
        "calibration": {"metres_per_pixel": 1e-3},
    },
    "front": {"plugin": "kitti_odometry", "path": "kitti", "camera": "image_0"},
    "kinect": {"plugin": "tum_rgbd", "path": "rgbd"},
    "log": {"plugin": "carmen_log", "path": "log.clf", "rename": {"odometry": "log_odometry"}},
    "film": {"plugin": "video", "path": "film.avi"},
    "bag": {"plugin": "rosbag", "path": "drive.mcap", "topics": {"imu": "/imu", "fix": "/fix", "odom": "/odom"}},
    "world": {"plugin": "sim", "world": "corridor", "stop_s": 0.2},
}
#: What a localizer needs.
_FITTING = {
    **dict.fromkeys(("ground_vo", "ground_map", "klt", "orb", "phase_correlation"), "floor"),
    **dict.fromkeys(("column_ncc", "patch_ncc", "phase_shift", "divs", "omni_surf"), "front"),
    **dict.fromkeys(("kinect_flow", "kinect_landmarks", "kinect_motion", "orb_rgbd"), "kinect"),
    **dict.fromkeys(("imu", "pose_fixes"), "bag"),
    "laser_icp": "log",
}
_RECORDINGS = ("wheels.csv", "log.clf", "pictures", "rgbd", "kitti", "drive.bag", "drive.mcap", "drive_db3", "film.avi")
_LOCALIZERS = ("odometry", "laser_icp", "ground_vo", "klt", "orb_rgbd", "phase_shift", "imu", "divs", "omni_surf")


@cache
def _grower() -> Grower:
    from trailmark.config.schema import run_config_schema
    from trailmark.plugins import load_plugins

    return Grower(run_config_schema(load_plugins()), FILES)


def config(rng: Rng, folder: Path, box: Box) -> tuple[list[str], dict[str, str | None]]:
    """A config grown from the schema, made wrong in some places, and run, taught or replayed."""
    grower = _grower()
    localizers = [str(name) for name in rng.choice(grower.names("localizer"), int(rng.integers(1, 3)), replace=False)]
    names = list(dict.fromkeys(_FITTING.get(name, "wheels") for name in localizers))
    if rng.random() < 0.3:
        names.append(str(rng.choice([name for name in _SOURCES if name not in ("world", *names)])))
    if rng.random() < 0.04:
        names = ["world"]
    document: dict[str, Any] = {"sources": {name: deepcopy(_SOURCES[name]) for name in names}}
    for name in names:
        if rng.random() < 0.3:
            more = grower.part("source", document["sources"][name]["plugin"], rng, 0.08)
            document["sources"][name] = more | document["sources"][name]
    density = float(rng.choice([0.0, 0.1, 0.3]))
    document["localizers"] = {
        f"l{i}": grower.part("localizer", name, rng, density) for i, name in enumerate(localizers)
    }
    if "wheels" in names and rng.random() < 0.7:
        document["localizers"]["wheels"] = {"plugin": "odometry"}
    for kind in ("estimator", "controller", "path_store"):
        if rng.random() < (0.6 if kind == "estimator" else 0.15):
            document[kind] = grower.part(kind, str(rng.choice(grower.names(kind))), rng)
            if rng.random() < 0.9:
                document[kind].pop("use", None)
    if rng.random() < 0.1:
        document["sinks"] = [{"plugin": "jsonl", "to": "out.jsonl"}]
    if rng.random() < 0.2:
        document |= {"mode": str(rng.choice(["track", "teach", "replay"])), "seed": int(rng.integers(5))}
    document = spoil_document(document, rng, int(rng.choice([0, 0, 0, 0, 1, 1, 2, 4])))
    _write(document, folder, rng)
    box.copy(("wheels.csv", "pictures", "kitti", "rgbd", "log.clf", "film.avi", "drive.mcap", GOOD_STORE), folder)
    name = "c.toml" if (folder / "c.toml").exists() else "c.yaml"
    kind = rng.random()
    if kind < 0.5:
        return ["run", name, "--out", "out", "--no-report"], {}
    if kind < 0.75:
        return ["teach", name, "--store", "new.trail", "--out", "out", "--no-report"], {}
    if kind < 0.85:
        return ["teach", name, "--store", GOOD_STORE, "--append", "--out", "out", "--no-report"], {}
    if kind < 0.95:
        return ["replay", name, "--store", GOOD_STORE, "--out", "out", "--no-report"], {}
    return ["inspect", name], {}


def _write(document: Any, folder: Path, rng: Rng) -> None:
    if rng.random() < 0.1:
        (folder / "c.toml").write_text(as_toml(document), encoding="utf-8", errors="surrogatepass")
    else:
        (folder / "c.yaml").write_text(as_yaml(document, rng), encoding="utf-8", errors="surrogatepass")


def recording(rng: Rng, folder: Path, box: Box) -> tuple[list[str], dict[str, str | None]]:
    """A recording of any reader with records, fields or files that are wrong."""
    name = str(rng.choice(_RECORDINGS))
    box.copy((name, GOOD_STORE), folder)
    for _ in range(int(rng.integers(1, 3))):
        spoil_file(folder / name, rng)
    return _played(name, rng), {}


def _played(name: str, rng: Rng) -> list[str]:
    """Return a command that reads a recording."""
    kind = rng.random()
    if kind < 0.35:
        return ["inspect", name, *(["--json"] if rng.random() < 0.3 else [])]
    if kind < 0.5:
        return ["record", name, "--out", "copy"]
    skip = ["--set", f"sources.{name.split('.')[0]}.on_bad_frame=skip"] if rng.random() < 0.3 else []
    return ["run", name, "--localizer", str(rng.choice(_LOCALIZERS)), "--out", "out", "--no-report", *skip]


def messages(rng: Rng, folder: Path, box: Box) -> tuple[list[str], dict[str, str | None]]:
    """A ROS recording whose messages say what they should not."""
    picture = np.full((24, 32), 7, np.uint8)
    record = good_recording(str(rng.choice(["ros1", "mcap", "sqlite"])), [picture] * 4)
    spoil_messages(record, rng)
    record.messages = [one for one in record.messages if _can_be_written(record, one[2])]
    path = record.write(folder)
    kind = rng.random()
    if kind < 0.3:
        return ["inspect", path.relative_to(folder).as_posix()], {}
    topics = {
        "imu": "/imu",
        "odom": "/odom",
        "fix": "/fix",
        "pose": "/pose",
        "scan": "/scan",
        "front": "/cam/image_raw",
        "tf": "odom -> base_link",
    }
    chosen = {name: topic for name, topic in topics.items() if rng.random() < 0.5}
    source = {"plugin": "rosbag", "path": path.relative_to(folder).as_posix(), **({"topics": chosen} if chosen else {})}
    if rng.random() < 0.4:
        source["ground_truth_topic"] = str(rng.choice(["/pose", "/odom", "/fix", "odom -> base_link", "map -> x"]))
    if rng.random() < 0.3:
        source["on_bad_frame"] = "skip"
    localizers = {
        "w": {"plugin": "odometry"},
        "i": {"plugin": "imu"},
        "p": {"plugin": "pose_fixes"},
        "l": {"plugin": "laser_icp"},
    }
    document = {"sources": {"bag": source}, "localizers": {k: v for k, v in localizers.items() if rng.random() < 0.4}}
    (folder / "c.yaml").write_text(json.dumps(document))
    return ["run", "c.yaml", "--out", "out", "--no-report"], {}


def _can_be_written(record: Recording, message: Any) -> bool:
    write = record.store.serialize_ros1 if record.kind == "ros1" else record.store.serialize_cdr
    try:
        write(message, message.__msgtype__)
    except Exception:  # a number that its type cannot hold
        return False
    return True


def store(rng: Rng, folder: Path, box: Box) -> tuple[list[str], dict[str, str | None]]:
    """A store whose rows, tables, pages or companions are wrong."""
    box.copy((GOOD_STORE, "run.yaml", "wheels.csv", "pictures"), folder)
    name = GOOD_STORE
    if rng.random() < 0.9:
        (folder / GOOD_STORE).rename(folder / "bad.trail")
        name = "bad.trail"
        spoil_store(folder / name, rng)
        box.copy((GOOD_STORE,), folder)
    taken = (
        ["store", "info", name],
        ["store", "info", name, "--json"],
        ["store", "check", name],
        ["store", "check", name, "--json"],
        ["store", "copy", name, "copy.trail"],
        ["store", "export", name, "--out", "exported"],
        ["run", "run.yaml", "--store", name, "--out", "out", "--no-report"],
        ["teach", "run.yaml", "--store", name, "--append", "--out", "out", "--no-report"],
        ["replay", "run.yaml", "--store", name, "--out", "out", "--no-report"],
        ["evaluate", "truth.tum", "truth.tum", "--store", name],
        ["omni", "candidates", name, "--out", "pics"],
    )
    box.copy(("truth.tum",), folder)
    return list(taken[int(rng.integers(len(taken)))]), {}


def left_folder(rng: Rng, folder: Path, box: Box) -> tuple[list[str], dict[str, str | None]]:
    """The folder of a run, with files that are wrong, lost or of another kind."""
    box.copy(("done", "truth.tum", GOOD_STORE), folder)
    for _ in range(int(rng.integers(1, 4))):
        spoil_file(folder / "done", rng)
    taken = (
        ["compare", "done"],
        ["compare", "done", "--json"],
        ["compare", "done", "done", "--align", "origin"],
        ["watch", "done", "--once"],
        ["evaluate", "truth.tum", "done/trajectories/fused.tum"],
        ["evaluate", "--noise", "truth.tum", "done/estimates.csv"],
        ["evaluate", "--noise", "--store", GOOD_STORE, "done/trajectories/wheels.tum", "done/estimates.csv"],
        ["run", "done/config.yaml", "--out", "done", "--overwrite"],
        ["report", "done"],
    )
    return list(taken[int(rng.integers(len(taken)))]), {}


def companion(rng: Rng, folder: Path, box: Box) -> tuple[list[str], dict[str, str | None]]:
    """What stands beside a recording: calibrations, truths, stamps, models."""
    box.copy(("wheels.csv", "pictures", "truth.tum", "front.calib.yaml", "kitti", "rgbd"), folder)
    spoil_file(folder / str(rng.choice(["truth.tum", "front.calib.yaml"])), rng)
    if rng.random() < 0.3:
        document = spoil_document({"fx": 60, "fy": 60, "cx": 31, "cy": 23, "distortion": [0.1, 0, 0, 0]}, rng, 2)
        if (folder / "front.calib.yaml").is_dir():
            (folder / "front.calib.yaml").rmdir()
        (folder / "front.calib.yaml").unlink(missing_ok=True)
        (folder / "front.calib.yaml").write_text(as_yaml(document, rng), encoding="utf-8", errors="surrogatepass")
    stamps = "".join(f"{0.1 * i:.2f}\n" for i in range(10))
    (folder / "stamps.txt").write_text(stamps)
    if rng.random() < 0.4:
        spoil_file(folder / "stamps.txt", rng)
    source: dict[str, Any] = {"plugin": "image_folder", "path": "pictures", "timestamps": "stamps.txt"}
    source |= {"calibration": "front.calib.yaml", "ground_truth": "truth.tum"}
    if rng.random() < 0.2:
        source["perturb"] = spoil_document({"noise": 3.0, "blur_px": 1.0, "drop": 0.1, "glints": {}}, rng, 1)
    document = {
        "sources": {"front": source},
        "localizers": {"f": {"plugin": str(rng.choice(["klt", "phase_shift", "divs"]))}},
    }
    (folder / "c.yaml").write_text(json.dumps(document))
    if rng.random() < 0.3:
        return ["evaluate", "truth.tum", "truth.tum", "--align", str(rng.choice(["none", "origin", "se2"]))], {}
    return ["run", "c.yaml", "--out", "out", "--no-report"], {}


def arguments(rng: Rng, folder: Path, box: Box) -> tuple[list[str], dict[str, str | None]]:
    """A call of any command, with values that may be wrong."""
    known = _commands()
    words = list(known)[int(rng.integers(len(known)))]
    box.copy(FILES, folder)
    return grown_arguments(words, known[words], FILES, rng), {}


_commands = cache(commands)
_SURROUNDINGS: dict[str, tuple[str | None, ...]] = {
    "HOME": (None, "", "/nowhere", "\udcff"),
    "COLUMNS": ("0", "-5", "1", "1000000", "x", ""),
    "LINES": ("0", "x"),
    "TERM": (None, "", "dumb", "x" * 300, "xterm-256color"),
    "NO_COLOR": ("1", ""),
    "FORCE_COLOR": ("1",),
    "LC_ALL": ("C", "x", "tr_TR.UTF-8", ""),
    "TZ": ("x/y", "", "Asia/Kathmandu"),
    "TRAILMARK_LOG": ("", "debug", "INFO", "0", "trace", "\u0130nfo"),
    "TRAILMARK_PLUGINS": ("", "sim", "datasets", "nothing", ",,", "datasets,baselines", "a" * 5000),
    "TRAILMARK_DEBUG": ("",),
    "TMPDIR": ("/nowhere", "", "/dev/null"),
    "MPLBACKEND": ("x", "agg", "TkAgg"),
    "MPLCONFIGDIR": ("",),
    "XDG_CACHE_HOME": ("",),
    "PWD": ("/nowhere",),
    "PYTHONWARNINGS": ("error",),
    "BROWSER": ("",),
    "EDITOR": ("",),
}


def surroundings(rng: Rng, folder: Path, box: Box) -> tuple[list[str], dict[str, str | None]]:
    """A good command in odd surroundings."""
    box.copy(("wheels.csv", "pictures", "run.yaml", "done", "truth.tum", GOOD_STORE, "drive.bag"), folder)
    odd: dict[str, str | None] = {}
    for name in rng.choice(list(_SURROUNDINGS), int(rng.integers(1, 4)), replace=False):
        values = _SURROUNDINGS[str(name)]
        odd[str(name)] = values[int(rng.integers(len(values)))]
    taken = (
        ["run", "run.yaml", "--out", "out"],
        ["run", "run.yaml", "--no-report"],
        ["inspect", "wheels.csv"],
        ["compare", "done"],
        ["store", "info", GOOD_STORE],
        ["evaluate", "truth.tum", "truth.tum"],
        ["plugins", "list"],
        ["doctor"],
        ["init"],
        ["inspect", "drive.bag"],
        ["-h"],
        ["run", "wheels.csv", "--localizer", "odometry"],
        ["schema"],
        ["plugins", "show", "odometry"],
        ["watch", "done", "--once"],
        ["teach", "run.yaml", "--store", "new.trail", "--out", "out", "--no-report"],
    )
    return list(taken[int(rng.integers(len(taken)))]), odd


def picture(rng: Rng, folder: Path, box: Box) -> tuple[list[str], dict[str, str | None]]:
    """Pictures that change on the way: size, depth, channels, kind, or what is in them."""
    box.copy(("pictures", GOOD_STORE), folder)
    for path in sorted((folder / "pictures").iterdir()):
        if rng.random() > 0.4:
            continue
        shape = (int(rng.choice([1, 2, 48, 49])), int(rng.choice([1, 3, 64, 65])))
        shape = (*shape, int(rng.choice([3, 4]))) if rng.random() < 0.4 else (48, 64)
        dtype = np.uint16 if rng.random() < 0.3 else np.uint8
        top = 65535 if dtype is np.uint16 else 255
        content = rng.choice(["black", "white", "noise"])
        pixels = np.full(shape, 0 if content == "black" else top, dtype)
        if content == "noise":
            pixels = rng.integers(0, top, shape, dtype=dtype)
        cv2.imwrite(str(path), pixels)
    name = str(
        rng.choice(
            [
                "klt",
                "orb",
                "phase_correlation",
                "ground_vo",
                "ground_map",
                "phase_shift",
                "column_ncc",
                "patch_ncc",
                "divs",
                "omni_surf",
            ]
        )
    )
    document: dict[str, Any] = {
        "sources": {"floor": deepcopy(_SOURCES["floor"]) | {"on_bad_frame": str(rng.choice(["skip", "error"]))}},
        "localizers": {"f": {"plugin": name}},
    }
    if rng.random() < 0.5:
        del document["sources"]["floor"]["calibration"]
    (folder / "c.yaml").write_text(json.dumps(document))
    kind = rng.random()
    if kind < 0.5 or name in ("ground_map", "divs", "omni_surf"):
        return ["teach", "c.yaml", "--store", "new.trail", "--out", "out", "--no-report"], {}
    return ["run", "c.yaml", "--out", "out", "--no-report"], {}


TARGETS: dict[str, Case] = {
    case.__name__: case
    for case in (config, recording, messages, store, left_folder, companion, arguments, surroundings, picture)
}
