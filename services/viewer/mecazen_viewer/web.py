"""Serves Rerun's web page, with a policy that allows connections only to the viewer."""

from __future__ import annotations

import re
import socket
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from http import HTTPStatus
from http.client import HTTPConnection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from mecazen.bus import ports
from mecazen.bus.ports import LOOPBACK

from mecazen_viewer.rerun_process import SERVES, RerunProcess

POLICY = (
    "default-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob: data:; "
    "connect-src 'self' http://*:{port}"
)
"""Content security policy; without it the page loads a font, reports its use, and checks for
updates."""
LINKS_OUTSIDE = re.compile(rb'<link\b[^>]*"https://[^>]*>')
"""Links for fonts: browsers connect to their hosts in advance, in spite of the policy."""
TIMEOUT_S = 10.0
POLL_S = 0.1
"""Period in which the server checks whether it has to end [s]."""


@contextmanager
def served_page(
    data_port: int, web_port: int, *arguments: str, listen: str = LOOPBACK
) -> Iterator[RerunProcess]:
    """Serve data and the page within the context, with more arguments for Rerun's program.

    Raises:
        RerunError: Rerun does not start.
    """
    source = ports.free_port()
    ways = f"--port={data_port}", f"--web-viewer-port={source}"
    rerun = RerunProcess("--serve-web", *ways, *arguments, ready=SERVES, bind=listen)
    with closing(rerun), _Server(listen, web_port, source, POLICY.format(port=data_port)) as page:
        thread = threading.Thread(target=page.serve_forever, args=(POLL_S,), daemon=True)
        thread.start()
        try:
            yield rerun
        finally:
            page.shutdown()
            thread.join()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, listen: str, port: int, source: int, policy: str) -> None:
        self.address_family = socket.AF_INET6 if ":" in listen else socket.AF_INET
        self.listen, self.source, self.policy = listen, source, policy
        super().__init__((listen, port), _Handler)


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = TIMEOUT_S

    def do_GET(self) -> None:
        """Respond with a file of Rerun's server."""
        path = self.path.partition("?")[0]
        if not re.fullmatch(r"/[\w./-]*", path, re.ASCII):
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        try:
            connection = HTTPConnection(self.server.listen, self.server.source, timeout=TIMEOUT_S)
            with closing(connection):
                connection.request("GET", path)
                answer = connection.getresponse()
                body = LINKS_OUTSIDE.sub(b"", answer.read()) if path == "/" else answer.read()
                self.send_response(answer.status)
                self.send_header("Content-Type", answer.getheader("Content-Type", ""))
                self.send_header("Content-Length", str(len(body)))
                self.send_header("Content-Security-Policy", self.server.policy)
                self.end_headers()
                self.wfile.write(body)
        except (ConnectionError, TimeoutError):
            self.close_connection = True  # the browser has disconnected, or Rerun has ended

    def log_message(self, *_: object) -> None:
        """Log nothing."""
