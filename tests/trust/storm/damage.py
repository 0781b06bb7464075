"""Damage to recordings, stores and what lies beside them: records and rows that are wrong, files that are none."""

from __future__ import annotations

import bz2
import gzip
import os
import shutil
import sqlite3
from contextlib import closing, suppress
from pathlib import Path

import numpy as np

__all__ = ["spoil_bytes", "spoil_file", "spoil_records", "spoil_store"]

Rng = np.random.Generator

_FIELDS = (
    *("nan", "inf", "-inf", "1e308", "-1", "0", "1e18", "99999999999999999999", "", "x", "1,5", "1e-400", "0x10", "+"),
    *(
        "\u0661",
        "1_0",
        "--1",
        "1e",
        "null",
        "../x.png",
        "/dev/null",
        "\x00",
        "a" * 2000,
        "\u202e",
        "\x1b[31m",
        '"',
        "#",
    ),
)


def spoil_records(text: str, rng: Rng) -> str:
    """Return a text of records with records lost, doubled, swapped, cut, of other stamps, or with wrong fields."""
    lines = text.splitlines()
    comma = "," in text[:200]
    for _ in range(int(rng.integers(1, 5))):
        if not lines:
            break
        at = int(rng.integers(len(lines)))
        fields = lines[at].split("," if comma else " ")
        field = int(rng.integers(len(fields)))
        match int(rng.integers(12)):
            case 0:
                del lines[at]
            case 1:
                lines.insert(int(rng.integers(len(lines) + 1)), lines[at])
            case 2:
                other = int(rng.integers(len(lines)))
                lines[at], lines[other] = lines[other], lines[at]
            case 3:
                fields.append(str(rng.choice(_FIELDS)))
            case 4:
                del fields[field]
            case 5:
                fields = [str(rng.choice(_FIELDS))] * len(fields)
            case 6:  # one clock in other units
                scale = float(rng.choice([1e-9, 1e3, 1e9, 0.0, -1.0]))
                lines = [_scaled(line, "," if comma else " ", scale) for line in lines]
                continue
            case 7:
                lines = lines[: at + 1] + lines
            case 8:
                lines.insert(at, str(rng.choice(["", "#", "%", "t,x,y,theta", ",,,,", " ", "\x0c", "EOF", "\ufeff"])))
            case _:
                fields[field] = str(rng.choice(_FIELDS))
        if at < len(lines) and len(fields) > 0 and lines[at] != "":
            lines[at] = ("," if comma else " ").join(fields)
    return str(rng.choice(["\n", "\n", "\n", "\r\n", "\r"])).join(lines) + "\n" * int(rng.integers(3))


def _scaled(line: str, separator: str, scale: float) -> str:
    fields = line.split(separator)
    with suppress(ValueError):
        fields[0] = str(float(fields[0]) * scale)
    return separator.join(fields)


def spoil_bytes(data: bytes, rng: Rng) -> bytes:
    """Return bytes with blocks lost, swapped, zeroed, repeated, cut, or with numbers that are lengths made large."""
    raw = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        if len(raw) < 16:
            return bytes(raw)
        at, other = sorted(int(value) for value in rng.integers(0, len(raw) - 8, 2))
        size = int(rng.choice([1, 4, 8, 64, 512, 1024]))
        match int(rng.integers(8)):
            case 0:
                del raw[at : at + size]
            case 1:
                raw[at : at + size], raw[other : other + size] = raw[other : other + size], raw[at : at + size]
            case 2:
                raw[at : at + size] = bytes(min(size, len(raw) - at))
            case 3:
                raw[other:other] = raw[at : at + size]
            case 4:
                del raw[other:]
            case 5:
                wide = int(rng.choice([0, 1, 0x7FFFFFFF, 0xFFFFFFFF, 0x10000000])).to_bytes(
                    4, str(rng.choice(["little", "big"]))
                )
                raw[at : at + 4] = wide
            case 6:
                raw[at] ^= 1 << int(rng.integers(8))
            case 7:
                raw[at : at + 8] = np.array([rng.choice([np.nan, np.inf, -1e308, 1e18])]).tobytes()
    return bytes(raw)


def spoil_file(path: Path, rng: Rng) -> None:
    """Make a file, or one of a folder's, something that it should not be."""
    if path.is_dir():
        inside = sorted(entry for entry in path.rglob("*") if entry.is_file() and not entry.is_symlink())
        if not inside:
            return
        path = inside[int(rng.integers(len(inside)))]
    if path.is_symlink() or not path.is_file():  # spoilt already
        return
    data = path.read_bytes()
    is_text = path.suffix in (".csv", ".clf", ".tum", ".txt", ".yaml", ".json")
    kind = rng.random()
    if kind < 0.80:
        path.write_bytes(
            spoil_records(data.decode("utf-8", "replace"), rng).encode("utf-8", "replace")
            if is_text
            else spoil_bytes(data, rng)
        )
        return
    path.unlink()
    match int(rng.integers(9)):
        case 0:
            path.mkdir()
        case 1:
            path.symlink_to(path)
        case 2:
            path.symlink_to("/dev/null")
        case 3:
            path.write_bytes(b"")
        case 4:
            path.write_bytes(data.decode("latin-1").encode("utf-16"))
        case 5:
            path.write_bytes(gzip.compress(data)[: int(rng.integers(1, 60))])
        case 6:
            path.write_bytes(rng.bytes(300))
        case 7:
            os.mkfifo(path)
        case _:
            packed = path.with_name(path.name + str(rng.choice([".gz", ".bz2"])))
            packed.write_bytes(spoil_bytes(bz2.compress(data) if packed.suffix == ".bz2" else gzip.compress(data), rng))


def spoil_store(path: Path, rng: Rng) -> bool:
    """Make rows or pages of a store wrong, or lay files beside it; return whether its rows may be fewer now."""
    kind = int(rng.integers(4))
    if kind == 0:
        path.write_bytes(spoil_bytes(path.read_bytes(), rng))
        return True
    if kind == 1:
        return _lie_beside(path, rng)
    tables = ("facts", "waypoints", "drawers", "keyframes", "saved")
    with suppress(sqlite3.Error, OverflowError, UnicodeEncodeError), closing(sqlite3.connect(path)) as store:
        for _ in range(int(rng.integers(1, 4))):
            table = str(rng.choice(tables))
            columns = [row[1] for row in store.execute(f"PRAGMA table_info({table})")]
            if not columns:  # dropped
                continue
            column = str(rng.choice(columns))
            value = _VALUES[int(rng.integers(len(_VALUES)))]
            row = int(rng.integers(0, 13))
            match int(rng.integers(8)):
                case 0:
                    store.execute(f"DELETE FROM {table} WHERE id = ?", (row,))
                case 1:
                    store.execute(f"INSERT INTO {table} SELECT * FROM {table} LIMIT 0")
                    store.execute(f"UPDATE {table} SET id = id + ?", (int(rng.choice([1, 100, 2**40])),))
                case 2:
                    store.execute(str(rng.choice(_STATEMENTS)))
                case _:
                    store.execute(f"UPDATE {table} SET {column} = ? WHERE id = ?", (value, row))
        store.commit()
    return True


_VALUES = (
    None,
    -1,
    0,
    2**62,
    float("inf"),
    1e308,
    "",
    "x",
    "nan",
    "\u0000",
    b"",
    b"\x00" * 40,
    b"\xff" * 8,
    "[]",
    "{}",
)
_STATEMENTS = (
    "DROP TABLE waypoints",
    "DROP TABLE saved",
    "ALTER TABLE facts ADD COLUMN more TEXT",
    "PRAGMA user_version = 99",
    "PRAGMA user_version = 0",
    "PRAGMA application_id = 1",
    "CREATE TABLE other (x)",
    "DELETE FROM facts",
    "CREATE VIEW v AS SELECT 1",
    "CREATE INDEX i ON waypoints (x)",
    "DELETE FROM drawers",
    "UPDATE saved SET layout = '{}'",
    "CREATE TRIGGER t AFTER INSERT ON waypoints BEGIN DELETE FROM waypoints; END",
    "PRAGMA journal_mode = DELETE",
    "UPDATE keyframes SET layout = replace(layout, '16', '99999999')",
    "UPDATE facts SET value = '[' || value",
)


def _lie_beside(path: Path, rng: Rng) -> bool:
    """Lay a journal, a log or their index beside a store: rubbish, a folder, or a copy of the store."""
    beside = path.with_name(path.name + str(rng.choice(["-wal", "-shm", "-journal", ".lock"])))
    match int(rng.integers(5)):
        case 0:
            beside.mkdir()
        case 1:
            beside.write_bytes(rng.bytes(int(rng.integers(0, 4000))))
        case 2:
            shutil.copyfile(path, beside)
        case 3:
            beside.symlink_to("/dev/null")
        case 4:
            beside.write_bytes(b"")
    return False
