"""Checks that a PNG is whole, before a decoder trusts the lengths in it."""

from __future__ import annotations

import struct

__all__ = ["check_png", "is_png"]

_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def is_png(data: bytes) -> bool:
    """Return whether data begins as a PNG does."""
    return data.startswith(_SIGNATURE)


def check_png(data: bytes) -> None:
    """Refuse a PNG whose pieces reach beyond its end.

    A decoder takes the memory that a piece says it needs: 12 damaged bytes cost it 4 GiB.

    Raises
    ------
    ValueError
        If a piece is longer than what is left, or the end is missing.
    """
    at = len(_SIGNATURE)
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        at += 12 + length
        if at > len(data):
            raise ValueError("the PNG picture is damaged: a piece of it reaches beyond its end")
        if kind == b"IEND":
            return
    raise ValueError("the PNG picture is damaged: it has no end")
