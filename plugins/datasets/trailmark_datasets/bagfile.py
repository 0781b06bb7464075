"""One recording of ROS, opened with rosbags; the only place that touches that library."""

from __future__ import annotations

import heapq
import struct
import traceback
from collections.abc import Collection, Generator, Iterator, Mapping
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.interfaces import MessageDefinition
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import ReaderError
from rosbags.rosbag1.reader import Header, IndexData, RecordType, read_bytes, read_uint32
from rosbags.typesys import Stores, get_typestore

from trailmark.errors import SourceError
from trailmark.values import quick_dataclass
from trailmark_datasets.ros1_decoding import DECODERS

__all__ = ["BagFile", "Message", "open_bag"]


# Their words are about the inside of the library, and tell nobody what is wrong with the recording.
_SPEAK_OF_PYTHON = (struct.error, LookupError, TypeError, AttributeError, AssertionError, RecursionError, OverflowError)

_TIME = struct.Struct("<II")
_TIME_FIELD = b"\x0d\x00\x00\x00time="

_MOST_WORDS = 200  # letters: some errors quote whole message definitions


@quick_dataclass(frozen=True, slots=True)
class Message:
    """A message of a recording.

    Attributes
    ----------
    topic : str
        Where it was sent.
    where : str
        Recording, topic and number, for errors.
    receive_s : float
        When it was recorded [s].
    content : object
        The message.
    """

    topic: str
    where: str
    receive_s: float
    content: Any


class _Ros1Reader(Ros1Reader):
    """Reads an index record by its count of entries, as ROS does.

    rosbags checks the record's length too and refuses the recording if it differs; old writers left it at another
    value. It also expects the fields of the head in the order of the first record (ROS bag format 2.0, op 4). And the
    message ``Header`` was once defined in the package roslib.
    """

    def open(self) -> None:
        super().open()
        self.connections = [c._replace(msgdef=_with_known_header(c.msgdef)) for c in self.connections]

    def read_index_data(self, pos: int, indexes: dict[int, list[Any]]) -> None:
        file = self.bio
        if file is None:
            raise ReaderError("the recording is not open")
        (n_head,) = struct.unpack("<I", file.read(4))
        fields = dict(_fields_of(file.read(n_head)))
        if fields.get(b"op") != b"\x04" or fields.get(b"ver") != b"\x01\x00\x00\x00":
            raise ReaderError(f"no index record of version 1 behind the chunk at byte {pos}")
        (connection,), (count,) = (struct.unpack("<I", fields[name]) for name in (b"conn", b"count"))
        file.read(4)  # the length
        entries = np.frombuffer(file.read(12 * count), "<u4").reshape(count, 3).tolist()
        indexes[connection].extend(IndexData(sec * 10**9 + nanosec, pos, offset) for sec, nanosec, offset in entries)

    def messages(
        self, connections: Collection[Any] = (), start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Any, int, bytes], None, None]:
        """Yield connection, time [ns] and bytes of the messages, as rosbags does, which reads each head anew."""
        if start is not None or stop is not None or self.bio is None:
            yield from super().messages(connections, start, stop)
            return
        heads = _KnownHeads({connection.id: connection for connection in self.connections})
        chunk_pos, chunk = -1, b""
        for time_ns, pos, offset in heapq.merge(*(self.indexes[one.id] for one in connections or self.connections)):
            if pos != chunk_pos:
                where = self.chunks[pos]
                self.bio.seek(where.datapos)
                chunk_pos, chunk = pos, where.decompressor(read_bytes(self.bio, where.datasize))
            yield heads.read(chunk, offset, time_ns)


class _KnownHeads:
    """The heads of message records, which differ by their time alone: each is parsed once.

    Parameters
    ----------
    connections : mapping of int to Connection
        By number, as heads name them.
    """

    def __init__(self, connections: Mapping[int, Any]) -> None:
        self._connections = connections
        self._known: dict[bytes, Any] = {}  # what stands around the time -> connection
        self._time_at = 0

    def read(self, chunk: bytes, offset: int, time_ns: int) -> tuple[Any, int, bytes]:
        """Return connection, time [ns] and bytes of the message at a place of a chunk."""
        begin = offset + self._time_at
        length_at = offset + 4 + int.from_bytes(chunk[offset : offset + 4], "little")
        connection = self._known.get(chunk[offset:begin] + chunk[begin + 8 : length_at])
        if connection is not None and chunk[begin : begin + 8] == _TIME.pack(*divmod(time_ns, 10**9)):
            data_at = length_at + 4
            end = data_at + int.from_bytes(chunk[length_at:data_at], "little")
            data = chunk[data_at:end]
            if end <= len(chunk):
                return connection, time_ns, data
        return self._parsed(chunk, offset, time_ns)

    def _parsed(self, chunk: bytes, offset: int, time_ns: int) -> tuple[Any, int, bytes]:
        """Return the same of a message whose head is not known yet, by the steps of rosbags."""
        file = BytesIO(chunk)
        file.seek(offset)
        begin, head = offset, Header.read(file)
        while head.get_uint8("op") == RecordType.CONNECTION:
            file.seek(read_uint32(file), 1)
            begin, head = file.tell(), Header.read(file)
        if head.get_uint8("op") != RecordType.MSGDATA:
            raise ReaderError("where a message should be, there is none")
        end, connection = file.tell(), self._connections[head.get_uint32("conn")]
        assert head.get_time("time") == time_ns
        found_at = chunk.find(_TIME_FIELD, begin, end)
        time_at = found_at + len(_TIME_FIELD)
        if not self._known:
            self._time_at = time_at - begin
        if found_at >= 0 and time_at - begin == self._time_at:
            self._known[chunk[begin:time_at] + chunk[time_at + 8 : end]] = connection
        return connection, time_ns, read_bytes(file, read_uint32(file))


def _with_known_header(definition: MessageDefinition) -> MessageDefinition:
    return definition._replace(data=definition.data.replace("roslib/Header", "std_msgs/Header"))


def _fields_of(head: bytes) -> Iterator[tuple[bytes, bytes]]:
    start = 0
    while start < len(head):
        (length,) = struct.unpack_from("<I", head, start)
        name, _, value = head[start + 4 : start + 4 + length].partition(b"=")
        yield name, value
        start += 4 + length


class BagFile:
    """An open recording.

    Attributes
    ----------
    path : Path
        The file or folder.
    topics : mapping of str to str
        Topics that hold messages, and their types as ROS 2 writes them.
    rates_hz : mapping of str to float
        Mean rate of the topics that hold several [Hz].
    duration_s : float
        From the first message to the last [s].
    """

    def __init__(self, path: Path, reader: AnyReader) -> None:
        self.path = path
        self._reader = reader
        counts: dict[str, int] = {}
        topics: dict[str, str] = {}
        for connection in reader.connections:
            if connection.msgcount:
                topics[connection.topic] = connection.msgtype
                counts[connection.topic] = counts.get(connection.topic, 0) + connection.msgcount
        self.duration_s = duration_s = reader.duration / 1e9 if topics else 0.0
        self.topics: Mapping[str, str] = topics
        self.rates_hz: Mapping[str, float] = {
            topic: (count - 1) / duration_s for topic, count in counts.items() if count > 1 and duration_s > 0
        }

    def messages(self, topics: Collection[str]) -> Iterator[Message | SourceError]:
        """Yield the messages of topics as they were recorded; one that cannot be decoded, as the error.

        Raises
        ------
        SourceError
            If the recording is damaged.
        """
        connections = [connection for connection in self._reader.connections if connection.topic in topics]
        numbers, prefix = dict.fromkeys(topics, -1), f"{self.path}: message "
        for connection, receive_ns, raw in self._raw(connections):
            topic = connection.topic
            numbers[topic] += 1
            where = f"{prefix}{numbers[topic]} of {topic}"
            try:
                content = self._decoded(connection, raw)
            except Exception as error:  # whatever damaged bytes may cause in there
                yield SourceError(f"{where} cannot be decoded: {_words_of(error)}")
            else:
                yield Message(topic, where, receive_ns / 1e9, content)

    def _decoded(self, connection: Any, raw: bytes) -> Any:
        decoder = None if self._reader.is2 else DECODERS.get(connection.digest)
        if decoder is not None:
            with suppress(struct.error, UnicodeDecodeError):  # rosbags says what is wrong
                if (content := decoder(raw)) is not None:
                    return content
        return self._reader.deserialize(raw, connection.msgtype)

    def _raw(self, connections: list[Any]) -> Iterator[tuple[Any, int, bytes]]:
        messages = iter(self._reader.messages(connections)) if connections else iter(())
        while True:
            try:
                item = next(messages, None)
            except Exception as error:
                raise SourceError(f"{self.path} is damaged: {_words_of(error)}") from error
            if item is None:
                return
            yield item


@contextmanager
def open_bag(path: Path, distribution: str) -> Iterator[BagFile]:
    """Open a ``.bag`` file (or a folder of them), a folder of a ROS 2 recording, or an ``.mcap`` or ``.db3`` file.

    Parameters
    ----------
    path : Path
        The recording.
    distribution : str
        Whose message definitions to take where the recording brings none, for example ``"ros2_humble"``.

    Raises
    ------
    SourceError
        If it cannot be opened.
    """
    _refuse_pipes(path)
    parts = sorted(path.glob("*.bag")) if path.is_dir() and not (path / "metadata.yaml").exists() else []
    try:
        reader = AnyReader(parts or [path], default_typestore=get_typestore(Stores(distribution)))
        if all(isinstance(part, Ros1Reader) for part in reader.readers):
            reader.readers = [_Ros1Reader(part.path) for part in reader.readers]
        reader.open()
        bag = BagFile(path, reader)
    except Exception as error:  # rosbags lets errors of zip, SQLite, YAML and struct through
        raise SourceError(f"{path}: cannot open the recording: {_words_of(error)}{_remedy(path)}") from error
    try:
        yield bag
    finally:
        reader.close()


def _remedy(path: Path) -> str:
    """Return what helps with a bag of ROS 1 whose index is not there, as a recorder leaves it that was cut off."""
    if not path.is_file():
        return ""
    with path.open("rb") as file:
        head = file.read(4096)
    _, found, index_pos = head.partition(b"index_pos=")
    is_whole = 0 < int.from_bytes(index_pos[:8], "little") < path.stat().st_size
    if not head.startswith(b"#ROSBAG V2.0") or not found or is_whole:
        return ""
    return "; was the recorder cut off? `rosbag reindex` makes its index anew"


def _refuse_pipes(path: Path) -> None:
    """Refuse pipes and devices: opening one blocks, or reading it does not end."""
    for entry in (path, *(path.iterdir() if path.is_dir() else ())):
        if entry.exists() and not (entry.is_file() or entry.is_dir()):
            raise SourceError(f"{path}: cannot open the recording: {entry} is a device or a pipe")


def _words_of(error: BaseException) -> str:
    """Return the message of an error in a line; where it has none of use, the place where it was raised."""
    if any(isinstance(one, UnicodeDecodeError) for one in (error, *_behind(error))):  # rosbags quotes it
        return "a text in it is not UTF-8"
    if isinstance(error, MemoryError):
        return "a length in it is larger than the memory"
    for inner in _behind(error):  # rosbags quotes them
        if isinstance(inner, OSError) and inner.strerror:
            return f"{str(error).partition(':')[0]}: {inner.strerror}"
        if isinstance(inner, _SPEAK_OF_PYTHON) and str(error):
            what = str(error).partition(":")[0].replace(repr(inner), "").rstrip(" .")
            return f"{what}: it lacks {inner}" if isinstance(inner, KeyError) else f"{what}: its structure is wrong"
    if str(error) and not isinstance(error, _SPEAK_OF_PYTHON):
        first = str(error).partition("\n")[0]
        return first if len(first) < _MOST_WORDS else f"{first[:_MOST_WORDS]} ..."
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"its structure is wrong ({last.name} of {Path(last.filename).name} could not go on)"


def _behind(error: BaseException) -> Iterator[BaseException]:
    """Yield the errors that an error was raised because of."""
    inner = error.__cause__ or error.__context__
    while inner is not None:
        yield inner
        inner = inner.__cause__ or inner.__context__
