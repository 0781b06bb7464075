"""Public recordings that Trailmark was tried on. They are not shipped: `trailmark data` says where each can be had.

Names and checksums are those of the files as they were tried: unpacked here, compressed there, not always as their
publishers pack them. A file of another name or checksum may hold the same drive; `trailmark data check` says which
differ.
"""

from __future__ import annotations

from typing import Any

from trailmark.datasets import Dataset

__all__ = [
    "ACES", "FR079", "FR079_CORRECTED", "FR1_RPY", "HUSKY", "INTEL",
    *(f"MRCLAM_D6_ROBOT{robot}" for robot in range(1, 6)), "PLAZA1", "PLAZA2",
]  # fmt: skip

_RADISH = "http://radish.sourceforge.net"
_KUEMMERLE = "Kuemmerle et al., Autonomous Robots 27(4), 2009"


def _laser(summary: str, file: str, digest: str, *, truth: str = "", **about: Any) -> Dataset:
    """Return a CARMEN log with its wheels; what stands `beside` it belongs to it, `reads` are keys of its source."""
    log = {"plugin": "carmen_log", "path": f"{{data}}/{file}", **about.pop("reads", {})}
    files = {file: digest, **about.pop("beside", {})}
    config = {"sources": {"log": log}, "localizers": {"wheels": {"plugin": "odometry"}}}
    return Dataset(summary, files, config, truth, **about)


INTEL = _laser(
    "Intel Research Lab, Seattle: planar laser and odometry of a Pioneer, corrected poses",
    "omni/laser2d_carmen/intel-corrected.log.gz",
    "71bef16e9926506cf7417995ef35ace09dbd5de067fd042a3aab85188b5480dc",
    truth="poses corrected by SLAM",
    reads={"on_bad_frame": "skip"},  # some stamps of the laser's computer go back by 6 ms
    cite="D. Haehnel; Howard & Roy, Radish",
    url=_RADISH,
)
FR079_CORRECTED = _laser(
    "Freiburg, building 079: planar laser and odometry, corrected poses",
    "omni/laser2d_carmen/freiburg-079-corrected.log.gz",
    "0631d30baf4b9d1d209af47da9096e876e1b4cb3d5a2d68ef9c39c5a2360a466",
    truth="poses corrected by SLAM",
    cite="C. Stachniss; Howard & Roy, Radish",
    url=_RADISH,
)
FR079 = _laser(
    "Freiburg, building 079: planar laser and raw odometry, 392 m",
    "laser/fr079.clf.bz2",
    "9c3930e17957889c24986390dc7fe3eeddd3d7019a8172085dbed8a28a0e6b77",
    licence="CC BY 3.0",
    cite=f"C. Stachniss; {_KUEMMERLE}",
    url="http://ais.informatik.uni-freiburg.de/slamevaluation",
)
ACES = _laser(
    "ACES building, Austin: planar laser and raw odometry, 325 m; relations laid by hand",
    "laser/aces.clf.bz2",
    "b663e2976ed0621c2bec0cc20c4e7cc117b88db5bac6f921d3fbaa9685d2232a",
    beside={"laser/aces.relations": "11a15800a751b6f9413078a021d49c7cda85a768c2a465433b4fae7ef57b03d5"},
    licence="CC BY 3.0",
    cite=f"P. Beeson; {_KUEMMERLE}",
    url="http://ais.informatik.uni-freiburg.de/slamevaluation",
)
HUSKY = Dataset(
    "A Husky outdoors, 395 s: wheel odometry, an inertial unit that lies on its side, GPS",
    {"fusion/rl_test1.bag": "fd759aa942a3ef549412ff724d15e7280a347a366996a012cf9079329ec28f4a"},
    {
        "sources": {"bag": {"plugin": "rosbag", "path": "{data}/fusion/rl_test1.bag"}},
        "sensors": {"imu_data": {"mounting": {"y": -0.3, "z": 0.52, "roll_deg": 90.0, "yaw_deg": -90.0}}},
        "localizers": {
            "wheels": {"plugin": "odometry", "reads": "velocity"},
            "imu": {"plugin": "imu", "heading_sigma_deg": 1.0},
        },
        "estimator": {"plugin": "kalman", "start_sigma_deg": 180.0},
        "start": [0.0, 0.0, 0.0],
    },
    licence="BSD",
    cite="the tests of robot_localization",
    url="https://github.com/cra-ros-pkg/robot_localization",
)


FR1_RPY = Dataset(
    "TUM RGB-D freiburg1_rpy, its first 5 s: a Kinect that is turned in the hand",
    {"rgbd/fr1_rpy_0_5s": "33ce964c8439ac9cb69d499177731b15edba66b1452c16aa7520aa2e6717d85c"},
    {
        "sources": {"kinect": {"plugin": "tum_rgbd", "path": "{data}/rgbd/fr1_rpy_0_5s"}},
        "localizers": {"motion": {"plugin": "kinect_motion", "camera": "kinect"}},
    },
    "motion capture",
    licence="CC BY 4.0",
    cite="Sturm et al., IROS 2012",
    url="https://cvg.cit.tum.de/data/datasets/rgbd-dataset",
)


def _plaza(
    number: int,
    km: str,
    *,
    start: tuple[float, float, float],
    digests: tuple[str, str],
    radios: dict[int, tuple[float, float]],
) -> Dataset:
    """Return a lawn mower's drive: digests of odometry and ranges, start [m, m, deg], where the radios stand [m]."""
    files = [f"uwb/Plaza{number}_{what}.txt.gz" for what in ("DR", "TD")]
    odometry, ranges = (f"{{data}}/{file}" for file in files)
    wheels = {"plugin": "csv_odometry", "path": odometry, "header": ["t", "distance", "turn"], "per_row": True}
    seen = {
        "plugin": "csv_records",
        "path": ranges,
        "header": ["t", "_", "id", "range"],
        "metres_per_unit": 1.0 / 1.07,  # too long by so much on both drives, against GPS
        "on_bad_frame": "skip",  # two of the first drive's stamps go back
    }
    return Dataset(
        f"A lawn mower among four ultra-wideband radios, {km} km: odometry and ranges",
        dict(zip(files, digests, strict=True)),
        {
            "sources": {"wheels": wheels, "radios": seen},
            "localizers": {
                "wheels": {"plugin": "odometry"},
                "radios": {
                    "plugin": "known_landmarks",
                    "landmarks": {radio: list(place) for radio, place in radios.items()},
                },
            },
            "estimator": {"plugin": "kalman"},
            "start": list(start),
        },
        licence="BSD-3",
        cite="Djugash, Hamner & Roth, Journal of Field Robotics 26(9), 2009",
        url="https://github.com/borglab/gtsam/tree/develop/examples/Data",
    )


PLAZA1 = _plaza(
    1,
    "1.9",
    start=(0.0, 0.0, 241.928),
    digests=(
        "0d8e8f4f326ac5491eaba1546cc794e3d6fbf9ba87d5b9eb036e7ce84bf0bb4b",
        "e1d9696887378d47255c343c6c9914cdfd744b3f4f7ce57503d4745893666b85",
    ),
    radios={0: (-46.6232, 11.0255), 1: (11.0361, -6.9587), 6: (22.0531, 23.8485), 5: (-17.6649, 59.0092)},
)
PLAZA2 = _plaza(
    2,
    "1.4",
    start=(-34.2086, 45.3008, 64.200),
    digests=(
        "db5db6cedf1b29291ec0edab5d53725e09df38330dcf00a1d6857cee51edb9f1",
        "f05e6a654fbc82aa052fc51844851b894af52fcb64eb08154abb4695dd807f48",
    ),
    radios={1: (-68.9265, 18.3778), 6: (-37.5805, 69.2278), 0: (-33.6205, 26.9678), 5: (1.7095, -5.8122)},
)


def _mrclam(robot: int, *, start: tuple[float, float, float], digests: tuple[str, str, str]) -> Dataset:
    """Return the drive of a robot: the start is where motion capture saw it; digests of odometry, sightings, truth."""
    folder = "fusion/mrclam_D6"
    own = [f"{folder}/Robot{robot}_{what}.dat" for what in ("Odometry", "Measurement", "Groundtruth")]
    odometry, sightings, truth = (f"{{data}}/{file}" for file in own)
    wheels = {
        "plugin": "csv_odometry",
        "path": odometry,
        "header": ["t", "v", "omega"],
        "poses": truth,
        "poses_header": ["t", "x", "y", "theta"],
    }
    landmarks = {
        "plugin": "csv_records",
        "path": sightings,
        "header": ["t", "id", "range", "bearing"],
        "codes": f"{{data}}/{folder}/Barcodes.dat",
        "codes_header": ["id", "code"],
        "landmarks": f"{{data}}/{folder}/Landmark_Groundtruth.dat",
        "landmarks_header": ["id", "x", "y"],
    }
    return Dataset(
        f"UTIAS MRCLAM data set 6, robot {robot}: commanded wheels, range and bearing to 15 landmarks",
        dict(zip(own, digests, strict=True))
        | {
            f"{folder}/Barcodes.dat": "4b4f4d9e65c452f58a6df2e02f25b5aced4300bd32cfbdb0acd8439692f09683",
            f"{folder}/Landmark_Groundtruth.dat": "8e0ecf890a1ea5607fa28332809b64660fd01b70845b4ccff1a408d79ef13ba0",
        },
        {
            "sources": {"wheels": wheels, "landmarks": landmarks},
            "localizers": {"wheels": {"plugin": "odometry"}, "landmarks": {"plugin": "known_landmarks"}},
            "estimator": {"plugin": "kalman"},
            "start": list(start),
        },
        "motion capture",
        cite="Leung, Halpern, Barfoot & Liu, IJRR 30(8), 2011",
        url="http://asrl.utias.utoronto.ca/datasets/mrclam",
    )


MRCLAM_D6_ROBOT1 = _mrclam(
    1,
    start=(1.4127, -3.8908, 130.2),
    digests=(
        "52a9cc01ffffb02842ed6f6de75c62f20a19eb87b04f5f7b0c08267f0abd2349",
        "c367aef4b30a36be833f38d4bbfd8f7e4e947d17b354cbd3a68f043cc9517831",
        "fa1ac14edf93e3fef2d976189aaf88096a5156a7d24ae938b22ba0f17a115590",
    ),
)
MRCLAM_D6_ROBOT2 = _mrclam(
    2,
    start=(2.4353, -0.1813, 173.1),
    digests=(
        "0d844fe0d20ec84b748cd4ae00cc968c8084260b9c8f5d724e2f6be4a77b00e7",
        "d051673a69aa80bb9236aee84ecd6940ca62cd10ffe74ea19ceb9eb3a9b9ccd7",
        "f81bb2b0a98d794169869d6c774732cea148b516b4ef1ad27dd3dde6ea47ff73",
    ),
)
MRCLAM_D6_ROBOT3 = _mrclam(
    3,
    start=(2.6425, 2.5331, -95.8),
    digests=(
        "e31f3db4a0b1d3215598e783831d69e126429984f5396d1e7562592e963484af",
        "6cf848e54a6fc6975e7b8a286f32832cda74d066d035dc53890acdf6d28b0620",
        "a5e1a9db0efbdfb8125941eb320c67e4abe5f3402d889960301e56a761d3a549",
    ),
)
MRCLAM_D6_ROBOT4 = _mrclam(
    4,
    start=(3.4587, -1.2434, 176.1),
    digests=(
        "d368a6f73cd9ba93c2e7d68819020dadef80f039d1dc1c3185ed4fb4875f23eb",
        "46a529d7514a42f41d2fe7404eaf7b5a20ff370a9de380db8fb5936fbcec42b8",
        "6a74b0f86f1af5a92c0e8a45453abc8e034331b930366ac68be07a912080b66f",
    ),
)
MRCLAM_D6_ROBOT5 = _mrclam(
    5,
    start=(2.7797, -3.3349, 142.6),
    digests=(
        "93de21f8501797e0dfa4b209063bb911d027b7c6e7aa68528ebf21ca9238e1a0",
        "fff2b646be38850c172420bebb80f99f9373e50eaff0726df102bcd99bbbde72",
        "853299dcbbec1d681a6a057f0624ae3207f4a40bb98ea9d1f1335f866abb095a",
    ),
)
