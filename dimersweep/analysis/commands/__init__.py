"""Commands of the analysis: the class of each, and the examples that its help shows."""

from typing import Any

from dimersweep.cli.printing import DimerCommand, PrintingCommand

ANALYSIS_EXAMPLES: dict[str, tuple[Any, ...]] = {
    "borders": (PrintingCommand, "borders atlas", "borders my.toml --plan"),
    "orbits": (
        DimerCommand,
        "orbits --e 0.65 --f 22 --A_r 5 --mu 0.1 --mu_s 0.15",
        "orbits --spin 100 --follow Gamma=1.3 --out branch.nc --plot branch.png",
    ),
    "later": (
        DimerCommand,
        "later --spin 110 --seconds 3h",
        "later --e 0.65 --f 22 --A_r 5 --mu 0.1 --mu_s 0.15 --seconds inf",
    ),
    "attractors": (DimerCommand, "attractors beta0=1deg:89deg xdot0=0.2:2 --e 0.8 --Gamma 1 --starts 100"),
    "fit": (
        DimerCommand,
        "fit track.csv e=0.55:0.75 spin=100:160 --mu 0.3 --mu_s 0.6 --plot fit.png",
        "fit track.csv e=0.55:0.75 --t time --x x1 --y y1 --sigma 2mm --json",
    ),
    "waveform": (
        PrintingCommand,
        "waveform acc.csv --out plate.toml",
        "waveform acc.csv --t time --z ch1 --x ch2 --plot plate.png",
    ),
}
