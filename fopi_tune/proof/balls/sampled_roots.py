"""Closed-loop poles of one sampled loop outside the unit circle, counted by the roots of its characteristic polynomial.

Source: derived; zeros in w = (z - 1)/(z + 1) with Re w > 0 are poles with |z| > 1.
"""

from __future__ import annotations

from collections.abc import Sequence

from flint import acb, acb_poly, arb, arb_poly, ctx

from fopi_tune.proof.balls.argument_principle import count_right_half_plane_zeros
from fopi_tune.proof.balls.plant import PlantEnclosure
from fopi_tune.proof.balls.sampled import SampledBallLoop
from fopi_tune.proof.balls.sampled_controllers import Sections

#: for more closed-loop poles than this they are counted by the argument principle, not computed
MOST_ROOTS = 40
#: bits for a polynomial's roots
_ROOT_PRECISION = 256


def count_unstable_roots(loop: SampledBallLoop, theta: Sequence[float]) -> int | None:
    """Closed-loop poles outside the unit circle of one plant, from the roots in w of

        (1 + w)^late prod_k (w + sigma_k) D(w) + C(w) prod_k (w + sigma_k) N(w) (1 - w)^late ,

    or, where these are many or coincide, by the argument principle.

    Returns:
        The number; None when a root cannot be separated from the circle.
    """
    with ctx.workprec(_ROOT_PRECISION):
        plant = loop.plant([arb(value) for value in theta])
        sections = loop.compute_sections()
        if plant.late + len(plant.denominator) + len(sections[1]) <= MOST_ROOTS:
            count = _count_by_roots(sections, plant)
            if count is not None:
                return count
    return count_right_half_plane_zeros(loop, loop.plant([arb(value) for value in theta]), loop.has_integrator)


def _count_by_roots(sections: Sections, plant: PlantEnclosure) -> int | None:
    bottom = arb_poly([c.value for c in reversed(plant.denominator)])
    for sigma, _ in sections[1]:
        bottom = bottom * arb_poly([sigma, 1])
    top = arb_poly([plant.gain.value * c.value for c in reversed(plant.numerator)]) * _numerator_of(sections)
    polynomial = bottom * arb_poly([1, 1]) ** plant.late + top * arb_poly([1, -1]) ** plant.late
    return _right_roots(_coefficients_of(polynomial))


def _right_roots(coefficients: list[arb]) -> int | None:
    """Roots with Re w > 0 of a polynomial, ascending powers."""
    # a root at w = 0 is one at z = 1, a root at w = infinity one at z = -1
    ends = (coefficients[0], coefficients[-1]) if coefficients else ()
    if not ends or not all(c.is_finite() for c in coefficients) or any(end.contains(0) for end in ends):
        return None
    if len(coefficients) == 1:
        return 0
    try:
        roots = acb_poly([acb(c) for c in coefficients]).roots()
    except ValueError:
        # coinciding roots, as those of a fast filter at z = 0, cannot be isolated
        return None
    return None if any(root.real.contains(0) for root in roots) else sum(bool(root.real > 0) for root in roots)


def _numerator_of(sections: Sections) -> arb_poly:
    """C(w) prod_k (w + sigma_k)."""
    direct, pairs = sections
    top = arb_poly([direct])
    for sigma, _ in pairs:
        top = top * arb_poly([sigma, 1])
    for k, (_, rho) in enumerate(pairs):
        part = arb_poly([rho])
        for i, (sigma, _) in enumerate(pairs):
            part = part * arb_poly([sigma, 1]) if i != k else part
        top = top + part
    return top


def _coefficients_of(polynomial: arb_poly) -> list[arb]:
    """Ascending powers."""
    return [polynomial[i] for i in range(polynomial.length())]
