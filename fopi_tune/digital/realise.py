"""Realisations of a digital controller and their rounding errors:  parallel, second-order sections, CMSIS-DSP.

Each form, rounded to the target's precision, is compared with the parallel form in float64 on the same input; its error
is relative to the largest output.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.parallel_form import Sections
from fopi_tune.core.sampled_loops import zeros_and_poles
from fopi_tune.errors import DomainError

Matrix = NDArray[np.float64]


class Precision(StrEnum):
    """Floating-point format of the target."""

    FLOAT64 = "float64"
    FLOAT32 = "float32"

    @property
    def dtype(self) -> type[np.floating]:
        """NumPy's type."""
        return np.float64 if self is Precision.FLOAT64 else np.float32

    @property
    def flush_below(self) -> float:
        """F, below which a state at rest becomes 0:  smallest normal number/eps, 2^-970 in float64, 2^-103 in float32.

        The last place of a state that is left is a normal number.
        """
        limits = np.finfo(self.dtype)
        return float(limits.smallest_normal) / float(limits.eps)

    @property
    def absorbs_flushed(self) -> float:
        """4 F/eps:  a number of this size or more plus one below F is the number itself, bit for bit."""
        # half of the gap below a power of two b is eps b/4
        return 4.0 * self.flush_below / float(np.finfo(self.dtype).eps)


class Form(StrEnum):
    """Filter structure."""

    PARALLEL = "parallel"
    SECOND_ORDER = "second_order"
    CMSIS = "cmsis"


@dataclass(frozen=True)
class Realisation:
    """A form in a precision with its measured error.

    Args:
        form: layout.
        precision: of coefficients, states and arithmetic.
        coefficients: parallel: rows (pole, residue) after a first row (0, direct); second-order: SciPy's
            {b0, b1, b2, 1, a1, a2} a row; CMSIS-DSP: {b0, b1, b2, -a1, -a2} a row.
        error: largest error over the largest output; inf when it diverges.
        stable: whether the rounded poles stay inside the unit circle (the integrator's on it).
    """

    form: Form
    precision: Precision
    coefficients: tuple[tuple[float, ...], ...]
    error: float
    stable: bool


def realise(sections: Sections, form: Form, precision: Precision, inputs: Array) -> Realisation:
    """Round a controller to a form and measure the error.

    Args:
        sections: the controller.
        form: layout.
        precision: of coefficients, states and arithmetic.
        inputs: shape (n,), the test input.
    """
    reference = run_parallel(sections, inputs, Precision.FLOAT64)
    if form is Form.PARALLEL:
        rows = parallel_rows(sections, precision)
        outputs, stable = run_parallel(sections, inputs, precision), _poles_inside(sections, rows[1:, 0])
    else:
        table = second_order_sections(sections).astype(precision.dtype)
        outputs, stable = run_second_order(table, inputs, precision), _table_stable(table)
        cmsis = np.hstack([table[:, :3], -table[:, 4:]])
        rows = cmsis if form is Form.CMSIS else table
    with np.errstate(invalid="ignore", over="ignore"):
        error = float(np.abs(outputs - reference).max() / np.abs(reference).max())
    coefficients = tuple(tuple(float(value) for value in row) for row in rows)
    return Realisation(form, precision, coefficients, error if np.isfinite(error) else np.inf, stable)


def checked_realisation(realisation: Realisation, tolerance: float) -> Realisation:
    """The realisation, if its error is within a tolerance.

    Raises:
        DomainError: a rounded pole left the unit disc, or the error exceeds the tolerance.
    """
    what = f"the {realisation.form.value} form in {realisation.precision.value}"
    parallel = realisation.form is Form.PARALLEL
    advice = (
        "raise the lower end of the band, or take fewer poles or a longer sample time" if parallel else "use parallel"
    )
    if not realisation.stable:
        raise DomainError(f"{what} has a pole outside the unit circle after rounding; {advice}")
    if not realisation.error <= tolerance:
        raise DomainError(f"{what} errs by {realisation.error:.2g}, more than {tolerance:.2g}; {advice}")
    return realisation


def parallel_rows(sections: Sections, precision: Precision) -> NDArray[np.floating]:
    """(0, direct), then (pole, residue) a section, rounded."""
    rows = [(0.0, sections.direct), *zip(sections.poles, sections.residues, strict=True)]
    return np.array(rows).astype(precision.dtype)


def run_parallel(sections: Sections, inputs: Array, precision: Precision) -> Array:
    """y = direct e + sum x_k,  x_k <- p_k x_k + r_k e  after each sample, all in the precision; shape (n,)."""
    dtype = precision.dtype
    rows = parallel_rows(sections, precision)
    direct, poles, residues = rows[0, 1], rows[1:, 0], rows[1:, 1]
    states = np.zeros(len(poles), dtype=dtype)
    outputs = np.empty(len(inputs))
    for k, value in enumerate(inputs.astype(dtype)):
        total = direct * value
        for state in states:
            total = dtype(total + state)
        outputs[k] = total
        states = (poles * states + residues * value).astype(dtype)
    return outputs


def second_order_sections(sections: Sections) -> Matrix:
    """SciPy's layout, from zeros, poles and gain; shape (m, 6)."""
    from scipy.signal import zpk2sos

    zeros, poles, gain = zeros_poles_gain(sections)
    table = np.asarray(zpk2sos(zeros, poles, gain), dtype=float)
    for _ in range(len(poles) - len(zeros)):
        # SciPy uses powers of 1/z, so that every zero fewer than poles loses one sample of delay: it is restored in a
        # section whose last coefficient is free
        row = int(np.argmin(np.abs(table[:, 2])))
        table[row, :3] = 0.0, *table[row, :2]
    return table


def zeros_poles_gain(sections: Sections) -> tuple[NDArray[np.complex128], Array, float]:
    """The zeros as eigenvalues of the sections' own state space: no polynomial is formed."""
    poles, residues = np.array(sections.poles), np.array(sections.residues)
    if sections.direct == 0.0:
        shifted, _, leading = zeros_and_poles(sections)
        return shifted + 1.0, poles, leading
    if not len(poles):
        return np.zeros(0, dtype=complex), poles, sections.direct
    # y = c x + d e with x+ = A x + b e:  zeros are the eigenvalues of A - b c/d
    zeros = np.linalg.eigvals(np.diag(poles) - np.outer(residues, np.ones(len(poles))) / sections.direct)
    return zeros.astype(complex), poles, sections.direct


def run_second_order(table: NDArray[np.floating], inputs: Array, precision: Precision) -> Array:
    """A cascade of transposed direct forms II, sample by sample in the precision; shape (n,)."""
    dtype = precision.dtype
    states = np.zeros((len(table), 2), dtype=dtype)
    outputs = np.empty(len(inputs))
    b, a = table[:, :3].astype(dtype), table[:, 4:].astype(dtype)
    with np.errstate(over="ignore", invalid="ignore"):
        for k, sample in enumerate(inputs.astype(dtype)):
            value = sample
            for i in range(len(table)):
                result = dtype(b[i, 0] * value + states[i, 0])
                states[i, 0] = dtype(dtype(b[i, 1] * value - a[i, 0] * result) + states[i, 1])
                states[i, 1] = dtype(b[i, 2] * value - a[i, 1] * result)
                value = result
            outputs[k] = value
    return outputs


def _poles_inside(sections: Sections, rounded: NDArray[np.floating]) -> bool:
    """Whether only the integrator's pole is on the unit circle."""
    integrates = sections.poles[:1] == (1.0,)
    return bool(np.all(np.abs(rounded[int(integrates) :]) < 1.0))


def _table_stable(table: NDArray[np.floating]) -> bool:
    """Poles of every rounded section inside, or on the circle at exactly 1 once (the integrator)."""
    at_one = 0
    for _, _, _, _, a1, a2 in np.asarray(table, dtype=float):
        for root in np.roots([1.0, a1, a2]):
            size = abs(root)
            if abs(root - 1.0) < 1e-9:
                at_one += 1
            elif size >= 1.0:
                return False
    return at_one <= 1
