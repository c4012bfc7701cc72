"""Make pictures of the README, and movies of the motions: ``python docs/make_figures.py`` writes them into docs/figures."""

import re
from pathlib import Path

from matplotlib.figure import Figure

from dimersweep import simulate
from dimersweep.plots import DPI, contact_legend, heights, last_cycle, orbit, portrait

FOLDER = Path(__file__).parent / "figures"
COMMAND = re.compile(r"^dimersweep simulate (.*)--periods (\d+) --movie (\w+)\.gif$", re.MULTILINE)


def motions() -> dict[str, tuple[int, dict[str, str]]]:
    """The commands of the page of the motions: periods and parameters by the name of the movie."""
    page = (FOLDER.parent / "motions.md").read_text(encoding="utf-8")
    return {name: (int(n), dict(re.findall(r"--(\w+) (\S+)", given))) for given, n, name in COMMAND.findall(page)}


def main() -> None:
    """The motion of the base case: heights, dip angle and orbit."""
    run = simulate(periods=600)
    period = 1 / run.parameters["f"]
    end = run.n_periods * period

    motion = Figure(figsize=(9, 3.2), layout="constrained")
    left, right = motion.subplots(1, 2, width_ratios=(2, 1))
    heights(left, run, (end - 4 * period, end))
    portrait(right, run, "beta", last_cycle(run))
    motion.legend(handles=contact_legend(), loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    motion.savefig(FOLDER / "motion.png", dpi=DPI)

    run.animate(FOLDER / "drift.gif", periods=12, speed=0.12, fps=20, force=True)

    path = Figure(figsize=(4.6, 4.4), layout="constrained")
    orbit(path.subplots(), run)
    path.savefig(FOLDER / "orbit.png", dpi=DPI)

    for name, (periods, parameters) in motions().items():  # six periods in three seconds
        run = simulate(**parameters, periods=periods)
        speed = 2 / run.parameters["f"]
        run.animate(FOLDER / "motions" / f"{name}.gif", periods=6, speed=speed, fps=12, dpi=70, force=True)


if __name__ == "__main__":
    (FOLDER / "motions").mkdir(parents=True, exist_ok=True)
    main()
