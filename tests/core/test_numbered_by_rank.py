"""Numbers of bodies by which each rank's are in a row."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fenics_contact.solvers.block_modes import numbered_by_rank

#: Nodes of every body on every rank, and the rank that has most of them.
NODES = np.array([[4, 0, 1, 6, 0], [0, 5, 3, 0, 2], [0, 0, 0, 1, 2]])
HOME = [0, 1, 1, 0, 1]


def ranks(nodes: np.ndarray) -> list[tuple[np.ndarray, range]]:
    """What every rank is told."""

    def of(rank: int) -> tuple[np.ndarray, range]:
        def gathered(mine: np.ndarray) -> list[np.ndarray]:
            assert np.array_equal(mine, nodes[rank])
            return list(nodes)

        comm = SimpleNamespace(rank=rank, size=len(nodes), allgather=gathered)
        body = np.repeat(np.arange(nodes.shape[1]), nodes[rank])
        return numbered_by_rank(comm, body, nodes.shape[1])

    return [of(rank) for rank in range(len(nodes))]


def test_bodies_of_a_rank_are_in_a_row():
    told = ranks(NODES)
    number = told[0][0]
    assert all(np.array_equal(other, number) for other, _ in told)
    assert sorted(number) == list(range(5))
    for rank, (_, mine) in enumerate(told):
        assert sorted(number[np.equal(HOME, rank)]) == list(mine)
    assert [len(mine) for _, mine in told] == [2, 3, 0]


def test_one_rank_keeps_its_numbers():
    ((number, mine),) = ranks(np.array([[1, 3, 2]]))
    assert list(number) == [0, 1, 2]
    assert mine == range(3)


@pytest.mark.parametrize("count", [2, 3])
def test_bodies_numbered_so_keep_their_numbers(count):
    nodes = NODES[:count]
    number = ranks(nodes)[0][0]
    again = np.empty_like(nodes)
    again[:, number] = nodes
    assert list(ranks(again)[0][0]) == list(range(5))
