"""Cases of files: recordings, stores, folders of runs and what stands beside them, each wrong in its structure."""

from __future__ import annotations

import json
from copy import deepcopy
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tests.datasets.conftest import Recording
from tests.trust.storm.box import SOURCES, Box
from tests.trust.storm.damage import spoil_file, spoil_store
from tests.trust.storm.grammar import as_yaml, spoil_document
from tests.trust.storm.messages import good_recording, spoil_messages
from tests.trust.storm.oracle import GOOD_STORE

__all__ = ["companion", "left_folder", "messages", "picture", "recording", "store"]

Rng = np.random.Generator

_RECORDINGS = ("wheels.csv", "log.clf", "pictures", "rgbd", "kitti", "drive.bag", "drive.mcap", "drive_db3", "film.avi")
_LOCALIZERS = ("odometry", "laser_icp", "ground_vo", "klt", "orb_rgbd", "phase_shift", "imu", "divs", "omni_surf")


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
        "sources": {"floor": deepcopy(SOURCES["floor"]) | {"on_bad_frame": str(rng.choice(["skip", "error"]))}},
        "localizers": {"f": {"plugin": name}},
    }
    if rng.random() < 0.5:
        del document["sources"]["floor"]["calibration"]
    (folder / "c.yaml").write_text(json.dumps(document))
    kind = rng.random()
    if kind < 0.5 or name in ("ground_map", "divs", "omni_surf"):
        return ["teach", "c.yaml", "--store", "new.trail", "--out", "out", "--no-report"], {}
    return ["run", "c.yaml", "--out", "out", "--no-report"], {}
