"""Products of joint operators with many columns at once."""

import numpy as np
import pytest
from petsc4py import PETSc

from fenics_contact.solvers.problem import SparseMap


@pytest.mark.parametrize("columns", [1, 15, 16, 37])
def test_many_columns_at_once_are_products_of_each_bit_for_bit(columns: int) -> None:
    random = np.random.default_rng(columns)
    rows = np.where(random.random((23, 40)) < 0.3, random.normal(size=(23, 40)), 0.0)
    rows[5] = 0.0
    start = np.concatenate([[0], np.cumsum(np.count_nonzero(rows, axis=1))])
    csr = start.astype(PETSc.IntType), np.nonzero(rows)[1].astype(PETSc.IntType), rows[rows != 0.0]
    operator = SparseMap(PETSc.Mat().createAIJ(rows.shape, csr=csr, comm=PETSc.COMM_SELF))
    x = random.normal(size=(40, columns))
    dense = PETSc.Mat().createDense(x.shape, array=x, comm=PETSc.COMM_SELF)
    dense.assemble()
    found = np.full((columns, 23), np.nan)
    operator.times(dense, 1.7, found)
    product = operator.matrix.matMult(dense)
    assert np.array_equal(found, 1.7 * product.getDenseArray().T)
    assert found == pytest.approx(1.7 * (rows @ x).T, abs=1e-12)
    for matrix in (product, dense):
        matrix.destroy()
    operator.close()
