"""Sparse system whose matrix changes little by little, solved by its first factorisation.

The matrix A is factorised once.  What changes, D, touches some of its unknowns, and brings new ones of its own; the
touched and the new ones are the local unknowns w.  Under loads f on them

    (I + G D) w = G f,      G: the part of A^-1 that belongs to w; a new unknown has only its row of D w = f.

G grows by a solve for every touched unknown.  This is the Schur complement of the augmented matrices of Yeung, Crouch
and Pothen (2016, arXiv:1603.04479); it is dense and solved directly, as a cut through a plane model touches hundreds of
unknowns, where theirs touches thousands and iterates.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse.linalg import SuperLU

from cutenv._base.arrays import Array, Indices

_CAPACITY = 256  # local unknowns by which the matrices grow
_NEW = -1


class AugmentedSystem:
    """Changes of a factorised matrix.

    Parameters
    ----------
    factors : SuperLU
        Factorisation of the matrix, symmetric, of size ``n``.
    n : int
        Number of its unknowns.
    """

    def __init__(self, factors: SuperLU, n: int) -> None:
        self._factors, self._n = factors, n
        self._G, self._D, self._H = (np.zeros((_CAPACITY, _CAPACITY)) for _ in range(3))  # H = G D
        self._place: Indices = np.full(n, _NEW)
        self._numbers: list[int] = []
        self._solved: tuple[Array, NDArray[np.int32]] | None = None

    def __len__(self) -> int:
        return len(self._numbers)

    def copy(self) -> AugmentedSystem:
        """Return an independent copy that shares the factorisation."""
        other = object.__new__(AugmentedSystem)
        other._factors, other._n, other._solved = self._factors, self._n, self._solved
        other._G, other._D, other._H = (_enlarged(m, len(self)) for m in (self._G, self._D, self._H))
        other._place, other._numbers = self._place.copy(), list(self._numbers)
        return other

    def local(self, number: int) -> int:
        """Return the place of a touched unknown of the matrix among the local ones."""
        return int(self._place[number])

    def add_unknown(self, number: int = _NEW) -> int:
        """Return the place of a new local unknown."""
        n = len(self)
        if n == len(self._G):
            self._G, self._D, self._H = (_enlarged(m, n) for m in (self._G, self._D, self._H))
        self._numbers.append(number)
        if number == _NEW:
            self._G[n, n] = 1.0
        return n

    def touch(self, numbers: Sequence[int]) -> None:
        """Bring unknowns of the matrix among the local ones; negative numbers are passed over."""
        new = [number for number in dict.fromkeys(numbers) if number >= 0 and self._place[number] < 0]
        if not new:
            return
        first = len(self)
        for number in new:
            self._place[number] = self.add_unknown(number)
        loads = np.zeros((self._n, len(new)))
        loads[new, np.arange(len(new))] = 1.0
        known = self._known
        columns = self._factors.solve(loads)[np.array(self._numbers)[known]]
        n = len(self)
        self._G[known, first:n] = columns
        self._G[first:n, known] = columns.T
        self._H[first:n, :n] = self._G[first:n, :n] @ self._D[:n, :n]
        self._solved = None

    def change(self, unknowns: Indices, by: Array) -> None:
        """Add a matrix ``by``, shape (k, k), to the entries of k local unknowns."""
        n = len(self)
        self._D[np.ix_(unknowns, unknowns)] += by
        self._H[:n, unknowns] += self._G[:n, unknowns] @ by
        self._solved = None

    def solve(self, loads: Array) -> Array:
        """Return the local unknowns under loads on them, both of shape (n_local, k)."""
        n = len(self)
        if self._solved is None or len(self._solved[0]) != n:
            matrix = self._H[:n, :n].copy()
            known = self._known
            matrix[known, known] += 1.0
            self._solved = lu_factor(matrix, overwrite_a=True, check_finite=False)
        answer: Array = lu_solve(self._solved, self._G[:n, :n] @ loads, check_finite=False)
        return answer

    def spread(self, local: Array, loads: Array) -> Array:
        """Return all unknowns of the matrix, shape (n,), from the local ones and the loads on them, (n_local,)."""
        n, known = len(self), self._known
        push = loads - self._D[:n, :n] @ local
        whole = np.zeros(self._n)
        whole[np.array(self._numbers)[known]] = push[known]
        answer: Array = self._factors.solve(whole)
        return answer

    @property
    def _known(self) -> Indices:
        """Places of the local unknowns that the matrix has."""
        return np.flatnonzero(np.array(self._numbers) >= 0)


def _enlarged(matrix: Array, used: int) -> Array:
    larger = np.zeros((used + _CAPACITY, used + _CAPACITY))
    larger[:used, :used] = matrix[:used, :used]
    return larger
