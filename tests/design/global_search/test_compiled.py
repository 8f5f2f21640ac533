"""Functions that Numba compiles:  one compilation whatever constants they get, a key that holds all their sources."""

from __future__ import annotations

import pickle

import numpy as np
from numba import types

from fopi_tune.design.global_search.compiled import Compiled, compiled, entry, order_by_first


@compiled
def power(x, n):
    """x to the power of n."""
    return x**n


@compiled
def two_powers(x, n):
    """A sum of calls with constants and with a variable."""
    return power(x, 2) + power(x, 3) + power(x, n)


def test_a_compiled_function_is_called_by_python_and_by_compiled_code() -> None:
    assert two_powers(2.0, 4) == 4.0 + 8.0 + 16.0
    assert power(3.0, 2) == 9.0


def test_constants_do_not_compile_a_function_anew() -> None:
    # not called by Python: another process may have left it compiled on disk, and then nothing is
    two_powers.dispatcher.compile((types.float64, types.int64))
    assert len(power.dispatcher.signatures) == 1


def test_a_compiled_function_is_pickled_by_its_name() -> None:
    assert pickle.loads(pickle.dumps(order_by_first)) is order_by_first
    assert isinstance(order_by_first, Compiled)


def test_a_function_that_python_calls_is_compiled_once_for_both() -> None:
    both = entry(lambda x: x + 1.0)
    assert both.dispatcher is both.from_python
    assert power.dispatcher is not power.from_python


def test_rows_are_ordered_by_their_first_column() -> None:
    rows = np.array([[3.0, 0.0], [1.0, 5.0], [2.0, 1.0], [-9.0, 0.0]])
    assert order_by_first(rows, 3).tolist() == [1, 2, 0]
