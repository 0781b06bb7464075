"""PNG pictures whose pieces tell wrong lengths."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trailmark.frames.png import check_png, is_png

WHOLE = cv2.imencode(".png", np.arange(24 * 32, dtype=np.uint8).reshape(24, 32))[1].tobytes()
DATA_LENGTH = WHOLE.index(b"IDAT") - 4


def test_a_whole_picture_is_taken_and_what_follows_it_is_left_alone() -> None:
    check_png(WHOLE)
    check_png(WHOLE + b"more")


@pytest.mark.parametrize("cut", [9, DATA_LENGTH + 6, len(WHOLE) - 1])
def test_a_cut_picture_is_refused(cut: int) -> None:
    with pytest.raises(ValueError, match="the PNG picture is damaged"):
        check_png(WHOLE[:cut])


def test_a_piece_that_tells_a_length_of_gigabytes_is_refused() -> None:
    damaged = bytearray(WHOLE)
    damaged[DATA_LENGTH : DATA_LENGTH + 4] = (0xFFFFFFF0).to_bytes(4, "big")

    with pytest.raises(ValueError, match="a piece of it reaches beyond its end"):
        check_png(bytes(damaged))


def test_only_what_begins_as_a_png_is_one() -> None:
    assert is_png(WHOLE)
    assert not is_png(b"GIF89a")
