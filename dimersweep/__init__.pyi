"""The public names and where each is at home; `__init__.py` loads it from there when it is asked for."""

from dimersweep import cubes as cubes
from dimersweep import errors as errors
from dimersweep import fits as fits
from dimersweep import orbits as orbits
from dimersweep import plots as plots
from dimersweep import runs as runs
from dimersweep import studies as studies
from dimersweep.analysis.attractors.shares import attractors as attractors
from dimersweep.analysis.fits.fitting import fit as fit
from dimersweep.cubes.cube import names as names
from dimersweep.cubes.findings import Minimum as Minimum
from dimersweep.cubes.findings import PowerLaw as PowerLaw
from dimersweep.cubes.findings import boundary as boundary
from dimersweep.cubes.findings import circle_through as circle_through
from dimersweep.cubes.findings import drift_intervals as drift_intervals
from dimersweep.cubes.findings import drift_lengths as drift_lengths
from dimersweep.cubes.findings import exponents as exponents
from dimersweep.cubes.findings import minimum as minimum
from dimersweep.cubes.findings import runs_of as runs_of
from dimersweep.cubes.findings import stick_ratio as stick_ratio
from dimersweep.errors import ParameterError as ParameterError
from dimersweep.errors import PointError as PointError
from dimersweep.errors import Stopped as Stopped
from dimersweep.errors import StoreError as StoreError
from dimersweep.exploring.serving import explore as explore
from dimersweep.parameters import Parameters as Parameters
from dimersweep.runs import growth
from dimersweep.runs.growth import Lyapunov as Lyapunov
from dimersweep.runs.growth import Multipliers as Multipliers
from dimersweep.runs.growth import Spectrum as Spectrum
from dimersweep.runs.growth import lyapunov as lyapunov
from dimersweep.runs.growth import multipliers as multipliers
from dimersweep.runs.growth import qr_growth as qr_growth
from dimersweep.runs.growth import spectrum as spectrum
from dimersweep.runs.outcomes import Orbit as Orbit
from dimersweep.runs.run import Run as Run
from dimersweep.runs.run import load_run as load_run
from dimersweep.runs.simulating import simulate as simulate
from dimersweep.storage.cubefiles import open_cube as open_cube
from dimersweep.studies.declared import make as make
from dimersweep.studies.declared import read_declaration as read_declaration
from dimersweep.studies.loops import loops as loops
from dimersweep.studies.merging import merge as merge
from dimersweep.studies.observing import observer as observer
from dimersweep.studies.refine import refine as refine
from dimersweep.studies.search import search as search
from dimersweep.studies.sweep import bifurcation as bifurcation
from dimersweep.studies.sweep import sweep as sweep

__version__: str
stability = growth
