#!/usr/bin/env bash
# A frequency of 15 Hz, asked for in rad/s: Pint and UDUNITS (cf-units) give 15, without a word; astropy refuses.
#
# One would guess 2 pi * 15 = 94.2, or a refusal. For both the hertz is 1/s, and so is the radian per second: only a frequency that is
# written in cycles per second, or in revolutions, is turned into radians. Seen with Pint 0.25.3, cf-units 3.3.1 and
# astropy 7.2.0 (Python 3.11):
#   pint: 15 Hz is 15.0 rad/s; 15 cycle/s is 94.25 rad/s
#   udunits: 15 Hz is 15.0 rad/s; 900 rpm is 94.25 rad/s
#   astropy: 15 Hz in rad/s: UnitConversionError
# Fails if one of them does otherwise.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pint==0.25.3 cf-units==3.3.1 astropy==7.2.0
"$folder/venv/bin/python" - <<'PYTHON'
import math

import astropy.units
import cf_units
import pint

turning = 2 * math.pi * 15
registry = pint.UnitRegistry()
hertz, cycles = (registry.Quantity(15, unit).to("rad/s").magnitude for unit in ("Hz", "cycle/s"))
print(f"pint: 15 Hz is {hertz} rad/s; 15 cycle/s is {cycles:.2f} rad/s")
assert hertz == 15 and math.isclose(cycles, turning)

hertz = cf_units.Unit("Hz").convert(15.0, "rad s-1")
revolutions = cf_units.Unit("rpm").convert(900.0, "rad s-1")
print(f"udunits: 15 Hz is {hertz} rad/s; 900 rpm is {revolutions:.2f} rad/s")
assert hertz == 15 and math.isclose(revolutions, turning)

try:
    (15 * astropy.units.Hz).to(astropy.units.rad / astropy.units.s)
except astropy.units.UnitConversionError as error:
    print(f"astropy: 15 Hz in rad/s: {type(error).__name__}")
else:
    raise AssertionError("astropy converts hertz to radians per second")
PYTHON
