"""The mixed model against closed forms, brute force and derivatives by the complex step."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import least_squares, minimize_scalar

from beltid.errors import NumericsError
from beltid.mixed import Mixed, Own, Posterior, Shared, Size, relinearised, root

RNG = np.random.default_rng(3)
R, M = 5, 7
X, Z, U = RNG.normal(size=(R, M, 2)), RNG.normal(size=(R, M, 3)), RNG.normal(size=(R, M, 2))
ONE, Y = 1.0 + RNG.random((R, M)), RNG.normal(size=(R, M))
SD = 0.5 + RNG.random((R, M))
SCALE = 0.5 + RNG.random(R)


def stacked(blocks):
    """Diagonal of blocks (R, m, k) as one matrix (R m, R k)."""
    rows = [np.kron(np.eye(len(blocks))[r], block) for r, block in enumerate(blocks)]
    return np.vstack(rows)


def test_known_sizes_give_generalised_least_squares() -> None:
    own = [Own("noise", Size(0.7), diagonal=SD), Own("effect", Size(0.4), columns=U)]
    found = Mixed(Y, [Shared("p", X)], own, ONE, SCALE).fit()
    V = stacked(0.49 * (SD**2)[..., None] * np.eye(M) + 0.16 * U @ U.transpose(0, 2, 1))
    W = np.linalg.inv(V * np.repeat(SCALE, M))
    A = np.hstack([X.reshape(-1, 2), stacked(ONE[..., None])])
    C = np.linalg.inv(A.T @ W @ A)
    p = C @ A.T @ W @ Y.ravel()
    np.testing.assert_allclose(found.mean, p[:2], rtol=1e-10)
    np.testing.assert_allclose(found.level, p[2:], rtol=1e-10)
    np.testing.assert_allclose(found.covariance, C[:2, :2], rtol=1e-10)
    columns = -found.level_shift @ root(found.covariance)
    levels = np.diag(found.level_variance) + columns @ columns.T
    np.testing.assert_allclose(levels, C[2:, 2:], rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(columns @ root(found.covariance).T, C[2:, :2], rtol=1e-9, atol=1e-14)


def test_an_effect_is_the_same_as_columns_and_as_covariance() -> None:
    noise, y, x, z = Own("noise", Size(0.5, 2.0), diagonal=SD[0]), Y[0], X[0], Z[0]
    p = Shared("p", x)
    one = Mixed(y, [p, Shared("u", z, Size(0.8, 1.0))], [noise]).fit()
    other = Mixed(y, [p], [noise, Own("u", Size(0.8, 1.0), columns=z)]).fit()
    assert one.sizes == pytest.approx(other.sizes, rel=1e-4)
    assert one.log_evidence == pytest.approx(other.log_evidence, abs=1e-8)
    np.testing.assert_allclose(one.of("p")[0], other.mean, rtol=1e-4)
    np.testing.assert_allclose(one.of("p")[1], other.covariance, rtol=1e-3)
    # best linear unbiased prediction: u = s² Z' V^-1 (y - X p)
    s2, n2 = one.sizes["u"] ** 2, one.sizes["noise"] ** 2
    V = s2 * z @ z.T + n2 * np.diag(SD[0] ** 2)
    u = s2 * z.T @ np.linalg.solve(V, y - x @ one.of("p")[0])
    np.testing.assert_allclose(one.of("u")[0], u, rtol=1e-8)


PRIOR = RNG.normal(size=(2, 2))
PRIOR = PRIOR @ PRIOR.T + np.eye(2)
TERMS = (
    [Shared("p", X), Shared("u", U, Size(0.3, 1.0), PRIOR, mean=0.2)],
    [
        Own("noise", Size(0.6, 0.8), diagonal=SD),
        Own("effect", Size(0.4, 0.7), columns=Z),
        Own("known", Size(0.2), covariance=np.broadcast_to(0.1 * np.eye(M) + 0.3, (R, M, M))),
    ],
)


def brute_force(theta):
    """Log posterior of ln s of the terms above, with everything as one dense covariance."""
    s = np.exp(2.0 * theta)
    V = s[1] * (SD**2)[..., None] * np.eye(M) + s[2] * Z @ Z.transpose(0, 2, 1)
    V = stacked((V + 0.04 * (0.1 * np.eye(M) + 0.3)) * SCALE[:, None, None])
    u = U.reshape(-1, 2)
    V = V + s[0] * u @ np.linalg.inv(PRIOR) @ u.T
    A = np.hstack([X.reshape(-1, 2), stacked(ONE[..., None])])
    y = Y.ravel() - u @ [0.2, 0.2]
    W = np.linalg.inv(V)
    N = A.T @ W @ A
    P = W - W @ A @ np.linalg.inv(N) @ A.T @ W
    log_det = np.log(np.linalg.det(V)) + np.log(np.linalg.det(N))
    away = (theta - np.log([0.3, 0.6, 0.4])) / [1.0, 0.8, 0.7]
    return -0.5 * (log_det + y @ P @ y + away @ away)


@pytest.mark.parametrize("theta", [[-1.0, -0.5, -1.5], [0.4, 0.2, 0.3]])
def test_evidence_and_its_slope_are_those_of_brute_force(theta: list[float]) -> None:
    model = Mixed(Y, *TERMS, ONE, SCALE)
    at = np.array([*theta, np.log(0.2)])
    posterior = Posterior(model, at)
    assert posterior.log_evidence == pytest.approx(brute_force(at[:3]), rel=1e-10)
    exact = [brute_force(at[:3] + 1e-30j * np.eye(3)[i]).imag / 1e-30 for i in range(3)]
    np.testing.assert_allclose(posterior.slope[:3], exact, rtol=1e-8)


def test_the_sizes_found_are_the_largest_density_and_obey_a_limit() -> None:
    model = Mixed(Y, *TERMS, ONE, SCALE)
    best = model.fit()
    for name, s in best.sizes.items():
        if name != "known":
            for factor in (0.98, 1.02):
                assert model.at({**best.sizes, name: factor * s}).log_evidence < best.log_evidence
    noise = Own("noise", Size(0.3, 2.0, largest=0.4), diagonal=SD)
    held = Mixed(Y, TERMS[0], [noise, *TERMS[1][1:]], ONE, SCALE).fit()
    assert held.sizes["noise"] == pytest.approx(0.4)


def test_sizes_far_off_that_have_no_covariance_are_stepped_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    x, tried = np.linspace(0.0, 1.0, 40), list[float]()
    y = np.random.default_rng(3).normal(scale=0.2, size=40) + x
    line = [Shared("line", np.column_stack([np.ones(40), x]))]
    model = Mixed(y, line, [Own("noise", Size(1.0, 2.0), diagonal=np.ones(40))])
    expected = model.fit().sizes["noise"]

    def second_fails(model: Mixed, theta: np.ndarray, *ended: bool) -> Posterior:
        tried.append(float(theta[0]))
        if len(tried) == 2:
            raise NumericsError("singular")
        return Posterior(model, theta, *ended)

    monkeypatch.setattr("beltid.mixed.Posterior", second_fails)
    assert model.fit().sizes["noise"] == pytest.approx(expected, rel=1e-4)
    monkeypatch.undo()
    with pytest.raises(NumericsError, match="flat"):  # but not where it starts
        Mixed(y, [Shared("twice", np.ones((40, 2)))], model.own).fit()


def test_choices_are_averaged_with_their_probabilities() -> None:
    noise = [Own("noise", Size(0.5), diagonal=SD[0])]
    choices = ((0.01, 0.9), (2.0, 0.1))
    found = Mixed(Y[0], [Shared("u", X[0], choices=choices)], noise).fit()
    single = [Mixed(Y[0], [Shared("u", X[0], Size(s))], noise).fit() for s, _ in choices]
    w = np.array([0.9, 0.1]) * np.exp([f.log_evidence for f in single])
    assert found.log_evidence == pytest.approx(np.log(w.sum()))
    w /= w.sum()
    mean = w @ [f.mean for f in single]
    moments = [f.covariance + np.outer(f.mean, f.mean) for f in single]
    np.testing.assert_allclose(found.mean, mean)
    moment = np.tensordot(w, moments, 1)
    np.testing.assert_allclose(found.covariance + np.outer(mean, mean), moment)


def test_a_positive_coefficient_has_mode_and_evidence_of_its_density() -> None:
    x, y = np.linspace(0.2, 1.0, 30), 2.0 * np.linspace(0.2, 1.0, 30)
    noise = Own("noise", Size(0.3), diagonal=np.ones(30))
    term = Shared("a", x[:, None], Size(0.5), mean=0.4, positive=True)
    found = Mixed(y, [term], [noise]).fit()

    def log_density(q: float) -> float:
        misfit = np.sum((y - np.exp(q) * x) ** 2) / 0.09 + 30 * np.log(0.09)
        return float(-0.5 * (misfit + ((q - 0.4) / 0.5) ** 2) - np.log(0.5 * np.sqrt(2 * np.pi)))

    mode = minimize_scalar(lambda q: -log_density(q), bounds=(-1, 2), options={"xatol": 1e-10}).x
    assert found.mean[0] == pytest.approx(np.exp(mode), rel=1e-6)
    exact = quad(lambda q: np.exp(log_density(q)), -1.0, 2.0, points=[mode])[0]
    assert found.log_evidence == pytest.approx(np.log(exact), abs=0.01)


def test_the_slope_of_the_evidence_holds_with_positive_coefficients() -> None:
    positive = Shared("a", X**2, Size(0.7, 1.0), mean=[0.2, -0.4], positive=True)
    y, terms = X**2 @ [3.0, 0.2] + 0.5 * Y, [positive, Shared("u", U, Size(0.3, 1.0))]
    model = Mixed(y, terms, [Own("noise", Size(0.6, 0.8), diagonal=SD)], ONE, SCALE)
    theta, steps = np.array([0.3, -0.8, -0.6]), 1e-4 * np.eye(3)
    evidence = [[Posterior(model, theta + s * d).log_evidence for d in steps] for s in (1, -1)]
    differences = np.subtract(*evidence) / 2e-4
    np.testing.assert_allclose(Posterior(model, theta).slope, differences, rtol=1e-5, atol=1e-6)


def test_padding_tells_nothing() -> None:
    pad = [(0, 0), (0, 3)]
    own = [Own("noise", Size(0.5, 1.0), diagonal=SD), Own("effect", Size(0.4, 1.0), columns=U)]
    plain = Mixed(Y, [Shared("p", X)], own, ONE, SCALE).fit()
    own = [
        Own("noise", Size(0.5, 1.0), diagonal=np.pad(SD, pad)),
        Own("effect", Size(0.4, 1.0), columns=np.pad(U, [*pad, (0, 0)])),
    ]
    shared = [Shared("p", np.pad(X, [*pad, (0, 0)]))]
    padded = Mixed(np.pad(Y, pad), shared, own, np.pad(ONE, pad), SCALE).fit()
    assert padded.log_evidence == pytest.approx(plain.log_evidence, rel=1e-9)
    np.testing.assert_allclose(padded.level, plain.level, rtol=1e-6)


def test_a_curved_model_is_nonlinear_least_squares() -> None:
    t = np.linspace(0.0, 3.0, 40)
    y = 2.0 * np.exp(-1.3 * t) + 0.05 * RNG.normal(size=40)

    def residual(p):
        return (y - p[0] * np.exp(-p[1] * t)) / 0.05

    def build(p):
        decay = np.exp(-p[1] * t)
        J = np.column_stack([decay, -p[0] * t * decay])
        noise = Own("noise", Size(0.05), diagonal=np.ones(40))
        return Mixed(y - p[0] * decay, [Shared("p", J)], [noise])

    exact = least_squares(residual, [1.0, 1.0], xtol=1e-15)
    p, found = relinearised(build, [0.5, 0.3])
    sd = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose((p - exact.x) / sd, 0.0, atol=2e-3)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(exact.jac.T @ exact.jac), rtol=1e-2)


def test_what_the_data_do_not_determine_is_refused() -> None:
    noise = [Own("noise", Size(0.5, 1.0), diagonal=np.ones(M))]
    with pytest.raises(NumericsError, match="do not determine"):
        Mixed(Y[0], [Shared("p", np.zeros((M, 1)))], noise).fit()
