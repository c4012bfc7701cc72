"""The board of a cube in a browser, or in a notebook."""

import logging
from typing import Any

import xarray as xr

from dimersweep.errors import StoreError

GONE_PAGE = ("WebSocketClosedError", "StreamClosedError")


def _panel() -> Any:
    """The package `panel`.

    Raises
    ------
    StoreError
        If it is not installed.
    """
    try:
        import panel
    except ImportError:
        raise StoreError("explore: needs panel; pip install 'dimersweep[explore]'") from None
    return panel


def _of_an_open_page(record: logging.LogRecord) -> bool:
    """Whether a line of the server's log is worth reading: that a page was closed while it was drawn is not."""
    error = record.exc_info[0] if record.exc_info else None
    return not (error and error.__name__ in GONE_PAGE) and "connection was closed" not in record.getMessage()


def explore(cube: xr.Dataset) -> Any:
    """A map to click, in a notebook: the map of a cube, sliders for its further axes, and the run behind a clicked point.

    Parameters
    ----------
    cube : xarray.Dataset
        Of `sweep`, `search` or `refine`.

    Returns
    -------
    panel.viewable.Viewable
        What a notebook shows; ``.show()`` opens it in a browser.

    Raises
    ------
    StoreError
        If the package panel is not installed.
    ParameterError
        If the cube has no axis of more than one value.

    Examples
    --------
    >>> import dimersweep
    >>> cube = dimersweep.sweep({"beta0": [0.2, 0.28, 0.36]}, periods=60, progress=False)
    >>> dimersweep.explore(cube)  # doctest: +SKIP
    """
    _panel()
    from dimersweep.exploring.board import layout_of

    return layout_of(cube)


def serve(cube: xr.Dataset, *, port: int, show: bool) -> None:
    """Serve the board to browsers on this machine, until Ctrl-C.

    Raises
    ------
    KeyboardInterrupt
        At Ctrl-C, which the server keeps to itself.
    StoreError
        If the package panel is not installed, or the port is taken.
    """
    panel = _panel()
    from dimersweep.exploring.board import Board, layout_of

    Board(cube)  # what is wrong with a cube is reported before a server starts
    for name in ("asyncio", "bokeh.server.views.ws", "tornado.application"):
        logging.getLogger(name).addFilter(_of_an_open_page)
    try:
        panel.serve(
            lambda: layout_of(cube), port=port, show=show, address="127.0.0.1", title="dimersweep", verbose=True
        )
    except OSError as error:
        raise StoreError(f"port = {port}: cannot be served on ({error.strerror or error})") from None
    raise KeyboardInterrupt
