"""The digital controllers of a system as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.text import Text

    from fopi_tune.results.system import DiscretizedSystem


def system_digital_text(result: DiscretizedSystem) -> Text:
    """Gains, switching, and the errors of both filters."""
    from fopi_tune.report.text.formatting import BAD, QUIET, TIE, Line, entry, gains_lines, to_text, with_unit, wrapped

    spec, controllers = result.spec, result.controllers
    lines: list[Line] = [
        *wrapped(f"{spec.name}, digital: made. Both controllers and how they take turns are C code."),
        ("", ""),
        *gains_lines(result.gains),
        ("", ""),
    ]
    raising, lowering = (mode.name for mode in spec.modes)
    unit, dwell = spec.measurement_unit, spec.min_dwell_samples
    eps = with_unit(spec.hysteresis, unit) if unit else f"{spec.hysteresis:g}"
    lines += entry("sampled", f"every {with_unit(spec.sample_time_s, 's')}")
    above, below = (f"the setpoint{TIE}{sign}{TIE}{eps}" for sign in "+-")
    lines += entry("switching", f"{lowering} from {above} on, {raising} from {below} on")
    if dwell > 1:
        lines += entry("dwell", f"at least {dwell} samples, {with_unit(dwell * spec.sample_time_s, 's')}")
    lines += entry("inactive", spec.inactive)
    for mode, controller in zip(spec.modes, controllers, strict=True):
        errors = [f"{100 * error:.3g}{TIE}% up to {with_unit(omega, 'rad/s')}" for omega, error in controller.errors]
        low = with_unit(controller.errors_from_rad_s, "rad/s")
        lines += entry(mode.name, f"largest relative error of its filter from {low}: {', '.join(errors)}")
        if controller.band_note:
            lines += entry("", f"NOTE: {controller.band_note}", BAD)
    for note in result.notes:
        lines += wrapped(f"{note}.", "yellow")
    lines += [("", ""), *wrapped("Nothing is proved here: `fopi prove` says whether the system settles.", QUIET)]
    return to_text(lines)
