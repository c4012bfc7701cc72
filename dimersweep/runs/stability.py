"""Former place of multipliers and exponents, which are at the top of the package now."""

from dimersweep.faces import former

__getattr__ = former(
    __name__, "multipliers", "Multipliers", "lyapunov", "Lyapunov", "spectrum", "Spectrum", "qr_growth"
)
