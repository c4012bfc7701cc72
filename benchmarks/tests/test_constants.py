"""The table of the kernel's constants has each of them, with its value."""

import re
from pathlib import Path

import constants as program

TABLE = Path(program.__file__).with_suffix(".md")


def told() -> dict[str, float]:
    """The constants in the table, by file and name, and what they are."""
    found, file = {}, ""
    for line in TABLE.read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            file = line.removeprefix("## ")
        elif row := re.match(r"\| (\w+) \| (\S+) \| (.*) \| (.*) \|$", line):
            name, value, decides, noticed = row.groups()
            if name == "constant":
                continue
            assert decides and noticed, f"{file}.{name}"
            found[f"{file}.{name}"] = float(value)
    return found


def test_each_constant_of_the_kernel_stands_in_the_table(tmp_path):
    listed = {f"{each.file}.{each.name}": each.value for each in program.asked(program.make_copy(tmp_path))}
    assert told() == listed
