"""A small program of parts and kernels, to be compiled where the whole kernel would take too long."""

import math

from dimersweep.kernel.compiler.jit import compiled, exported


@compiled
def leaf(x):
    return math.sqrt(x)


@compiled(inline=True)
def left(line):
    line[1] = leaf(line[0]) + 1.0
    return line[1]


@compiled
def handed(verb, x):
    return verb(x)


@exported
def root(line):
    return left(line) * (handed(leaf, line[0]) + left(line))


@exported
def simple(x):
    return leaf(x)


@exported
def wrong(x):
    return leaf(x) + x.nothing
