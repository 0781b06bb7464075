"""Every source that comes with Trailmark passes the checks that the authors of others are given."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from trailmark.frames import RGBD, Image
from trailmark.plugins import load_plugins
from trailmark.testing import room_run, source_checks
from trailmark.testing.checks.parametrize import parametrize

REGISTRY = load_plugins().registry
BUILT_IN = {spec.name for spec in REGISTRY.specs("source") if spec.distribution == "trailmark"}

#: Sources that cannot be checked here, and why.
NOT_HERE = {
    "camera": "needs a device",
    "ros2": "needs a robot: tests/ros2/test_contract.py",
    "lines": "needs a robot: tests/lines",
}

N_FRAMES = 12


@cache
def folder() -> Path:
    """The folder that all recordings of this module are written into."""
    return Path(tempfile.mkdtemp(prefix="recordings-"))


@pytest.fixture(scope="module", autouse=True)
def _tidy() -> Iterator[None]:
    yield
    shutil.rmtree(folder(), ignore_errors=True)


def write_pictures(into: Path) -> Path:
    into.mkdir(parents=True)
    for index, frame in enumerate(room_run("image", n_frames=N_FRAMES).frames):
        assert isinstance(frame.payload, Image)
        cv2.imwrite(str(into / f"{index:06d}.png"), frame.payload.pixels)
    return into


def write_video(path: Path) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, (160, 120))
    for frame in room_run("image", n_frames=N_FRAMES).frames:
        assert isinstance(frame.payload, Image)
        writer.write(np.array(frame.payload.pixels))
    writer.release()
    return path


def write_table(path: Path) -> Path:
    rows = [f"{0.1 * i:.1f},{0.03 * i:.2f},0,{0.01 * i:.2f}" for i in range(N_FRAMES)]
    path.write_text("\n".join(["t,x,y,theta", *rows]) + "\n")
    return path


def write_sightings(path: Path) -> Path:
    rows = [f"{0.1 * i:.1f},{1 + i % 3},{3.0 + 0.1 * i:.1f},{0.05 * i:.2f}" for i in range(N_FRAMES)]
    path.write_text("\n".join(["t,id,range,bearing", *rows]) + "\n")
    return path


def write_carmen(path: Path) -> Path:
    ranges = " ".join(f"{2 + 0.01 * beam:.2f}" for beam in range(180))
    lines = ["# CARMEN"]
    for i in range(N_FRAMES):
        pose = f"{0.03 * i:.2f} 0 0"
        lines += [f"ODOM {pose} 0 0 0 {i}.0 host {i}.0", f"FLASER 180 {ranges} {pose} {pose} {i}.5 host {i}.5"]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_tum(path: Path) -> Path:
    (path / "rgb").mkdir(parents=True)
    (path / "depth").mkdir()
    colour, depth, truth = ["# color"], ["# depth"], ["# truth"]
    for index, frame in enumerate(room_run("rgbd", n_frames=N_FRAMES).frames):
        assert isinstance(frame.payload, RGBD)
        cv2.imwrite(str(path / f"rgb/{index}.png"), frame.payload.bgr)
        cv2.imwrite(str(path / f"depth/{index}.png"), (frame.payload.depth_m * 5000).astype(np.uint16))
        colour.append(f"{frame.stamp_s:.4f} rgb/{index}.png")
        depth.append(f"{frame.stamp_s + 0.002:.4f} depth/{index}.png")
        truth.append(f"{frame.stamp_s:.4f} 0 0 {0.3 * frame.stamp_s:.4f} 0 0 0 1")
    for name, lines in (("rgb", colour), ("depth", depth), ("groundtruth", truth)):
        (path / f"{name}.txt").write_text("\n".join(lines) + "\n")
    return path


def write_rgbd_folder(path: Path) -> Path:
    path.mkdir(parents=True)
    for index, frame in enumerate(room_run("rgbd", n_frames=N_FRAMES).frames):
        assert isinstance(frame.payload, RGBD)
        cv2.imwrite(str(path / f"frame-{index:06d}.color.png"), frame.payload.bgr)
        cv2.imwrite(str(path / f"frame-{index:06d}.depth.png"), (frame.payload.depth_m * 1000).astype(np.uint16))
        pose = f"1 0 0 0\n0 1 0 0\n0 0 1 {0.03 * index:e}\n0 0 0 1\n"
        (path / f"frame-{index:06d}.pose.txt").write_text(pose)
    return path


def write_kitti(root: Path) -> Path:
    path = root / "sequences" / "00"
    write_pictures(path / "image_0")
    (path / "times.txt").write_text("".join(f"{0.1 * i:e}\n" for i in range(N_FRAMES)))
    (path / "calib.txt").write_text("".join(f"P{i}: 140 0 79.5 0 0 140 59.5 0 0 0 1 0\n" for i in range(4)))
    (root / "poses").mkdir()
    (root / "poses" / "00.txt").write_text("".join(f"1 0 0 0 0 1 0 0 0 0 1 {0.03 * i:e}\n" for i in range(N_FRAMES)))
    return path


def write_euroc(path: Path) -> Path:
    """Write a camera that looks ahead, and an inertial unit whose axes are the camera's."""
    mav = path / "mav0"
    pictures = write_pictures(mav / "cam0" / "data")
    names = sorted(picture.name for picture in pictures.iterdir())
    (mav / "cam0/data.csv").write_text("".join(f"{i * 10**8},{name}\n" for i, name in enumerate(names)))
    (mav / "cam0/sensor.yaml").write_text("intrinsics: [140, 140, 79.5, 59.5]\n")
    (mav / "imu0").mkdir()
    (mav / "imu0/data.csv").write_text("".join(f"{i * 10**8},0,0,0,0,-9.8,0\n" for i in range(N_FRAMES)))
    (mav / "imu0/sensor.yaml").write_text("sensor_type: imu\n")
    (mav / "state_groundtruth_estimate0").mkdir()
    truth = "".join(f"{i * 10**8},0,0,{0.03 * i},1,0,0,0\n" for i in range(N_FRAMES))
    (mav / "state_groundtruth_estimate0/data.csv").write_text(truth)
    return path


def write_bag(path: Path) -> Path:
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="needs the extra bags")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    image_type, header_type, time_type = (
        store.types[f"{name}"]
        for name in ("sensor_msgs/msg/Image", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    with rosbag2.Writer(path, version=8) as writer:
        topic = writer.add_connection("/front", "sensor_msgs/msg/Image", typestore=store)
        for index, frame in enumerate(room_run("image", n_frames=N_FRAMES).frames):
            assert isinstance(frame.payload, Image)
            header = header_type(stamp=time_type(sec=100 + index, nanosec=0), frame_id="front")
            data = np.array(frame.payload.pixels).ravel()
            image = image_type(
                header=header, height=120, width=160, encoding="bgr8", is_bigendian=0, step=480, data=data
            )
            serialized = store.serialize_cdr(image, "sensor_msgs/msg/Image")
            writer.write(topic, (100 + index) * 1_000_000_000, serialized)
    return path


#: What each source plays: how it is written, under which name, and further keys.
RECORDINGS: dict[str, tuple[Callable[[Path], Path], str, dict[str, float]]] = {
    "carmen_log": (write_carmen, "robot.log", {}),
    "csv_odometry": (write_table, "wheels.csv", {}),
    "csv_records": (write_sightings, "sightings.csv", {}),
    "image_folder": (write_pictures, "pictures", {"rate_hz": 10}),
    "kitti_odometry": (write_kitti, "kitti", {}),
    "euroc": (write_euroc, "euroc", {}),
    "rgbd_folder": (write_rgbd_folder, "scenes", {}),
    "rosbag": (write_bag, "bag", {}),
    "tum_rgbd": (write_tum, "tum", {}),
    "video": (write_video, "film.avi", {}),
}


@cache
def config_of(name: str) -> object:
    """Return the config of a source, whose recording is written now."""
    model = REGISTRY.find("source", name).load_config()
    if name == "sim":
        return model.model_validate({"world": "ground_course"})
    write, file, keys = RECORDINGS[name]
    return model.model_validate({"path": write(folder() / file), **keys})


def all_checks() -> dict[str, Callable[[], None]]:
    found: dict[str, Callable[[], None]] = {}
    for name in sorted(BUILT_IN - NOT_HERE.keys()):
        checks = source_checks(REGISTRY.find("source", name).load(), lambda name=name: config_of(name), n_frames=20)
        found |= {f"{name}-{check}": call for check, call in checks.items()}
    return found


def test_every_built_in_is_checked() -> None:
    assert RECORDINGS.keys() | {"sim"} | NOT_HERE.keys() == BUILT_IN


@parametrize(all_checks())
def test_contract(check: Callable[[], None]) -> None:
    check()
