"""`preset: paper` of every method: keys that exist, values that hold, sources that are told, and an old name."""

from __future__ import annotations

import pytest

from trailmark.config import PresetConfig
from trailmark.config.describe import describe_part
from trailmark.plugins import Kind, load_plugins

#: What differs from the default: where the printed method is another one, or leaves something out.
_DIFFERENT: dict[tuple[Kind, str], set[str]] = {
    ("localizer", "ground_vo"): {
        "mode", "max_shift_px", "margin_px", "wide_search", "max_error_ratio", "max_error_growth",
    },
    ("localizer", "ground_map"): {
        "high_pass", "refined", "min_groups", "min_correlation", "heading_sigma_deg", "max_attempts",
    },
    ("localizer", "divs"): {"threshold", "average", "shift", "confidence", "gain", "when_blind"},
    ("controller", "drift_steering"): {"law"},
    ("localizer", "omni_surf"): {
        "ratio", "n_longest", "refresh_every", "min_agreeing", "max_rival_share", "min_agreeing_share",
        "confirm_pictures", "max_gap_deg", "place_fit",
    },
    ("localizer", "kinect_landmarks"): {
        "solve", "angles", "depth_kind", "min_landmarks", "finders", "point", "refind", "landmarks", "trial",
        "moved_after", "min_agreeing", "place_alike", "notice_tilt",
    },
    ("localizer", "kinect_flow"): {"solve", "angles", "depth_kind", "min_landmarks"},
}  # fmt: skip


def config_of(kind: Kind, name: str) -> type[PresetConfig]:
    model = load_plugins().registry.find(kind, name).load_config()
    assert issubclass(model, PresetConfig)
    return model


@pytest.mark.parametrize(("kind", "name"), _DIFFERENT)
def test_one_word_makes_a_method_that_of_its_paper(kind: Kind, name: str) -> None:
    model = config_of(kind, name)
    printed, default = model.model_validate({"preset": "paper"}), model.model_validate({})

    differ = {key for key in model.model_fields if getattr(printed, key) != getattr(default, key)}
    assert differ == {"preset", *_DIFFERENT[kind, name]}
    for key, value in model.presets["paper"].items():
        assert getattr(printed, key) == value.value
        assert value.source


@pytest.mark.parametrize(("kind", "name"), _DIFFERENT)
def test_the_manual_of_a_part_says_what_its_preset_sets(kind: Kind, name: str) -> None:
    model = config_of(kind, name)
    told = {key.key: key for key in describe_part(load_plugins().registry.find(kind, name))}["preset"]

    assert told.type == "paper"
    assert all(f"{key}: " in told.description for key in model.presets["paper"])


def test_the_old_mode_paper_of_the_ground_camera_does_what_it_did_and_says_its_new_name(
    caplog: pytest.LogCaptureFixture,
) -> None:
    model = config_of("localizer", "ground_vo")

    old = model.model_validate({"mode": "paper", "search_px": 4})

    assert old == model.model_validate({"mode": "whole_pixels", "search_px": 4})
    assert "'mode: paper' is called 'whole_pixels' now" in caplog.text
