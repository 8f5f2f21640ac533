"""Specs that are not shipped, as inputs of the design's tests: every kind of plant, requirement, objective and ending.

Each case says how it must end.  `objective` is the best that is known (design_references.py), None where the ending is
not `solved` or where every feasible point is as good.
"""

from __future__ import annotations

from dataclasses import dataclass

from cases.design_references import REFERENCES

USUAL = "{kp: {min: 0, max: 10}, ki: {min: 0, max: 10}, alpha: {min: 0.3, max: 1.5}}"
BRAKE = "{model: lag, static_gain: 1.0, time_constant_s: {nominal: 2.25, min: 1.6, max: 3.1}}"
LAG = "{model: lag, static_gain: 1.0, time_constant_s: 1.0}"
DELAYED = "{model: lag, static_gain: 1.0, time_constant_s: 1.0, dead_time_s: 0.2}"
#: no gains have this crossover, and the margin there
CONTRADICTORY = (
    "schema: 1\nname: x\nplant: {model: pole, gain: 25, pole_rad_s: -1, dead_time_s: 0.033}\n"
    "controller: {kp: {min: 0, max: 6.7}, ki: {min: 0, max: 0.85}, alpha: {min: 0.44, max: 1.36}}\n"
    "requirements:\n  - {crossover_rad_s: {equals: 1.0}, on: nominal}\n  - {phase_margin_deg: {at_least: 44}}\n"
    "objective: {minimize: phase_margin_spread_deg}\n"
)


@dataclass(frozen=True)
class Case:
    """A spec's text, how tuning it ends, and the objective (to be minimised; the negative of what is maximised)."""

    name: str
    text: str
    status: str
    objective: float | None
    clash: frozenset[int]


def case(name, plant, requirements, objective=None, controller: str | None = USUAL, status="solved", clash=()) -> Case:
    lines = [f"schema: 1\nname: {name}\nplant: {plant}"]
    if controller is not None:
        lines.append(f"controller: {controller}")
    if requirements:
        lines += ["requirements:", *(f"  - {{{r}}}" for r in requirements)]
    if objective:
        lines.append(f"objective: {{{objective}}}")
    return Case(name, "\n".join(lines) + "\n", status, REFERENCES.get(name), frozenset(clash))


def boxed(kp="{min: 0, max: 10}", ki="{min: 0, max: 10}", alpha="{min: 0.3, max: 1.5}") -> str:
    return f"{{kp: {kp}, ki: {ki}, alpha: {alpha}}}"


WC03, PM90 = "crossover_rad_s: {equals: 0.3}, on: nominal", "phase_margin_deg: {equals: 90}, on: nominal"
S20 = "sensitivity_db: {at_most: -20}, to_rad_s: 0.02"

SOLVED = [
    # uncertain gain and time constant together
    case(
        "gain_and_lag",
        "{model: lag, static_gain: {nominal: 1.0, min: 0.8, max: 1.2}, time_constant_s: {nominal: 2.25, "
        "min: 1.6, max: 3.1}}",
        [WC03, PM90, "phase_margin_deg: {at_least: 75}", S20],
        "minimize: phase_margin_spread_deg",
    ),
    case(
        "gain_and_lag_ki",
        "{model: lag, static_gain: {min: 2, max: 4}, time_constant_s: {min: 1, max: 3}, dead_time_s: 0.1}",
        ["sensitivity_db: {at_most: 4}", "control_sensitivity_db: {at_most: 3}"],
        "maximize: ki",
    ),
    case(
        "gain_and_pole",
        "{model: pole, gain: {min: 3.5, max: 5}, pole_rad_s: {min: 0.1, max: 0.3}}",
        [
            "crossover_rad_s: {between: [0.3, 0.8]}",
            "phase_margin_deg: {at_least: 80}",
            "sensitivity_db: {at_most: -15}, to_rad_s: 0.03",
        ],
        "maximize: ki",
    ),
    case(
        "gain_lag_crossover_spread",
        "{model: lag, static_gain: {min: 0.9, max: 1.1}, time_constant_s: {min: 1.6, max: 3.1}}",
        ["crossover_rad_s: {equals: 0.4}, on: nominal", "phase_margin_deg: {at_least: 70}"],
        "minimize: crossover_spread_db",
    ),
    # dead time
    case(
        "dead_time",
        DELAYED,
        ["crossover_rad_s: {equals: 1.0}", "phase_margin_deg: {at_least: 60}", "gain_margin_db: {at_least: 10}"],
        "maximize: ki",
    ),
    case(
        "dead_time_uncertain",
        "{model: lag, static_gain: 1, time_constant_s: 1, dead_time_s: {min: 0.1, max: 0.4}}",
        ["phase_margin_deg: {at_least: 50}", "gain_margin_db: {at_least: 8}", "control_sensitivity_db: {at_most: 15}"],
        "maximize: ki",
    ),
    case(
        "gain_margin_binds",
        "{model: lag, static_gain: 1, time_constant_s: 1, dead_time_s: {min: 0.2, max: 0.3}}",
        ["gain_margin_db: {at_least: 9}", "phase_margin_deg: {at_least: 20}"],
        "maximize: ki",
        boxed(alpha="{min: 0.6, max: 1.2}"),
    ),
    case(
        "gain_margin_between",
        DELAYED,
        ["gain_margin_db: {between: [8, 10]}", "phase_margin_deg: {at_least: 60}"],
        "maximize: ki",
    ),
    case(
        "gain_margin_equals",
        DELAYED,
        ["gain_margin_db: {equals: 12}", "phase_margin_deg: {equals: 65}"],
        "maximize: ki",
    ),
    case(
        "delay_dominant",
        "{model: lag, static_gain: 1, time_constant_s: 0.2, dead_time_s: {min: 0.8, max: 1.0}}",
        ["sensitivity_db: {at_most: 5}"],
        "maximize: ki",
    ),
    # alpha fixed
    case(
        "alpha_half",
        BRAKE,
        ["crossover_rad_s: {equals: 0.4}, on: nominal", "phase_margin_deg: {at_least: 85}"],
        "maximize: ki",
        boxed(alpha="0.5"),
    ),
    case(
        "alpha_one",
        BRAKE,
        ["phase_margin_deg: {at_least: 70}", "sensitivity_db: {at_most: 1}", "crossover_rad_s: {at_most: 1}"],
        "maximize: ki",
        boxed(alpha="1"),
    ),
    case(
        "alpha_1_3",
        BRAKE,
        ["crossover_rad_s: {at_most: 1.0}", "phase_margin_deg: {at_least: 60}"],
        "maximize: ki",
        boxed(alpha="1.3"),
    ),
    case("alpha_fixed_two_equalities", BRAKE, [WC03, PM90], "minimize: phase_margin_spread_deg", boxed(alpha="0.8")),
    case(
        "kp_fixed",
        BRAKE,
        ["phase_margin_deg: {at_least: 80}", "crossover_rad_s: {at_most: 0.6}"],
        "maximize: ki",
        boxed(kp="0.3"),
    ),
    case("pure_integral", BRAKE, ["phase_margin_deg: {at_least: 60}"], "maximize: ki", boxed(kp="0")),
    # sensitivities only
    case("sensitivity_only", DELAYED, ["sensitivity_db: {at_most: 4}"], "maximize: ki"),
    case(
        "all_sensitivities",
        DELAYED,
        [
            "sensitivity_db: {at_most: 4.5}",
            "complementary_sensitivity_db: {at_most: 1}",
            "control_sensitivity_db: {at_most: 10}",
        ],
        "maximize: ki",
    ),
    case(
        "sensitivity_bands",
        BRAKE,
        [
            "sensitivity_db: {at_most: -30}, to_rad_s: 0.01",
            "complementary_sensitivity_db: {at_most: -15}, from_rad_s: 3",
            "sensitivity_db: {at_most: 2}",
        ],
        "minimize: control_sensitivity_peak_db",
    ),
    case(
        "sensitivity_at",
        BRAKE,
        ["sensitivity_db: {equals: -20}, at_rad_s: 0.02, on: nominal", "phase_margin_deg: {at_least: 80}"],
        "minimize: control_sensitivity_peak_db",
    ),
    case(
        "sensitivity_between",
        LAG,
        ["sensitivity_db: {between: [-30, -20]}, from_rad_s: 0.02, to_rad_s: 0.05", "phase_margin_deg: {at_least: 70}"],
        "maximize: ki",
    ),
    case(
        "sensitivity_peak",
        DELAYED,
        ["crossover_rad_s: {at_least: 1.5}", "sensitivity_db: {at_most: -15}, to_rad_s: 0.1"],
        "minimize: sensitivity_peak_db",
    ),
    case(
        "control_peak",
        "{model: lag, static_gain: {min: 0.8, max: 1.2}, time_constant_s: {min: 1.6, max: 3.1}, dead_time_s: 0.3}",
        ["crossover_rad_s: {at_least: 0.3}", "phase_margin_deg: {at_least: 60}", S20],
        "minimize: control_sensitivity_peak_db",
    ),
    case(
        "noise_band",
        DELAYED,
        ["control_sensitivity_db: {at_most: 5}, from_rad_s: 10", "sensitivity_db: {at_most: 5}"],
        "minimize: iae_disturbance",
    ),
    # loop gain
    case(
        "loop_gain_bounds",
        BRAKE,
        [
            "loop_gain_db: {at_least: 20}, to_rad_s: 0.02",
            "loop_gain_db: {at_most: -20}, from_rad_s: 5",
            "phase_margin_deg: {at_least: 60}",
        ],
    ),
    case(
        "loop_gain_equals",
        LAG,
        ["loop_gain_db: {equals: 20}, at_rad_s: 0.1", "crossover_rad_s: {equals: 1}"],
        "minimize: sensitivity_peak_db",
    ),
    case(
        "loop_gain_at",
        LAG,
        ["loop_gain_db: {between: [20, 22]}, at_rad_s: 0.1", "phase_margin_deg: {between: [60, 70]}"],
        "maximize: ki",
    ),
    # delay margin, slope
    case("delay_margin", BRAKE, ["delay_margin_s: {at_least: 2}", "sensitivity_db: {at_most: 3}"], "maximize: ki"),
    case(
        "delay_margin_depth",
        DELAYED,
        ["delay_margin_s: {at_least: 0.5}", "crossover_rad_s: {at_least: 0.5}", "gain_margin_db: {at_least: 6}"],
    ),
    case(
        "iso_damping",
        "{model: lag, static_gain: {min: 0.7, max: 1.4}, time_constant_s: 1.0, dead_time_s: 0.1}",
        [
            "crossover_rad_s: {equals: 1}, on: nominal",
            "phase_margin_deg: {equals: 60}, on: nominal",
            "phase_slope_deg_per_decade: {equals: 0}, on: nominal",
        ],
        None,
        "{alpha: {min: 0.3, max: 1.9}}",
    ),
    case(
        "iso_damping_free_crossover",
        DELAYED,
        ["phase_margin_deg: {equals: 65}", "phase_slope_deg_per_decade: {equals: 0}"],
        "maximize: ki",
        "{alpha: {min: 0.3, max: 1.9}}",
    ),
    case(
        "flat_phase",
        DELAYED,
        [
            "phase_margin_deg: {at_least: 60}",
            "phase_slope_deg_per_decade: {between: [-20, 20]}",
            "crossover_rad_s: {at_most: 3}",
        ],
        "maximize: ki",
    ),
    # plants
    case(
        "integrator",
        "{model: pole, gain: 1.0, pole_rad_s: 0.0, dead_time_s: 0.3}",
        ["sensitivity_db: {at_most: 5}"],
        "maximize: ki",
    ),
    case(
        "integrator_uncertain",
        "{model: pole, gain: {min: 0.8, max: 1.3}, pole_rad_s: 0.0, dead_time_s: 0.2}",
        ["phase_margin_deg: {at_least: 45}", "gain_margin_db: {at_least: 8}"],
        "minimize: iae_disturbance",
    ),
    case(
        "unstable_pole",
        "{model: pole, gain: 1.0, pole_rad_s: -1.0, dead_time_s: 0.05}",
        ["sensitivity_db: {at_most: 5}", "control_sensitivity_db: {at_most: 20}"],
        "maximize: ki",
    ),
    case(
        "unstable_without_delay",
        "{model: transfer_function, numerator: [1.0], denominator: [1.0, -1.0]}",
        ["crossover_rad_s: {equals: 4}", "phase_margin_deg: {at_least: 50}"],
        "maximize: ki",
    ),
    case(
        "pole_of_either_sign",
        "{model: pole, gain: 1.0, pole_rad_s: {min: -0.2, max: 0.5}, dead_time_s: 0.1}",
        ["sensitivity_db: {at_most: 4}", "crossover_rad_s: {at_most: 4}"],
        "maximize: ki",
    ),
    case(
        "second_order_tf",
        "{model: transfer_function, numerator: [2.0], denominator: [1.0, 3.0, 2.0], dead_time_s: 0.05}",
        ["phase_margin_deg: {at_least: 60}", "gain_margin_db: {at_least: 10}"],
        "maximize: ki",
    ),
    case(
        "third_order_tf",
        "{model: transfer_function, numerator: [1.0], denominator: [1.0, 3.0, {min: 2.5, max: 3.5}, 1.0]}",
        ["sensitivity_db: {at_most: 4}"],
        "maximize: ki",
    ),
    case(
        "right_half_plane_zero",
        "{model: transfer_function, numerator: [-0.5, 1.0], denominator: [1.0, 2.0, 1.0]}",
        ["sensitivity_db: {at_most: 5}", "gain_margin_db: {at_least: 6}"],
        "maximize: ki",
    ),
    case(
        "resonant",
        "{model: transfer_function, numerator: [1.0], denominator: [1.0, 0.2, 1.0]}",
        ["sensitivity_db: {at_most: 6}"],
        "maximize: ki",
        boxed(kp="{min: -2, max: 10}"),
    ),
    case(
        "resonant_uncertain",
        "{model: transfer_function, numerator: [1.0], denominator: [1.0, {min: 0.1, max: 0.2}, {min: 0.9, max: 1.1}]}",
        ["sensitivity_db: {at_most: 6}", "gain_margin_db: {at_least: 6}"],
        "maximize: ki",
    ),
    case(
        "negative_plant",
        "{model: lag, static_gain: {min: -1.2, max: -0.8}, time_constant_s: 1.0, dead_time_s: 0.2}",
        ["sensitivity_db: {at_most: 4}", "phase_margin_deg: {at_least: 50}"],
        "minimize: iae_disturbance",
        "{kp: {min: -10, max: 0}, ki: {min: -10, max: 0}, alpha: {min: 0.3, max: 1.5}}",
    ),
    # slow and fast twins; equal but for the unit of time
    *(
        case(
            f"twin_{name}",
            f"{{model: lag, static_gain: 1.0, dead_time_s: {0.1 * t:.17g}, "
            f"time_constant_s: {{nominal: {t}, min: {0.7 * t:.17g}, max: {1.4 * t:.17g}}}}}",
            [
                "phase_margin_deg: {at_least: 60}",
                "sensitivity_db: {at_most: 4}",
                "control_sensitivity_db: {at_most: 14}",
                f"sensitivity_db: {{at_most: -20}}, to_rad_s: {0.05 / t:.17g}",
            ],
            "minimize: phase_margin_spread_deg",
            "{kp: {min: 0}, ki: {min: 0}, alpha: {min: 0.3, max: 1.5}}",
        )
        for name, t in (("seconds", 1.0), ("hours", 2.0e4), ("microseconds", 1.0e-6))
    ),
    *(
        case(
            f"gain_{name}",
            f"{{model: lag, static_gain: {k}, time_constant_s: 1.0, dead_time_s: 0.2}}",
            ["sensitivity_db: {at_most: 4}"],
            "maximize: ki",
            "{kp: {min: 0}, ki: {min: 0}, alpha: {min: 0.3, max: 1.5}}",
        )
        for name, k in (("one", 1.0), ("tiny", 1.0e-6), ("huge", 1.0e6))
    ),
    # open ranges, nothing but an objective, no objective
    case("open_ranges", DELAYED, ["sensitivity_db: {at_most: 4}"], "maximize: ki", None),
    case(
        "open_ranges_depth",
        BRAKE,
        ["phase_margin_deg: {at_least: 60}", "crossover_rad_s: {between: [0.2, 0.6]}", S20],
        None,
        None,
    ),
    case(
        "depth_brake",
        BRAKE,
        [
            "phase_margin_deg: {at_least: 60}",
            "sensitivity_db: {at_most: -20}, to_rad_s: 0.02",
            "crossover_rad_s: {at_most: 1}",
        ],
    ),
    case(
        "depth_delay",
        DELAYED,
        [
            "phase_margin_deg: {between: [50, 80]}",
            "gain_margin_db: {at_least: 6}",
            "crossover_rad_s: {between: [0.5, 2]}",
        ],
    ),
    case(
        "depth_one_parameter",
        "{model: lag, static_gain: 0.5271, time_constant_s: 21.08}",
        [
            "crossover_rad_s: {equals: 0.02359}",
            "delay_margin_s: {at_least: 15.15}",
            "loop_gain_db: {at_most: -12.4}, from_rad_s: 0.9486",
            "gain_margin_db: {at_least: 9.97}",
        ],
        None,
        boxed(kp="{min: 0, max: 189.7}", ki="{min: 0, max: 9}", alpha="0.7"),
    ),
    case(
        "constant_objective",  # one plant: its spread is 0 whatever the gains
        "{model: transfer_function, numerator: [0.6462], denominator: [0.0018, 0.044, 0.42, 1], dead_time_s: 0.01}",
        [
            "crossover_rad_s: {at_most: 7.28}",
            "sensitivity_db: {at_most: -24.5}, to_rad_s: 0.09549",
            "complementary_sensitivity_db: {at_most: 3.1}",
        ],
        "minimize: phase_margin_spread_deg",
        boxed(kp="{min: 0, max: 154}", ki="{min: 0, max: 738}"),
    ),
    case("stability_only_ki", DELAYED, [], "maximize: ki", boxed(kp="{min: 0, max: 2}", alpha="1")),
]

INFEASIBLE = [
    case(
        "no_phase_margin",
        BRAKE,
        [WC03, PM90],
        "maximize: ki",
        boxed(alpha="{min: 0.3, max: 0.6}"),
        "infeasible",
        clash=[0, 1],
    ),
    case(
        "no_gain_margin_equality",
        BRAKE,
        ["gain_margin_db: {equals: 12.04}, on: nominal"],
        "maximize: ki",
        boxed(alpha="{min: 0.3, max: 1.0}"),
        "infeasible",
        clash=[0],
    ),
    case(
        "no_gain_margin_at_most",
        LAG,
        ["gain_margin_db: {at_most: 10}"],
        "maximize: ki",
        boxed(alpha="{min: 0.3, max: 1.0}"),
        "infeasible",
        clash=[0],
    ),
    case(
        "no_gain_margin",
        DELAYED,
        ["gain_margin_db: {at_least: 20}", "crossover_rad_s: {at_least: 3}"],
        "maximize: ki",
        status="infeasible",
        clash=[0, 1],
    ),
    case(
        "no_crossover",
        LAG,
        ["crossover_rad_s: {at_least: 20}"],
        "maximize: ki",
        boxed(kp="{min: 0, max: 1}", ki="{min: 0, max: 1}"),
        "infeasible",
        clash=[0],
    ),
    case(
        "no_crossover_between",
        "{model: lag, static_gain: {min: 0.5, max: 2}, time_constant_s: 1}",
        ["crossover_rad_s: {between: [0.95, 1.05]}"],
        "maximize: ki",
        status="infeasible",
        clash=[0],
    ),
    case(
        "no_delay_margin",
        DELAYED,
        ["delay_margin_s: {at_least: 2}", "crossover_rad_s: {at_least: 2}"],
        "maximize: ki",
        status="infeasible",
        clash=[0, 1],
    ),
    case(
        "no_sensitivity",
        DELAYED,
        ["sensitivity_db: {at_most: 1}", "sensitivity_db: {at_most: -20}, to_rad_s: 0.2"],
        "maximize: ki",
        status="infeasible",
        clash=[0, 1],
    ),
    case(
        "no_complementary",
        DELAYED,
        ["complementary_sensitivity_db: {at_most: -40}, from_rad_s: 3", "crossover_rad_s: {at_least: 1}"],
        "maximize: ki",
        status="infeasible",
        clash=[0, 1],
    ),
    case(
        "no_control",
        BRAKE,
        ["control_sensitivity_db: {at_most: -10}", "crossover_rad_s: {at_least: 1}"],
        "maximize: ki",
        status="infeasible",
        clash=[0, 1],
    ),
    case(
        "no_loop_gain",
        LAG,
        ["loop_gain_db: {at_least: 40}, to_rad_s: 0.1", "loop_gain_db: {at_most: 10}, at_rad_s: 0.3"],
        "maximize: ki",
        status="infeasible",
        clash=[0, 1],
    ),
    case(
        "no_iso_damping",
        BRAKE,
        [WC03, PM90, "phase_slope_deg_per_decade: {equals: 100}, on: nominal"],
        "maximize: ki",
        boxed(alpha="{min: 0.3, max: 1.0}"),
        "infeasible",
        clash=[2],
    ),
    case(
        "no_spread",
        BRAKE,
        [WC03, PM90, "phase_margin_deg: {at_least: 86}"],
        "maximize: ki",
        status="infeasible",
        clash=[0, 1, 2],
    ),
    case(
        "no_stability",
        "{model: pole, gain: 1.0, pole_rad_s: -1.0, dead_time_s: 1.2}",
        ["phase_margin_deg: {at_least: 5}"],
        "maximize: ki",
        status="infeasible",
        clash=[],
    ),
    case(
        "no_overlap",
        LAG,
        [
            "phase_margin_deg: {at_least: 60}",
            "crossover_rad_s: {equals: 2}",
            "sensitivity_db: {at_most: -60}, to_rad_s: 0.5",
        ],
        "maximize: ki",
        status="infeasible",
        clash=[2],
    ),
]

UNBOUNDED = [
    case(
        "unbounded_lag",
        LAG,
        ["phase_margin_deg: {at_least: 60}"],
        "maximize: ki",
        "{kp: {min: 0}, ki: {min: 0}, alpha: {min: 0.3, max: 1.5}}",
        "unbounded",
    ),
    case("unbounded_alone", LAG, [], "maximize: ki", None, "unbounded"),
    case("unbounded_brake", BRAKE, ["sensitivity_db: {at_most: 2}"], "maximize: ki", None, "unbounded"),
]

#: what takes seconds; run with -m long
SLOW = {"gain_and_lag_ki", "resonant_uncertain", "negative_plant", "no_sensitivity"}
SLOW |= {"no_stability", "no_gain_margin", "gain_tiny"}

CASES = SOLVED + INFEASIBLE + UNBOUNDED
