"""The web server that pages in the browser share: started on a port of this machine, ended by Ctrl-C."""

from __future__ import annotations

import atexit
import io
import logging
import socket
import threading
import weakref
import webbrowser
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import Any

from mjhcmc.errors import SettingsError

EXTRA = 'pip install "mjhcmc[view]"'

_EVERYWHERE = ("0.0.0.0", "::", "")
_LOOK = 0.5  # s


def start_server(host: str, port: int) -> Any:
    """A ``viser.ViserServer``.

    Args:
        host: to listen on; ``"127.0.0.1"`` is reached from this machine only.
        port: 0: any that is free.

    Raises:
        SettingsError: viser is not installed; the port is no port, is taken, or the host is not this machine's.
    """
    if isinstance(port, bool) or not isinstance(port, int) or not 0 <= port <= 65535:
        raise SettingsError(f"port {port!r}: give a whole number from 1024 to 65535, or 0 for any that is free")
    try:
        import viser
    except ImportError as error:
        raise SettingsError(f"viewing in the browser needs viser, which is not installed: {EXTRA}") from error
    check_port(host, port)
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)  # browsers that go away are no news
    with redirect_stdout(io.StringIO()):  # its banner; ours is one line
        server = viser.ViserServer(host=host, port=port, verbose=False)
    atexit.register(_stop_alive, weakref.ref(server))  # before viser's own, which says so on standard output
    return server


def check_port(host: str, port: int) -> None:
    """Refuse a port that cannot be listened on: viser would silently take another.

    Raises:
        SettingsError: naming the remedy.
    """
    try:
        family = socket.getaddrinfo(host or None, port, type=socket.SOCK_STREAM)[0][0]
    except OSError as error:
        raise SettingsError(f"host {host!r} is not known ({error.strerror}): 127.0.0.1 is this machine") from error
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a server that has just ended is no obstacle
        try:
            probe.bind((host, port))
        except OSError as error:
            raise SettingsError(
                f"port {port} of {host} cannot be listened on ({error.strerror}): give another port, or 0 for any that "
                "is free"
            ) from error


def url_of(server: Any) -> str:
    """Where the page is."""
    host = server.get_host()
    host = "localhost" if host in _EVERYWHERE else host
    return f"http://{f'[{host}]' if ':' in host else host}:{server.get_port()}"


def serve(
    server: Any, what: str, *, open_browser: bool, block: bool, say: Callable[[str], None], close: Callable[[], None]
) -> None:
    """Say where the page is, open it, and wait for Ctrl-C.

    Args:
        server: that has the page.
        what: the page is, for the line that is said.
        open_browser: open it in the user's browser; where there is none, the line is enough.
        block: wait; otherwise return at once.
        say: prints a line.
        close: ends what the page has running; called after an interrupt, before the server stops.
    """
    try:
        say(f"{what}: {url_of(server)}" + ("  (Ctrl-C ends it)" if block else ""))
        if open_browser:
            threading.Thread(target=webbrowser.open, args=(url_of(server),), daemon=True).start()
        forever = threading.Event()
        while block and not forever.wait(_LOOK):  # without a limit, Windows would not let Ctrl-C through
            pass
    except KeyboardInterrupt:
        if not block:
            raise
        say("ended")
    finally:
        if block:
            close()
            stop_server(server)


def stop_server(server: Any) -> None:
    """Stop a server without a word of its own; a second time does nothing."""
    with redirect_stdout(io.StringIO()):
        server.stop()


def _stop_alive(server: weakref.ref[Any]) -> None:
    if (alive := server()) is not None:
        stop_server(alive)
