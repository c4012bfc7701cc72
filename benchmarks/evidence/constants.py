"""What each constant decides: ``python benchmarks/evidence/constants.py {kernel,orbits} [PART ...]``.

Each number that stands by itself in a file of the kernel or of the orbits is halved and doubled, one at a time, and the same
is asked. ``constants.md`` beside this program is what it has printed.
"""

import argparse

import constants_kernel
import constants_orbits

ROOMS = {"kernel": constants_kernel.ask, "orbits": constants_orbits.ask}


def main() -> None:
    """Print the table of a room."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("room", choices=ROOMS)
    parser.add_argument("parts", nargs="*", help="parts of the names of constants; all by default")
    given = parser.parse_args()
    ROOMS[given.room](given.parts)


if __name__ == "__main__":
    main()
