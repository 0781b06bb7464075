"""Which measured landmarks to trust: an RBF support vector machine over six features, in plain numpy."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, fields
from importlib.resources import files
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ConfigError, ShapeError
from trailmark_omni_surf.landmarks import FEATURE_NAMES

__all__ = ["SelectionModel", "log_features", "shipped_model"]


_N_FEATURES = len(FEATURE_NAMES)
_MAX_BYTES = 64 << 20  # a thousand times what training gives
_FLOOR = np.array([1.0, 1e-7, 1.0, 1e-4, 1e-4, 1e-5])  # below this a feature says "none"


def log_features(features: Floats) -> Floats:
    """Return the logarithm of the features, (N, 6): they spread over decades, and an RBF kernel sees differences."""
    if features.ndim != 2 or features.shape[1] != _N_FEATURES:
        raise ShapeError(f"features must be (N, {_N_FEATURES}), not {features.shape}")
    return np.asarray(np.log(np.maximum(features, _FLOOR)))


@dataclass(frozen=True, slots=True, eq=False)
class SelectionModel:
    """A trained machine as plain arrays.

    Attributes
    ----------
    mean, scale : (6,) float64
        Of the transformed features.
    support : (S, 6) float64
        Support vectors, scaled.
    weights : (S,) float64
        Dual coefficients.
    intercept, gamma : float64 scalars
        Of the decision function ``sum_s w_s exp(-gamma |x - s|^2) + b``.
    sigmoid : (2,) float64
        Platt's a and b: probability ``1 / (1 + exp(a f + b))``.
    """

    mean: Floats
    scale: Floats
    support: Floats
    weights: Floats
    intercept: Floats
    gamma: Floats
    sigmoid: Floats

    def decision(self, features: Floats) -> Floats:
        """Return the signed distance from the boundary, (N,); positive: a landmark."""
        x = (log_features(features) - self.mean) / self.scale
        squared = ((x[:, None, :] - self.support[None, :, :]) ** 2).sum(axis=2)
        return np.asarray(np.exp(-self.gamma * squared) @ self.weights + self.intercept)

    def probability(self, features: Floats) -> Floats:
        """Return how likely each candidate is measured correctly, (N,)."""
        exponent = np.clip(self.sigmoid[0] * self.decision(features) + self.sigmoid[1], -500.0, 500.0)
        return np.asarray(1.0 / (1.0 + np.exp(exponent)))

    def save(self, path: Path) -> None:
        """Write the arrays as npz."""
        with path.open("wb") as stream:  # given a name, numpy would put .npz behind it
            np.savez_compressed(stream, **{field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def load(cls, path: Path) -> SelectionModel:
        """Read what `save` wrote.

        Raises
        ------
        ConfigError
            If the file cannot be read or lacks an array.
        """
        try:
            with np.load(path, allow_pickle=False) as saved:
                if sum(part.file_size for part in saved.zip.infolist()) > _MAX_BYTES:
                    raise ValueError(f"it unpacks to more than {_MAX_BYTES} bytes")
                arrays = {field.name: np.asarray(saved[field.name], dtype=np.float64) for field in fields(cls)}
        except (OSError, ValueError, KeyError, EOFError, AttributeError, TypeError, BadZipFile, zlib.error) as error:
            raise ConfigError(
                f"{path} is no selection model ({error}); make one with 'trailmark omni train'"
            ) from error
        if arrays["support"].ndim != 2 or arrays["support"].shape != (len(arrays["weights"]), _N_FEATURES):
            raise ConfigError(f"{path} is no selection model: support vectors of shape {arrays['support'].shape}")
        return cls(**arrays)


def shipped_model() -> SelectionModel:
    """Return the model that comes with the plugin; README.md says what it was trained on."""
    return SelectionModel.load(Path(str(files("trailmark_omni_surf").joinpath("selection.npz"))))
