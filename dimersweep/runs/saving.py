"""Write a run to one NetCDF file that other programs read, too, and read it back exactly."""

import os
import warnings
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import PACKED, fixed_coordinates
from dimersweep.errors import StoreError, one_line
from dimersweep.kernel import kernel_version
from dimersweep.kernel.batch import N_START
from dimersweep.kernel.model.event_row import N_EVENT
from dimersweep.kernel.model.layout import CODES, RUN_COLUMNS
from dimersweep.kernel.record import N_SEGMENT, SEGMENT_SLIP
from dimersweep.kernel.verdict.past import PAST_SHAPE
from dimersweep.parameters import Parameters, updated
from dimersweep.runs.outcomes import MissingValue, Orbit, no_orbit
from dimersweep.runs.recorded import RunRecord
from dimersweep.runs.solving import RunEnd
from dimersweep.storage.checking import changed, configuration_of
from dimersweep.storage.cubefiles import write_cube
from dimersweep.storage.formats.netcdf import read_netcdf
from dimersweep.storage.outputs import TABLES, check_output
from dimersweep.storage.provenance import attributes
from dimersweep.symbols import FORMER_NAMES

# arrays of the kernel: their dimensions and meanings
ROWS = {
    "event_rows": (("event", "event_column"), "events as the kernel wrote them"),
    "segment_rows": (("segment", "segment_column"), "state at the start of each smooth phase, as the kernel wrote it"),
    "end_start": (("one", "start_column"), "state and friction modes at the end, from which the run goes on"),
    "end_past": (("past_row", "past_column"), "what the verdict on the mode keeps of the run"),
}

# shapes of these arrays; 0 for any length
SHAPES = {
    "event_rows": (0, N_EVENT),
    "segment_rows": (0, N_SEGMENT),
    "end_start": (1, N_START),
    "end_past": PAST_SHAPE,
}


def write_run(
    fields: Mapping[str, Any], events: xr.Dataset, path: str | os.PathLike[str], *, force: bool = False
) -> Path:
    """Write the fields of a `Run` and its labelled events, if there are any; see `Run.save`."""
    path = check_output(path, force=force, what="a run", endings=TABLES)
    write_cube(_as_dataset(fields, events), path, force=force)
    return path


def _as_dataset(fields: Mapping[str, Any], events: xr.Dataset) -> xr.Dataset:
    """Return a run as one dataset: parameters and labelled events for the reader, rows of the kernel for `load_run`."""
    end, record = fields["_end"], fields["_record"]
    if end is None:
        raise StoreError("save: the run has no end; it was not made by simulate")
    arrays = {"end_start": end.start, "end_past": end.past}
    if record is not None:
        # the last row may be the end of a chatter that the record does not reach; `recorded.events_of` drops it
        arrays |= {"event_rows": record.events[: events.sizes["event"]], "segment_rows": record.segments}
    variables = {
        name: xr.Variable(ROWS[name][0], values, {"long_name": ROWS[name][1]}) for name, values in arrays.items()
    }
    for variable in variables.values():
        variable.encoding.update(PACKED, _FillValue=None)
    dataset = events.drop_encoding().assign(variables).assign_coords(fixed_coordinates(fields["parameters"]))
    without_rows = [name for name, values in arrays.items() if not len(values)]
    dataset.attrs = attributes(_configuration(fields, without_rows), "run of a 3D dimer on a vibrating plate", 0.0)
    del dataset.attrs["dimersweep_cube"], dataset.attrs["wall_time_s"]
    return dataset.assign_attrs(dimersweep_run="1", mode=fields["mode"], status=fields["status"])


def _configuration(fields: Mapping[str, Any], without_rows: list[str]) -> dict[str, Any]:
    """Return the parameters and the outcome of a run as JSON can hold them; numbers keep every digit."""
    return {
        **{name: fields[name] for name in ("parameters", "start", "rtol")},
        "outcome": {name: fields[name] for name in ("message", *CODES, *RUN_COLUMNS) if name != "di_end"},
        "orbit": None if isinstance(fields["orbit"], MissingValue) else asdict(fields["orbit"]),
        "without_rows": without_rows,
        "record_cut": fields["_record"] is not None and fields["_record"].cut,
        "kernel_version": kernel_version(),
    }


def read_run(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the fields of a `Run` from its file; see `load_run`."""
    dataset = read_netcdf(Path(path))
    configuration = configuration_of(dataset, "run", Path(path))
    rows = {name: np.ascontiguousarray(dataset[name].values) for name in ROWS if name in dataset}
    try:
        if configuration["kernel_version"] != kernel_version():
            line = f"{path}: was made by another version of the kernel"
            warnings.warn(
                f"{line}; states between its events may differ in the last digits", RuntimeWarning, stacklevel=3
            )
        for name in configuration.get("without_rows", ()):  # arrays without rows are not written
            rows[name] = np.zeros(SHAPES[name])
        if "segment_rows" in rows:  # files of earlier versions have no columns of slips
            lack = N_SEGMENT - SEGMENT_SLIP if rows["segment_rows"].shape[1:] == (SEGMENT_SLIP,) else 0
            rows["segment_rows"] = np.pad(rows["segment_rows"], [(0, 0), (0, lack)], constant_values=np.nan)
        for name, values in rows.items():  # the kernel trusts these shapes: it would read beyond a shorter array
            shape = tuple(want or found for want, found in zip(SHAPES[name], values.shape, strict=True))
            if values.dtype != np.float64 or values.shape != shape:
                raise ValueError(
                    f"{name} has shape {values.shape} and type {values.dtype} in place of {shape} and float64"
                )
        return _fields(configuration, rows)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise changed("run", Path(path), one_line(error)) from error


def _fields(configuration: dict[str, Any], rows: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return the fields of a `Run` from its configuration and the rows of the kernel."""
    # earlier versions wrote e beside e_1 and e_2
    parameters = updated(configuration["parameters"], {})
    # earlier versions called gamma spin, and spin spin_rate
    start, orbit = configuration["start"], configuration["orbit"]
    start = start and {FORMER_NAMES.get(name, name): value for name, value in start.items()}
    orbit = orbit and Orbit(**{"spin" if name == "spin_rate" else name: value for name, value in orbit.items()})
    row = Parameters(**parameters).row()
    rtol, record = float(configuration["rtol"]), None
    if "event_rows" in rows:
        record = RunRecord(row, rtol, rows["event_rows"], rows["segment_rows"], configuration["record_cut"])
    return {
        "parameters": parameters,
        "start": start,
        "rtol": rtol,
        "orbit": orbit or no_orbit(configuration["outcome"]["mode"]),
        **configuration["outcome"],
        "_record": record,
        "_end": RunEnd(rows["end_start"], rows["end_past"]),
    }
