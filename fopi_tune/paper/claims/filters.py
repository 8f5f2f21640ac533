"""The digital filters:  what the printed coefficients approximate, and whether they are stable."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Complex
from fopi_tune.core.controller import FoPi
from fopi_tune.digital import discretize
from fopi_tune.digital.discretize import DigitalController
from fopi_tune.digital.realise import Form, Precision
from fopi_tune.paper.published import FILTERS, SAMPLE_TIME_S, PublishedFilter
from fopi_tune.paper.table import Row, verdict_of
from fopi_tune.paper.variants import spec

#: relative; b0 agrees with a limit up to this
_CLOSE = 0.05
#: digits that most printed coefficients have
_DIGITS = 4
#: z - 1; an integrator's gain is unbounded as z -> 1
_NEAR_ONE = (1e-3, 1e-6)
#: of the largest output, in float32
_LOST = 1e-5
_POLES = 7


def filters() -> tuple[Row, ...]:
    """The printed filters of both controllers, and the tool's."""
    printed = FILTERS.values()
    return (
        *(_order_of(each) for each in printed),
        *(_poles_of(each) for each in printed),
        _rounded(),
        _integrator(),
        _eighth_order(),
        _parallel_sections(),
    )


def published_response(found: PublishedFilter, omega: NDArray[np.float64]) -> Complex:
    """R_d(e^{j omega Ts}) of the printed coefficients."""
    inverse = np.exp(-1j * omega * SAMPLE_TIME_S)
    return np.asarray(np.polyval(found.b[::-1], inverse) / np.polyval(found.a[::-1], inverse), dtype=complex)


def published_poles(found: PublishedFilter) -> Complex:
    """Roots of z^7 + a_1 z^6 + ... + a_7."""
    return np.asarray(np.roots(found.a), dtype=complex)


def tool_filter(name: str, gains: FoPi) -> DigitalController:
    """The tool's filter for the same band, poles, rule and sample time."""
    digital = spec(name).digital
    assert digital is not None
    return discretize(gains, digital)


def _order_of(found: PublishedFilter) -> Row:
    """b_0 shows the order: Tustin's s^m is ((2/Ts)(z - 1)/(z + 1))^m, whose limit for z -> inf, (Ts/2)^-m, is b_0."""
    alpha = found.of.alpha.value
    half = 0.5 * SAMPLE_TIME_S
    stated, other = half ** -(1.0 - alpha), half**alpha
    gain = np.abs(published_response(found, np.array([1.0, 10.0])))
    errors = [abs(found.b[0] / limit - 1.0) for limit in (stated, other)]
    holds = errors[0] < _CLOSE and gain[1] > gain[0]
    said = "approximates s^-alpha itself" if errors[1] < _CLOSE and gain[1] < gain[0] else "approximates neither"
    return Row(
        f"The {found.name}'s R_d approximates s^(1 - alpha) = s^{1.0 - alpha:.2g}",
        f"b0 = {found.b[0]:g}",
        f"b0 of s^(1 - alpha) would be (Ts/2)^(alpha - 1) = {stated:.4f}, of s^-alpha (Ts/2)^alpha = {other:.4f}; "
        f"|R_d| = {gain[0]:.3f} at 1 rad/s and {gain[1]:.3f} at 10 rad/s",
        verdict_of(holds),
        f"R_d {said}: b0 within {_CLOSE:.0%} of its limit, and |R_d| falls with the frequency.",
    )


def _poles_of(found: PublishedFilter) -> Row:
    poles = published_poles(found)
    outside = sorted((p for p in poles if abs(p) > 1.0), key=lambda p: -abs(p))
    said = " and ".join(f"{p.real:.4f}" if p.imag == 0.0 else f"|z| = {abs(p):.4f}" for p in outside)
    return Row(
        f"The {found.name}'s filter runs with the printed coefficients",
        f"a1 = {found.a[1]:g}, ..., a7 = {found.a[7]:g}",
        f"poles outside the unit circle: {said}" if outside else "all poles inside the unit circle",
        verdict_of(not outside),
        "Roots of the printed denominator. Four digits do not hold a seventh-order polynomial whose roots crowd at 1.",
    )


def _rounded() -> Row:
    """Rounding to four digits makes a stable filter unstable too."""
    gains = FILTERS["throttle"].of.gains
    made = tool_filter("throttle", gains)
    # the first pole is the true integrator, at exactly 1
    fractional = np.array(made.sections.poles[1:])
    polynomial = np.poly(fractional)
    rounded = np.array([float(f"{c:.{_DIGITS}g}") for c in polynomial])
    before, after = float(np.abs(fractional).max()), float(np.abs(np.roots(rounded)).max())
    return Row(
        f"{_DIGITS} digits are enough for such a filter's polynomial",
        f"{_DIGITS} digits",
        f"largest |pole| of the tool's own {len(fractional)}-pole filter: {before:.4f}; with its polynomial rounded to "
        f"{_DIGITS} digits {after:.3f}",
        verdict_of(after < 1.0),
        "The tool therefore delivers first-order sections in parallel.",
    )


def _integrator() -> Row:
    """C(z) = kp + ki ((1 - z^-1)/Ts) s^(1-alpha) near z = 1, with the exact s^(1-alpha), which is 0 at z = 1."""
    gains = FILTERS["throttle"].of.gains
    printed, meant = [], []
    for beyond in _NEAR_ONE:
        z = 1.0 + beyond
        fractional = (2.0 / SAMPLE_TIME_S * (z - 1.0) / (z + 1.0)) ** (1.0 - gains.alpha)
        difference = (1.0 - 1.0 / z) / SAMPLE_TIME_S
        printed.append(gains.kp + gains.ki * difference * fractional)
        meant.append(gains.kp + gains.ki / difference * fractional)
    return Row(
        "C(z) = kp + ki ((1 - 1/z)/Ts) R_d(z) preserves the integral effect",
        "(1 - 1/z)/Ts",
        f"throttle at z = 1 + 1e-3 and 1 + 1e-6: {printed[0]:.4f} and {printed[1]:.4f} as printed, {meant[0]:.2f} and "
        f"{meant[1]:.1f} with Ts/(1 - 1/z)",
        verdict_of(printed[1] > 2.0 * printed[0]),
        "Inverted: an integrator is Ts/(1 - 1/z). Taken with the exact s^(1 - alpha); preserved: it grows "
        "towards z = 1.",
    )


def _eighth_order() -> Row:
    orders = [len(tool_filter(name, found.of.gains).sections.poles) for name, found in FILTERS.items()]
    return Row(
        "The controllers are 8th-order IIR filters",
        "8th order",
        f"{orders[0]} and {orders[1]} poles: {_POLES} and the integrator",
        verdict_of(orders == [_POLES + 1] * 2),
        "7 poles and 7 zeros for the fractional part, Tustin's rule at 0.2 s, band 1e-3 to 1e3 rad/s.",
    )


def _parallel_sections() -> Row:
    low, high, lost, stable = 0.0, np.inf, 0.0, True
    for name, found in FILTERS.items():
        made = tool_filter(name, found.of.gains)
        ends = made.accurate_rad_s or (np.inf, 0.0)
        low, high = max(low, ends[0]), min(high, ends[1])
        parallel = [r for r in made.realisations if r.form is Form.PARALLEL]
        stable = stable and all(r.stable for r in parallel)
        lost = max(lost, *(r.error for r in parallel if r.precision is Precision.FLOAT32))
    good = stable and lost < _LOST
    return Row(
        "Such filters can be run at 0.2 s",
        "direct form, 4 digits",
        f"parallel sections: |C_d/C - 1| <= 5 % from {low:.2g} to {high:.2g} rad/s, float32 costs "
        f"{'less than' if good else 'more than'} {_LOST:g}",
        verdict_of(good and low < high, on_condition=True),
        "As a true integrator and first-order sections in parallel, with s^(1 - alpha) by Oustaloup's filter.",
    )
