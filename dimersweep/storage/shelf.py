"""The folder of finished tiles, as workers see it that put their results there by themselves.

Whether they see it is shown by a token: the driver writes one for each run, and a worker reads it back before each file. A
worker that does not share the disk, or that is still at work for a sweep that has ended, finds none or another one.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from uuid import uuid4

from dimersweep.cubes.results import Finished
from dimersweep.storage.files import delete, put
from dimersweep.storage.manifest import Entry
from dimersweep.storage.tilefiles import write_points

TOKEN = "token"
LEAST_BYTES = 1 << 17  # of a file: smaller results travel, and the driver puts many of them into one


class Shelf(NamedTuple):
    """Where to put results, the token that must be there, and the configuration that gives them."""

    folder: str
    token: str
    configuration_sha256: str

    def is_here(self) -> bool:
        """Whether this process sees the folder, and the sweep is still at work there."""
        try:
            return Path(self.folder, TOKEN).read_bytes() == self.token.encode()
        except OSError:
            return False

    def keep(self, pieces: Sequence[Finished]) -> Entry | None:
        """Write results to a file there; what the manifest must tell of it, or None if they have to travel."""
        if sum(piece.results.nbytes for piece in pieces) < LEAST_BYTES or not self.is_here():
            return None
        path = Path(self.folder, f"tiles-w{uuid4().hex[:16]}.npy")  # whoever makes the same points has another name
        try:
            return write_points(path, pieces, self.configuration_sha256, 0.0)
        except OSError:  # the driver will say why, if it is refused too
            return None


def open_shelf(folder: Path, configuration_sha256: str) -> Shelf:
    """Let workers put their results into `folder`, in place of those that were allowed to before."""
    token = f"{uuid4().hex} of process {os.getpid()}"
    put(folder / TOKEN, [token.encode()])
    return Shelf(str(folder.absolute()), token, configuration_sha256)


def close_shelf(folder: Path) -> None:
    """Let no worker put anything into `folder` any more."""
    delete(folder / TOKEN)
