"""The plate as it was measured: harmonics of its motion from a record of accelerations, their file and their picture."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from matplotlib.figure import Figure

from dimersweep.errors import ParameterError
from dimersweep.inputs import as_numbers, check_labels, columns_of, number, read_toml
from dimersweep.kernel.model.layout import HARMONICS
from dimersweep.plots.style import Look, board, ink
from dimersweep.storage.files import disk_errors, replacing
from dimersweep.storage.outputs import check_output
from dimersweep.symbols import BASE

Waves = dict[str, dict[int, tuple[float, float]]]
MEASURED_AXES = ("z", "x", "y")
LEAST_PERIODS = 20  # of a record: fewer do not tell the harmonics from what lies between them
PER_PERIOD = 2.5  # samples in a period of the highest harmonic, at least
BREAK = 1.5  # step of the times, over the median one, from which it is a gap
BINS = 20  # of the spectrum on each side of a harmonic, whose mean is the noise there
SURE = 4.0  # errors above which a harmonic is kept
DRIFT = 0.25  # cycles by which a frequency that is given may be off over the record
STEPS, SETTLED = 20, 1e-12  # of Gauss and Newton for the frequency, and the last of them, in units of it


@dataclass(frozen=True, eq=False)
class Waveform:
    """A periodic motion of the plate, as a sum of harmonics along each axis.

    Attributes
    ----------
    f : float
        Frequency [Hz].
    waves : dict
        Of each axis "z", "x", "y" its harmonics: by order, intensity [1] and phase [rad], as in `Parameters`; the phase of the
        first one along z is zero.
    errors : dict
        Standard deviations of both, and of f [Hz] with the key "f"; empty where they are not known.
    rest : dict
        Of each axis what of the record is not periodic, over all of it: root mean square [1]. Constants do not count.
    spectrum : tuple of ndarray
        Frequencies [Hz], and for each axis the spectral density of the record and of its rest [g Hz-1/2], shape (2, axes, m).

    Examples
    --------
    >>> import numpy as np
    >>> from dimersweep.fits import Waveform
    >>> t = np.arange(20_000) / 2000
    >>> angle = 2 * np.pi * 15.01 * t
    >>> found = Waveform.fit(t, -9.81 * (0.9 * np.sin(angle) + 0.02 * np.sin(3 * angle + 1.0)))
    >>> round(found.f, 4), round(found.waves["z"][3][0], 4), round(found.waves["z"][3][1], 3)
    (15.01, 0.02, 1.0)
    """

    f: float
    waves: Waves
    errors: dict[str, Any] = field(default_factory=dict)
    rest: dict[str, float] = field(default_factory=dict)
    spectrum: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def harmonics(self) -> dict[str, Any]:
        """What `harmonics` of a run takes: the axes, and f."""
        return {"f": self.f, **self.waves}

    @classmethod
    def fit(
        cls,
        t: Any,
        a: Any,
        f: float | None = None,
        *,
        axes: Sequence[str] | Mapping[str, Any] | None = None,
        g: float = BASE["g"],
    ) -> "Waveform":
        """The harmonics in a record of accelerations, by least squares.

        Parameters
        ----------
        t : array_like, shape (n,), or label
            Times [s], or the label of their column in `a`: a text, a number or a tuple.
        a : array_like, shape (n,) or (n, k), or a table
            Accelerations of the plate [m s-2]; a constant, such as gravity, does not count.
        f : float, optional
            Frequency [Hz] by the clock of the record; by default it is fitted, from the strongest line on.
        axes : sequence of str, or mapping of str to label, optional
            Of each column of `a` its axis, "z", "x" or "y", "z" among them; of a table, of each axis its column. By default
            "z", or the columns of these names.
        g : float
            Gravity [m s-2].

        Returns
        -------
        Waveform
            With those harmonics that are above four times their errors.

        Raises
        ------
        ParameterError
            For a record with gaps, one that is too short or too coarse, or one of another frequency.

        Examples
        --------
        >>> import numpy as np
        >>> from dimersweep.fits import Waveform
        >>> t = np.arange(20_000) / 2000
        >>> table = {"t": t, "up": -8 * np.sin(94 * t), "along": -0.1 * np.sin(94 * t + 0.3)}
        >>> found = Waveform.fit("t", table, axes={"z": "up", "x": "along"})
        >>> round(found.waves["x"][1][1], 3)
        0.3
        """
        g = number("g", g)
        t, a, names = _record(t, a, axes)
        n, step = t.size, (t[-1] - t[0]) / (t.size - 1)
        middle = t.mean()
        fitted = _strongest(a, step)
        least = (LEAST_PERIODS - 0.5) / (n * step)
        if fitted < least:
            raise ParameterError(
                f"t: the record holds {fitted * n * step:.3g} periods; must be at least {LEAST_PERIODS}"
            )
        most = min(HARMONICS, int(1 / (PER_PERIOD * step * fitted)))
        if most < 2:
            raise ParameterError(f"t: {1 / (step * fitted):.3g} samples a period; must be at least {2 * PER_PERIOD:g}")
        omega, parts, rest, error = _fitted(t - middle, a, 2 * np.pi * fitted, most)
        fitted = omega / (2 * np.pi)
        if f is not None:
            given = number("f", f)
            if not abs(given - fitted) * n * step <= DRIFT:
                raise ParameterError(f"f = {given:g}: that of the record is {fitted:.8g} Hz; leave f out to take it")
            fitted, error = given, 0.0
            parts, rest = _least_squares(t - middle, a, 2 * np.pi * fitted, most)
        window = np.hanning(n)[:, None]  # so that a line does not hide what is beside it
        scale = np.sqrt(2 * step / (window**2).sum()) / g
        density = [np.abs(np.fft.rfft(window * each, axis=0)) * scale for each in (a - a.mean(axis=0), rest)]
        waves, errors = _waves(parts, names, g, density[1] / np.sqrt(n * step), n * step * fitted)
        left = {name: float(np.sqrt((rest[:, k] ** 2).mean()) / g) for k, name in enumerate(names)}
        spectrum = np.fft.rfftfreq(n, step), np.moveaxis(np.array(density), 1, 2)
        return cls(fitted, waves, {**errors, "f": error / (2 * np.pi)}, left, spectrum)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Waveform":
        """A waveform that was saved, without its errors.

        Raises
        ------
        ParameterError
            If it cannot be read, or is none.

        Examples
        --------
        >>> from dimersweep.fits import Waveform
        >>> Waveform(15.0, {"z": {1: (0.9, 0.0)}}).save("plate.toml", force=True)
        >>> Waveform.load("plate.toml")
        <Waveform: f 15 Hz, z1: 0.9 at 0 rad>
        """
        told = read_toml(Path(path))
        if "f" not in told or "z" not in told:
            raise ParameterError(f"{path}: is no waveform, which has f and z")
        waves = {
            axis: {int(k): (float(size), float(phase)) for k, (size, phase) in told[axis].items()}
            for axis in {*told} - {"f"}
        }
        return cls(float(told["f"]), waves)

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write it to a file of TOML, which `harmonics` of a run, of a sweep file and of the command line takes.

        Raises
        ------
        ParameterError, StoreError
            If it cannot be written, or exists and is not to be replaced.

        Examples
        --------
        >>> from dimersweep import simulate
        >>> from dimersweep.fits import Waveform
        >>> Waveform(15.0, {"z": {1: (0.9, 0.0), 2: (0.02, 1.0)}}).save("plate.toml", force=True)
        >>> simulate(harmonics="plate.toml", periods=60).mode
        'drift'
        """
        path = check_output(path, force=force, name="path", what="a waveform", endings=(".toml",))
        lines = [
            "# motion of a plate: of each harmonic of f [Hz] intensity [1] and phase [rad], with their errors",
            f"f = {self.f!r}",
        ]
        for axis, wave in self.waves.items():
            lines += ["", f"[{axis}]"]
            for k, (size, phase) in wave.items():
                errors = self.errors.get(axis, {}).get(k)
                lines.append(
                    f"{k} = [{size!r}, {phase!r}]" + (f"  # {errors[0]:.2g}, {errors[1]:.2g}" if errors else "")
                )
        with disk_errors(f"path = {path}", ""), replacing(path) as temporary:
            temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")

    def acceleration(self, cycles: Any, axis: str = "z") -> np.ndarray:
        """Acceleration of the plate along an axis, in g, at times in forcing periods."""
        angles = 2 * np.pi * as_numbers("cycles", cycles)
        return np.sum([-size * np.sin(k * angles + phase) for k, (size, phase) in self.waves[axis].items()], axis=0)

    def plot(self, **look: Unpack[Look]) -> Figure:
        """One period of each axis, and the spectra of the record and of what of it is not periodic; `look` as in `plots.Look`.

        Examples
        --------
        >>> from dimersweep.fits import Waveform
        >>> Waveform(15.0, {"z": {1: (0.9, 0.0), 2: (0.02, 1.0)}}).plot().savefig("plate.png")
        """
        place, panels = board(look, (11, 1 + 2.6 * len(self.waves)), nrows=len(self.waves), ncols=2, squeeze=False)
        cycles = np.linspace(0, 1, 401)
        for k, (axis, wave) in enumerate(self.waves.items()):
            left, right = panels[k]
            left.plot(cycles, self.acceleration(cycles, axis), label="all harmonics")
            if 1 in wave:
                first = Waveform(self.f, {axis: {1: wave[1]}})
                left.plot(cycles, first.acceleration(cycles, axis), ":", color=ink(), lw=1, label="the first one")
            left.set(xlim=(0, 1), xlabel="time [forcing periods]", ylabel=f"acceleration along {axis} [g]")
            left.grid(alpha=0.3)
            if self.spectrum is not None:
                frequencies, densities = self.spectrum
                for density, word in zip(densities[:, k, 1:], ("record", "what is not periodic"), strict=True):
                    right.loglog(frequencies[1:], density, lw=0.6, label=word)
                right.set_ylabel("spectral density [g Hz$^{-1/2}$]")
            for order in wave:
                right.axvline(
                    order * self.f, color=ink(), lw=0.5, ls=":", label="harmonics" if order == min(wave) else None
                )
            right.set(xlabel="frequency [Hz]")
            right.grid(alpha=0.3)
        handles = [each for axes in panels[0] for each in axes.get_legend_handles_labels()[0]]
        place.legend("lower center", handles, fontsize=8, ncols=5)
        return place.done()

    def __repr__(self) -> str:
        words = [f"f {self.f:.8g} Hz"]
        for axis, wave in self.waves.items():
            words += [f"{axis}{k}: {size:.4g} at {phase:.3g} rad" for k, (size, phase) in wave.items()]
        words += [f"not periodic along {axis}: {rest:.2g} g" for axis, rest in self.rest.items()]
        return f"<Waveform: {', '.join(words)}>"


def _record(t: Any, a: Any, axes: Any) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Times, accelerations of shape (n, axes), and the names of the axes, z first."""
    if hasattr(a, "columns") or hasattr(a, "data_vars") or isinstance(a, Mapping):
        there = list(getattr(a, "column_names", getattr(a, "columns", getattr(a, "variables", a))))
        found = [name for name in MEASURED_AXES if name in there] or ["z"]
        named = dict(axes) if isinstance(axes, Mapping) else {name: name for name in axes or found}
        its_time = isinstance(t, str | int) or (isinstance(t, tuple) and t in there)
        for column in (*named.values(), *([t] if its_time else [])):
            if column not in there:
                raise ParameterError(f"a: has no column {column} (there are {', '.join(map(str, there))})")
        t = a[t] if its_time else t
        columns = [a[column] for column in named.values()]
    else:
        columns = columns_of(a)
        named = dict.fromkeys(("z",) if axes is None else axes)
    names = list(named)
    if "z" not in names or len(names) != len(columns) or not {*names} <= {*MEASURED_AXES}:
        raise ParameterError(f"axes = {names}: must be one of z, x, y for each column, z among them")
    given = {"t": t} | {f"a ({name})": column for name, column in zip(names, columns, strict=True)}
    check_labels(given)
    times, *values = (as_numbers(name, each, "s" if name == "t" else "m s-2") for name, each in given.items())
    order = sorted(range(len(names)), key=lambda k: MEASURED_AXES.index(names[k]))
    for k in order:
        if values[k].size != times.size or times.size < 2:
            raise ParameterError(f"a: has {values[k].size} values for {times.size} times")
    steps = np.diff(times)
    usual = float(np.median(steps))
    wrong = np.flatnonzero((steps <= 0) | (steps > BREAK * usual))
    if wrong.size:
        k = int(wrong[0])
        what = "the times must increase" if steps[k] <= 0 else "the record has a gap there; give one without"
        raise ParameterError(f"t = {times[k + 1]:.9g} after {times[k]:.9g}: {what}")
    return times, np.column_stack([values[k] for k in order]), [names[k] for k in order]


def _strongest(a: np.ndarray, step: float) -> float:
    """Frequency of the strongest line [Hz], to a small part of a bin."""
    window = np.hanning(len(a))[:, None]
    power = (np.abs(np.fft.rfft((a - a.mean(axis=0)) * window, axis=0)) ** 2).sum(axis=1)
    k = int(power[1:-1].argmax()) + 1
    low, here, high = np.log(np.maximum(power[k - 1 : k + 2], 1e-300))
    return float((k + 0.5 * (low - high) / (low - 2 * here + high or -1.0)) / (len(a) * step))


def _design(t: np.ndarray, omega: float, most: int) -> np.ndarray:
    angles = omega * np.multiply.outer(t, np.arange(1, most + 1))
    return np.column_stack([np.ones_like(t), np.sin(angles), np.cos(angles)])


def _least_squares(t: np.ndarray, a: np.ndarray, omega: float, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Parts of sine and cosine of each harmonic, shape (2, harmonics, axes), and what is left of the record."""
    design = _design(t, omega, most)
    parts = np.linalg.solve(design.T @ design, design.T @ a)
    return parts[1:].reshape(2, most, -1), a - design @ parts


def _fitted(t: np.ndarray, a: np.ndarray, omega: float, most: int) -> tuple[float, np.ndarray, np.ndarray, float]:
    """Angular frequency, parts, rest and the error of the frequency, by Gauss and Newton; times count from their middle."""
    orders = np.arange(1, most + 1)[:, None]
    for _ in range(STEPS):
        design = _design(t, omega, most)
        normal = design.T @ design
        all_parts = np.linalg.solve(normal, design.T @ a)
        rest, parts = a - design @ all_parts, all_parts[1:].reshape(2, most, -1)
        slope = t[:, None] * (
            design[:, most + 1 :] @ (orders * parts[0]) - design[:, 1 : most + 1] @ (orders * parts[1])
        )
        slope -= design @ np.linalg.solve(normal, design.T @ slope)
        weights = 1 / np.maximum((rest**2).mean(axis=0), (1e-15 * np.abs(a).max()) ** 2)
        curve = float((weights * slope**2).sum())
        change = float((weights * slope * rest).sum()) / curve
        omega += change
        if abs(change) <= max(SETTLED * omega, 1e-3 * curve**-0.5):
            break
    return omega, *_least_squares(t, a, omega, most), curve**-0.5


def _waves(
    parts: np.ndarray, names: list[str], g: float, noise: np.ndarray, periods: float
) -> tuple[Waves, dict[str, dict[int, tuple[float, float]]]]:
    """Harmonics of each axis that are above their errors, with these.

    Of what is not periodic counts the `noise` in bins beside a harmonic; the record holds so many `periods`.
    """
    most = parts.shape[1]
    waves: Waves = {name: {} for name in names}
    errors: dict[str, dict[int, tuple[float, float]]] = {name: {} for name in names}
    first, first_error = 0.0, 0.0
    for axis, name in enumerate(names):
        for k in range(1, most + 1):
            sine, cosine = -parts[:, k - 1, axis] / g  # the plate's acceleration is -Gamma_k g sin(k omega t + phi_k)
            at = round(k * periods)
            beside = np.r_[noise[max(1, at - BINS) : max(1, at - 1), axis], noise[at + 2 : at + BINS + 1, axis]]
            error, size = float(np.sqrt((beside**2).mean())), float(np.hypot(sine, cosine))
            phase, phase_error = float(np.arctan2(cosine, sine)), error / size if size else np.inf
            if name == "z" and k == 1:
                first, first_error = phase, phase_error
            elif size <= SURE * error:
                continue
            own = (name, k) != ("z", 1)
            waves[name][k] = (size, float((phase - k * first) % (2 * np.pi)) if own else 0.0)
            errors[name][k] = (error, float(np.hypot(phase_error, k * first_error)) if own else 0.0)
    return {name: wave for name, wave in waves.items() if wave}, errors
