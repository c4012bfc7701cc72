"""The table of the constants has each of them, with its value, what it decides, and what notices it."""

import constants_kernel
import constants_orbits
import constants_table


def test_each_constant_stands_in_the_table(tmp_path):
    told = constants_table.standing()
    assert [name for name, cells in told.items() if not all(cells)] == []
    listed = constants_kernel.listed(constants_kernel.make_copy(tmp_path)) + constants_orbits.listed()
    assert {name: float(value) for name, (value, *_) in told.items()} == {
        f"{each.file}.{each.name}": each.value for each in listed
    }
