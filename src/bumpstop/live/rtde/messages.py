"""Messages of the Real-Time Data Exchange, protocol version 2, as they travel both ways.

A package is a big-endian uint16 with its size, a byte with its type, and what the type holds. The same type byte means
one thing from the client and another from the controller: :func:`decode_request` reads the first, :func:`decode_reply`
the second. Both take a message exactly or not at all.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from bumpstop.live.rtde.fields import ProtocolError

PORT = 30004
VERSION = 2
HEADER = struct.Struct(">HB")
MAX_PACKAGE = 0xFFFF
# A message for people has two texts of up to 255 bytes, their lengths and a level.
MAX_TEXT_PACKAGE = HEADER.size + 2 * 256 + 1
# Text messages have a level: 0 exception, 1 error, 2 warning, 3 information.
LEVELS = ("exception", "error", "warning", "information")


@dataclass(frozen=True)
class RequestVersion:
    """The client asks for a version of the protocol."""

    version: int = VERSION


@dataclass(frozen=True)
class RequestController:
    """The client asks for the version of the controller."""


@dataclass(frozen=True)
class SetupOutputs:
    """The client asks for fields of the controller, so many times a second [Hz]."""

    frequency_hz: float
    names: tuple[str, ...]


@dataclass(frozen=True)
class SetupInputs:
    """The client says which fields it will write."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class Start:
    """The client asks for data packages."""


@dataclass(frozen=True)
class Pause:
    """The client asks for no more data packages."""


@dataclass(frozen=True)
class Data:
    """A data package of either side: the number of its recipe, and the bytes of its values."""

    recipe: int
    values: bytes


@dataclass(frozen=True)
class Text:
    """A message for people, of either side."""

    text: str
    source: str = ""
    level: int = 3


@dataclass(frozen=True)
class Accepted:
    """The controller accepts a version (``"V"``), a start (``"S"``) or a pause (``"P"``), or does not."""

    what: str
    accepted: bool


@dataclass(frozen=True)
class ControllerVersion:
    """Of the controller's software."""

    major: int
    minor: int
    bugfix: int
    build: int

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}.{self.bugfix}.{self.build}"


@dataclass(frozen=True)
class RecipeReply:
    """The controller's answer to a setup of outputs (``"O"``) or inputs (``"I"``): number and types, one a field."""

    what: str
    number: int
    types: tuple[str, ...]


Request = RequestVersion | RequestController | SetupOutputs | SetupInputs | Start | Pause | Data | Text
Reply = Accepted | ControllerVersion | RecipeReply | Data | Text


def encode(message: Request | Reply) -> bytes:
    """A message as a package.

    Raises:
        ProtocolError: it does not fit a package.
    """
    kind, body = _body(message)
    size = HEADER.size + len(body)
    if size > MAX_PACKAGE:
        raise ProtocolError(f"a package of {size} bytes is larger than {MAX_PACKAGE}")
    return HEADER.pack(size, ord(kind)) + body


def _body(message: Request | Reply) -> tuple[str, bytes]:
    match message:
        case RequestVersion(version):
            return "V", struct.pack(">H", version)
        case RequestController():
            return "v", b""
        case SetupOutputs(frequency, names):
            return "O", struct.pack(">d", frequency) + _ascii(",".join(names))
        case SetupInputs(names):
            return "I", _ascii(",".join(names))
        case Start():
            return "S", b""
        case Pause():
            return "P", b""
        case Data(recipe, values):
            return "U", bytes([recipe]) + values
        case Text(text, source, level):
            parts = [part.encode("utf-8")[:255] for part in (text, source)]
            return "M", b"".join(bytes([len(part)]) + part for part in parts) + bytes([level])
        case Accepted(what, accepted):
            return what, bytes([accepted])
        case ControllerVersion(major, minor, bugfix, build):
            return "v", struct.pack(">4I", major, minor, bugfix, build)
        case RecipeReply(what, number, types):
            return what, bytes([number]) + _ascii(",".join(types))


def decode_request(kind: int, body: bytes) -> Request:
    """What a client sent.

    Raises:
        ProtocolError: it is no message of a client.
    """
    match chr(kind):
        case "V":
            return RequestVersion(int.from_bytes(_exactly(body, 2, "V"), "big"))
        case "v":
            _exactly(body, 0, "v")
            return RequestController()
        case "O":
            if len(body) < 8:
                raise ProtocolError(f"'O' has {len(body)} bytes, wanted at least 8")
            (frequency,) = struct.unpack(">d", body[:8])
            if not (math.isfinite(frequency) and frequency > 0):
                raise ProtocolError(f"'O' asks for a frequency of {frequency} Hz")
            return SetupOutputs(frequency, _names(body[8:], "O"))
        case "I":
            return SetupInputs(_names(body, "I"))
        case "S":
            _exactly(body, 0, "S")
            return Start()
        case "P":
            _exactly(body, 0, "P")
            return Pause()
        case "U":
            return _data(body)
        case "M":
            return _text(body)
    raise ProtocolError(f"a message of the unknown type {kind}")


def decode_reply(kind: int, body: bytes) -> Reply:
    """What a controller sent.

    Raises:
        ProtocolError: it is no message of a controller.
    """
    match chr(kind):
        case "V" | "S" | "P" as what:
            return Accepted(what, _exactly(body, 1, what) != b"\0")
        case "v":
            return ControllerVersion(*struct.unpack(">4I", _exactly(body, 16, "v")))
        case "O" | "I" as what:
            if not body:
                raise ProtocolError(f"'{what}' is empty")
            return RecipeReply(what, body[0], _names(body[1:], what))
        case "U":
            return _data(body)
        case "M":
            return _text(body)
    raise ProtocolError(f"a message of the unknown type {kind}")


def _exactly(body: bytes, size: int, what: str) -> bytes:
    if len(body) != size:
        raise ProtocolError(f"'{what}' has {len(body)} bytes, wanted {size}")
    return body


def _ascii(text: str) -> bytes:
    try:
        return text.encode("ascii")
    except UnicodeEncodeError:
        raise ProtocolError(f"{text[:40]!r} is not ASCII") from None


def _names(body: bytes, what: str) -> tuple[str, ...]:
    try:
        text = body.decode("ascii")
    except UnicodeDecodeError:
        raise ProtocolError(f"'{what}' has names that are not ASCII") from None
    names = tuple(name.strip() for name in text.split(",")) if text else ()
    if not all(name.isprintable() and name for name in names):
        raise ProtocolError(f"'{what}' has a name that is none")
    return names


def _data(body: bytes) -> Data:
    if not body:
        raise ProtocolError("'U' is empty")
    return Data(body[0], body[1:])


def _text(body: bytes) -> Text:
    parts, at = [], 0
    for _ in range(2):
        if at >= len(body) or at + 1 + body[at] > len(body):
            raise ProtocolError("'M' ends inside a text")
        # A controller's words may be in any encoding; nothing but people reads them.
        parts.append(body[at + 1 : at + 1 + body[at]].decode("utf-8", errors="replace"))
        at += 1 + body[at]
    if at + 1 != len(body):
        raise ProtocolError(f"'M' has {len(body)} bytes, wanted {at + 1}")
    return Text(parts[0], parts[1], body[at])


class PackageReader:
    """Cuts a stream of bytes into packages; holds one package and what was fed last at most.

    After a :class:`~bumpstop.live.rtde.fields.ProtocolError` the stream has no beginning any more: close it.

    Attributes:
        largest: bytes that a package may have.
    """

    def __init__(self) -> None:
        self._held = bytearray()
        self.largest = MAX_PACKAGE

    @property
    def held(self) -> int:
        """Bytes of packages that were not taken yet."""
        return len(self._held)

    def feed(self, data: bytes) -> None:
        """Add bytes as they came."""
        self._held += data

    def take(self) -> tuple[int, bytes] | None:
        """Type and body of the next package; None: it is not complete.

        Raises:
            ProtocolError: a size that is none.
        """
        if len(self._held) < HEADER.size:
            return None
        size, kind = HEADER.unpack_from(self._held)
        if size < HEADER.size:
            raise ProtocolError(f"a package says it has {size} bytes, a header alone has {HEADER.size}")
        if size > self.largest:
            raise ProtocolError(f"a package says it has {size} bytes, none has more than {self.largest}")
        if len(self._held) < size:
            return None
        body = bytes(self._held[HEADER.size : size])
        del self._held[:size]
        return kind, body
