"""The server of the pages: on loopback, for pages of its own alone, with one state for every browser."""

from __future__ import annotations

import asyncio
import errno
import gc
import http
import ipaddress
import os
import socket
import threading
import warnings
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache, partial
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from bumpstop.errors import InputError
from bumpstop.view.answer import Answer
from bumpstop.view.freed_memory import trim_freed_memory
from bumpstop.view.latest import LatestWins
from bumpstop.view.page.front import with_first_result
from bumpstop.view.page.page import Page

if TYPE_CHECKING:
    import viser

    from bumpstop.view.opened import Opened

LOOPBACK = "127.0.0.1"
_LOOPBACK_NAME = "localhost"
_MAX_PORT = 65_535
# So many ports are tried, as by viser.
_PORTS = 1000
# How long what is being computed may take to end.
_WAIT_S = 20.0
# How long a page waits for the first result, which most scenarios have in a tenth of it.
_FIRST_S = 0.5
# What is left of a closed page is given back so long after it: viser still tells of its end, and others may close, too.
_REST_S, _LOOK_S = 1.0, 0.1
_STARTING = threading.Lock()


class ViewServer:
    """Serves an opened scenario to any number of browsers, each with a page and a state of its own.

    Attributes:
        pages: of the browsers that are connected, by the number of the connection.
    """

    def __init__(self, opened: Opened, *, host: str = LOOPBACK, port: int = 0) -> None:
        if not 0 <= port <= _MAX_PORT:
            raise InputError("--port", f"{port} is no port", f"wanted 0 (any that is free) to {_MAX_PORT}")
        viser = viser_module()
        port = free_port(host, port)
        self.pages: dict[int, Page] = {}
        # Closed pages, as long as something of them is computed.
        self._ended: list[Page] = []
        self._freeing: LatestWins[None] = LatestWins(self._free, "bumpstop-view-free")
        self._lock = threading.Lock()
        self._opened = opened
        # While the browser starts: what its page is sent with, and what every page begins with.
        self._computer = ThreadPoolExecutor(1, "bumpstop-view-first")
        self._first = self._computer.submit(_first_answer, opened)
        # A page that closes while it is drawn is no fault.
        warnings.filterwarnings("ignore", "Queued a .* on a closed connection", UserWarning)
        with _guarded(host, self._sent), _silent():
            self._server = viser.ViserServer(host=host, port=port, verbose=False)
        self._host = host
        self._server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        # Shadows and an environment to mirror cost seconds where the processor draws, and show nothing of a collision.
        self._server.scene.configure_environment_map(None)
        self._server.scene.configure_default_lights(cast_shadow=False)
        self._server.on_client_connect(self._connect)
        self._server.on_client_disconnect(self._disconnect)

    @property
    def url(self) -> str:
        """Where the page is."""
        host = f"[{self._host}]" if ":" in self._host else self._host
        return f"http://{host}:{self._server.get_port()}"

    def stop(self) -> None:
        """Close every page, and the server."""
        with self._lock:
            pages, self.pages = [*self.pages.values(), *self._ended], {}
        self._freeing.close()
        for page in pages:
            page.close()
        # A thread that still computes must not outlive the interpreter.
        for page in pages:
            page.wait(_WAIT_S)
        self._computer.shutdown()
        with _silent():
            self._server.stop()

    async def _sent(self, page: bytes) -> bytes:
        """The page as it is sent."""
        await asyncio.wait([asyncio.wrap_future(self._first)], timeout=_FIRST_S)
        return with_first_result(page, self._opened.title, self._first.result() if self._first.done() else None)

    def _connect(self, client: viser.ClientHandle) -> None:
        wake_in_its_loop(client)
        page = Page(client, self._opened, self._first.result())
        with self._lock:
            # A browser may be gone before its page is built.
            if client.client_id in self._server.get_clients():
                self.pages[client.client_id] = page
                return
            self._end(page)

    def _disconnect(self, client: viser.ClientHandle) -> None:
        with self._lock:
            page = self.pages.pop(client.client_id, None)
            if page is not None:
                self._end(page)

    def _end(self, page: Page) -> None:
        page.close()
        self._ended.append(page)
        self._freeing.submit(None)

    def _free(self, _: None) -> None:
        """Give back what closed pages have, when nothing of them is computed any more."""
        computing, wait = True, _REST_S
        while computing:
            if self._freeing.newer_within(wait):
                return
            with self._lock:
                self._ended = [page for page in self._ended if page.computing]
                computing, wait = bool(self._ended), _LOOK_S
        # Panels, viser and a page know each other. By itself Python looks for such circles after many more pages.
        gc.collect()
        trim_freed_memory()


def wake_in_its_loop(client: Any) -> None:
    """Have what sends to a browser be woken in its own thread alone.

    viser 1.1 wakes it in the thread that draws, too, and asyncio's events are not made for that: now and then one
    raises there, and the rest of a drawing is lost.
    """
    with suppress(AttributeError):  # another viser, which need not do so
        event = client._websock_connection.get_message_buffer().message_event
        wake = event.set

        def wake_here() -> None:
            with suppress(RuntimeError):  # no loop runs in this thread
                asyncio.get_running_loop()
                wake()

        event.set = wake_here


def _first_answer(opened: Opened) -> Answer | None:
    """The result of what was opened; None where it cannot be computed: its page says why."""
    try:
        return Answer.of(opened.scenario)
    except InputError:
        return None


def free_port(host: str, port: int) -> int:
    """The first port from one on that can be served on; 0 stays 0.

    viser waits for ever where there is none: it tries in a thread of its own.

    Args:
        host: name or address to serve on; empty: all addresses.
        port: to begin with; 0: any that is free.

    Raises:
        InputError: the host is not this machine, or no port is free.
    """
    valid = "wanted an address of this machine, such as 127.0.0.1, or 0.0.0.0 for all of them"
    try:
        found = socket.getaddrinfo(host or None, 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, ValueError):
        raise InputError("--host", f"{host!r} is not known to this machine", valid) from None
    places = list(dict.fromkeys((family, address) for family, _, _, _, address in found))
    for each in range(port, min(port + _PORTS, _MAX_PORT + 1)):
        try:
            for family, address in places:
                _try_to_serve(family, (address[0], each, *address[2:]))
        except OSError as error:
            if error.errno in (errno.EADDRINUSE, errno.EACCES):
                continue
            raise InputError("--host", f"{host!r} is no address of this machine", valid) from None
        return each
    raise InputError("--port", f"{port} and the ports after it are taken", "wanted one that is free, or 0 for any")


def _try_to_serve(family: int, address: tuple[Any, ...]) -> None:
    """Open a port as asyncio does, and close it.

    Raises:
        OSError: it cannot be opened.
    """
    with socket.socket(family, socket.SOCK_STREAM) as trial:
        if os.name == "posix":
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            trial.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        trial.bind(address)
        trial.listen(1)


def is_loopback(host: str) -> bool:
    """Whether nobody but this machine reaches a host of that name."""
    address = _address(host)
    return host == _LOOPBACK_NAME if address is None else address.is_loopback


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """The address that a host is given by; None where it is a name."""
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None


def _is_own(name: str, host: str) -> bool:
    """Whether a name is that which is served on, or of this machine."""
    plain = name.lower().rstrip(".")
    return bool(plain) and (plain == host.lower().rstrip(".") or plain in _own_names())


@cache
def _own_names() -> frozenset[str]:
    """Names by which others may call this machine."""
    name = socket.gethostname()
    names = (_LOOPBACK_NAME, name, name.partition(".")[0], f"{name.partition('.')[0]}.local", socket.getfqdn())
    return frozenset(each.lower().rstrip(".") for each in names if each)


def may_connect(headers: Any, host: str, *, upgrade: bool) -> bool:
    """Whether a request comes from a page of this server.

    A page of another origin may open a WebSocket to this machine, and one whose name was bound to an address of it may
    read from it: the browser says both, in the headers ``origin`` and ``host``. An address cannot be bound to another,
    and our own names are not.

    Args:
        headers: of the request, their names in lower case.
        host: that the server is bound to.
        upgrade: the request opens a WebSocket.
    """
    asked = headers.get("host", "")
    name = urlsplit(f"//{asked}").hostname or ""
    ours = is_loopback(name) if is_loopback(host) else _address(name) is not None or _is_own(name, host)
    if not ours:
        return False
    origin = headers.get("origin")
    if origin is None:
        return not upgrade
    return bool(origin in (f"http://{asked}", f"https://{asked}"))


def viser_module() -> Any:
    """The package viser.

    Raises:
        InputError: it is not installed.
    """
    try:
        import viser
    except ImportError:
        raise InputError("view", "viser is not installed", "pip install 'bumpstop[view]'") from None
    return viser


@contextmanager
def _guarded(host: str, sent: Callable[[bytes], Awaitable[bytes]]) -> Iterator[None]:
    """Have a viser server that starts in here refuse foreign origins: viser 1.1 has no setting for that.

    Args:
        host: that it is bound to.
        sent: the page to send for that of viser.
    """
    import websockets.asyncio.server as websockets

    serve = websockets.serve

    def guarded(*arguments: Any, process_request: Any = None, **others: Any) -> Any:
        async def checked(connection: Any, request: Any) -> Any:
            upgrade = request.headers.get("Upgrade", "").lower() == "websocket"
            if not may_connect(request.headers, host, upgrade=upgrade):
                return connection.respond(http.HTTPStatus.FORBIDDEN, "foreign origin\n")
            # Packed again, three quarters of a megabyte take longer than they are under way on this machine.
            request.headers.pop("Accept-Encoding", None)
            answer = process_request(connection, request)
            if answer is not None and answer.headers.get("Content-Type", "").startswith("text/html"):
                answer.body = await sent(answer.body)
                answer.headers.pop("Content-Length", None)
                answer.headers["Content-Length"] = str(len(answer.body))
            return answer

        return serve(*arguments, process_request=checked, **others)

    with _STARTING:
        websockets.serve = guarded  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            websockets.serve = serve  # type: ignore[misc]


@contextmanager
def _silent() -> Iterator[None]:
    """Keep viser from printing: the command says where the page is."""
    import rich

    shown = rich.print
    rich.print = partial(lambda *_, **__: None)
    try:
        yield
    finally:
        rich.print = shown
