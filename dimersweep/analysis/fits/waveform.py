"""Waveforms of a measured plate: fit harmonics to a record of accelerations, save and draw them."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import detrend

from dimersweep.analysis.fits import lines
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_numbers, check_labels, columns_of, number, read_toml
from dimersweep.kernel.model.layout import HARMONICS, WAVES
from dimersweep.parameters import Parameters, check
from dimersweep.plots.style import Look, board, ink
from dimersweep.storage.files import disk_errors, replacing
from dimersweep.storage.outputs import check_output
from dimersweep.symbols import BASE

Waves = dict[str, dict[int, tuple[float, float]]]
MEASURED_AXES = ("z", "x", "y")
LEAST_PERIODS = 20  # least length of a record [periods]: a shorter one does not resolve what lies between the harmonics
PER_PERIOD = 2.5  # least number of samples in a period of the highest harmonic: above the 2 of Nyquist's limit
GAP_PERIODS = 0.5  # time without a sample that counts as a gap [periods]
SURE = 4.0  # errors above which a harmonic is kept
# how far a given frequency may be off: cycles over the record, of the fitted one; relative, when its line is looked for
DRIFT, NEAR_FREQUENCY = 0.25, 0.02
LINE_SHARE = 0.1  # amplitude over the strongest line from which a line may be that of the shaker
# frequencies of the mains [Hz], and how far they and the clock of a record are off [Hz]
MAINS, MAINS_OFF = (50.0, 60.0), 0.3
GRAVITY_ALONG = 0.2  # part of g by which the mean of an axis along gravity may differ from g
# number of samples at an end of the range that shows clipping: over the number of a sine, and at least
CUT_PEAKS, LEAST_CUT = 2.0, 20
# number of the slowest waves of a phase, and the factor over the fast ones that shows a wandering clock
SLOW, REDDER = 3, 4.0
# square of the level of a random walk of the phase, over the mean of k^2 times the power of its slowest waves k: 4.0,
# and doubled, since three waves give this mean to 40 % only
WALK = 8.0
SHOWN = 4  # other lines that are printed


@dataclass(frozen=True, eq=False)
class Waveform:
    """A periodic motion of the plate, as a sum of harmonics along each axis.

    Attributes
    ----------
    f : float
        Frequency [Hz].
    waves : dict
        Harmonics of each axis "z", "x", "y": by order, intensity [1] and phase [rad], as in `Parameters`. The phase of
        the first one along z is zero.
    errors : dict
        Standard deviations of intensity and phase, in the same places, and of f [Hz] with the key "f"; empty if
        unknown.
    rest : dict
        Root mean square [g] of the part of the record that is not periodic, by axis. Constants do not count.
    spectrum : tuple of ndarray
        Frequencies [Hz], and spectral densities [g Hz-1/2] of the record without its trend and of the part that is not
        periodic, shape (2, axes, m).
    others : dict
        Further lines in the record, the strongest first: by frequency [Hz], and then by axis, their amplitude [g].
    notes : tuple of str
        Sentences for the user: an accelerometer upside down, peaks that are cut, a line that changes.

    Examples
    --------
    >>> import numpy as np
    >>> from dimersweep.analysis.fits import Waveform
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
    others: dict[float, dict[str, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def harmonics(self) -> dict[str, Any]:
        """The waveform as the argument `harmonics` of a run: f, and the harmonics of each axis."""
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
        """Fit harmonics to a record of accelerations, by least squares.

        Parameters
        ----------
        t : array_like, shape (n,), or label
            Times [s], or the label of their column in `a`: a text, a number or a tuple.
        a : array_like, shape (n,) or (n, k), or a table
            Accelerations of the plate [m s-2]. A constant, such as gravity, and a trend do not count. If the mean of z
            is about -g, the sign of z is changed.
        f : float, optional
            Frequency [Hz] by the clock of the record. By default it is fitted, starting from the line along z that has
            most of the others as harmonics, is not of the mains, and has the greatest velocity.
        axes : sequence of str, or mapping of str to label, optional
            Axis of each column of `a`: "z", "x" or "y", "z" among them. For a table, the column of each axis. By
            default "z", or the columns of these names.
        g : float
            Gravity [m s-2].

        Returns
        -------
        Waveform
            Waveform with the harmonics that are above four times their errors.

        Raises
        ------
        ParameterError
            For a record with gaps, one that is too short or too coarse, or one of another frequency than `f`. Also if
            the line of the shaker changes or stops within the record, or is no greater than the noise.

        Examples
        --------
        >>> import numpy as np
        >>> from dimersweep.analysis.fits import Waveform
        >>> t = np.arange(20_000) / 2000
        >>> table = {"t": t, "up": -8 * np.sin(94 * t), "along": -0.1 * np.sin(94 * t + 0.3)}
        >>> found = Waveform.fit("t", table, axes={"z": "up", "x": "along"})
        >>> round(found.waves["x"][1][1], 3)
        0.3
        """
        g, given = number("g", g), None if f is None else number("f", f)
        check({"g": g})
        t, a, names = _record(t, a, axes)
        begin, (t, pace) = float(t.mean()), lines.on_a_grid(t)
        t -= t.mean()
        notes = _seen(a, names, g)
        quanta = np.array([np.diff(np.unique(each)).min(initial=np.inf) for each in a.T])
        start, strongest, most = _start(t, a, given, begin)
        found = lines.fitted(t, detrend(a, axis=0), 2 * np.pi * start, most)
        a = a - lines.trend(t, found.taken_from(t, a), 1 / start)
        found = lines.fitted(t, a, found.omega, most)
        rest = found.taken_from(t, a)
        notes += filter(None, [lines.changes(t, rest, found, begin)])
        clean, others = lines.without_others(t, a, rest, found)
        found = lines.fitted(t, clean, found.omega, most)
        if given is not None:
            if not abs(given - found.f) * np.ptp(t) <= DRIFT:
                raise ParameterError(f"f = {given:g}: that of the record is {strongest:.8g} Hz; leave f out to take it")
            found = lines.fitted(t, clean, 2 * np.pi * given, most, free=False)
        rest, first = found.taken_from(t, clean), 2 * abs(found.parts[1, 0])
        if (noise := float(rest[:, 0].std())) >= first / 2**0.5:
            raise ParameterError(
                f"a (z): {noise / g:.3g} g are left beside the lines, as much as that at {found.f:.6g} Hz has; "
                f"must be less{''.join(f'; {note}' for note in notes)}"
            )
        # without noise the error of quantisation repeats in each period, so it does not average out
        coarse = np.where(2 * rest.std(axis=0) < quanta, quanta * np.sqrt(found.f * np.ptp(t) / t.size / 6), 0.0)
        waves, errors = _waves(found, t, rest, coarse / g, names, g)
        rest = found.taken_from(t, a)
        (frequencies, whole), (_, part) = (lines.densities(t, each) for each in (a, rest))
        return cls(
            found.f if given is None else given,
            waves,
            errors | {"f": float(np.hypot(errors["f"], pace * found.f)) if given is None else 0.0},
            dict(zip(names, (rest.std(axis=0) / g).tolist(), strict=True)),
            (frequencies, np.array([whole, part]) / g),
            {line.f: dict(zip(names, np.abs(2 * line.parts[1] / g).tolist(), strict=True)) for line in others},
            tuple(notes),
        )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Waveform":
        """Load a waveform that was saved; errors are not stored in a form that is read.

        Raises
        ------
        ParameterError
            If the file cannot be read, or has no waveform.

        Examples
        --------
        >>> from dimersweep.analysis.fits import Waveform
        >>> Waveform(15.0, {"z": {1: (0.9, 0.0)}}).save("plate.toml", force=True)
        >>> Waveform.load("plate.toml")
        <Waveform: f 15 Hz, z1: 0.9 at 0 rad>
        """
        harmonics = read_toml(Path(path))
        if "f" not in harmonics or "z" not in harmonics:
            raise ParameterError(f"{path}: is no waveform, which has f and z")
        try:
            plate = Parameters(harmonics=harmonics)
        except ParameterError as error:
            raise ParameterError(f"{path}: {error}") from None
        waves: Waves = {}
        for axis, names in zip(MEASURED_AXES, WAVES, strict=True):
            for k in sorted(map(int, harmonics.get(axis, ()))):
                size, phase = (float(getattr(plate, name)) for name in names[k - 1])
                waves.setdefault(axis, {})[k] = (size, phase)
        return cls(float(plate.f), waves)

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the waveform to a TOML file, which runs, sweep files and the command line take as `harmonics`.

        Raises
        ------
        ParameterError, StoreError
            If the file cannot be written, or exists and `force` is False.

        Examples
        --------
        >>> from dimersweep import simulate
        >>> from dimersweep.analysis.fits import Waveform
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
        """Return the acceleration of the plate along an axis [g], at times in forcing periods."""
        angles = 2 * np.pi * as_numbers("cycles", cycles)
        return np.sum([-size * np.sin(k * angles + phase) for k, (size, phase) in self.waves[axis].items()], axis=0)

    def plot(self, **look: Unpack[Look]) -> Figure:
        """Draw one period of each axis, and the spectra of the record and of the part that is not periodic.

        `look` is as in `plots.Look`.

        Examples
        --------
        >>> from dimersweep.analysis.fits import Waveform
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
        place.legend("lower center", handles, fontsize="small", ncols=5)
        return place.done()

    def __repr__(self) -> str:
        words = [f"f {self.f:.8g} Hz"]
        for axis, wave in self.waves.items():
            words += [f"{axis}{k}: {size:.4g} at {phase:.3g} rad" for k, (size, phase) in wave.items()]
        words += [f"not periodic along {axis}: {rest:.2g} g" for axis, rest in self.rest.items()]
        words += [
            f"another line at {f:.6g} Hz: {max(sizes.values()):.2g} g" for f, sizes in list(self.others.items())[:SHOWN]
        ]
        words += self.notes
        return f"<Waveform: {', '.join(words)}>"


def _record(t: Any, a: Any, axes: Any) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return times [s], accelerations [m s-2] of shape (n, axes), and the names of the axes, z first; all checked."""
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
    return times, np.column_stack([values[k] for k in order]), [names[k] for k in order]


def _start(t: np.ndarray, a: np.ndarray, given: float | None, begin: float) -> tuple[float, float, int]:
    """Return a frequency to start from, the frequency of the shaker [Hz], and the number of harmonics in the record.

    The line of the shaker is the line along z, not of the mains, that has most of the others as harmonics. Of several
    it is the one with the greatest velocity.
    """
    places, sizes = lines.peaks(t, detrend(a[:, :1], axis=0))
    places, sizes = (each[sizes > lines.SMALL_LINE**2 * np.abs(a[:, 0]).max()] for each in (places, sizes))
    if not places.size:
        raise ParameterError("a (z): has no line, as the acceleration of a shaker has")
    strong = places[sizes >= LINE_SHARE * sizes[0]]
    orders = np.rint(np.divide.outer(strong, strong))  # order of each line (row) as a harmonic of each (column)
    harmonic = (np.abs(strong[:, None] - orders * strong) * np.ptp(t) < 0.5) & (orders >= 1) & (orders <= HARMONICS)
    mains = np.abs(np.subtract.outer(strong, MAINS)).min(axis=1) < MAINS_OFF
    shaker = start = max(zip(~mains, harmonic.sum(axis=0), sizes[: strong.size] / strong, strong, strict=True))[-1]
    if given is not None:
        near = places[np.abs(places - given) < max(NEAR_FREQUENCY * given, lines.NEAR_LINE / np.ptp(t))]
        start = near[0] if near.size else shaker
    step, gap = float(np.median(np.diff(t))), int(np.diff(t).argmax())
    if (periods := start * (np.ptp(t) + step)) < LEAST_PERIODS - 0.5:
        raise ParameterError(f"t: the record holds {periods:.3g} periods; must be at least {LEAST_PERIODS}")
    if (most := min(HARMONICS, int(1 / (PER_PERIOD * step * start)))) < 2:
        raise ParameterError(f"t: {1 / (step * start):.3g} samples a period; must be at least {2 * PER_PERIOD:g}")
    if t[gap + 1] - t[gap] > GAP_PERIODS / start:
        ends = f"t = {begin + t[gap + 1]:.13g} after {begin + t[gap]:.13g}"
        raise ParameterError(f"{ends}: the record has a gap there; give one without")
    return float(start), float(shaker), most


def _seen(a: np.ndarray, names: list[str], g: float) -> list[str]:
    """Return sentences on how the accelerometer was mounted and clipped; change the sign of z if it was upside down."""
    notes, means = [], a.mean(axis=0)
    if means[0] < (GRAVITY_ALONG - 1) * g:
        notes.append(f"z: the mean is {means[0]:.4g} m/s2, so the accelerometer was upside down; z is turned over")
        a[:, 0] *= -1
    for name, mean, values in zip(names, means, a.T, strict=True):
        if name != "z" and abs(abs(mean) - g) < GRAVITY_ALONG * g and abs(means[0]) < GRAVITY_ALONG * g:
            notes.append(f"{name}: the mean is {mean:.4g} m/s2, that of z {means[0]:.4g}: gravity is along {name}")
        if name == "z" and abs(abs(mean) - 1) < 0.05 and g > 2:
            notes.append(f"z: the mean is {mean:.4g} m/s2; of a record in units of g, g is 1")
        for end in (values.min(), values.max()):
            at_end, gap = int((values == end).sum()), np.abs(values[values != end] - end).min(initial=np.inf)
            sine = len(values) * np.sqrt(4 * gap / np.ptp(values)) / np.pi  # samples of a sine within a gap of its peak
            if at_end > max(LEAST_CUT, CUT_PEAKS * sine):
                notes.append(f"{name}: {at_end / len(values):.2%} of the values are {end:.6g} m/s2: its peaks are cut")
    return notes


def _waves(
    found: lines.Periodic, t: np.ndarray, rest: np.ndarray, coarse: np.ndarray, names: list[str], g: float
) -> tuple[Waves, dict[str, Any]]:
    """Return the harmonics of each axis that are above their errors, and the errors of these and of f.

    Each block of the record adds its part of the residual to a harmonic. Noise shifts the harmonic as much as it moves
    these parts from block to block. Amplitude and phase have errors of their own, as jitter moves the phase more.
    """
    times, _, sums = found.sums(t, rest)
    # the plate accelerates as -Gamma_k g sin(k omega t + phi_k), so these are Gamma_k exp(i phi_k)
    parts, shifts = -2j / g * found.parts, -2j / g / t.size * sums
    sizes, phases, orders = np.abs(parts), np.angle(parts), np.arange(len(parts))[:, None]
    along = shifts * np.exp(-1j * phases)
    turned = along.imag / np.maximum(sizes, 1e-300)
    size_errors = np.hypot(_levels(along.real), coarse)
    # phases count from the first one along z
    phase_errors = np.hypot(_levels(turned - orders * turned[:, 1:2, :1]), coarse / np.maximum(sizes, 1e-300))
    pulls = np.einsum("bka,ka,a->b", sums, (1j * orders * found.parts).conj(), found.weights).real
    pull = max(_levels(pulls), _wander(pulls)) * np.sqrt((times**2).mean())
    waves: Waves = {name: {} for name in names}
    errors: dict[str, Any] = {name: {} for name in names}
    for axis, name in enumerate(names):
        for k in range(1, len(parts)):
            size, error, first = float(sizes[k, axis]), float(size_errors[k, axis]), (name, k) == ("z", 1)
            if first or size > SURE * error:
                phase = (phases[k, axis] - k * phases[1, 0]) % (2 * np.pi)
                waves[name][k] = (size, 0.0 if first else float(phase))
                errors[name][k] = (error, 0.0 if first else float(phase_errors[k, axis]))
    errors["f"] = float(pull / found.curve / np.pi)
    return {name: wave for name, wave in waves.items() if wave}, errors


def _wander(pulls: np.ndarray) -> float:
    """Return the level of the slowest pulls of a wandering clock on the frequency; 0 if the clock is steady."""
    powers = np.abs(np.fft.rfft(pulls)[1:]) ** 2
    slow = powers[:SLOW] * np.arange(1, SLOW + 1) ** 2
    wanders = powers[:SLOW].mean() > REDDER * powers[len(powers) // 2 :].mean()
    return float(np.sqrt(WALK * slow.mean())) if wanders else 0.0


def _levels(series: np.ndarray) -> np.ndarray:
    """Return the standard deviation of sums over blocks, from how their parts change from block to block."""
    return np.sqrt((np.abs(np.fft.rfft(series, axis=0)[1:]) ** 2).mean(axis=0))
