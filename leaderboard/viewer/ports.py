"""Where the viewer is served: what cannot be is refused here, as viser would wait for ever."""

import socket

from hydroviews.errors import InputError

LAST, TRIED = 65535, 100  # ports


def free_port(host: str, port: int) -> int:
    """The first port from `port` on that nothing is served at; 0 leaves the choice to the system.

    Raises:
        InputError: there is no such address or port, or none is free.
    """
    if not 0 <= port <= LAST:
        raise InputError(f"--port {port}: no port", expected=f"0 to {LAST}")
    try:
        family, kind, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, UnicodeError) as error:
        raise InputError(f"--host {host}: no such address", found=error, expected="such as 127.0.0.1") from None
    reason: object = None
    for candidate in range(port, min(port + TRIED, LAST) + 1):
        with socket.socket(family, kind) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((host, candidate, *address[2:]))
                return candidate
            except OSError as error:
                reason = error.strerror
    raise InputError(f"{host}: nothing can be served at ports {port} to {candidate}", found=reason)
