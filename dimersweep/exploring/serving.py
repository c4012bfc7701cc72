"""Serve the page with the moving dimer to browsers on this machine."""

import json
import re
import sys
import threading
from contextlib import suppress
from functools import partial
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

import xarray as xr

from dimersweep.errors import StoreError, UserError, one_line
from dimersweep.exploring.page import LivePage
from dimersweep.plots.view import IFRAME

HERE = "127.0.0.1"
OWN_HOSTS = (HERE, "localhost", "[::1]")
ELSEWHERE = Path(__file__).with_name("elsewhere.html")  # answer to a request that names another host
USUAL_PORT = 8470  # the same each time, so that an address stays good if nothing else has taken the port


class Explorer:
    """A server of the page of one dimer, and of a cube if there is one, for this machine until it is closed.

    Attributes
    ----------
    address : str
        Address of the page (URL).
    """

    def __init__(self, cube: xr.Dataset | None = None, port: int | None = None) -> None:
        page = LivePage(cube)
        self._server = _listen(port, partial(_Answer, page))
        self.address = f"http://{HERE}:{self._server.server_port}/"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()
        threading.Thread(target=_warm_up, args=(page,), daemon=True).start()

    def _repr_html_(self) -> str:
        return IFRAME.format(f'src="{self.address}" allow="clipboard-write"')

    def wait(self) -> None:
        """Wait until the server is closed."""
        self._thread.join()

    def close(self) -> None:
        """Close the server and its port."""
        self._server.shutdown()
        self._server.server_close()


def _warm_up(page: LivePage) -> None:
    """Load or compile the kernel while the page opens; an error is reported by the first request for a run."""
    with suppress(Exception):
        page.run({"periods": "20"})


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exception(), ConnectionError):  # raised when a page is closed during an answer
            super().handle_error(request, client_address)


def _listen(port: int | None, answer: Any) -> _Server:
    """Return a server on a port; raise a `StoreError` if the port is in use.

    Without a port, the usual one is taken, or any free one.
    """
    for each in (USUAL_PORT, 0) if port is None else (port,):
        try:
            return _Server((HERE, each), answer)
        except OSError as error:
            why = error.strerror or error
    raise StoreError(f"port = {port}: cannot be served on ({why})")


class _Answer(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"  # keeps one connection for all requests of a page
    wbufsize = -1  # buffers the header and the body, to send them in one piece

    def __init__(self, page: LivePage, *rest: Any) -> None:
        self.page = page
        super().__init__(*rest)

    def log_message(self, *rest: Any) -> None: ...

    def do_GET(self) -> None:
        path, _, query = self.path.partition("?")
        handlers = {"/run": self.page.run} | ({"/map": self.page.map.part} if self.page.map else {})
        host = self.headers.get("Host", "")
        # a page of another site, whose name was made to lead to this machine, sends that name as the host
        if re.sub(r":\d*$", "", host).lower() not in OWN_HOSTS:
            words = {"host": escape(one_line(host)), "port": self.connection.getsockname()[1]}
            self._send(403, "text/html", ELSEWHERE.read_text(encoding="utf-8").format(**words))
        elif path == "/":
            self._send(200, "text/html", self.page.html())
        elif path in handlers:
            self._send(200, "application/json", _as_json(handlers[path], dict(parse_qsl(query))))
        else:
            self._send(404, "text/html", f'<p>{escape(one_line(path))}: no such page; there is <a href="/">one</a>.')

    do_HEAD = do_GET

    def _refuse(self) -> None:
        """Refuse another method, and close the connection, since the body of the request is not read."""
        self._send(405, "text/plain", f"{self.command}: must be GET or HEAD\n", Allow="GET, HEAD", Connection="close")

    do_POST = do_PUT = do_PATCH = do_DELETE = do_OPTIONS = do_TRACE = do_CONNECT = _refuse

    def _send(self, code: int, kind: str, content: str, **headers: str) -> None:
        body = content.encode()
        self.send_response(code)
        standard = {
            "Content-Type": f"{kind}; charset=utf-8",
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
        }
        for name, value in (standard | headers).items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)


def _as_json(handler: Any, asked: dict[str, str]) -> str:
    """Return the answer of a handler to a request as JSON, or the error message of a bad request."""
    try:
        return json.dumps(handler(asked))
    except UserError as error:
        return json.dumps({"error": str(error)})


def explore(cube: xr.Dataset | None = None) -> Explorer:
    """Show the moving dimer in a notebook: sliders for its parameters, and beside it the map of a cube to click.

    Parameters
    ----------
    cube : xarray.Dataset, optional
        Cube of `sweep`, `search` or `refine`.

    Returns
    -------
    Explorer
        Server of the page. A notebook on this machine shows it, and so does any browser at its `address`. It ends with
        its `close()`, or with Python.

    Raises
    ------
    ParameterError
        If the cube has no axis of more than one value.

    Examples
    --------
    >>> import dimersweep
    >>> cube = dimersweep.sweep({"beta0": [0.2, 0.28, 0.36]}, periods=60, progress=False)
    >>> explorer = dimersweep.explore(cube)
    >>> explorer.address.startswith("http://127.0.0.1:")
    True
    >>> explorer.close()
    """
    return Explorer(cube)
