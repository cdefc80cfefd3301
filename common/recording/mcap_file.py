"""The only file that imports MCAP: writes a recording, and reads one back, also one that a crash cut short.

A message is kept byte for byte as it was on the wire, on a channel of its key with the encoding ``msgpack``: log time
is its receipt, publish time its source's stamp.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal

from common.errors import ConfigError

try:
    import zstandard
    from mcap.exceptions import McapError
    from mcap.records import Channel as McapChannel
    from mcap.records import Message as McapMessage
    from mcap.records import Metadata
    from mcap.stream_reader import StreamReader
    from mcap.writer import CompressionType, Writer
except ModuleNotFoundError as error:
    raise ConfigError(f"recordings need {error.name}: pip install 'davpc[record]'") from error

PROFILE, LIBRARY = "davpc", "davpc"
_CHUNK_BYTES = 256 * 1024
_UNREADABLE = (McapError, struct.error, ValueError, EOFError, zstandard.ZstdError)
Encoding = Literal["msgpack", "json", "protobuf", "raw"]


@dataclass(frozen=True)
class Schema:
    """How a viewer reads the messages of a channel: ``jsonschema`` text or a ``protobuf`` descriptor set."""

    name: str
    encoding: Literal["jsonschema", "protobuf"]
    data: bytes


class RunWriter:
    """Writes one MCAP file; what was written before the last :meth:`flush` survives a crash. Not thread-safe.

    Args:
        stream: a new file.
        compressed: whether its chunks are compressed; not for pictures, which are already.
    """

    def __init__(self, stream: IO[bytes], *, compressed: bool = True) -> None:
        kind = CompressionType.ZSTD if compressed else CompressionType.NONE
        self._writer = Writer(stream, chunk_size=_CHUNK_BYTES, compression=kind)
        self._writer.start(PROFILE, LIBRARY)
        self._stream = stream
        self._channels: dict[str, int] = {}
        self._sequences: dict[str, int] = {}

    @property
    def size_bytes(self) -> int:
        """Bytes in the file so far."""
        return self._stream.tell()

    def declare(
        self, topic: str, encoding: Encoding, schema: Schema | None = None, about: Mapping[str, str] | None = None
    ) -> None:
        """Declare a channel before its first message; does nothing if it is known.

        Args:
            topic: its name.
            encoding: of its messages.
            schema: of its messages, if viewers can read them.
            about: what else is known of it.
        """
        if topic in self._channels:
            return
        number = 0
        if schema is not None:
            number = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        self._channels[topic] = self._writer.register_channel(topic, encoding, number, dict(about or {}))

    def known(self, topic: str) -> bool:
        """Whether the channel is declared."""
        return topic in self._channels

    def add(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        """Append a message to a declared channel.

        Args:
            topic: of the channel.
            data: the message.
            log_ns: time of receipt.
            publish_ns: time of publication by its source.
        """
        sequence = self._sequences.get(topic, 0)
        self._sequences[topic] = (sequence + 1) % 2**32
        self._writer.add_message(self._channels[topic], log_ns, data, publish_ns, sequence)

    def note(self, name: str, content: Mapping[str, str]) -> None:
        """Add a metadata record."""
        self._writer.add_metadata(name, dict(content))

    def flush(self) -> None:
        """End the chunk and hand everything to the operating system."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Write the index and the summary; the stream stays open."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.flush()


@dataclass(frozen=True)
class Recorded:
    """One message of a recording; ``data`` are its bytes."""

    topic: str
    data: bytes
    log_ns: int
    publish_ns: int


@dataclass(frozen=True)
class Note:
    """One metadata record."""

    name: str
    content: dict[str, str]


@dataclass(frozen=True)
class TornEnd:
    """The file ends here, too early; ``reason`` is one line."""

    reason: str


def read_file(path: Path) -> Iterator[Recorded | Note | TornEnd]:
    """What a recording holds, in the order of the file; a file cut short or damaged gives all before the fault.

    Raises:
        ConfigError: there is no such file, or it is no MCAP file.
    """
    try:
        file = path.open("rb")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    topics: dict[int, str] = {}
    with file:
        if file.read(5) != b"\x89MCAP":
            raise ConfigError(f"{path}: not an MCAP file")
        file.seek(0)
        records = iter(StreamReader(file, validate_crcs=True).records)
        while True:
            try:
                record: Any = next(records, None)
            except _UNREADABLE as error:
                yield TornEnd(f"{type(error).__name__} {error}".strip()[:200])
                return
            match record:
                case None:
                    return
                case McapChannel():
                    topics[record.id] = record.topic
                case McapMessage():
                    topic = topics.get(record.channel_id, "")
                    yield Recorded(topic, record.data, record.log_time, record.publish_time)
                case Metadata():
                    yield Note(record.name, dict(record.metadata))
                case _:
                    pass
