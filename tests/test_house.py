"""Keep count of what the house weighs: lines of both halves, floors and types of orbits; and docstrings begin with verbs."""

import pytest

from tests.checks import house

# lines; where a change needs more, it says what for
MOST_LINES = {"engine": 28_450, "analysis": 11_500}
MOST_FLOORS = {"map": 5, "continuation": 5, "borders": 5, "slow": 4}
MOST_TYPES = 51  # of orbits
MOST_LOST = 56  # lines of the package that name OrbitLost


@pytest.mark.parametrize(("half", "is_analysis"), [("engine", False), ("analysis", True)])
def test_a_half_has_no_more_lines(half, is_analysis):
    assert 0.9 * MOST_LINES[half] < house.lines(is_analysis) <= MOST_LINES[half]


def test_the_rooms_of_orbits_have_no_more_floors():
    assert house.floors() == MOST_FLOORS


def test_each_room_of_orbits_has_five_to_eight_files():
    counts = {room: len(list((house.ANALYSIS / "orbits" / room).glob("[!_]*.py"))) for room in house.ROOMS}
    assert all(5 <= count <= 8 for count in counts.values()), counts


def test_orbits_have_no_more_types():
    assert len(house.types(house.ANALYSIS / "orbits")) <= MOST_TYPES


def test_what_orbits_find_has_at_most_four_types_beside_solution_and_event():
    found = house.found_types()
    beside = found.keys() - {"Solution", "Event"}
    assert len(beside) == len(found) - 2 <= 4
    assert all("It is a type of its own" in " ".join(found[name].split()) for name in beside)


def test_each_stepper_goes_along_something_else():
    assert house.steppers() == {
        "continuation/steps.py: steps",  # along a curve: a branch, or a border in the plane of two parameters
        "map/lost.py: in_steps",  # to given values
        "slow/sheets.py: onward",  # along a sheet of the slow family
        "continuation/events.py: graze",  # to a gap of zero, nearer by a factor
        "map/solution.py: _nearer",  # along a step of Newton's method
    }


def test_one_function_makes_tables_and_one_makes_cubes():
    assert house.builders() == {
        "cubes/cube.py": 2,  # `table`, of all results of runs and orbits; `build`, of a cube
        "storage/formats/zarr.py": 1,  # a cube that is read when it is asked for
        "runs/run.py": 1,  # no events
        "runs/accessor.py": 1,  # columns for pandas
        "analysis/orbits/borders/border_grid.py": 1,  # the axes of a grid, before its table
        "analysis/attractors/shares.py": 1,  # likewise
        "analysis/commands/measuring.py": 1,  # a file of measured numbers, of which only the units are known
    }


def test_an_orbit_is_lost_in_few_places():
    assert house.naming("OrbitLost") <= MOST_LOST


def test_the_docstring_of_a_function_begins_with_a_verb():
    found = [f"{path}:{line}: {word}" for path, line, word in house.openings() if word in house.NO_VERBS]
    assert not found
