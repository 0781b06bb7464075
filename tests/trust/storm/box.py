"""Good inputs of every kind, tiny; each case spoils a copy of what it needs."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tests.trust.storm.oracle import GOOD_STORE, N_WAYPOINTS

from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.paths import Keyframe, Waypoint
from trailmark.stores import SqlitePathStore, SqliteStoreConfig

__all__ = ["FILES", "SOURCES", "Box"]

#: What a box holds, by the name of its file or folder.
FILES = (
    *("wheels.csv", "log.clf", "pictures", "rgbd", "kitti", "drive.bag", "drive.mcap", "drive_db3"),
    *("truth.tum", "front.calib.yaml", GOOD_STORE, "run.yaml", "done", "film.avi"),
)
N_FRAMES = 10
SIZE = (64, 48)

RUN = """mode: track
sources:
  wheels: {plugin: csv_odometry, path: wheels.csv}
  floor: {plugin: image_folder, path: pictures, rate_hz: 10, calibration: {metres_per_pixel: 1.0e-3}}
localizers:
  wheels: {plugin: odometry}
  floor: {plugin: ground_vo, camera: floor}
estimator: {plugin: kalman}
"""


#: Sources that play what a box holds.
SOURCES: dict[str, dict[str, Any]] = {
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


class Box:
    """Makes good inputs once, and copies them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        if not (folder / "ready").exists():
            folder.mkdir(parents=True, exist_ok=True)
            self._fill()
            (folder / "ready").touch()

    def copy(self, names: Iterable[str], into: Path) -> None:
        """Copy good inputs into the folder of a case."""
        for name in names:
            source, target = self.folder / name, into / name
            if source.is_dir():
                shutil.copytree(source, target)
            else:
                shutil.copyfile(source, target)

    def _fill(self) -> None:
        folder, rng = self.folder, np.random.default_rng(7)
        rows = "".join(f"{0.1 * i:.1f},{0.02 * i:.2f},0,{0.01 * i:.2f}\n" for i in range(N_FRAMES))
        (folder / "wheels.csv").write_text("t,x,y,theta\n" + rows)
        (folder / "truth.tum").write_text("".join(f"{0.1 * i:.1f} {0.02 * i} 0 0 0 0 0 1\n" for i in range(N_FRAMES)))
        ranges = " ".join("1.5" for _ in range(180))
        scans = (
            f"ODOM {0.02 * i} 0 0 0 0 0 {0.1 * i} host {0.1 * i}\n"
            f"FLASER 180 {ranges} {0.02 * i} 0 0 {0.02 * i} 0 0 {0.1 * i} host {0.1 * i}\n"
            for i in range(N_FRAMES)
        )
        (folder / "log.clf").write_text("PARAM robot_frontlaser_offset 0.1\n" + "".join(scans))
        noise = rng.integers(0, 255, (400, 400), dtype=np.uint8)
        texture = cv2.equalizeHist(cv2.GaussianBlur(noise, (0, 0), 1.5))
        pictures = [texture[20:68, 5 * i : 5 * i + 64] for i in range(N_FRAMES)]
        self._pictures(pictures, [texture[20:300, 5 * i : 5 * i + 320] for i in range(N_FRAMES)])
        (folder / "front.calib.yaml").write_text("fx: 60\nfy: 60\ncx: 31.5\ncy: 23.5\ndistortion: [0.1, 0, 0, 0]\n")
        self._store()
        (folder / "run.yaml").write_text(RUN)
        self._bags(pictures)
        self._run()

    def _pictures(self, pictures: list[np.ndarray], large: list[np.ndarray]) -> None:
        folder = self.folder
        for name in ("pictures", "rgbd/rgb", "rgbd/depth", "kitti/image_0"):
            (folder / name).mkdir(parents=True)
        film = cv2.VideoWriter(str(folder / "film.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, SIZE)
        for i, picture in enumerate(pictures):
            cv2.imwrite(str(folder / f"pictures/{i:06d}.png"), large[i])
            cv2.imwrite(str(folder / f"kitti/image_0/{i:06d}.png"), picture)
            cv2.imwrite(str(folder / f"rgbd/rgb/{i}.png"), cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
            cv2.imwrite(str(folder / f"rgbd/depth/{i}.png"), np.full(picture.shape, 5000 + i, np.uint16))
            film.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
        film.release()
        for name in ("rgb", "depth"):
            lines = "".join(f"{0.1 * i:.2f} {name}/{i}.png\n" for i in range(N_FRAMES))
            (folder / f"rgbd/{name}.txt").write_text("# stamp file\n" + lines)
        truth = "".join(f"{0.1 * i:.2f} 0 0 {0.01 * i} 0 0 0 1\n" for i in range(N_FRAMES))
        (folder / "rgbd/groundtruth.txt").write_text(truth)
        (folder / "rgbd/camera.txt").write_text("60 60 31.5 23.5\n5000\n")
        (folder / "kitti/times.txt").write_text("".join(f"{0.1 * i:e}\n" for i in range(N_FRAMES)))
        (folder / "kitti/calib.txt").write_text("".join(f"P{i}: 60 0 31.5 0 0 60 23.5 0 0 0 1 0\n" for i in range(4)))
        (folder / "kitti/poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * N_FRAMES)

    def _store(self) -> None:
        store = SqlitePathStore(SqliteStoreConfig(path=str(self.folder / GOOD_STORE), access="create"))
        store.start(Session("path_store"))
        for index in range(N_WAYPOINTS):
            pose = Pose2(0.05 * index)
            store.localizer_map("floor").add(
                Keyframe(0.05 * index, float(index), pose, {"patch": np.full((16, 16), index, np.uint8)})
            )
            store.append(Waypoint(index, 0.05 * index, pose))
        store.localizer_map("floor").save("model", {"weights": np.linspace(0, 1, 50)})
        store.commit()
        store.close()

    def _bags(self, pictures: list[np.ndarray]) -> None:
        from tests.trust.storm.messages import good_recording

        for kind, name in (("ros1", "drive.bag"), ("mcap", "drive.mcap"), ("sqlite", "drive_db3")):
            folder = self.folder / f"making_{kind}"
            folder.mkdir()
            good_recording(kind, pictures).write(folder).rename(self.folder / name)
            shutil.rmtree(folder)

    def _run(self) -> None:
        import trailmark

        trailmark.run(self.folder / "run.yaml", out=self.folder / "done", report=False)
