"""An extra without the others: an environment with what it asks for alone, and what it is for, tried in a few lines.

``python -m tests.checks.alone FOLDER [EXTRA]`` makes one of links to what is installed here; nothing is fetched.
"""

import subprocess
import sys
import tomllib
from collections import Counter
from importlib.metadata import Distribution, distribution, distributions
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
BASE = ""  # no extra
SWEEP = "dimersweep.sweep({'f': [15.0, 20.0]}, periods=5, progress=False, out="
# what each extra is for, as a short program in a folder of its own
SMOKES = {
    BASE: f"import dimersweep; {SWEEP}'cube.nc'); dimersweep.simulate(periods=5).animate('run.gif'); dimersweep.explore()",
    "zarr": f"import dimersweep; {SWEEP}'cube.zarr'); dimersweep.open_cube('cube.zarr').load()",
    "movie": "import dimersweep; dimersweep.simulate(periods=5).animate('run.mp4')",
    "sensitivity": """
import dimersweep
import numpy as np
from SALib.analyze import sobol as analysis
from SALib.sample import sobol

problem = {"num_vars": 2, "names": ["e", "mu"], "bounds": [[0.4, 0.8], [0.1, 0.4]]}
points = dict(zip(problem["names"], sobol.sample(problem, 2).T))
cube = dimersweep.sweep(points=points, periods=5, progress=False)
analysis.analyze(problem, cube["n_events"].values.astype(float))
""",
    "sampling": """
import dimersweep, emcee
import numpy as np

sampler = emcee.EnsembleSampler(4, 1, lambda p: -p[0] ** 2)
sampler.run_mcmc(np.random.default_rng(1).random((4, 1)), 2)
""",
    "docs": "import dimersweep, furo, ipykernel, myst_nb, numpydoc, sphinx, zarr",
    "notebooks": "import dimersweep, ipykernel, jupyterlab",
    "cluster": "import dimersweep, dask_jobqueue, dask_mpi",
    "peers": "import dimersweep, heyoka",
}


def requirements(extra: str) -> list[str]:
    """What the package itself asks for, and what it does for an extra."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return project["dependencies"] if extra == BASE else project["optional-dependencies"][extra]


def closure(extra: str) -> dict[str, Distribution]:
    """What is installed when the package is asked for with this extra: distributions by name.

    Raises
    ------
    PackageNotFoundError
        If something of it is not installed here.
    """
    found: dict[str, Distribution] = {}
    left, seen = [("dimersweep", each) for each in {BASE, extra}], set()
    while left:
        name, extra = left.pop()
        if (name, extra) in seen:
            continue
        seen.add((name, extra))
        if name != "dimersweep":
            found[name] = found.get(name) or distribution(name)
        for text in requirements(extra) if name == "dimersweep" else found[name].requires or ():
            asked = Requirement(text)
            if asked.marker is None or asked.marker.evaluate({"extra": extra}):
                left += [(canonicalize_name(asked.name), each) for each in (BASE, *asked.extras)]
    return found


def tops(found: Distribution) -> set[str]:
    """The names in site-packages that a distribution has files under."""
    names = {path.parts[0] for path in found.files or ()}
    return {name for name in names if name not in ("..", "/", "__pycache__")}


def make(folder: Path, extra: str = BASE) -> Path:
    """An environment in `folder` with one extra alone, made of links to what is installed here; returns its Python."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    (site,) = folder.glob("lib/python*/site-packages")
    owners = Counter(name for each in distributions() for name in tops(each))
    for found in closure(extra).values():
        for top in tops(found):
            if owners[top] == 1 and not (site / top).exists():
                (site / top).symlink_to(found.locate_file(top))
        for path in found.files or ():
            if owners[path.parts[0]] > 1 and path.parts[0] in tops(found):
                (site / path).parent.mkdir(parents=True, exist_ok=True)
                (site / path).symlink_to(found.locate_file(path))
    (site / "dimersweep.pth").write_text(f"{ROOT}\n")
    script = folder / "bin" / "dimersweep"
    script.write_text(f"#!{folder.absolute()}/bin/python\nfrom dimersweep.cli import main\nmain()\n")
    script.chmod(0o755)
    return folder / "bin" / "python"


if __name__ == "__main__":
    make(Path(sys.argv[1]), *sys.argv[2:])
