"""C on samples over intervals of frequencies, in ball arithmetic, with its derivatives and the delay z^-late.

With z = (1 + w)/(1 - w), w = j nu, u = ln nu,

    C(w) = d + sum_k rho_k/(w + sigma_k),   sigma_k = (1 - p_k)/(1 + p_k),  rho_k = 2 r_k/(1 + p_k)^2,
                                            d = direct - sum_k r_k/(1 + p_k) .                                      (1)

Source: derived; C(z) with z = (1 + w)/(1 - w), section by section.
"""

from __future__ import annotations

from flint import acb, arb

from fopi_tune.core.parallel_form import Implementation
from fopi_tune.proof.balls.box import Interval
from fopi_tune.proof.balls.computed_once import computed_once
from fopi_tune.proof.balls.controllers import ControllerOnInterval, LoopParameters

#: d and (sigma_k, rho_k) of (1)
Sections = tuple[arb, tuple[tuple[arb, arb], ...]]


def sections_of(implementation: Implementation) -> Sections:
    """Formula (1) at the current precision."""
    sections = implementation.sections
    direct, pairs = arb(sections.direct), []
    for pole, residue in zip(sections.poles, sections.residues, strict=True):
        above = 1 + arb(pole)
        direct = direct - arb(residue) / above
        pairs.append(((1 - arb(pole)) / above, 2 * arb(residue) / (above * above)))
    return direct, tuple(pairs)


def has_integrator(sections: Sections) -> bool:
    """Whether C has a pole at z = 1."""
    return any(sigma.is_zero() for sigma, _ in sections[1])


def value_and_derivative(sections: Sections, w: acb) -> tuple[acb, acb]:
    """C and dC/du, u = ln nu, at w = j nu."""
    direct, pairs = sections
    value, slope = acb(direct), acb(0)
    for sigma, rho in pairs:
        part = 1 / (w + sigma)
        # a complex number times a real one: the other order costs seven times as much
        term = part * rho
        value, slope = value + term, slope - w * part * term
    return value, slope


def value_far_up(sections: Sections, inverse: acb) -> acb:
    """C at w = 1/t:  rho/(w + sigma) = rho t/(1 + sigma t)."""
    direct, pairs = sections
    return acb(direct) + sum((inverse * rho / (1 + inverse * sigma) for sigma, rho in pairs), acb(0))


class SampledControllerOnInterval(ControllerOnInterval):
    """C over one interval of frequencies on samples; `omega` and `s` are nu and w.

    Args:
        loop: the controller.
        u: the interval of ln nu, possibly a tail.
        sections: of C.
    """

    def __init__(self, loop: LoopParameters, u: Interval, sections: Sections) -> None:
        super().__init__(loop, u)
        self.sections = sections
        self._has_integrator = has_integrator(sections)
        self._turns: dict[int, tuple[acb, acb]] = {}

    @computed_once
    def c(self) -> acb:
        """The factor c of the controller; w C(w) in the low tail of a loop with an integrator."""
        direct, pairs = self.sections
        w = self.s
        if self.high_tail:
            return value_far_up(self.sections, w)
        if not self.low_tail or not self._has_integrator:
            return acb(direct) + sum((acb(rho) / (w + sigma) for sigma, rho in pairs), acb(0))
        rest = sum((rho / (w + sigma) for sigma, rho in pairs if not sigma.is_zero()), acb(direct))
        return w * rest + sum((rho for sigma, rho in pairs if sigma.is_zero()), arb(0))

    @computed_once
    def x(self) -> acb | None:
        """w in the low tail of a loop with an integrator; None is 1."""
        return self.s if self.low_tail and self._has_integrator else None

    @computed_once
    def value_and_derivative(self) -> tuple[acb, acb]:
        """C and dC/du; not in a tail."""
        return value_and_derivative(self.sections, self.s)

    @computed_once
    def controller_slope(self) -> acb:
        """d ln C/du."""
        value, slope = self.value_and_derivative
        return slope / value

    @computed_once
    def controller_curvature(self) -> acb:
        """d2 ln C/du2; not in a tail:  d2/du2 rho/(w + sigma) = -rho w/(w + sigma)^2 (1 - 2 w/(w + sigma))."""
        w, (_, pairs) = self.s, self.sections
        value, slope = self.value_and_derivative
        second = acb(0)
        for sigma, rho in pairs:
            part = 1 / (w + sigma)
            second = second - w * rho * part * part * (1 - 2 * w * part)
        return second / value - (slope / value) ** 2

    @computed_once
    def is_beyond_one(self) -> bool:
        """Whether |w| > 1."""
        return bool(self.omega > 1)

    @computed_once
    def inverse(self) -> acb:
        """1/w."""
        return 1 / self.s

    def turn(self, late: int) -> tuple[acb, acb]:
        """z^-late, in the high tail but for its sign, and d ln z^-late/du = -2j late nu/(1 + nu^2)."""
        if late not in self._turns:
            nu = self.omega
            angle, sign = 2 * late * nu.atan(), 1 if self.high_tail else -1
            self._turns[late] = acb(angle.cos(), sign * angle.sin()), acb(0, -2 * late / (nu + 1 / nu))
        return self._turns[late]
