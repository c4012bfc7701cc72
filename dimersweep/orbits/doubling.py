"""How a period doubles at a flip: to a stable orbit beyond it, or to an unstable one before it."""

import numpy as np

from dimersweep.orbits.poincare import ReturnMap, singular_lost

# of the differences, in units of the section: those of the third order are then right to about 1e-3
WIDTHS = (3e-3, 1e-3)
AGREE = 0.02  # part in which the coefficients of both widths differ at most; more where a change of word lies between


@singular_lost()
def doubling(m: ReturnMap, z: np.ndarray, matrix: np.ndarray) -> float:
    """The coefficient c of a flip: on its centre manifold the map is x -> -x + c x^3.

    With J v = -v, w J = -w, w v = 1 and the derivatives B and C of second and third order of the map it is

        c = w C(v, v, v)/6 + w B(v, (1 - J)^-1 B(v, v))/2

    (Kuznetsov, doi 10.1007/978-3-031-22007-4, section 5.4). Where c > 0 a stable orbit of twice the period begins beyond the
    flip, where c < 0 an unstable one ends there. NaN where contacts change so near that the map has no such derivatives.

    Parameters
    ----------
    m : ReturnMap
        All of whose fixed points close: that of the fast part alone.
    z : ndarray, shape (n,)
        Fixed point at the flip.
    matrix : ndarray, shape (n, n)
        J.

    Raises
    ------
    OrbitLost
        If the map cannot be taken beside the point.
    """
    v, w = (_eigenvector(J) for J in (matrix, matrix.T))
    v = v / np.linalg.norm(v)
    w = w / (w @ v)
    wide, narrow = (_coefficient(m, z, matrix, v, w, width) for width in WIDTHS)
    return wide if abs(wide - narrow) < AGREE * (abs(wide) + abs(narrow)) else float("nan")


def _coefficient(m: ReturnMap, z: np.ndarray, matrix: np.ndarray, v: np.ndarray, w: np.ndarray, width: float) -> float:
    def at(away: np.ndarray) -> np.ndarray:
        return m.image(z + width * away).point

    far_back, back, here, ahead, far_ahead = (at(by * v) for by in (-2, -1, 0, 1, 2))
    second = (ahead - 2 * here + back) / width**2
    third = (far_ahead - 2 * ahead + 2 * back - far_back) / (2 * width**3)
    bent = np.linalg.solve(np.eye(z.size) - matrix, second)
    size = np.linalg.norm(bent) or 1.0
    u = bent / size
    mixed = size * (at(v + u) - at(v - u) - at(u - v) + at(-u - v)) / (4 * width**2)
    return float(w @ third / 6 + w @ mixed / 2)


def _eigenvector(matrix: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eig(matrix)
    return vectors[:, int(np.argmin(np.abs(values + 1)))].real
