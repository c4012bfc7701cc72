"""The page with the moving dimer, and the map of a cube beside it, for browsers on this machine."""

import json
import sys
import threading
from contextlib import suppress
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import xarray as xr

from dimersweep.errors import StoreError, UserError
from dimersweep.exploring.page import LivePage
from dimersweep.plots.view import IFRAME

HERE = "127.0.0.1"
USUAL_PORT = 8470  # so that an address is good again the next time, if nothing else has the port


class Explorer:
    """The page of one dimer, and of a cube if there is one, which is served to this machine until it is closed.

    Attributes
    ----------
    address : str
        Of the page.
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
        """Return when it is closed."""
        self._thread.join()

    def close(self) -> None:
        """End it, and give the port back."""
        self._server.shutdown()
        self._server.server_close()


def _warm_up(page: LivePage) -> None:
    """Load or compile the kernel while the page opens; what is wrong with it is told to the first who asks for a run."""
    with suppress(Exception):
        page.run({"periods": "20"})


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exception(), ConnectionError):  # as when a page is closed while it is answered
            super().handle_error(request, client_address)


def _listen(port: int | None, answer: Any) -> _Server:
    """A server on a port; on the usual one, or any that is free, if none is given; a `StoreError` if it is taken."""
    for each in (USUAL_PORT, 0) if port is None else (port,):
        try:
            return _Server((HERE, each), answer)
        except OSError as error:
            why = error.strerror or error
    raise StoreError(f"port = {port}: cannot be served on ({why})")


class _Answer(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"  # one connection for all that a page asks
    wbufsize = -1  # an answer in one piece

    def __init__(self, page: LivePage, *rest: Any) -> None:
        self.page = page
        super().__init__(*rest)

    def log_message(self, *rest: Any) -> None: ...

    def do_GET(self) -> None:
        asked = urlsplit(self.path)
        ways = {"/run": self.page.run} | ({"/map": self.page.map.part} if self.page.map else {})
        # a page of another site, whose name was made to lead here, has its own name as the host
        if self.headers.get("Host", "").partition(":")[0] not in (HERE, "localhost") or asked.path not in ("/", *ways):
            self.send_error(404)
            return
        if asked.path == "/":
            kind, content = "text/html", self.page.html()
        else:
            kind, content = "application/json", _as_json(ways[asked.path], dict(parse_qsl(asked.query)))
        body = content.encode()
        self.send_response(200)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(body)


def _as_json(way: Any, asked: dict[str, str]) -> str:
    """What is answered, or the line on what is wrong with what was asked."""
    try:
        return json.dumps(way(asked))
    except UserError as error:
        return json.dumps({"error": str(error)})


def explore(cube: xr.Dataset | None = None) -> Explorer:
    """The moving dimer, in a notebook: sliders for its parameters, and beside it the map of a cube to click.

    Parameters
    ----------
    cube : xarray.Dataset, optional
        Of `sweep`, `search` or `refine`.

    Returns
    -------
    Explorer
        What a notebook on this machine shows; any browser here shows its `address`. It ends with its `close()`, or with Python.

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
