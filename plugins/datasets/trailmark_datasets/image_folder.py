"""Pictures in a folder."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from trailmark.errors import SourceError
from trailmark.frames import SensorInfo
from trailmark.geometry import Trajectory
from trailmark_datasets.config import ImageFolderConfig
from trailmark_datasets.picture_source import Entry, PictureSource, list_pictures, missing_numbers
from trailmark_datasets.posetable import FrameStamp, poses_from_table
from trailmark_datasets.stamps import read_stamps

__all__ = ["ImageFolder"]


class ImageFolder(PictureSource):
    """Pictures in a folder: sorted files at a rate, or as a file of stamps lists them."""

    config: ImageFolderConfig

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        self.grey, self.rate_hz = self.config.grey, self.config.rate_hz
        return super().open_recording(name)

    def _list(self) -> Iterable[Entry]:
        if self.config.timestamps is not None:
            return _with_stamps(self.config, self.config.timestamps)
        return _at_rate(self.config, self.config.rate_hz or 1.0)

    def ground_truth(self) -> Trajectory | None:
        """Return the poses of the table `poses`."""
        return poses_from_table(self.config, [FrameStamp(entry.stamp_s, entry.path.name) for entry in self._entries])


def _at_rate(config: ImageFolderConfig, rate_hz: float) -> Iterator[Entry]:
    paths = list_pictures(config.path, config.pattern)
    missing = missing_numbers([path.name for path in paths]) if config.numbered else {}
    present = iter(paths)
    for place in range(len(paths) + len(missing)):
        if place in missing:
            path = paths[0].with_name(missing[place])
            yield Entry(place / rate_hz, path, f"{path} (the files around it count up; numbered: false allows gaps)")
        else:
            path = next(present)
            yield Entry(place / rate_hz, path, str(path))


def _with_stamps(config: ImageFolderConfig, timestamps: Path) -> Iterator[Entry]:
    stamps = read_stamps(timestamps, config.time_unit)
    if all(stamp.name is not None for stamp in stamps):
        for stamp in stamps:
            path = _path_of(config.path, timestamps.parent, str(stamp.name))
            yield Entry(stamp.stamp_s, path, f"{stamp.where} ({path})")
        return
    paths = list_pictures(config.path, config.pattern)
    if len(stamps) != len(paths):
        raise SourceError(f"{timestamps} has {len(stamps)} stamps for {len(paths)} pictures in {config.path}")
    for stamp, path in zip(stamps, paths, strict=True):
        yield Entry(stamp.stamp_s, path, f"{stamp.where} ({path})")


def _path_of(folder: Path, beside: Path, name: str) -> Path:
    """Return the file of a name that is relative to the folder, or to where the list stands."""
    inside = folder / name
    return inside if inside.exists() or not (beside / name).exists() else beside / name
