"""The throttle's controller:  its three specifications, and the gains that follow from them."""

from __future__ import annotations

import math

from fopi_tune.core.controller import FoPi
from fopi_tune.core.margins import margins
from fopi_tune.paper.published import (
    REJECTION_DB,
    REJECTION_RAD_S,
    THROTTLE,
    THROTTLE_GAIN,
    THROTTLE_PLANT,
    THROTTLE_POLE_RAD_S,
)
from fopi_tune.paper.table import Row, Verdict, verdict_of
from fopi_tune.paper.variants import spec, with_requirements
from fopi_tune.pipeline.prove import prove
from fopi_tune.pipeline.tune import tune
from fopi_tune.report.text.formatting import number
from fopi_tune.results.design import Design
from fopi_tune.results.status import Status

#: relative; equalities are met to 1e-6 in neper and radian, and the gains follow them with a factor of a few
_SAME = 1e-5


def throttle() -> tuple[Row, ...]:
    """The published gains against the specifications, and the gains that meet these."""
    design = tune(spec("throttle"), bracket=False)
    return (_rejection(), _margins(), _procedure(design), _closed_form(design))


def _rejection() -> Row:
    wanted = spec("throttle")
    band = next(each for each in wanted.requirements if each.quantity == "sensitivity_db")
    check = prove(with_requirements(wanted, band), THROTTLE.gains)
    (report,) = check.reports
    achieved = report.result.achieved if report.result is not None else None
    return Row(
        f"The throttle's gains reject output disturbances: |S| <= {REJECTION_DB:g} dB for omega <= "
        f"{REJECTION_RAD_S:g} rad/s",
        str(THROTTLE),
        "-" if achieved is None else f"largest |S| = {achieved:.3f} dB",
        verdict_of(check.status == "met"),
        "Proved for every frequency in the band." if check.status == "met" else "The proof refutes it.",
    )


def _margins() -> Row:
    found = margins(THROTTLE.gains, THROTTLE_PLANT)
    assert found.crossover_rad_s is not None
    assert found.phase_margin_deg is not None
    return Row(
        "The throttle's gains meet their crossover and phase margin",
        "values not printed",
        f"crossover {found.crossover_rad_s:.4f} rad/s, phase margin {found.phase_margin_deg:.2f} deg",
        Verdict.NOT_PRINTED,
        "Only |S| is printed of the three specifications.",
    )


def _procedure(design: Design) -> Row:
    gains = design.gains
    holds = design.status is Status.SOLVED and THROTTLE.agree(gains)
    return Row(
        "Solving the three specifications gives the throttle's gains",
        str(THROTTLE),
        "no gains" if gains is None else _gains(gains),
        verdict_of(holds, on_condition=True),
        "With a crossover of 0.46 rad/s and a phase margin of 88 deg, which are not printed; the tuned gains round to "
        "the printed digits.",
    )


def _closed_form(design: Design) -> Row:
    """z_c from the phase and k_p from the gain by the printed equations, with the design's alpha and specifications."""
    gains, wanted = design.gains, {r.quantity: r.limits[0] for r in design.spec.requirements}
    if gains is None:
        return Row("The printed equations give the gains", "z_c, k_p", "no gains", Verdict.DOES_NOT_HOLD, "No design.")
    omega, margin = wanted["crossover_rad_s"], math.radians(wanted["phase_margin_deg"])
    # phi, which the paper does not define, is alpha pi/2
    phi, size = 0.5 * math.pi * gains.alpha, omega**-gains.alpha
    # zc = -tan[arctan(w/p) + pm] / (w^-alpha {sin phi + cos phi tan[arctan(w/p) + pm]})
    tangent = math.tan(math.atan(omega / THROTTLE_POLE_RAD_S) + margin)
    zc = -tangent / (size * (math.sin(phi) + math.cos(phi) * tangent))
    # kp^2 + ki^2 w^-2alpha + 2 kp ki w^-alpha cos phi = (w^2 + p^2)/K^2,  ki = kp zc
    share = 1.0 + (zc * size) ** 2 + 2.0 * zc * size * math.cos(phi)
    kp = math.sqrt((omega**2 + THROTTLE_POLE_RAD_S**2) / share) / THROTTLE_GAIN
    same = math.isclose(kp, gains.kp, rel_tol=_SAME) and math.isclose(zc * kp, gains.ki, rel_tol=_SAME)
    return Row(
        "The printed equations for z_c and k_p give these gains",
        "equations for z_c and |L| = 1",
        f"z_c = {zc:.4f}, k_p = {kp:.5f}, k_i = {zc * kp:.5f}",
        verdict_of(same),
        f"With phi = alpha pi/2, which is not defined; equal to the tuned gains to {_SAME:g} (relative).",
    )


def _gains(gains: FoPi) -> str:
    return f"kp = {number(gains.kp, 4)}, ki = {number(gains.ki, 4)}, alpha = {number(gains.alpha, 4)}"
