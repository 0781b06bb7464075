from __future__ import annotations

import numpy as np
import pytest

from trailmark.errors import ConfigError, StoreError
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe
from trailmark_divs.eye import TURNING, Look
from trailmark_divs.keyframe_writer import KeyframeWriter
from trailmark_divs.layout import make_layout
from trailmark_divs.taught_layout import check_layout, layout_document
from trailmark_divs.taught_stream import TaughtStream, summarize
from trailmark_divs.windows import Windows

LAYOUT = make_layout((80, 40), 8, (0.0, 0.5))
DOCUMENT = layout_document(LAYOUT, (0.0, 0.5), None, "p90")


def make_look(k, run=0, seed=7):
    rng = np.random.default_rng((seed, k))
    sums, profile = rng.integers(0, 200, 8), rng.uniform(0, 255, 8)
    return Look(k, run, sums, profile, (0.05 * k, 0.05 * (k + 1)), (0.015 * k, 0.015 * (k + 1)), 0.001 * k)


def written(localizer_map, looks):
    memory = KeyframeWriter(localizer_map)
    memory.begin(DOCUMENT, "divs")
    for look in looks:
        memory.add(look, Pose2(look.travelled_m[1]))
    memory.flush()
    return TaughtStream.from_keyframes(localizer_map.keyframes())


def test_what_was_looked_at_comes_back(localizer_map):
    looks = [make_look(k, run=k // 20) for k in range(50)]

    recording = written(localizer_map, looks)

    np.testing.assert_array_equal(recording.sums, [look.sums for look in looks])
    np.testing.assert_allclose(recording.profiles, [look.profile for look in looks], atol=1 / 512)
    np.testing.assert_array_equal(recording.runs, [look.run for look in looks])
    np.testing.assert_allclose(recording.stations_m, [look.travelled_m for look in looks], atol=1e-12)
    np.testing.assert_array_equal(recording.stamps_s, [look.stamps_s for look in looks])
    np.testing.assert_array_equal(recording.headings_rad, [look.heading_rad for look in looks])


def test_sixteen_looks_share_a_keyframe_and_cost_50_small_numbers_each(localizer_map):
    written(localizer_map, [make_look(k) for k in range(33)])

    keyframes = localizer_map.keyframes()
    assert [len(keyframe.arrays["runs"]) for keyframe in keyframes] == [16, 16, 1]
    assert keyframes[0].arrays["sums"].dtype == np.uint16
    assert keyframes[0].station_m == pytest.approx(0.015 * 16)
    assert keyframes[0].pose_map_base == Pose2(0.015)


def test_sums_that_need_more_than_16_bits_get_them(localizer_map):
    look = make_look(0)
    look.sums[3] = 70_000

    assert written(localizer_map, [look]).sums[0, 3] == 70_000


def test_teaching_goes_on_where_it_ended(localizer_map):
    written(localizer_map, [make_look(k) for k in range(20)])

    localizer_map.offset_m = 5.0  # as the pipeline continues a path
    recording = written(localizer_map, [make_look(k) for k in range(20)])

    assert recording.runs.tolist() == [0] * 20 + [1] * 20
    assert recording.stations_m[[0, 20], 0] == pytest.approx([0.0, 5.0])
    assert recording.headings_rad[20] == recording.headings_rad[19]


def test_windows_are_the_averages_that_no_turn_interrupts(localizer_map):
    runs = [0] * 6 + [TURNING] * 3 + [1] * 5
    recording = written(localizer_map, [make_look(k, run) for k, run in enumerate(runs)])

    windows = Windows.of(recording, 4, 0, LAYOUT.scale)

    assert windows.ordinals.tolist() == [3, 4, 5, 12, 13]
    np.testing.assert_allclose(windows.vectors[3], recording.sums[9:13].mean(axis=0))
    assert windows.stations_m[0] == pytest.approx(0.015 * 2)  # the middle of 0 to 4 steps
    assert windows.elapsed_s[0] == pytest.approx(0.05 * 2)
    assert windows.headings_rad[1] == pytest.approx(np.mean([0.0005, 0.0015, 0.0025, 0.0035]))


def test_a_recording_shorter_than_a_window_has_none(localizer_map):
    assert len(Windows.of(written(localizer_map, [make_look(0)]), 4, 1, LAYOUT.scale)) == 0


def test_stamps_since_1970_keep_their_digits(localizer_map):
    looks = [
        Look(k, 0, np.zeros(8, int), np.zeros(8), (1.7e9 + 0.05 * k, 1.7e9 + 0.05 * (k + 1)), (0.0, 0.0), 0.0)
        for k in range(2000)
    ]

    windows = Windows.of(written(localizer_map, looks), 25, 6, LAYOUT.scale)

    np.testing.assert_allclose(windows.elapsed_s, 0.05 * (12.5 + np.arange(1976)), atol=1e-6)


def test_a_summary_says_whether_the_path_can_be_replayed(localizer_map):
    summary = summarize(written(localizer_map, [make_look(k, TURNING if k < 10 else 0) for k in range(40)]))

    assert summary == pytest.approx({"n_looks": 40, "length_m": 0.6, "spacing_m": 0.015, "turning_share": 0.25})


def test_an_empty_map_is_refused():
    with pytest.raises(StoreError, match="nothing of this path is remembered"):
        TaughtStream.from_keyframes([])


def test_keyframes_of_another_plugin_are_refused():
    with pytest.raises(StoreError, match="not those of a visual stream"):
        TaughtStream.from_keyframes([Keyframe(0.0, 0.0, Pose2(), {"patch": np.zeros(4)})])


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (
            layout_document(make_layout((80, 40), 10, (0.0, 0.5)), (0.0, 0.5), None, "p90"),
            "columns 8, but the config says 10",
        ),
        (layout_document(LAYOUT, (0.0, 0.4), None, "p90"), "region 0, 0.5, but the config says 0, 0.4"),
        (layout_document(LAYOUT, (0.0, 0.5), 0.45, "p90"), "lens_radius 0, but the config says 0.45"),
        (
            layout_document(LAYOUT, (0.0, 0.5), None, "otsu"),
            "threshold p90, but the config says otsu; set threshold back",
        ),
    ],
)
def test_a_path_taught_with_other_columns_is_refused(localizer_map, other, message):
    KeyframeWriter(localizer_map).begin(DOCUMENT, "divs")

    with pytest.raises(ConfigError, match=message):
        check_layout(localizer_map, other, "divs")


def test_a_map_that_does_not_tell_its_threshold_was_taught_with_otsus(localizer_map):
    untold = {key: value for key, value in DOCUMENT.items() if key != "threshold"}
    localizer_map.save("layout", untold)

    check_layout(localizer_map, layout_document(LAYOUT, (0.0, 0.5), None, "otsu"), "divs")
    with pytest.raises(ConfigError, match="taught with threshold otsu, but the config says p90"):
        check_layout(localizer_map, DOCUMENT, "divs")
