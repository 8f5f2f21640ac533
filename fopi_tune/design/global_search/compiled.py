"""What the compiled parts of the search share:  the decorator, codes of quantities and objectives, tables.

This module imports Numba: import it where it is needed.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit, types
from numba.extending import models, register_model, typeof_impl

from fopi_tune.core.compiled.kept import kept, sources
from fopi_tune.quantities.objectives import ObjectiveKind

#: kinds of rows; those up to LOOP_GAIN are functions of frequency
S, T, CS, PS, LOOP_GAIN, PHASE_MARGIN, GAIN_MARGIN, DELAY_MARGIN, CROSSOVER, PHASE_SLOPE = range(10)
#: rows that only an objective needs: |ln|L|| at the nominal crossover, and the discounted error
GAIN_AT_REFERENCE, DISCOUNTED_ERROR = 10, 11
KIND_OF_QUANTITY = {
    "sensitivity_db": S,
    "complementary_sensitivity_db": T,
    "control_sensitivity_db": CS,
    "load_sensitivity_db": PS,
    "loop_gain_db": LOOP_GAIN,
    "phase_margin_deg": PHASE_MARGIN,
    "gain_margin_db": GAIN_MARGIN,
    "delay_margin_s": DELAY_MARGIN,
    "crossover_rad_s": CROSSOVER,
    "phase_slope_deg_per_decade": PHASE_SLOPE,
}
KI, IAE, S_PEAK, CS_PEAK, PS_PEAK, MARGIN_SPREAD, CROSSOVER_SPREAD, DEPTH = range(8)
CODE_OF_OBJECTIVE = {
    ObjectiveKind.KI: KI,
    ObjectiveKind.IAE_DISTURBANCE: IAE,
    ObjectiveKind.SENSITIVITY_PEAK: S_PEAK,
    ObjectiveKind.CONTROL_SENSITIVITY_PEAK: CS_PEAK,
    ObjectiveKind.LOAD_SENSITIVITY_PEAK: PS_PEAK,
    ObjectiveKind.PHASE_MARGIN_SPREAD: MARGIN_SPREAD,
    ObjectiveKind.CROSSOVER_SPREAD: CROSSOVER_SPREAD,
    ObjectiveKind.DEPTH: DEPTH,
}
#: coefficients of a numerator and of a denominator: degrees up to 8
WIDTH = 9
#: where the numbers of a plant are behind those: the delay, and a and b of 1/F = 1 + a s + b s^2
DELAY, LAG, LAG_SQUARE = 2 * WIDTH, 2 * WIDTH + 1, 2 * WIDTH + 2
COEFFICIENTS = 2 * WIDTH + 3
#: numbers of a fractional plant: behind those of the others the powers of s of its coefficients, of N, then of D
WITH_ORDERS = COEFFICIENTS + 2 * WIDTH
#: neper; stands for an infinite ln|L| in a table
END = 40.0
#: a cost or a value that does not exist
NOTHING = 1e9
#: a slack that counts as endless
ENDLESS = 9.0
#: |1 + L| stays above this, as in STABILITY_GUARD_DB
CLOSEST = 0.01


#: what Numba's own type hints of `njit` do not know
_WITHOUT_WRAPPERS: Any = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


class Compiled:
    """A function that Numba compiles when it is first needed, called by compiled code or by Python.

    Only what Python calls gets the code that unpacks Python's objects, and a place in Numba's cache: for tables of many
    arrays this is most of the work of compiling.

    Args:
        function: in the part of Python that Numba knows.
        is_entry: compiled code calls what Python calls: it is compiled once although both do.
    """

    def __init__(self, function: Callable[..., Any], is_entry: bool = False) -> None:
        functools.update_wrapper(self, function)
        self.name, self._function, self._is_entry = function.__name__, function, is_entry

    def __call__(self, *arguments: Any) -> Any:
        return self.from_python(*arguments)

    def __reduce__(self) -> str:
        # by name, so that Numba's key, which is made of it, is the same in each process
        return self.name

    @functools.cached_property
    def dispatcher(self) -> Any:
        """What compiled code calls; not made where all code comes from Numba's cache."""
        return self.from_python if self._is_entry else njit(**_WITHOUT_WRAPPERS)(self._function)

    @functools.cached_property
    def from_python(self) -> Any:
        """What Python calls."""
        return kept(self._function, _SOURCES, error_model="numpy")


class _CompiledType(types.Dispatcher):
    """Numba compiles its own functions once more for each constant that they are called with; these it does not."""

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        return super().get_call_type(context, tuple(types.unliteral(t) for t in args), kws)


register_model(_CompiledType)(models.OpaqueModel)


@typeof_impl.register(Compiled)
def _typeof_compiled(value: Compiled, _: Any) -> _CompiledType:
    return _CompiledType(value.dispatcher)


_DESIGN = Path(__file__).parents[1]
_SOURCES = sources([*_DESIGN.glob("global_search/*.py"), *_DESIGN.glob("bound/*.py")])
#: compiles a function by Numba when it is first called
compiled: Any = Compiled
#: the same for what the package's Python or several of such functions call, and keeps the code where it can
entry: Any = functools.partial(Compiled, is_entry=True)


class Sampling(NamedTuple):
    """The filter of a loop on samples in the coordinate v of `samples.py`; `half` is 0 for the continuous loop.

    `half` = omega_s Ts/2.  `corners`, shape (2 N, 3), are zeros and poles in turn: ln corner = a + b alpha + c ln
    alpha.  `matched` is 1 for matched poles and zeros.  `gain` are the ln of frequencies where the gain is set.
    `derivative` is Tf omega_s of a derivative, 0 where there is none; `order` and `rise` are the orders of integral and
    derivative beside each other (`structures.py`), and `rise_corners` those of the derivative's filter.
    """

    half: float
    corners: Any
    matched: int
    gain: Any
    derivative: float = 0.0
    order: float = 1.0
    rise: float = 1.0
    rise_corners: Any = np.zeros((0, 3))


#: of the continuous loop
NO_SAMPLES = Sampling(0.0, np.zeros((0, 3)), 0, np.zeros(4))


class Family(NamedTuple):
    """The coefficients of every plant of a box: `terms`[0] + point @ `terms`[1:], shape (1 + p, 21).

    Fractional plants have their orders beside them, shape (1 + p, 39), and so have their tables' `members`.

    Of a family by parameters each row of `terms`, shape (t, 21), is a factor of the product of powers in that row of
    `powers`, shape (t, p); other families have no `powers`.

    On samples the plant is behind a hold: `half` = omega_s Ts/2, 0 in continuous time, and `delay` in samples.
    """

    terms: Any
    half: float
    delay: float
    powers: Any


#: fields of a table that have a row for each plant, but for its points
OF_PLANTS = (
    "gain", "phase", "real", "imag", "delay", "unstable", "start_phase", "low_slope", "high_slope", "alias",
    "error_gain", "members", "late", "plant_gain",
)  # fmt: skip


class Table(NamedTuple):
    """m plants at n frequencies, scaled: omega/omega_s and P/g_s; column 0 is omega -> 0 and the last omega -> inf.

    P has the measurement filter F, where there is one.

    Fields of shape (n,): `v` = ln(omega/omega_s) and `omega`; of shape (m, n): ln|P|, arg P unwrapped with its dead
    time, and P itself; of shape (m,): the rest.  From column `alias` on, the dead time turns P by more than a radian
    between columns.  `start_phase` is arg P at s = +0, `low_slope` the exponent of omega there, `high_slope` at inf.
    `members` are the coefficients (numerator 9, denominator 9, dead time, 2 of F), shape (m, 21); `points` of the box
    (m, p).

    On samples v is that of `samples.py`, the last column is Nyquist's frequency, `delay` is 0 and `late` the whole
    samples of delay; `log_omega` = ln(omega/omega_s) is v itself in continuous time.  `filter_gain` = ln|F|, shape
    (n,), is what |C S| has to be multiplied by, whose C has no filter here; 0 without one.  `plant_gain` = ln|P|, shape
    (m, n), has none either: it is ln|P S| where |S| = 1.
    """

    v: Any
    omega: Any
    gain: Any
    phase: Any
    real: Any
    imag: Any
    delay: Any
    unstable: Any
    start_phase: Any
    low_slope: Any
    high_slope: Any
    alias: Any
    error_gain: Any
    members: Any
    points: Any
    log_omega: Any
    late: Any
    sampling: Sampling
    filter_gain: Any
    plant_gain: Any


class Rows(NamedTuple):
    """What is asked, a row each:  side (limit - value) scale >= 0, with side -1, 1, or 0 for an equality.

    Limits are natural and scaled (neper, radian; times in 1/omega_s, |C| in 1/g_s, |P| in g_s).  `first` and `last` are
    columns of a table, `low_v` and `high_v` the band itself.  `soft` rows need not hold: they only count in the depth.
    A function of frequency has the limit  limit + tilt ln(omega/omega_s) .
    """

    kind: Any
    side: Any
    limit: Any
    nominal: Any
    first: Any
    last: Any
    scale: Any
    in_depth: Any
    low_v: Any
    high_v: Any
    soft: Any
    tilt: Any


class Box(NamedTuple):
    """The ranges of the scaled kp and kd, of ki in the user's unit, and what turns the one into the other."""

    kp_low: float
    kp_high: float
    ki_low: float
    ki_high: float
    alpha_low: float
    alpha_high: float
    log_omega: float
    log_gain: float
    #: ln(T omega_s) of the horizon T
    log_horizon: float
    #: 0 without a derivative; of one with any order in the unit of mu = 1 (`structures.py`)
    kd_low: float
    kd_high: float
    #: of what decides a ray's shape, as in `structures.py`
    shape_low: float
    shape_high: float


class Work(NamedTuple):
    """Scratch arrays for one ray; rows of `controller` are ln|C0|, its real and imaginary part and its phase."""

    gain: Any
    phase: Any
    real: Any
    square: Any
    controller: Any
    #: of the order `order[0]`: real and imaginary part of (j omega)^-alpha or of its filter
    power: Any
    order: Any
    #: of the order `rise_order[0]`: real and imaginary part of a derivative or of its filter
    rise: Any
    rise_order: Any
    low: Any
    high: Any
    forbidden: Any
    allowed: Any
    cross_gain: Any
    cross_turn: Any
    cross_count: Any
    found: Any


def nominal_of(table: Table) -> Table:
    """The table of its first plant alone."""
    return table._replace(**{name: getattr(table, name)[:1] for name in (*OF_PLANTS, "points")})


def work_for(table: Table) -> Work:
    """Scratch arrays for rays on a table."""
    m, n = table.gain.shape
    most = 8 * n
    return Work(
        gain=np.empty((m, n)),
        phase=np.empty((m, n)),
        real=np.empty((m, n)),
        square=np.empty((m, n)),
        controller=np.empty((4, n)),
        power=np.empty((2, n)),
        order=np.full(1, np.nan),
        rise=np.empty((2, n)),
        rise_order=np.full(1, np.nan),
        low=np.empty(n),
        high=np.empty(n),
        forbidden=np.empty((most * 4 + 64 * m, 2)),
        allowed=np.empty((most, 2)),
        cross_gain=np.empty((m, most)),
        cross_turn=np.empty((m, most)),
        cross_count=np.zeros(m, dtype=np.int64),
        found=np.empty((64, 2)),
    )


@compiled
def order_by_first(rows, count):
    """The order in which the first `count` rows ascend in their first column."""
    return np.argsort(rows[:count, 0])
