"""A client's connection to a controller: negotiation of versions and recipes, then data packages."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Sequence

from bumpstop.errors import InputError
from bumpstop.live.rtde import messages
from bumpstop.live.rtde.fields import IN_USE, NOT_FOUND, ProtocolError, Recipe, Value

_CHUNK = 65536
# A controller that lost its power, or whose cable was pulled, says nothing any more: after a second of silence it is
# asked every second, and the connection ends where it does not know of it, or three times does not answer.
_KEEP_ALIVE = {"TCP_KEEPIDLE": 1, "TCP_KEEPINTVL": 1, "TCP_KEEPCNT": 3, "TCP_USER_TIMEOUT": 4000}


class LostConnectionError(Exception):
    """The connection ended; the text says how."""


class RtdeConnection:
    """One connection to a controller.

    Args:
        host, port: of the controller.
        timeout_s: for the connection, and for each answer of the negotiation [s].

    Attributes:
        where: host and port, for people.
        controller: version of its software, once negotiated.
        texts: what it has said for people while negotiating.
        received_s: ``time.monotonic()`` when the last bytes came [s].

    Raises:
        LostConnectionError: there is no such controller.
    """

    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        self.where = f"{host}:{port}"
        self._timeout = timeout_s
        self._packages = messages.PackageReader()
        self.controller: messages.ControllerVersion | None = None
        self.texts: list[messages.Text] = []
        self.received_s = time.monotonic()
        try:
            self._socket = socket.create_connection((host, port), timeout_s)
        except TimeoutError:
            raise LostConnectionError(f"no answer from {self.where} within {timeout_s:g} s") from None
        except OSError as error:
            raise LostConnectionError(f"cannot connect to {self.where}: {error.strerror or error}") from None
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in _KEEP_ALIVE.items():
            if hasattr(socket, option):  # some systems lack some
                self._socket.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)

    def close(self) -> None:
        """End; may be called twice."""
        self._socket.close()

    def negotiate(self, frequency_hz: float, outputs: dict[str, str], inputs: dict[str, str]) -> tuple[Recipe, Recipe]:
        """Agree on the version and on recipes, and start the data packages.

        Args:
            frequency_hz: of the data packages.
            outputs: fields to read, with the types they must have.
            inputs: fields to write, likewise.

        Returns:
            Recipes of outputs and inputs; that of inputs has number 0 where there are none.

        Raises:
            LostConnectionError: the controller went away, or does not answer.
            ProtocolError: it does not speak the protocol.
            InputError: it has not got a field, or will not start.
        """
        if not self._accepted(messages.RequestVersion(), "V"):
            problem = f"the controller at {self.where} does not accept version {messages.VERSION} of the protocol"
            raise InputError("rtde", problem, "wanted CB-Series from 3.2.19171, or e-Series")
        self._send(messages.RequestController())
        reply = self._answer()
        if not isinstance(reply, messages.ControllerVersion):
            raise ProtocolError(f"{type(reply).__name__} in answer to the question for the controller's version")
        self.controller = reply
        read = self._recipe(messages.SetupOutputs(frequency_hz, tuple(outputs)), "O", outputs)
        written = self._recipe(messages.SetupInputs(tuple(inputs)), "I", inputs) if inputs else Recipe(0, (), ())
        if not self._accepted(messages.Start(), "S"):
            raise InputError("rtde", f"the controller at {self.where} does not start the exchange")
        self.expect(read)
        return read, written

    def expect(self, outputs: Recipe) -> None:
        """Take data packages of this recipe and texts from now on, and nothing that is larger."""
        self._packages.largest = max(messages.MAX_TEXT_PACKAGE, messages.HEADER.size + 1 + outputs.size)

    def _accepted(self, request: messages.Request, what: str) -> bool:
        self._send(request)
        reply = self._answer()
        if not isinstance(reply, messages.Accepted) or reply.what != what:
            raise ProtocolError(f"{type(reply).__name__} in answer to '{what}'")
        return reply.accepted

    def _recipe(
        self, request: messages.SetupOutputs | messages.SetupInputs, what: str, wanted: dict[str, str]
    ) -> Recipe:
        self._send(request)
        reply = self._answer()
        if not isinstance(reply, messages.RecipeReply) or reply.what != what:
            raise ProtocolError(f"{type(reply).__name__} in answer to '{what}'")
        if len(reply.types) != len(wanted):
            raise ProtocolError(f"{len(reply.types)} types for {len(wanted)} fields")
        for (name, kind), found in zip(wanted.items(), reply.types, strict=True):
            version = "" if self.controller is None else f" {self.controller}"
            if found == NOT_FOUND:
                problem = f"the controller{version} at {self.where} has no field {name}"
                raise InputError("rtde", problem, "wanted newer controller software, or a detector of currents")
            if found == IN_USE:
                problem = f"another client of {self.where} writes {name}"
                raise InputError("rtde", problem, "end that client, or monitor without an answer")
            if found != kind:
                raise InputError("rtde", f"{name} at {self.where} is a {found[:20]}", f"wanted a {kind}")
        if not reply.number:
            raise InputError("rtde", f"the controller at {self.where} rejects the recipe {', '.join(wanted)}")
        return Recipe(reply.number, tuple(wanted), reply.types)

    def _answer(self) -> messages.Reply:
        """The next message that is an answer: texts are kept, and data of an exchange before this one are passed."""
        end = time.monotonic() + self._timeout
        while True:
            while (package := self._packages.take()) is not None:
                reply = messages.decode_reply(*package)
                if isinstance(reply, messages.Text):
                    self.texts.append(reply)
                elif not isinstance(reply, messages.Data):
                    return reply
            left = end - time.monotonic()
            if left <= 0:
                raise LostConnectionError(f"{self.where} is connected and does not answer within {self._timeout:g} s")
            self._packages.feed(self._receive(left))

    def _send(self, request: messages.Request) -> None:
        try:
            self._socket.settimeout(self._timeout)
            self._socket.sendall(messages.encode(request))
        except OSError as error:
            raise LostConnectionError(f"the connection to {self.where} broke: {error.strerror or error}") from None

    def send_inputs(self, recipe: Recipe, values: Sequence[Value]) -> None:
        """Write the fields of the recipe of inputs.

        Raises:
            LostConnectionError: the connection broke.
        """
        self._send(messages.Data(recipe.number, recipe.pack(values)))

    def pause(self) -> None:
        """Ask for no more data packages; what goes wrong does not matter any more."""
        try:
            self._send(messages.Pause())
        except LostConnectionError:
            return

    def package(self, timeout_s: float) -> tuple[int, bytes] | None:
        """Type and body of the next package; None: none is complete within the time [s].

        Raises:
            LostConnectionError: the connection ended.
            ProtocolError: the bytes are no packages. The connection is of no use any more.
        """
        found = self._packages.take()
        if found is None and (data := self._receive(timeout_s)):
            self.received_s = time.monotonic()
            self._packages.feed(data)
            found = self._packages.take()
        return found

    def _receive(self, timeout_s: float) -> bytes:
        """Bytes that came; empty: none within the time."""
        try:
            if not select.select([self._socket], [], [], max(0.0, timeout_s))[0]:
                return b""
            data = self._socket.recv(_CHUNK)
        except OSError as error:
            raise LostConnectionError(f"the connection to {self.where} broke: {error.strerror or error}") from None
        if not data:
            held = self._packages.held
            inside = f", {held} bytes into a package" if held else ""
            raise LostConnectionError(f"{self.where} closed the connection{inside}")
        return data
