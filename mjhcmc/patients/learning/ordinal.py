"""Ordinal logistic regression: proportional odds with an L2 penalty.

P(y <= k | x) = sigma(theta_k - x . beta), theta_1 < theta_2 < ... (McCullagh 1980,
doi:10.1111/j.2517-6161.1980.tb01109.x).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import SettingsError

Array = NDArray[np.float64]


class OrdinalLogistic:
    """Proportional odds; minimises -sum log P(y_i | x_i) + penalty/2 |beta|^2, thresholds free.

    Grades that training lacks get probability 0. Two grades make it logistic regression.

    Attributes:
        penalty: weight of |beta|^2/2 against the summed log likelihood.
        classes: (n_class,) int, the grades of training, rising.
        coefficients: (n_feature,) beta.
        thresholds: (n_class - 1,) theta, rising.
    """

    def __init__(self, penalty: float = 1.0) -> None:
        if not (np.isfinite(penalty) and penalty >= 0):
            raise SettingsError(f"penalty must be finite and not negative; got {penalty}")
        self.penalty = float(penalty)
        self.classes: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self.coefficients: Array = np.zeros(0)
        self.thresholds: Array = np.zeros(0)

    def fit(self, x: ArrayLike, y: ArrayLike) -> OrdinalLogistic:
        """Find coefficients and thresholds by L-BFGS.

        Args:
            x: (n, n_feature), standardised.
            y: (n,) int grades.

        Returns:
            Itself.

        Raises:
            SettingsError: fewer than two grades, values that are not finite, lengths that differ.
        """
        from scipy.optimize import minimize

        x = np.asarray(x, dtype=np.float64)
        grades = np.asarray(y, dtype=np.int64)
        if x.ndim != 2 or grades.shape != x.shape[:1]:
            raise SettingsError(f"x must be (n, features) and y (n,); got {x.shape} and {grades.shape}")
        if not np.isfinite(x).all():
            raise SettingsError("x holds values that are not finite: fill in what is missing first")
        self.classes, rank = np.unique(grades, return_inverse=True)
        n_class = len(self.classes)
        if n_class < 2:
            raise SettingsError(f"ordinal regression needs two grades or more; got {self.classes.tolist()}")
        below = np.cumsum(np.bincount(rank))[:-1] / len(rank)
        theta = np.log(below / (1 - below))
        start = np.concatenate([theta[:1], np.log(np.diff(theta)), np.zeros(x.shape[1])])
        found = minimize(
            self._loss, start, (x, rank, n_class), "L-BFGS-B", True, options={"maxiter": 1000, "ftol": 1e-11}
        )
        self.thresholds = _thresholds(found.x[: n_class - 1])
        self.coefficients = found.x[n_class - 1 :]
        return self

    def linear(self, x: ArrayLike) -> Array:
        """The score x . beta, (n,): the higher, the higher the grade."""
        return np.asarray(np.asarray(x, dtype=np.float64) @ self.coefficients)

    def predict_proba(self, x: ArrayLike) -> Array:
        """P(y = class | x), (n, n_class) in the order of `classes`."""
        score = self.linear(x)[:, None]
        below = _sigmoid(self.thresholds[None, :] - score)
        edges = np.concatenate([np.zeros_like(score), below, np.ones_like(score)], axis=1)
        return np.diff(edges, axis=1)

    def predict(self, x: ArrayLike) -> NDArray[np.int64]:
        """The most likely grade, (n,)."""
        return np.asarray(self.classes[np.argmax(self.predict_proba(x), axis=1)])

    def _loss(self, w: Array, x: Array, rank: NDArray[np.int64], n_class: int) -> tuple[float, Array]:
        """What is minimised, and its gradient in (theta_1, log of increments, beta)."""
        theta, beta = _thresholds(w[: n_class - 1]), w[n_class - 1 :]
        edges = np.concatenate([[-np.inf], theta, [np.inf]])
        score = x @ beta
        a, b = edges[rank] - score, edges[rank + 1] - score
        # sigma(b) - sigma(a) = sigma(b) sigma(-a) (1 - e^(a - b)): exact in the tails too
        with np.errstate(over="ignore", divide="ignore"):
            gap = np.maximum(b - a, 1e-300)
            logp = _log_sigmoid(b) + _log_sigmoid(-a) + np.log(-np.expm1(-gap))
            between = 1.0 / np.expm1(gap)
        to_b, to_a = _sigmoid(-b) + between, -_sigmoid(a) - between
        by_edge = np.bincount(rank + 1, to_b, n_class + 1) + np.bincount(rank, to_a, n_class + 1)
        by_theta = by_edge[1:-1]
        increments = np.cumsum(by_theta[::-1])[::-1]  # theta_k holds every increment up to k
        by_w = np.concatenate([increments[:1], increments[1:] * np.exp(w[1 : n_class - 1])])
        gradient = np.concatenate([-by_w, x.T @ (to_a + to_b) + self.penalty * beta])
        return float(-logp.sum() + 0.5 * self.penalty * beta @ beta), gradient


def _thresholds(w: Array) -> Array:
    """Rising thresholds from the first and the logarithms of the steps."""
    return np.cumsum(np.concatenate([w[:1], np.exp(w[1:])]))


def _log_sigmoid(z: Array) -> Array:
    return -np.logaddexp(0.0, -z)


def _sigmoid(z: Array) -> Array:
    from scipy.special import expit

    return np.asarray(expit(z))
