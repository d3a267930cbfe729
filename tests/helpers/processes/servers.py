"""A web server in a thread, with the failings that servers have."""

import re
import socketserver
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


@dataclass
class Server:
    """What it has, how it behaves, and what it was asked."""

    files: dict[str, bytes]
    ranges: bool = True
    tag: str | None = '"one"'
    cut_after: list[int] = field(default_factory=list)  # bytes sent of each of the next answers before it hangs up
    status: list[int] = field(default_factory=list)  # of the next answers, instead of the file
    login: str | None = None  # header Authorization, without which it answers 401
    asked: list[tuple[str, str | None]] = field(default_factory=list)  # paths and ranges
    logins: list[str | None] = field(default_factory=list)  # headers Authorization that came
    address: str = ""


@contextmanager
def serving(files: dict[str, bytes], **behaviour) -> Iterator[Server]:
    """Serve files by their paths (`/a.zip`) on this machine."""
    server = Server(files, **behaviour)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            answer(self, server)

        def log_message(self, *arguments) -> None:
            pass

    listener = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.address = f"http://127.0.0.1:{listener.server_address[1]}"
    thread = threading.Thread(target=listener.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    try:
        yield server
    finally:
        listener.shutdown()
        listener.server_close()
        thread.join()


def answer(request: BaseHTTPRequestHandler, server: Server) -> None:
    """The file or the rest of it, with If-Range honoured (RFC 9110, 13.1.5 and 14)."""
    wanted = request.headers.get("Range")
    server.asked.append((request.path, wanted))
    server.logins.append(request.headers.get("Authorization"))
    if server.login not in (None, server.logins[-1]):
        request.send_error(401)
        return
    if server.status or request.path not in server.files:
        request.send_error(server.status.pop(0) if server.status else 404)
        return
    content = server.files[request.path]
    match = re.fullmatch(r"bytes=(\d+)-", wanted or "")
    tag = request.headers.get("If-Range")
    same = tag is None or (tag == server.tag and not tag.startswith("W/"))  # a weak one never is
    start = int(match[1]) if match and same and server.ranges else 0
    if start and start >= len(content):
        request.send_error(416)
        return
    request.send_response(206 if start else 200)
    if start:
        request.send_header("Content-Range", f"bytes {start}-{len(content) - 1}/{len(content)}")
    if server.tag:
        request.send_header("ETag", server.tag)
    request.send_header("Content-Length", str(len(content) - start))
    request.end_headers()
    count = server.cut_after.pop(0) if server.cut_after else len(content)
    with suppress(ConnectionError):  # it may have hung up
        request.wfile.write(content[start : start + count])


@contextmanager
def answering(content: bytes) -> Iterator[str]:
    """Answer every request with these bytes, HTTP or not; yields the address."""

    class Handler(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            self.request.recv(65536)
            self.request.sendall(content)

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler) as listener:
        thread = threading.Thread(target=listener.serve_forever, args=(0.01,), daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{listener.server_address[1]}"
        listener.shutdown()
        thread.join()
