"""The assembled belt as a beam: elastica, frequencies, free flight; rates are fitted."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from rig_bench import dense
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.optimize import brentq

from beltid.params import Belt
from beltid.rigsim.banded import WIDTH
from beltid.rigsim.beam import belt as belt_forces
from beltid.rigsim.beam.belt import BeltArrays, belt_arrays, store_strains
from beltid.rigsim.compiled import kernel

Array = NDArray[np.float64]

# called thousands of times here: compiled for Python, too
add_internal, add_inertia = kernel(belt_forces.add_internal), kernel(belt_forces.add_inertia)


def fitted_rate(sizes: Array, errors: Array) -> float:
    """Slope of log(error) over log(size)."""
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])


def straight(belt: Belt, length: float, n: int) -> tuple[BeltArrays, Array]:
    nodes = np.linspace(0.0, length, n + 1)
    q = np.column_stack([nodes, 0 * nodes, 0 * nodes + 1, 0 * nodes]).ravel()
    return belt_arrays(belt, nodes, 5), q


def tangent(arrays: BeltArrays, q: Array, stretch: float = 1.0) -> tuple[Array, Array]:
    A, f, f_stretch = np.zeros((q.size, WIDTH)), np.zeros(q.size), np.zeros(q.size)
    add_internal(arrays, q, stretch, np.zeros((*arrays.w_g.shape, 2)), 0.0, A, f, f_stretch)
    return dense(A), f


def mass(arrays: BeltArrays, n: int) -> Array:
    A = np.zeros((n, WIDTH))
    add_inertia(arrays, np.zeros(n), 1.0, A, np.zeros(n))
    return dense(A)


def test_cantilever_bends_into_the_elastica() -> None:
    """A dead load at the tip bends it by more than 60 degrees; the rod is extensible."""
    length, EA, EI, P = 0.1, 5.0e3, 0.02, 12.0  # P L^2/EI = 6

    def rod(_: Array, y: Array) -> Array:
        # theta, kappa, x, y over the stress-free length: M' = -|r'| x t_x P
        stretch = 1.0 + P * np.sin(y[0]) / EA
        return np.array(
            [y[1], -stretch * P * np.cos(y[0]) / EI, stretch * np.cos(y[0]), stretch * np.sin(y[0])]
        )

    def end(kappa_0: float) -> Array:
        way = solve_ivp(rod, (0, length), [0, kappa_0, 0, 0], "DOP853", rtol=1e-12, atol=1e-13)
        return np.asarray(way.y[:, -1])

    tip = end(brentq(lambda kappa_0: end(kappa_0)[1], 10.0, 50.0, xtol=1e-12))
    assert tip[0] > 1.1  # rad: a large rotation
    sizes, errors = [], []
    for n in (4, 8, 16, 32):
        arrays, q = straight(Belt(EA, EI, 0.1), length, n)
        free = np.setdiff1d(np.arange(q.size), [0, 1, 3])  # r fixed, direction of r' fixed
        for load in np.linspace(0.1, 1.0, 10) * P:
            for _ in range(30):
                K, f = tangent(arrays, q)
                f[-3] -= load
                step = np.linalg.solve(K[np.ix_(free, free)], -f[free])
                q[free] += step
                if np.abs(step).max() < 1e-13:
                    break
        sizes.append(length / n)
        errors.append(math.hypot(*(q[-4:-2] - tip[2:])))
    assert errors[-1] < 1e-5 * length
    assert 3.5 < fitted_rate(np.array(sizes), np.array(errors)) < 4.6


def test_frequencies_of_a_pinned_beam_converge_with_the_fourth_power() -> None:
    length, EI, rhoA = 0.5, 0.02, 0.1
    mode = np.arange(1, 4)
    exact = (mode * np.pi / length) ** 2 * math.sqrt(EI / rhoA)
    sizes, errors = [], []
    for n in (4, 8, 16):
        arrays, q = straight(Belt(1.0e5, EI, rhoA), length, n)
        K, _ = tangent(arrays, q)
        M = mass(arrays, q.size)
        across = np.setdiff1d(np.arange(q.size), [*range(0, q.size, 2), 1, q.size - 3])
        omega2 = eigh(K[np.ix_(across, across)], M[np.ix_(across, across)], eigvals_only=True)
        errors.append(np.abs(np.sqrt(omega2[:3]) / exact - 1))
        sizes.append(length / n)
    worst = np.max(errors, axis=1)
    assert worst[-1] < 1e-4
    assert 3.7 < fitted_rate(np.array(sizes), worst) < 4.3


def test_frequencies_of_a_tightened_string_with_its_little_bending_stiffness() -> None:
    """omega^2 rhoA = T (n pi/L)^2 + EI (n pi/L)^4; per reference length EI becomes EI/stretch."""
    length, EI, rhoA, T, EA = 0.5, 1.0e-5, 0.1, 270.0, 1.0e5
    stretch = 1.0 / (1.0 + T / EA)
    k = np.arange(1, 4) * np.pi / length
    exact = np.sqrt((T * k**2 + EI / stretch * k**4) / rhoA)
    sizes, errors = [], []
    for n in (8, 16, 32):
        arrays, q = straight(Belt(EA, EI, rhoA), length, n)
        K, _ = tangent(arrays, q, stretch)
        M = mass(arrays, q.size)
        across = np.setdiff1d(np.arange(q.size), [*range(0, q.size, 2), 1, q.size - 3])
        omega2 = eigh(K[np.ix_(across, across)], M[np.ix_(across, across)], eigvals_only=True)
        errors.append(np.abs(np.sqrt(omega2[:3]) / exact - 1))
        sizes.append(length / n)
    worst = np.max(errors, axis=1)
    assert worst[-1] < 1e-7
    # cubics carry the slope of a string to the third order, its energy to the sixth
    assert 5.3 < fitted_rate(np.array(sizes), worst) < 6.7


def axial_frequency(n: int) -> float:
    EA, rhoA, length = 1.0e5, 0.1, 0.5
    arrays, q = straight(Belt(EA, 0.02, rhoA), length, n)
    K, _ = tangent(arrays, q)
    M = mass(arrays, q.size)
    along = np.setdiff1d(np.arange(0, q.size, 2), [0, q.size - 4])
    return math.sqrt(
        eigh(K[np.ix_(along, along)], M[np.ix_(along, along)], eigvals_only=True)[0]
    ) / (math.pi / length * math.sqrt(EA / rhoA))


def test_axial_waves_run_at_their_speed() -> None:
    assert abs(axial_frequency(8) - 1) < 1e-6


def flight(steps: int, duration: float, damping_time: float) -> tuple[Array, Array, Array]:
    """A bent belt thrown and spun, by implicit Euler with the kernels: (2,) momenta, energies."""
    belt = Belt(1.0e3, 0.02, 0.1, damping_time)
    arrays, q = straight(belt, 0.2, 8)
    M = mass(arrays, q.size)
    dt = duration / steps
    x = q[::4]
    q_dot = np.zeros_like(q)
    q_dot[0::4], q_dot[1::4] = 0.3, -0.2 + 3.0 * (x - 0.1) + 40.0 * (x - 0.1) ** 2
    q_dot[3::4] = 3.0 + 80.0 * (x - 0.1)
    old = np.zeros((*arrays.w_g.shape, 2))
    rigid = np.zeros((q.size, 2))  # translations
    rigid[0::4, 0] = rigid[1::4, 1] = 1.0

    def energy() -> float:
        strain = np.zeros_like(old)
        store_strains(arrays, q, 1.0, strain)
        elastic = 0.5 * np.sum(arrays.w_g[..., None] * [belt.EA, belt.EI] * strain**2)
        return float(0.5 * q_dot @ M @ q_dot + elastic)

    momenta, energies = [rigid.T @ M @ q_dot], [energy()]
    for _ in range(steps):
        trial = q + dt * q_dot
        for _ in range(30):
            A, f, f_s = np.zeros((q.size, WIDTH)), np.zeros(q.size), np.zeros(q.size)
            add_internal(arrays, trial, 1.0, old, 1 / dt, A, f, f_s)
            add_inertia(arrays, trial - q - dt * q_dot, dt**-2, A, f)
            step = np.linalg.solve(dense(A), -f)
            trial += step
            if np.abs(step).max() < 1e-15:
                break
        q_dot = (trial - q) / dt
        q = trial
        store_strains(arrays, q, 1.0, old)
        momenta.append(rigid.T @ M @ q_dot)
        energies.append(energy())
    return np.array(momenta), np.array(energies), q


def test_free_flight_keeps_its_momentum_exactly() -> None:
    momenta, _, _ = flight(40, 2.0e-3, 1.0e-4)
    np.testing.assert_allclose(momenta, np.broadcast_to(momenta[0], momenta.shape), rtol=1e-9)
    # 0.2 m of 0.1 kg/m at 0.3 m/s
    assert math.isclose(momenta[0, 0], 0.02 * 0.3, rel_tol=1e-12)


def test_free_flight_loses_energy_in_proportion_to_the_time_step() -> None:
    """Without damping implicit Euler alone dissipates: first order in the step, never a gain."""
    steps = np.array([200, 400, 800])
    lost = []
    for n in steps:
        _, energies, _ = flight(int(n), 2.0e-3, 0.0)
        assert np.all(np.diff(energies) <= 1e-12 * energies[0])
        lost.append(energies[0] - energies[-1])
    assert 0.85 < -fitted_rate(steps.astype(float), np.array(lost)) < 1.15
    assert lost[-1] < 0.1 * energies[0]


def test_kelvin_voigt_damping_dissipates_more() -> None:
    _, damped, _ = flight(100, 2.0e-3, 1.0e-4)
    _, free, _ = flight(100, 2.0e-3, 0.0)
    assert np.all(np.diff(damped) <= 1e-12 * damped[0])
    assert damped[-1] < free[-1]
