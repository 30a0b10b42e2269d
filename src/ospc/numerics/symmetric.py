"""Symmetric matrices, such as covariances."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray


def eigh(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the increasing eigenvalues of a symmetric matrix, shape (n,), and its eigenvectors as columns, (n, n).

    For a few well-conditioned matrices, the divide-and-conquer algorithm of :func:`numpy.linalg.eigh` does not
    converge, depending on the processor: it did not for one of the covariances of a 90-second film. The slower QR
    algorithm converges for these, too.
    """
    try:
        return np.linalg.eigh(matrix)
    except np.linalg.LinAlgError:
        import scipy.linalg  # slow to import and hardly ever needed

        values, vectors = scipy.linalg.eigh(matrix, driver="ev")
        return values, vectors


def variances(rows: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the variance of each of n sums of p values, given their weights, (n, p), and the covariance, (p, p)."""
    return np.asarray(np.sum(rows @ covariance * rows, axis=1))
