"""Further attacks of ``faults.py``: on finished cubes by their users, with xarray, with threads and with attributes."""

import shutil
import sys
from collections.abc import Callable
from typing import Any

from fault_attacks import as_zarr
from fault_scene import Scene, attack, ended, forked, line_of

# --- cubes that were changed --------------------------------------------------------------------------------------------


def rewritten(scene: Scene, change: Callable[[Any], Any]) -> None:
    """Open the cube with xarray, change it, and write it again."""
    import xarray as xr
    import zarr

    how: dict[str, Any] = {"engine": "zarr", "consolidated": False} if scene.cube.is_dir() else {"engine": "netcdf4"}
    with xr.open_dataset(scene.cube, **how) as file:
        changed = change(file.load()).drop_encoding()
    if not scene.cube.is_dir():
        changed.to_netcdf(scene.cube)
        return
    shutil.rmtree(scene.cube)
    with zarr.config.set({"array.write_empty_chunks": True}):
        changed.to_zarr(scene.cube, consolidated=False, zarr_format=3)


CHANGES: dict[str, Callable[[Any], Any]] = {
    "cut": lambda cube: cube.isel(f=slice(0, 2)),
    "cut from within": lambda cube: cube.isel(beta0=slice(1, 30)),
    "turned": lambda cube: cube.transpose(),
    "reversed": lambda cube: cube.isel(f=slice(None, None, -1)),
    "with an axis moved": lambda cube: cube.assign_coords(f=cube["f"] + 1),
    "with an axis reversed": lambda cube: cube.assign_coords(f=cube["f"].values[::-1]),
    "with results at other points": lambda cube: cube.roll(beta0=1),
    "with one number changed": lambda cube: cube.assign(
        n_events=cube["n_events"] + (cube["beta0"] == cube["beta0"][7])
    ),
    "with modes that are no whole numbers": lambda cube: cube.assign(mode=cube["mode"].astype(float)),
    "without events": lambda cube: cube.drop_vars("n_events"),
    "without status": lambda cube: cube.drop_vars("status"),
}
for _name, _change in CHANGES.items():

    @attack(f"a cube {_name}, by its user")
    def _(scene: Scene, change: Callable[[Any], Any] = _change) -> str | None:
        if scene.rng.random() < 0.5:
            as_zarr(scene)
        scene.complete()
        rewritten(scene, change)
        for more in ((), ("--retry",), ("--out", "wide.nc", "--extend", scene.out)):
            if scene.run(*more) == 0 or not line_of(scene.told()):
                return f"FAILED: {' '.join(more)}: taken: {scene.told()[-200:]}"
        scene.again = ("--force",)
        return None


# --- threads ------------------------------------------------------------------------------------------------------------


@attack("threads that ask for a finished cube at once")
def _(scene: Scene) -> str | None:
    scene.complete()

    def call() -> None:
        from concurrent.futures import ThreadPoolExecutor

        from dimersweep import make
        from dimersweep.studies.declared import read_declaration

        declared = read_declaration(scene.folder / "sweep.toml")
        with ThreadPoolExecutor(3) as threads:
            for done in [threads.submit(make, declared, scene.cube, progress=False) for _ in range(60)]:
                done.result()

    code = ended(forked(call, scene.folder / "told"))
    return f"FAILED: exit {code}: {scene.told()[-200:]}" if code else None


# --- attributes ---------------------------------------------------------------------------------------------------------

ATTRIBUTES: dict[str, Any] = {
    "named as the program's": {"configuration": "x", "dimersweep_cube": "9"},
    "of names that no file bears": {"a/b": 1},
    "without a name": {"": 1},
    "that are nothing": {"note": None},
    "that are true or false": {"note": True},
    "that are objects": {"note": {}},
}
for _name, _attrs in ATTRIBUTES.items():

    @attack(f"attributes {_name}")
    def _(scene: Scene, attrs: Any = _attrs) -> str | None:
        def call() -> None:
            from dimersweep import sweep
            from dimersweep.errors import UserError

            try:
                sweep({"f": [15, 20]}, periods=60, progress=False, attrs=attrs, out=scene.cube)
            except UserError as error:
                print("dimersweep: error:", error)
                sys.exit(1)

        code = ended(forked(call, scene.folder / "told"))
        if code == 0 or not line_of(scene.told()) or scene.cube.exists() or scene.tiles.exists():
            return f"FAILED: exit {code}: {scene.told()[-200:]}"
        return None
