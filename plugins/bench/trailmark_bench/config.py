"""The section ``bench:`` of a bench config: what is crossed with what, what is compared, within which limits."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, field_validator

from trailmark.config.base import PluginConfig

__all__ = ["AXES", "BenchSection", "CellsSection", "Installed", "Judging", "Limits"]

#: Sections of ``cells:`` and what one value of each is called in a table.
AXES: dict[str, str] = {
    "sources": "source",
    "places": "place",
    "perturbations": "perturbation",
    "localizers": "localizer",
    "estimators": "estimator",
    "controllers": "controller",
    "pipelines": "pipeline",
}

_DEFAULT_METRICS = (
    "ate_rmse_m",
    "ate_heading_rmse_deg",
    "rpe_rmse_m",
    "drift_percent",
    "tracked_fraction",
    "answered_fraction",
    "silent",
    "nees_per_dof",
    "call_p95_ms",
)


class Installed(PluginConfig):
    """Every installed localizer, with its defaults: what a plugin brings appears by being installed."""

    gives: tuple[Literal["motion", "fix", "path_offset"], ...] = ("motion",)
    """Those that may say one of these."""
    leave_out: tuple[str, ...] = ()
    """Not these."""
    beside: dict[str, Any] = Field(default_factory=dict)
    """Localizers that run with each of them, by name, such as `{wheels: odometry}`."""


class Limits(PluginConfig):
    """What a cell may use; beyond it the cell fails, and no other."""

    timeout_s: float = Field(default=3600.0, gt=0)
    """Wall time [s]."""
    memory_mb: float | None = Field(default=None, ge=64)
    """Address space of a process, and memory of all its processes together; compiled code and libraries take 2 to 4 GB
    of address space before the first frame [MB]."""
    file_mb: float | None = Field(default=None, gt=0)
    """Size of a single file [MB]."""
    disk_mb: float | None = Field(default=10_000.0, gt=0)
    """All that it leaves in its folder, and has in its working folder and as temporary files [MB]."""
    processes: int | None = Field(default=200, ge=1)
    """Processes at a time."""
    threads: int = Field(default=1, ge=1)
    """Threads of the numeric libraries; 1 is fair and reproducible."""


class Judging(PluginConfig):
    """How a cell is judged; part of its address, so that figures of two protocols never meet in a table."""

    trajectory: Literal["fused", "localizer"] = "fused"
    """The belief of the whole pipeline, or the way of the cell's first localizer by itself."""
    align: Literal["se2", "origin", "none"] = "se2"
    """Alignment of the absolute errors."""


class CellsSection(PluginConfig):
    """One matrix: every value of every axis with every other. An axis that is left out has no say."""

    name: str = ""
    """Of the matrix, where there are several."""
    sources: dict[str, Any] = Field(default_factory=dict)
    """By name: one source, or several by their names; beside those of the run config."""
    places: dict[str, Any] = Field(default_factory=dict)
    """By name: sections of a run config laid over the sources, such as another route or world seed. Places are samples
    of a condition, as seeds are: methods are compared on equal ones, and each place counts once."""
    perturbations: dict[str, Any] = Field(default_factory=dict)
    """By name: what is wrong with the sensors, as under `perturb` of a source; `{}` is nothing."""
    localizers: dict[str, Any] = Field(default_factory=dict)
    """By name: one localizer, or several by their names; beside those of the run config. A list names plugins. Times
    and consistency are told of the first, or of the one that `about` names."""
    installed: Installed | None = None
    """Besides these, every installed localizer of a kind."""
    estimators: dict[str, Any] = Field(default_factory=dict)
    """By name. A list names plugins."""
    controllers: dict[str, Any] = Field(default_factory=dict)
    """By name. A list names plugins."""
    pipelines: dict[str, Any] = Field(default_factory=dict)
    """By name: any sections of a run config, laid over it."""
    seeds: int | tuple[int, ...] = 1
    """How many, from `seed` of the run config on; or which."""
    config: dict[str, Any] = Field(default_factory=dict)
    """Sections of a run config that only this matrix has."""
    teach: dict[str, Any] | None = None
    """What is different while the path is taught, before the run of the cell; `{}`: nothing."""
    judging: Judging | None = None
    """How its cells are judged; default: as those of the bench."""
    exclude: tuple[dict[str, Any], ...] = ()
    """Combinations that are left out: `{localizer: klt, source: [street, corridor]}`."""
    alone: bool = False
    """For times that count: these cells run one at a time, when nothing else does."""

    @field_validator("localizers", "estimators", "controllers", mode="before")
    @classmethod
    def _name_by_plugin(cls, value: Any) -> Any:
        if isinstance(value, list | tuple):
            return {str(name).rpartition(":")[2]: {"plugin": name} for name in value}
        return value

    @field_validator("seeds")
    @classmethod
    def _are_seeds(cls, seeds: int | tuple[int, ...]) -> int | tuple[int, ...]:
        if isinstance(seeds, int):
            if seeds < 1:
                raise ValueError(f"must be at least 1, not {seeds}")
        elif not seeds or min(seeds) < 0 or len(set(seeds)) < len(seeds):
            raise ValueError(f"must be different numbers from 0 on, not {list(seeds)}")
        return seeds


class BenchSection(PluginConfig):
    """A bench: a run config shared by its cells, and this."""

    cells: CellsSection | tuple[CellsSection, ...]
    """One matrix, or a list of them."""
    version: str = ""
    """Of the suite; it stands beside its results, and in what is sent of them."""
    baseline: str | None = None
    """Value of an axis that the others are compared with, pair by pair."""
    exclude: tuple[dict[str, Any], ...] = ()
    """Combinations that are left out of every matrix."""
    teach: dict[str, Any] | None = None
    """As `teach` of a matrix, for all of them."""
    metrics: tuple[str, ...] = Field(default=_DEFAULT_METRICS, min_length=1)
    """Quantities of the tables; the first one ranks."""
    judging: Judging = Judging()
    """How a cell is judged."""
    limits: Limits = Limits()
    """What a cell may use."""
    executor: dict[str, Any] = Field(default_factory=lambda: {"plugin": "local"})
    """Where cells run: `{plugin: local, jobs: 2}`; options of the command line win."""
    code: Literal["source", "version"] = "source"
    """What of the code makes the address of a cell: its source, so that a cell is run again when its code was changed,
    or its version alone."""
    keep_stores: bool = False
    """Keep the path stores of cells that were taught; they can be large."""

    @property
    def matrices(self) -> tuple[CellsSection, ...]:
        """The matrices."""
        return self.cells if isinstance(self.cells, tuple) else (self.cells,)
