"""``trailmark omni``: train the landmark selection, list candidates to label. What is heavy is imported on use."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import click

from trailmark.errors import ConfigError

__all__ = ["omni"]


@click.group("omni")
def omni() -> None:
    """Landmark selection of the omnidirectional camera: label candidates, train."""


@omni.command("train")
@click.argument("labels", type=click.Path(path_type=Path, dir_okay=False), required=False)
@click.option(
    "--synthetic", type=click.IntRange(20), metavar="N", help="Train on N candidates made from geometry alone."
)
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="Model to write (.npz).")
@click.option(
    "--label-distance", default=0.6, show_default=True, help="T_d: a good landmark is measured this well [m]."
)
@click.option("--seed", default=0, show_default=True, type=click.IntRange(0), help="Seed of --synthetic.")
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
def train_command(
    labels: Path | None, synthetic: int | None, out: Path, label_distance: float, seed: int, as_json: bool
) -> None:
    """Train the selection on LABELS, a CSV as `trailmark omni candidates` writes it, with true places filled in."""
    if (labels is None) == (synthetic is None):
        raise ConfigError("give either a CSV or --synthetic N to train on")
    import numpy as np

    from trailmark_omni_surf.synthetic import synthetic_candidates
    from trailmark_omni_surf.training import read_candidates, train

    if labels is not None:
        features, is_good = read_candidates(labels, label_distance)
    else:
        features, is_good = synthetic_candidates(synthetic or 0, np.random.default_rng(seed), label_distance)
    model, report = train(features, is_good)
    try:
        model.save(out)
    except OSError as error:
        raise ConfigError(f"cannot write {out}: {error}") from error
    if as_json:
        click.echo(json.dumps(dataclasses.asdict(report) | {"model": str(out)}))
        return
    click.echo(
        f"{report.n} candidates, {report.n_good} good; cross-validated: accuracy {report.accuracy:.2f}, "
        f"precision {report.precision:.2f}, recall {report.recall:.2f}"
    )
    click.echo(f"wrote {out}; use it with localizers.NAME.model: {out}")


@omni.command("candidates")
@click.argument("store", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--localizer", default="omni", show_default=True, help="Name of the localizer in the config.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="CSV to write.")
def candidates_command(store: Path, localizer: str, out: Path) -> None:
    """Write the candidates of a taught place as a CSV, to be labelled by hand: fill in true_x and true_y."""
    from trailmark_omni_surf.export import stored_candidates
    from trailmark_omni_surf.training import write_candidates

    features, measured = stored_candidates(store, localizer)
    try:
        write_candidates(out, features, measured)
    except OSError as error:
        raise ConfigError(f"cannot write {out}: {error}") from error
    click.echo(
        f"wrote {len(features)} candidates to {out}; fill in true_x and true_y, then: trailmark omni train {out}"
    )
