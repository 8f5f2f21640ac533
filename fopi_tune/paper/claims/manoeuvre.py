"""The brake manoeuvre from 30 km/h, under each reading of how it starts."""

from __future__ import annotations

from collections.abc import Mapping

from fopi_tune.montecarlo.montecarlo import Evidence
from fopi_tune.paper.published import (
    BRAKE,
    COMFORT_M_S2,
    CONTROL_LIMIT,
    MANOEUVRE_KMH,
    TAU_MAX_S,
    TAU_MIN_S,
    TAU_NOISE_MEAN_S,
    TAU_NOMINAL_S,
    THROTTLE_GAIN,
    THROTTLE_POLE_RAD_S,
)
from fopi_tune.paper.table import Row, Verdict, verdict_of
from fopi_tune.paper.variants import manoeuvre as spec_of
from fopi_tune.paper.variants import with_comfort
from fopi_tune.pipeline.simulate import simulate
from fopi_tune.pipeline.tune import tune
from fopi_tune.pipeline.validate import validate
from fopi_tune.results.status import Status

GAINS = (1, 10)
#: the one with which the brake can stop the car
DESIGNED_GAIN = 10
READINGS: Mapping[str, str] = {
    "held_step": "the pedal stays, the setpoint steps to 0",
    "held_ramp": "the pedal stays, the setpoint falls in 10 s",
    "released_step": "the pedal is released as the brake begins",
}


def manoeuvre() -> tuple[Row, ...]:
    """The claims: the start, the comfort limit under each reading, gains designed for it, and the control needed."""
    rows = [_start(), _noise()]
    evidence = {gain: validate(spec_of(gain), BRAKE.gains).evidence for gain in GAINS}
    rows += [_comfort(gain, reading, evidence[gain]) for gain in GAINS for reading in READINGS]
    rows += [_designed(reading, evidence[DESIGNED_GAIN]) for reading in READINGS]
    return (*rows, *(_control(gain) for gain in GAINS))


def _start() -> Row:
    top = CONTROL_LIMIT * THROTTLE_GAIN / THROTTLE_POLE_RAD_S
    return Row(
        "With a fixed pedal the car reaches 30 km/h",
        f"{MANOEUVRE_KMH:g} km/h",
        f"the throttle's plant ends at {top:.1f} km/h at full throttle",
        verdict_of(top >= MANOEUVRE_KMH),
        "K/p times the largest control, 1, in the printed model.",
    )


def _noise() -> Row:
    mean = TAU_NOMINAL_S + TAU_NOISE_MEAN_S
    return Row(
        "The manoeuvre's tau, 2.25 s plus noise of mean 0.85 s, is one of the design's",
        f"tau in [{TAU_MIN_S:g}, {TAU_MAX_S:g}] s",
        f"its mean is {mean:.2f} s, the interval's end",
        Verdict.NOT_PRINTED,
        "The distribution is not printed. Of a symmetric one half the draws lie beyond the interval.",
    )


def _comfort(gain: int, reading: str, evidence: Evidence) -> Row:
    about = {j.limit.measure: j for j in evidence.limits if j.scenario == reading and j.limit is not None}
    comfort, final = about["acceleration_m_s2"], about["final_error"]
    met, total = comfort.fraction.met, comfort.fraction.total
    brakes = final.fraction.met == total
    slows = "brakes" if brakes else f"still rolls at {final.worst[0].value:.0f} km/h after a minute"
    every = met == total
    return Row(
        f"Braking keeps |a| <= {COMFORT_M_S2:g} m/s^2: static gain {gain}, {READINGS[reading]}",
        f"[-{COMFORT_M_S2:g}, {COMFORT_M_S2:g}] m/s^2",
        f"{met} of {total} brakes keep it; largest |a| = {comfort.worst[0].value:.2f} m/s^2; the car {slows}",
        verdict_of(every, on_condition=True),
        "With this reading of the start, which is not printed." if every else _why_not(reading),
    )


def _designed(reading: str, evidence: Evidence) -> Row:
    """Gains for the comfort limit, with the true integral of the error as their objective."""
    asked = with_comfort(spec_of(DESIGNED_GAIN), reading, COMFORT_M_S2)
    design = tune(asked)
    published = next(
        j for j in evidence.limits
        if j.scenario == reading and j.limit is not None and j.limit.measure == "acceleration_m_s2"
    )  # fmt: skip
    beside = f"; the published gains reach {published.worst[0].value:.2f} m/s^2"
    claim = (
        f"Gains can be found that keep |a| <= {COMFORT_M_S2:g} m/s^2: static gain {DESIGNED_GAIN}, {READINGS[reading]}"
    )
    if design.status is not Status.SOLVED or design.gains is None or design.objective is None:
        return Row(claim, "not tried", f"{design.status.value}{beside}", verdict_of(False), _why_not(reading))
    gains, (report,) = design.gains, design.measures
    assert report.result is not None
    found = f"kp = {gains.kp:.3f}, ki = {gains.ki:.3f}, alpha = {gains.alpha:.2f}"
    found += f": |a| <= {report.result.achieved:.2f} m/s^2"
    return Row(
        claim,
        "not tried",
        f"{found}, {report.verdict} for every tau; error's integral {design.objective:.1f} km/h s{beside}",
        verdict_of(report.verdict == "proved", on_condition=True),
        "With this reading of the start, |S| <= 2 dB and a phase margin of 60 deg, on samples of 0.2 s.",
    )


def _why_not(reading: str) -> str:
    if reading == "released_step":
        return f"Released, the plant alone slows by y/tau: {MANOEUVRE_KMH / TAU_MIN_S / 3.6:.2f} m/s^2 at tau = 1.6 s."
    return "A step of the setpoint by 30 km/h moves the control at once by kp times 30."


def _control(gain: int) -> Row:
    found = simulate(spec_of(gain), BRAKE.gains)
    peak = {driven.scenario.name: driven.measures["peak_control"] for driven in found.driven}
    return Row(
        f"The brake's control stays in [-1, 1]: static gain {gain}",
        f"[-{CONTROL_LIMIT:g}, {CONTROL_LIMIT:g}]",
        "largest |u|: " + ", ".join(f"{value:.1f} ({name.replace('_', ' ')})" for name, value in peak.items()),
        verdict_of(max(peak.values()) <= CONTROL_LIMIT),
        f"At tau = {TAU_NOMINAL_S:g} s, without limits. A control of 1 moves a plant of static gain {gain} by {gain} "
        "km/h.",
    )
