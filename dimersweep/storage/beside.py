"""The folder beside a file to be that keeps what is finished of it: a lock, a manifest, and files of one kind of name."""

import re
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from dimersweep.errors import StoreError
from dimersweep.storage.files import HALF, delete, disk_errors, put
from dimersweep.storage.locking import locked
from dimersweep.storage.manifest import Manifest, lines, read_manifest
from dimersweep.storage.provenance import as_text, cpu, differences
from dimersweep.storage.shelf import close_shelf


class Beside:
    """The folder of a file `out`.

    Parameters
    ----------
    out : Path
    ending : str
        What its name has more than that of the file.
    names : str
        Pattern of the names of its files of results. Of other files only those that it writes itself are ever removed.
    """

    def __init__(self, out: Path, ending: str, names: str) -> None:
        self.path, self._names = out.with_name(out.name + ending), re.compile(names)
        self.lock, self.manifest = self.path / "lock", self.path / "manifest.jsonl"
        self.scratch = self.path / "cube.tmp"  # the file as it is written: only who holds the lock does that

    def files(self) -> list[Path]:
        """Files of results."""
        return [path for path in self.path.glob("*") if self._names.fullmatch(path.name)]

    def half_written(self) -> list[Path]:
        """Files that a kill has left half written."""
        return [path for path in self.path.glob("*") if HALF.fullmatch(path.name) or path == self.scratch]

    def clear(self) -> None:
        """Delete all results."""
        close_shelf(self.path)
        for path in (*self.files(), *self.half_written(), self.manifest):
            delete(path)

    def remove(self) -> None:
        """Delete the folder, but for files in it that are not this program's."""
        self.clear()
        self.lock.unlink(missing_ok=True)
        with suppress(OSError):  # it holds something else
            self.path.rmdir()

    @contextmanager
    def claimed(self, configuration: Mapping[str, Any], size: int, *, force: bool) -> Iterator[Manifest]:
        """The manifest of this configuration, locked against other processes while the context lasts.

        Parameters
        ----------
        configuration : mapping
            All that decides the numbers, as JSON can hold it.
        size : int
            Number of points or parts.
        force : bool
            Whether results of another configuration, or damaged ones, may be deleted. Sound ones of this very
            configuration are kept all the same.

        Raises
        ------
        StoreError
            If another process is at work there, what is there belongs to another configuration (with what differs), or
            the folder cannot be written.
        """
        with ExitStack() as stack:
            with disk_errors(f"{self.path}", "nothing was computed"):
                stack.enter_context(locked(self.lock))
                nothing = Manifest(dict(configuration), size, cpu(), [], size)
                try:
                    manifest = self._read(nothing)
                except StoreError:
                    if not force:
                        raise
                    self.clear()
                    manifest = self._read(nothing)
                close_shelf(self.path)  # workers may still be at work for a sweep that was killed
            yield manifest

    def _read(self, nothing: Manifest) -> Manifest:
        """The manifest that is there, if it goes with `nothing`, the one to begin with."""
        if not self.manifest.exists():
            if self.files():
                raise StoreError(f"{self.path}: holds results, but no manifest of them; begin anew (force=True)")
            put(self.manifest, [lines(nothing)])
        manifest = read_manifest(self.manifest)
        if as_text(manifest.configuration) != as_text(nothing.configuration):
            changes = "".join(f"\n  {line}" for line in differences(manifest.configuration, nothing.configuration))
            raise StoreError(
                f"{self.path}: holds results of other settings, stopped before the end; "
                f"begin anew with force=True, or give another output. What differs:{changes}"
            )
        if manifest.size != nothing.size:
            why = f"tells of {manifest.size} points, where its grid has {nothing.size}"
            raise StoreError(f"{self.manifest}: is damaged ({why}); begin anew (force=True)")
        return manifest
