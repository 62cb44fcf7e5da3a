"""The compiled linear algebra against NumPy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjhcmc.small_linear import inverse_of, solve_in_place, whitening


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 12), k=st.integers(1, 5))
def test_solves_like_numpy(seed, n, k):
    rng = np.random.default_rng(seed)
    A, X = rng.normal(size=(n, n)), rng.normal(size=(n, k))
    expected = np.linalg.solve(A, X)
    found = X.copy()
    solve_in_place(A.copy(), found)
    np.testing.assert_allclose(found, expected, rtol=1e-10 * np.linalg.cond(A), atol=1e-12 * np.linalg.cond(A))
    inverse = np.empty((n, n))
    inverse_of(A, inverse)
    np.testing.assert_allclose(A @ inverse, np.eye(n), atol=1e-12 * np.linalg.cond(A))


def test_rows_are_exchanged_where_a_pivot_is_zero():
    A, X = np.array([[0.0, 2.0], [3.0, 1.0]]), np.array([[4.0], [5.0]])
    solve_in_place(A.copy(), X)
    np.testing.assert_allclose(X[:, 0], [1.0, 2.0])


def test_a_singular_matrix_leaves_nan():
    X = np.ones((2, 1))
    solve_in_place(np.array([[1.0, 2.0], [2.0, 4.0]]), X)
    assert not np.isfinite(X).any()


@pytest.mark.parametrize("n", [1, 3, 8])
def test_whitening_is_the_inverse_of_the_cholesky_factor(n):
    rng = np.random.default_rng(n)
    root = rng.normal(size=(n, n))
    M = root @ root.T + np.eye(n)
    out = np.empty((n, n))
    whitening(M, out)
    np.testing.assert_allclose(out, np.linalg.inv(np.linalg.cholesky(M)), atol=1e-12)
