"""Run the notebooks and keep in them what they print and draw: ``python docs/make_notebooks.py``.

The cubes that they read are those of the small presets, in the folder that DIMERSWEEP_CUBES names, or made anew.
"""

import os
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

from dimersweep import make
from dimersweep.studies.declared import read_declaration

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def make_small_cubes(folder: Path) -> None:
    """The cubes of all small presets."""
    for preset in sorted((ROOT / "sweeps").glob("*-small.toml")):
        declared = read_declaration(preset)
        make(declared, folder / declared.sweep.output, progress=False)


def executed(path: Path) -> nbformat.NotebookNode:
    """A notebook with what it gives now, without the times of its cells, which differ each time."""
    notebook = nbformat.read(path, as_version=4)
    resources = {"metadata": {"path": path.parent}}
    how = {"timeout": 300, "kernel_name": "python3", "record_timing": False, "coalesce_streams": True}
    NotebookClient(notebook, resources=resources, **how).execute()
    return notebook


def main() -> None:
    """Run all of them and write them."""
    with tempfile.TemporaryDirectory() as folder:
        if "DIMERSWEEP_CUBES" not in os.environ:
            make_small_cubes(Path(folder))
            os.environ["DIMERSWEEP_CUBES"] = folder
        for path in NOTEBOOKS:
            nbformat.write(executed(path), path)


if __name__ == "__main__":
    main()
