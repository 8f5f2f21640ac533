"""From gains to a digital controller:  gains and the spec's digital section -> DigitalController.

The result holds the sum of first-order sections, its error against C(j omega), and its realisations in the forms and
precisions that targets use, also as JSON.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi, FoPid, derivative_of, refuse_zero_gains, structure_of
from fopi_tune.core.parallel_form import Sections
from fopi_tune.digital.coefficients import SampledFilter
from fopi_tune.digital.fit import FIT_UP_TO, fit
from fopi_tune.digital.oustaloup import ZeroPoleGain, modified_oustaloup, oustaloup
from fopi_tune.digital.realise import Form, Precision, Realisation, checked_realisation, realise
from fopi_tune.digital.transforms import matched, tustin, with_derivative
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import DigitalSpec

_FREQUENCIES = 600
#: samples of the test input for realisations
_SAMPLES = 2000
#: largest relative error of the parallel form in float32
_TOLERANCE = 1e-3
#: relative error that counts as accurate
_ACCURATE = 0.05
#: the measurement filter among the terms whose errors are stated
FILTER_TERM = "measurement filter"
#: shares of the Nyquist frequency up to which the error is stated
_PARTS = (0.1, FIT_UP_TO, 1.0)
#: the filter has to be accurate from this share of the gain crossover on
_BELOW_CROSSOVER = 0.01
#: the suggested band extends by this factor below and above the crossover, as the default does for 1 rad/s
_SUITABLE = 1e3


class Method(StrEnum):
    """How s^-alpha is approximated; the value is the word in the spec."""

    OUSTALOUP = "oustaloup"
    MODIFIED_OUSTALOUP = "modified_oustaloup"
    FIT = "fit"


class Rule(StrEnum):
    """How a continuous approximation is sampled; the value is the word in the spec."""

    TUSTIN = "tustin"
    MATCHED = "matched"


#: s^-alpha as zeros, poles and gain, from alpha, number of poles and band; `fit` approximates on samples instead
APPROXIMATIONS: dict[Method, Callable[[float, int, tuple[float, float]], ZeroPoleGain]] = {
    Method.OUSTALOUP: oustaloup,
    Method.MODIFIED_OUSTALOUP: modified_oustaloup,
}


#: (frequency in rad/s, largest relative error up to it), ascending
Errors = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class DigitalController:
    """A controller that runs on samples.

    Args:
        gains: of the ideal controller.
        digital: the spec's section.
        sections: the filter; without an integrator if ki = 0.
        errors: (frequency in rad/s, largest |C_d/C - 1| from `errors_from_rad_s` up to it), ascending.
        errors_of_terms: of structure fopid the same of the integral and of the derivative, each against its own ideal;
            of a measurement filter too.
        accurate_rad_s: the range around the band's middle in which |C_d/C - 1| is at most 5 %; None where it is larger
            in the middle itself.
        realisations: forms and precisions with their measured errors.
        crossover_rad_s: the nominal gain crossover of the ideal controller; None where unknown.
    """

    gains: FoPi
    digital: DigitalSpec
    sections: Sections
    errors: Errors
    accurate_rad_s: tuple[float, float] | None
    realisations: tuple[Realisation, ...]
    crossover_rad_s: float | None = None
    errors_of_terms: dict[str, Errors] = field(default_factory=dict)

    @property
    def errors_from_rad_s(self) -> float:
        """Lower end of the range of `errors`: the band's, or lower where the loop needs the filter there."""
        return _errors_from(self.digital, self.crossover_rad_s)

    @property
    def band_note(self) -> str:
        """A warning that the band does not cover the loop's frequencies, with one that does; empty where it does."""
        (low, high), crossover = self.digital.band_rad_s, self.crossover_rad_s
        # integral and derivative of order one are exact for every band
        derivative = derivative_of(self.gains)
        is_exact = self.gains.alpha == 1.0 or self.gains.ki == 0.0
        if crossover is None or (is_exact and (derivative.mu == 1.0 or derivative.kd == 0.0)):
            return ""
        if low <= _BELOW_CROSSOVER * crossover and crossover <= high:
            return ""
        return (
            f"the filter's band_rad_s, {low:g} to {high:g}, does not hold the loop's gain crossover, {crossover:.3g} "
            f"rad/s, and two decades below it; write band_rad_s: [{crossover / _SUITABLE:.1e}, "
            f"{crossover * _SUITABLE:.1e}] in the spec's section digital"
        )


def discretize(gains: FoPi, digital: DigitalSpec, crossover_rad_s: float | None = None) -> DigitalController:
    """Make and measure the digital controller.

    Args:
        gains: from a design.
        digital: the spec's section.
        crossover_rad_s: where `matched` keeps the gain and a prewarped `tustin` is exact; None: the band's middle.

    Raises:
        DomainError: all gains are 0, the band does not fit the sample time, or the parallel form is too inaccurate in
            float32.
    """
    refuse_zero_gains(gains)
    sections = sections_of(gains, digital, crossover_rad_s)
    if gains.measurement_filter is not None:
        SampledFilter.of(gains.measurement_filter, digital.sample_time_s, Precision.FLOAT32)
    pairs = [(form, precision) for form in Form for precision in Precision]
    # an overflow shows as an infinite error
    with np.errstate(all="ignore"):
        errors, accurate = _errors(gains, digital, sections, _errors_from(digital, crossover_rad_s))
        of_terms = _errors_of_terms(gains, digital, crossover_rad_s)
        realisations = tuple(realise(sections, form, precision, _test_input()) for form, precision in pairs)
    for realisation in realisations:
        if realisation.form is Form.PARALLEL:
            checked_realisation(realisation, _TOLERANCE)
    return DigitalController(gains, digital, sections, errors, accurate, realisations, crossover_rad_s, of_terms)


def sections_of(gains: FoPi, digital: DigitalSpec, crossover_rad_s: float | None = None) -> Sections:
    """The digital controller alone, without its errors.

    Args:
        gains: kp, ki, alpha, and kd with mu and its filter.
        digital: the spec's section.
        crossover_rad_s: where Tustin's rule is exact with `prewarp: crossover`.

    Raises:
        DomainError: as for `discretize`; the derivative's or the measurement's filter is faster than half the sample
            time.
    """
    if gains.measurement_filter is not None:
        SampledFilter.of(gains.measurement_filter, digital.sample_time_s, Precision.FLOAT64)
    with np.errstate(all="ignore"):
        sections = with_derivative(
            _sections(gains, digital, crossover_rad_s), gains, _rest_of_derivative(gains, digital)
        )
    if gains.setpoint_weight is not None and sections.parts is not None:
        sections = replace(sections, parts=replace(sections.parts, setpoint_weight=gains.setpoint_weight))
    if not np.all(np.isfinite([sections.direct, *sections.poles, *sections.residues])):
        raise DomainError("the filter's numbers are beyond what a double holds; use fewer poles or a narrower band")
    count = sections.integral_sections
    groups = (sections.poles[:count], sections.poles[count:])
    if any(abs(pole) >= 1.0 for pole in sections.poles[1:]) or any(len(set(poles)) < len(poles) for poles in groups):
        raise DomainError("poles of the filter fall together at this sample time; use fewer poles or a narrower band")
    return sections


def _rest_of_derivative(gains: FoPi, digital: DigitalSpec) -> ZeroPoleGain:
    """The approximation of s^(mu - 2), of which `with_derivative` makes the sections; 1/s where mu is 1."""
    kd, mu, _ = derivative_of(gains)
    if kd == 0.0 or mu == 1.0:
        return ZeroPoleGain((), (0.0,), 1.0)
    method = Method(digital.method)
    if method is Method.FIT:
        raise DomainError(
            "method: fit approximates an integral, and no derivative of an order other than 1; take method: oustaloup "
            "or modified_oustaloup, or mu: 1"
        )
    return APPROXIMATIONS[method](2.0 - mu, digital.poles, digital.band_rad_s)


def _sections(gains: FoPi, digital: DigitalSpec, crossover_rad_s: float | None) -> Sections:
    low = digital.band_rad_s[0]
    sample_time_s, method = digital.sample_time_s, Method(digital.method)
    nyquist = np.pi / sample_time_s
    if low >= nyquist:
        raise DomainError(f"the band begins at {low:g} rad/s, above Nyquist's frequency {nyquist:g} rad/s; lower it")
    if method is Method.FIT:
        return fit(gains, sample_time_s, digital.poles, digital.band_rad_s)
    integral = APPROXIMATIONS[method](gains.alpha, digital.poles, digital.band_rad_s)
    at = exact_at(digital, crossover_rad_s)
    if Rule(digital.rule) is Rule.TUSTIN:
        return tustin(gains, integral, sample_time_s, at if digital.prewarp == "crossover" else None)
    return matched(gains, integral, sample_time_s, at)


def exact_at(digital: DigitalSpec, crossover_rad_s: float | None) -> float:
    """Where `matched` keeps the gain and a prewarped `tustin` is exact, rad/s.

    Args:
        digital: the spec's section; its band begins below the Nyquist frequency.
        crossover_rad_s: taken if it is below the Nyquist frequency; otherwise the middle of the band below that.
    """
    (low, high), nyquist = digital.band_rad_s, np.pi / digital.sample_time_s
    if crossover_rad_s is not None and crossover_rad_s < nyquist:
        return crossover_rad_s
    return float(np.sqrt(low * min(high, nyquist)))


def _errors_from(digital: DigitalSpec, crossover_rad_s: float | None) -> float:
    low = digital.band_rad_s[0]
    return low if crossover_rad_s is None else min(low, _BELOW_CROSSOVER * crossover_rad_s)


def _errors(
    gains: FoPi, digital: DigitalSpec, sections: Sections, from_rad_s: float
) -> tuple[tuple[tuple[float, float], ...], tuple[float, float] | None]:
    """Largest relative errors up to shares of the Nyquist frequency, and the range with at most 5 %."""
    omega, error = _relative_error(gains, sections, from_rad_s)
    stated = _stated(omega, error)
    good = error <= _ACCURATE
    low, high = digital.band_rad_s
    middle = int(np.argmin(np.abs(np.log(omega) - 0.5 * np.log(low * min(omega[-1], high)))))
    if not good[middle]:
        return stated, None
    below, above = np.flatnonzero(~good[:middle]), np.flatnonzero(~good[middle:])
    first = below[-1] + 1 if len(below) else 0
    last = middle + above[0] - 1 if len(above) else len(omega) - 1
    return stated, (float(omega[first]), float(omega[last]))


def _relative_error(gains: FoPi, sections: Sections, from_rad_s: float) -> tuple[Array, Array]:
    """Frequencies up to Nyquist's, and |C_d/C - 1| there."""
    omega = np.geomspace(from_rad_s, np.pi / sections.sample_time_s, _FREQUENCIES)
    return omega, np.abs(sections.response(omega, gains.measurement_filter) / gains(1j * omega) - 1.0)


def _stated(omega: Array, error: Array) -> Errors:
    """The largest errors up to shares of the last frequency, which is Nyquist's."""
    largest = np.maximum.accumulate(error)
    ends = [part * float(omega[-1]) for part in _PARTS if part * omega[-1] > omega[0]]
    return tuple((end, float(largest[omega <= end * (1.0 + 1e-12)][-1])) for end in ends)


def _errors_of_terms(gains: FoPi, digital: DigitalSpec, crossover_rad_s: float | None) -> dict[str, Errors]:
    """Of structure fopid the errors of the integral and the derivative alone, as far as there is such a term.

    Of a measurement filter those of it alone.
    """
    low, used, filtered = _errors_from(digital, crossover_rad_s), gains.measurement_filter, {}
    if used is not None:
        omega = np.geomspace(low, np.pi / digital.sample_time_s, _FREQUENCIES)
        error = np.abs(used.on_samples(omega, digital.sample_time_s) / used(1j * omega) - 1.0)
        filtered = {FILTER_TERM: _stated(omega, error)}
        gains = replace(gains, measurement_filter=None)
    if not isinstance(gains, FoPid) or structure_of(gains) != "fopid":
        return filtered
    terms = {
        "integral": replace(gains, kp=0.0, kd=0.0) if gains.ki != 0.0 else None,
        "derivative": replace(gains, kp=0.0, ki=0.0) if gains.kd != 0.0 else None,
    }
    found: dict[str, Errors] = {}
    for name, term in terms.items():
        if term is not None:
            sections = sections_of(term, digital, crossover_rad_s)
            found[name] = _stated(*_relative_error(term, sections, low))
    return found | filtered


def _test_input() -> Array:
    """A step with noise, similar to a loop's error; seeded, so that equal inputs give equal results."""
    rng = np.random.default_rng(20)
    return 0.3 + rng.normal(size=_SAMPLES)


def to_document(controller: DigitalController) -> dict[str, Any]:
    """The controller as in the JSON of `fopi discretize`."""
    sections = controller.sections
    return {
        "digital": {key: list(v) if isinstance(v, tuple) else v for key, v in asdict(controller.digital).items()},
        "controller": {
            "form": "direct + sum of residue/(z - pole)",
            "direct": sections.direct,
            "sections": [
                {"pole": pole, "residue": residue}
                for pole, residue in zip(sections.poles, sections.residues, strict=True)
            ],
            **_derivative_entry(sections),
        },
        **_filter_entry(controller),
        **({"band_note": controller.band_note} if controller.band_note else {}),
        "errors": _errors_entry(controller.errors),
        **_errors_of_terms_entry(controller),
        "accurate_rad_s": list(controller.accurate_rad_s) if controller.accurate_rad_s else None,
        "realisations": [
            {
                "form": realisation.form.value,
                "precision": realisation.precision.value,
                "relative_error": realisation.error if realisation.error < float("inf") else None,
                "stable": realisation.stable,
                "coefficients": [list(row) for row in realisation.coefficients],
            }
            for realisation in controller.realisations
        ],
    }


def _derivative_entry(sections: Sections) -> dict[str, Any]:
    """The derivative's part of the sum, which acts on -y; no entry without one."""
    if sections.parts is None or not sections.has_derivative:
        return {}
    direct, count = sections.parts.derivative, sections.integral_sections
    pairs = zip(sections.poles[count:], sections.residues[count:], strict=True)
    own = [{"pole": pole, "residue": residue} for pole, residue in pairs]
    # of a PID it is one section
    group = own[0] if len(own) == 1 else {"sections": own}
    return {"derivative": {"acts_on": "-measurement", "direct": sum(direct), **group}}


def _filter_entry(controller: DigitalController) -> dict[str, Any]:
    """The measurement's filter, which comes before the sum and is not in the realisations; no entry without one."""
    used, time = controller.gains.measurement_filter, controller.digital.sample_time_s
    if used is None:
        return {}
    found = SampledFilter.of(used, time, Precision.FLOAT64)
    numbers = {"share": found.share, **({} if found.damping is None else {"damping": found.damping})}
    return {
        "measurement_filter": {
            "acts_on": "measurement", "order": used.order, "time_constant_s": used.time_constant_s, "rule": "tustin",
            **numbers,
        }
    }  # fmt: skip


def _errors_entry(errors: Errors) -> list[dict[str, float]]:
    return [{"up_to_rad_s": omega, "largest_relative": error} for omega, error in errors]


def _errors_of_terms_entry(controller: DigitalController) -> dict[str, Any]:
    entries = {name: _errors_entry(errors) for name, errors in controller.errors_of_terms.items()}
    return {"errors_of_terms": entries} if entries else {}
