"""The JSON of a proof that no gains are better."""

from typing import Literal, TypedDict

from fopi_tune.results.schema.loops import OptimumParts


class ReasonEntry(TypedDict):
    """Why boxes of gains are discarded.

    Args:
        condition: its number.
        point: of a plant, in the order of the uncertain numbers.
        omega_rad_s: where it is evaluated, rad/s.
        above: which side of the limit it is about.
    """

    condition: int
    point: list[float]
    omega_rad_s: list[float]
    above: bool


class CoverEntry(TypedDict):
    """Boxes of gains that cover the whole one.

    Args:
        root: the whole box, [lower, upper] of each axis.
        tokens: how it is cut, and which reason discards each part.
    """

    root: list[tuple[float, float]]
    tokens: str


class OptimumProofEntry(TypedDict):
    """The proof that no gains are better.

    Args:
        beat: the objective that none beats, in its unit; null of an infeasible spec.
        reference_rad_s: the frequency that gains are scaled by, rad/s.
        reasons: that tokens name.
        covers: of the box of gains.
    """

    beat: float | None
    reference_rad_s: float | None
    reasons: list[ReasonEntry]
    covers: list[CoverEntry]


class OptimumDocument(OptimumParts):
    """What `--certify-optimum` proves, with its boxes.

    Args:
        kind: of the file.
        schema: version of this JSON; it may only grow.
        name: of the spec.
        spec_sha256: of the spec's bytes.
        versions: of what the ball arithmetic ran with.
        proof: null without a bound.
    """

    kind: Literal["fopi_tune optimum"]
    schema: Literal[3]
    name: str
    spec_sha256: str
    versions: dict[str, str]
    proof: OptimumProofEntry | None
