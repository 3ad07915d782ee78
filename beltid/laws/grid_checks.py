"""Checks of a grid of measured friction coefficients: all problems at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError

Array = NDArray[np.float64]

MIN_RELATIVE_GAP = 1e-9  # closer nodes leave no digits for a slope between them


def to_array(name: str, values: ArrayLike) -> Array:
    """Copy of the values as float64; the caller's array may change later."""
    try:
        return np.array(values, dtype=float, order="C")
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: must be an array of numbers ({error})") from None


def axis_problems(name: str, nodes: Array) -> list[str]:
    """What is wrong with the nodes of one axis, a line per problem."""
    if nodes.ndim != 1 or nodes.size == 0:
        return [f"{name}: shape {nodes.shape}, must be one-dimensional with at least one node"]
    problems = [
        f"{name}[{k}] = {nodes[k]:g}, must be >= 0 and finite"
        for k in np.flatnonzero(~(np.isfinite(nodes) & (nodes >= 0.0)))
    ]
    if not problems:
        gaps = np.diff(nodes)
        problems = [
            f"{name}[{k + 1}] = {nodes[k + 1]:.12g} after {nodes[k]:.12g}, "
            "must be strictly increasing"
            for k in np.flatnonzero(~(gaps > MIN_RELATIVE_GAP * nodes[1:]))
        ]
    return problems


def value_problems(f: Array, v: Array, mu: Array, mu_se: Array | None) -> list[str]:
    """What is wrong with the node values and their standard errors, a line per problem."""
    problems = []
    allowed = f"must be {(f.size, v.size)}: a row per force node, a column per speed node"
    if mu.shape != (f.size, v.size):
        problems.append(f"mu: shape {mu.shape}, {allowed}")
    problems += [
        f"mu[{', '.join(map(str, k))}] = {mu[tuple(k)]:g}, must be > 0 and finite"
        for k in np.argwhere(~(np.isfinite(mu) & (mu > 0.0)))
    ]
    if mu_se is not None:
        if mu_se.shape != (f.size, v.size):
            problems.append(f"mu_se: shape {mu_se.shape}, {allowed}")
        problems += [
            f"mu_se[{', '.join(map(str, k))}] = {mu_se[tuple(k)]:g}, must be >= 0 or nan"
            for k in np.argwhere((mu_se < 0.0) | np.isinf(mu_se))
        ]
    return problems
