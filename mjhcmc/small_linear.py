"""Small dense linear algebra for compiled code: quick to compile, and quicker than LAPACK at a leg's size."""

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy")
def solve_in_place(A, X):  # type: ignore[no-untyped-def]
    """Solve A Y = X by Gaussian elimination with partial pivoting: X (n, k) becomes Y, A (n, n) is used up.

    A singular A leaves infinities or NaN in X.
    """
    n, k = X.shape
    for p in range(n):
        best = p
        for i in range(p + 1, n):
            if abs(A[i, p]) > abs(A[best, p]):
                best = i
        if best != p:
            for j in range(n):
                A[p, j], A[best, j] = A[best, j], A[p, j]
            for j in range(k):
                X[p, j], X[best, j] = X[best, j], X[p, j]
        pivot = A[p, p]
        if pivot == 0.0:
            for i in range(n):
                for j in range(k):
                    X[i, j] = np.nan
            return
        for i in range(p + 1, n):
            factor = A[i, p] / pivot
            for j in range(p + 1, n):
                A[i, j] -= factor * A[p, j]
            for j in range(k):
                X[i, j] -= factor * X[p, j]
    for p in range(n - 1, -1, -1):
        for j in range(k):
            for i in range(p + 1, n):
                X[p, j] -= A[p, i] * X[i, j]
            X[p, j] /= A[p, p]


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def inverse_of(A, out):  # type: ignore[no-untyped-def]
    """Fill out (n, n) with the inverse of A (n, n), which is kept."""
    for i in range(A.shape[0]):
        for j in range(A.shape[0]):
            out[i, j] = 1.0 if i == j else 0.0
    used = np.empty_like(A)
    for i in range(A.shape[0]):
        for j in range(A.shape[0]):
            used[i, j] = A[i, j]
    solve_in_place(used, out)


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def whitening(M, out):  # type: ignore[no-untyped-def]
    """Fill out (n, n) with L^-1, where L L^T = M is the Cholesky factorization of a positive definite M (n, n)."""
    n = M.shape[0]
    L = np.zeros((n, n))
    for j in range(n):
        for k in range(j + 1):
            total = M[j, k]
            for i in range(k):
                total -= L[j, i] * L[k, i]
            L[j, k] = np.sqrt(total) if j == k else total / L[k, k]
    for c in range(n):
        for j in range(n):
            total = 1.0 if j == c else 0.0
            for i in range(j):
                total -= L[j, i] * out[i, c]
            out[j, c] = total / L[j, j]
