"""Which pages may talk to the viewer: those it served itself, whatever else is open in the browser.

Browsers let a page open a WebSocket to any machine, this one included, and leave it to the server to look at the
page's origin (RFC 6455, 10.2). A page is the viewer's own if it was loaded from where it connects to. A name that its
owner points at this machine (DNS rebinding) passes that test too, so that of names only this machine's own count;
addresses cannot be pointed elsewhere.
"""

import logging
import socket
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import lru_cache
from http import HTTPStatus
from ipaddress import ip_address
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from hydroviews.errors import InputError, printable

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

logger = logging.getLogger(__name__)

LOOPBACK = "localhost"
LONGEST = 100  # characters of an origin that are shown
REFUSAL = "The viewer answers its own pages only: open it by this machine's address, or by the name given as --host.\n"

Answer = Callable[["ServerConnection", "Request"], "Response | None"]  # None goes on with the WebSocket


def own_names(host: str) -> frozenset[str]:
    """Names of this machine in lower case: loopback, its host names, and the one that the viewer is started with."""
    return frozenset(name.lower() for name in (LOOPBACK, host, socket.gethostname(), socket.getfqdn()))


def is_own(origin: str, host: str, names: Collection[str]) -> bool:
    """Whether a WebSocket comes from a page of the viewer.

    Args:
        origin: the request's Origin, such as http://127.0.0.1:8080; empty where there is none.
        host: the request's Host: what the browser took the server for, through a tunnel as well.
        names: of this machine.
    """
    try:
        page = urlsplit(origin)
        name = page.hostname or ""
    except ValueError:
        return False
    return page.netloc.lower() == host.lower() != "" and (name in names or _is_address(name))


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


@contextmanager
def own_pages_only(host: str) -> Iterator[None]:
    """Servers that are started with websockets in this block, as viser does, refuse WebSockets of other pages.

    viser hands no setting on to websockets, so that the function which starts servers is replaced meanwhile.

    Args:
        host: the name or address to serve at.

    Raises:
        InputError: no server was started that way, so that nothing would be refused.
    """
    from websockets.asyncio import server

    serve, names, guarded = server.serve, own_names(host), []

    def serve_guarded(*arguments: Any, process_request: Answer, **settings: Any) -> Any:
        guarded.append(True)
        return serve(*arguments, process_request=guard(process_request, names), **settings)

    server.serve = serve_guarded  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        server.serve = serve  # type: ignore[misc]
    if not guarded:
        raise InputError("the viewer cannot refuse other pages", found="another viser than the one of constraints.txt")


def guard(answer: Answer, names: Collection[str]) -> Answer:
    """How a server answers requests, but for WebSockets of pages that are not its own, which it refuses."""

    def guarded(connection: "ServerConnection", request: "Request") -> "Response | None":
        response = answer(connection, request)
        origins, hosts = request.headers.get_all("Origin"), request.headers.get_all("Host")
        if response is not None or (len(origins) == len(hosts) == 1 and is_own(origins[0], hosts[0], names)):
            return response
        _warn(", ".join(origins)[:LONGEST])
        return connection.respond(HTTPStatus.FORBIDDEN, REFUSAL)

    return guarded


@lru_cache(maxsize=100)  # a page may try again and again
def _warn(origin: str) -> None:
    logger.warning("a page of %s was refused: the viewer answers its own pages only", printable(origin) or "nowhere")
