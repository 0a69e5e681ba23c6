"""A controller's side of the Real-Time Data Exchange, for the test bench: it serves whatever it is given."""

from __future__ import annotations

import select
import socket
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

from bumpstop.errors import InputError
from bumpstop.live.rtde import messages
from bumpstop.live.rtde.fields import IN_USE, NOT_FOUND, ProtocolError, Recipe, Value

# What the server says it is: the first software with `actual_current_as_torque`.
CONTROLLER = messages.ControllerVersion(5, 23, 0, 0)
INPUT_FIELDS = {f"input_int_register_{number}": "INT32" for number in range(48)} | {
    f"input_double_register_{number}": "DOUBLE" for number in range(48)
}
_MAX_CLIENTS = 8
_MAX_RECIPES = 255
# Bytes a client may leave unread before packages are left out, as a controller leaves them out.
_MAX_UNREAD = 262144
_POLL_S = 0.05


@dataclass(eq=False)
class _Client:
    """One connection: what it has asked for, and what could not be sent yet."""

    socket: socket.socket
    packages: messages.PackageReader = field(default_factory=messages.PackageReader)
    outputs: Recipe | None = None
    every: int = 1
    inputs: dict[int, Recipe] = field(default_factory=dict)
    recipes: int = 0
    started: bool = False
    unsent: bytearray = field(default_factory=bytearray)


class RtdeServer:
    """Serves fields to clients, and takes what they write.

    Args:
        fields: that clients may read, with their types.
        rate_hz: how often :meth:`publish` will be called; a client that wants less gets every second, third, ...
        host, port: where to listen; port 0: any that is free.

    Raises:
        InputError: the port cannot be had.

    Attributes:
        port: where it listens.
        left_out: data packages that were not sent, as their client did not read.
    """

    def __init__(
        self, fields: Mapping[str, str], rate_hz: float, host: str = "127.0.0.1", port: int = messages.PORT
    ) -> None:
        self._fields, self._rate = dict(fields), rate_hz
        self._clients: list[_Client] = []
        self._lock = threading.RLock()
        self._started = threading.Event()
        self._inputs: dict[str, Value] = dict.fromkeys(INPUT_FIELDS, 0)
        self._written_s = 0.0
        self._count = 0
        self.left_out = 0
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listener.bind((host, port))
            self._listener.listen(_MAX_CLIENTS)
        except (OSError, OverflowError) as error:
            self._listener.close()
            said = error.strerror if isinstance(error, OSError) else "no port has that number"
            raise InputError("--rtde", f"cannot listen on {host}:{port} ({said})", "give another port") from None
        self.port = int(self._listener.getsockname()[1])
        self._closing = False
        self._thread = threading.Thread(target=self._serve, name="rtde", daemon=True)
        self._thread.start()

    # --- What the robot says and asks ---------------------------------------------------------------------------

    def wait_for_client(self, timeout_s: float) -> bool:
        """Whether a client has started the exchange within the time [s]."""
        return self._started.wait(timeout_s)

    def publish(self, values: Mapping[str, Value]) -> None:
        """Send a sample to every client that has started the exchange.

        Args:
            values: of all fields.
        """
        with self._lock:
            for client in list(self._clients):
                if not client.started or client.outputs is None or self._count % client.every:
                    continue
                if len(client.unsent) > _MAX_UNREAD:
                    self.left_out += 1
                    continue
                body = client.outputs.pack([values[name] for name in client.outputs.names])
                self._send(client, messages.Data(client.outputs.number, body))
            self._count += 1

    def inputs(self) -> tuple[dict[str, Value], float]:
        """What clients wrote last, by field, and ``time.monotonic()`` of the last writing; 0 before."""
        with self._lock:
            # What has come must not wait until the thread gets its turn.
            for client in list(self._clients):
                self._read(client)
            return dict(self._inputs), self._written_s

    def close(self) -> None:
        """End all connections; may be called twice."""
        self._closing = True
        self._thread.join()
        with self._lock:
            for client in list(self._clients):
                self._drop(client)
        self._listener.close()

    # --- Clients ------------------------------------------------------------------------------------------------

    def _serve(self) -> None:
        while not self._closing:
            with self._lock:
                clients = {client.socket: client for client in self._clients}
                waiting = [client.socket for client in self._clients if client.unsent]
            try:
                ready, free, _ = select.select([self._listener, *clients], waiting, [], _POLL_S)
            except (OSError, ValueError):
                continue  # a client was dropped meanwhile
            for one in ready:
                if one is self._listener:
                    self._accept()
                else:
                    self._read(clients[one])
            with self._lock:
                for one in free:
                    self._flush(clients[one])

    def _accept(self) -> None:
        try:
            found, _ = self._listener.accept()
        except OSError:
            return
        found.setblocking(False)
        found.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        found.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _MAX_UNREAD)
        with self._lock:
            client = _Client(found)
            self._clients.append(client)
            if len(self._clients) > _MAX_CLIENTS:
                self._send(client, messages.Text("too many clients", "rtde", 1))
                self._drop(client)

    def _read(self, client: _Client) -> None:
        with self._lock:
            if client not in self._clients:
                return
            try:
                data = client.socket.recv(65536)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self._drop(client)
                return
            client.packages.feed(data)
            try:
                while (package := client.packages.take()) is not None:
                    self._handle(client, messages.decode_request(*package))
            except ProtocolError as error:
                self._send(client, messages.Text(str(error), "rtde", 1))
                self._drop(client)

    def _handle(self, client: _Client, request: messages.Request) -> None:
        match request:
            case messages.RequestVersion(version):
                self._send(client, messages.Accepted("V", version == messages.VERSION))
            case messages.RequestController():
                self._send(client, CONTROLLER)
            case messages.SetupOutputs(frequency, names):
                self._setup_outputs(client, frequency, names)
            case messages.SetupInputs(names):
                self._setup_inputs(client, names)
            case messages.Start():
                client.started = client.outputs is not None
                self._send(client, messages.Accepted("S", client.started))
                if client.started:
                    self._started.set()
            case messages.Pause():
                client.started = False
                self._send(client, messages.Accepted("P", True))
            case messages.Data(number, values):
                if number not in client.inputs:
                    raise ProtocolError(f"recipe {number} of inputs was not set up")
                self._inputs |= client.inputs[number].unpack(values)
                self._written_s = time.monotonic()
            case messages.Text():
                pass  # words of a client: there is nobody here to read them

    def _setup_outputs(self, client: _Client, frequency_hz: float, names: tuple[str, ...]) -> None:
        types = tuple(self._fields.get(name, NOT_FOUND) for name in names)
        number = 0
        if names and NOT_FOUND not in types:
            number = self._number(client)
            client.outputs = Recipe(number, names, types)
            client.every = max(1, round(self._rate / frequency_hz))
        self._send(client, messages.RecipeReply("O", number, types))

    def _setup_inputs(self, client: _Client, names: tuple[str, ...]) -> None:
        others = [recipe for one in self._clients if one is not client for recipe in one.inputs.values()]
        taken = {name for recipe in others for name in recipe.names}
        types = tuple(IN_USE if name in taken else INPUT_FIELDS.get(name, NOT_FOUND) for name in names)
        number = 0
        if names and not {NOT_FOUND, IN_USE} & set(types):
            number = self._number(client)
            client.inputs[number] = Recipe(number, names, types)
        self._send(client, messages.RecipeReply("I", number, types))

    def _number(self, client: _Client) -> int:
        if client.recipes >= _MAX_RECIPES:
            raise ProtocolError(f"more than {_MAX_RECIPES} recipes")
        client.recipes += 1
        return client.recipes

    def _send(self, client: _Client, reply: messages.Reply) -> None:
        client.unsent += messages.encode(reply)
        self._flush(client)

    def _flush(self, client: _Client) -> None:
        try:
            while client.unsent:
                del client.unsent[: client.socket.send(client.unsent)]
        except BlockingIOError:
            return
        except OSError:
            self._drop(client)

    def _drop(self, client: _Client) -> None:
        client.socket.close()
        client.unsent.clear()
        client.started = False
        if client in self._clients:
            self._clients.remove(client)
