"""Which of many parameters are quick tests: the others are slow ones."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from typing import Any

import pytest


def slow(*values: Any) -> list[Any]:
    """Parameters of the slow tests."""
    return [pytest.param(value, marks=pytest.mark.slow) for value in values]


def slow_rows(*rows: tuple[Any, ...]) -> list[Any]:
    """Rows of several parameters of the slow tests."""
    return [pytest.param(*row, marks=pytest.mark.slow) for row in rows]


def quick(names: Iterable[str], *chosen: str) -> Iterator[Any]:
    """Parameters of which the chosen ones are quick."""
    for name in names:
        yield pytest.param(name, marks=[] if name in chosen else pytest.mark.slow)


def each_once(*columns: Sequence[Any]) -> list[Any]:
    """All combinations of the columns' values, of which few are quick: each value is in one."""
    sizes = [len(column) for column in columns]
    chosen = {tuple(k % size for size in sizes) for k in range(max(sizes))}
    return [
        pytest.param(
            *(column[k] for column, k in zip(columns, places, strict=True)),
            marks=[] if places in chosen else pytest.mark.slow,
        )
        for places in product(*map(range, sizes))
    ]


def some(values: Sequence[Any], every: int) -> list[Any]:
    """Parameters of which one in so many is quick, from the first on."""
    return [
        pytest.param(value, marks=pytest.mark.slow if k % every else [])
        for k, value in enumerate(values)
    ]
