"""The controller in C: what the compiler makes of it, bit for bit; anti-windup, hand-over, hostile texts."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cases.plants import PUBLISHED_BRAKE, PUBLISHED_THROTTLE
from scipy import signal

from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Sections
from fopi_tune.digital import DigitalController, Export, Units, discretize, export_c
from fopi_tune.digital.discretize import sections_of
from fopi_tune.digital.export_c import comment, literal, sanitized
from fopi_tune.digital.oustaloup import modified_oustaloup, oustaloup
from fopi_tune.digital.realise import Precision, run_parallel
from fopi_tune.digital.runtime import Runtime, State, init, reset, step, track
from fopi_tune.digital.transforms import matched, tustin
from fopi_tune.digital.vectors import Op, Operation, replay, standard_operations, vector_table
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import DigitalSpec

#: to measure what rounding does to a filter takes a tenth of a second
discretized = cache(discretize)

TS = 0.2
SHA256 = "0123456789abcdef" * 4
FLAGS = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Werror",
    "-ffp-contract=off",
]
STRICTER = ["-Wshadow", "-Wstrict-prototypes", "-Wmissing-prototypes", "-Wcast-qual"]
SANITIZE = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)] or [n for n in ("cc",) if shutil.which(n)]
needs_compiler = pytest.mark.skipif(not COMPILERS, reason="no C compiler: neither gcc nor clang nor cc is found")
with_each_compiler = pytest.mark.parametrize(
    "compiler",
    [
        pytest.param(c, marks=pytest.mark.skipif(not shutil.which(c), reason=f"{c} is not found"))
        for c in ("gcc", "clang")
    ],
)
HOSTILE = [
    "*/ int escaped; /*",
    "**//* /*/ *\\\n/ #error escaped",
    "ends in a backslash \\",
    "ends in a trigraph ??/",
    "??/\n*??/\n/ #error escaped",
    "éé/\n*é/ \u2028*/ \x00\x1b[31m */\r\n#error escaped",
    "quotes \" ' and // slashes {{ 1/0 }} {% raw %}",
    "*/" * 5000,
    "a b*\\" * 2500,
]


@cache
def made(kp: float, ki: float, alpha: float, method: str = "oustaloup", poles: int = 7) -> DigitalController:
    """A digital controller; the fit's band begins where a fit is of use."""
    band = (10**-2.5, 1e3) if method == "fit" else (1e-3, 1e3)
    return discretized(FoPi(kp, ki, alpha), DigitalSpec(TS, method, poles, band))


def of_gains(gains: FoPi) -> DigitalController:
    return made(gains.kp, gains.ki, gains.alpha, "modified_oustaloup")


@cache
def designs() -> tuple[DigitalController, ...]:
    """The papers' two, and others of every method and kind."""
    rng = np.random.default_rng(8)
    found = [of_gains(PUBLISHED_THROTTLE), of_gains(PUBLISHED_BRAKE), made(0.3, 0.5, 1.0), made(0.7, 0.0, 0.8)]
    for method in ("oustaloup", "modified_oustaloup", "oustaloup"):
        kp, ki = (10 ** rng.uniform(-1.5, 0.5, 2)).tolist()
        found.append(made(kp, ki, float(rng.uniform(0.2, 1.6)), method, int(rng.integers(3, 9))))
    return (*found, made(0.2, 0.5, 0.6, "fit", 6), made(1.0, 0.4, 1.5))


def export(controller: DigitalController, limits: tuple[float, float] | None = (-1.0, 1.0), **others: str) -> Export:
    made = Export(
        name="Brake-1.2",
        description="A car's brake.",
        spec_sha256=SHA256,
        tool="fopi-tune 0",
        controller=controller,
        units=Units("km/h", "part of full brake"),
        limits=limits,
    )
    return replace(made, **others)


def written(files: dict[str, str], folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="ascii")
    return folder


def compiled(folder: Path, *flags: str, compiler: str = "") -> Path:
    sources = sorted(path.name for path in folder.glob("*.c"))
    command = [compiler or COMPILERS[0], *FLAGS, *flags, "-o", "replay", *sources]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "replay"


def run(program: Path, table: str = "test_vectors.csv") -> subprocess.CompletedProcess[str]:
    return subprocess.run([program, table], cwd=program.parent, capture_output=True, text=True, check=False)


def both(controller: DigitalController, limits: tuple[float, float] | None = (-1.0, 1.0)) -> list[Runtime]:
    return [Runtime.of(controller.sections, precision, limits) for precision in Precision]


def held_at(runtime: Runtime, state: State, error: float, samples: int) -> State:
    for _ in range(samples):
        state = step(runtime, state, error, 0.0)
    return state


@cache
def random_sections() -> tuple[Sections, ...]:
    """Designs of every method and rule with alpha in (0.2, 1.9)."""
    rng, found = np.random.default_rng(9), [of_gains(PUBLISHED_BRAKE).sections, made(0.2, 0.5, 0.6, "fit", 6).sections]
    for k in range(200):
        kp, ki = (10 ** rng.uniform(-2, 1, 2)).tolist()
        gains = FoPi(kp, ki, float(rng.uniform(0.2, 1.9)))
        integral = (oustaloup, modified_oustaloup)[k % 2](gains.alpha, int(rng.integers(3, 9)), (1e-3, 1e3))
        found.append(tustin(gains, integral, TS) if k % 3 else matched(gains, integral, TS, 0.5))
    return tuple(found)


def random_runtimes(precision: Precision) -> list[Runtime]:
    return [Runtime.of(sections, precision, (-1.0, 1.0)) for sections in random_sections()]


# -- the arithmetic --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("precision", Precision)
def test_without_limits_the_runtime_is_the_parallel_form_bit_for_bit(precision: Precision) -> None:
    inputs = np.random.default_rng(1).normal(size=1500)
    for controller in designs():
        runtime = Runtime.of(controller.sections, precision)
        found = replay(runtime, [Operation(Op.STEP, float(value)) for value in inputs])
        expected = run_parallel(controller.sections, inputs, precision)
        assert found.tobytes() == expected.tobytes()


def test_without_limits_the_runtime_is_scipys_filter_of_the_sections() -> None:
    inputs = np.random.default_rng(2).normal(size=1500)
    for controller in designs():
        sections = controller.sections
        expected = sections.direct * inputs
        for pole, residue in zip(sections.poles, sections.residues, strict=True):
            expected = expected + np.asarray(signal.lfilter([0.0, residue], [1.0, -pole], inputs), dtype=float)
        runtime = Runtime.of(sections, Precision.FLOAT64)
        found = replay(runtime, [Operation(Op.STEP, float(value)) for value in inputs])
        # 1500 additions into an integrator, half a last place each, in another order of the sections
        assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def test_inputs_beyond_the_precision_or_not_finite_are_held() -> None:
    for runtime in both(made(0.4, 0.4, 0.8)):
        before = held_at(runtime, init(runtime), 0.3, 20)
        nan, inf = float("nan"), float("inf")
        for pair in ((nan, 0.0), (0.0, nan), (inf, 0.0), (0.0, -inf), (inf, inf), (1.7e308, -1.7e308)):
            assert step(runtime, before, *pair) is before
            assert track(runtime, before, *pair, 0.5) is before
        for applied in (nan, inf, -inf):
            assert track(runtime, before, 0.3, 0.0, applied) is before


def test_a_state_that_would_overflow_is_held() -> None:
    sections = Sections(TS, 0.0, (1.0,), (1e300,))
    runtime = Runtime.of(sections, Precision.FLOAT64)
    before = step(runtime, init(runtime), 1e8, 0.0)
    assert before.x[0] == 1e308
    assert step(runtime, before, 1e8, 0.0) is before


def test_a_reset_starts_at_rest_at_the_output_within_the_limits() -> None:
    for runtime in both(made(0.4, 0.4, 0.8)):
        for wanted, found in ((0.5, 0.5), (7.0, 1.0), (-7.0, -1.0), (float("nan"), 0.0), (float("inf"), 0.0)):
            state = reset(runtime, wanted)
            assert state.output == found
            assert step(runtime, state, 3.0, 3.0).output == found
            assert list(state.x[1:]) == [0.0] * (len(state.x) - 1)


def test_a_start_is_the_limit_next_to_zero() -> None:
    sections = made(0.4, 0.4, 0.8).sections
    for limits, start in (((0.25, 1.0), 0.25), ((-1.0, -0.5), -0.5), ((-1.0, 1.0), 0.0)):
        assert init(Runtime.of(sections, Precision.FLOAT64, limits)).output == start


# -- limits and rounding ---------------------------------------------------------------------------------------------


def test_float32_limits_are_never_beyond_those_asked_for() -> None:
    rng = np.random.default_rng(3)
    sections = Sections(TS, 1.0, (), ())
    for low, high in (rng.uniform(-1, 1, (200, 2)) + np.array([-1.0, 1.0])).tolist():
        found = Runtime.of(sections, Precision.FLOAT32, (low, high)).limits
        assert low <= found[0] < found[1] <= high
        # inwards by less than one last place: 2^-23 of at most 2
        assert found == pytest.approx((low, high), abs=2.0**-22)
        assert [float(np.float32(limit)) for limit in found] == list(found)


@pytest.mark.parametrize("limits", [None, (-np.inf, np.inf)])
def test_without_limits_the_output_has_the_precisions_range(limits: tuple[float, float] | None) -> None:
    for precision in Precision:
        largest = float(np.finfo(precision.dtype).max)
        assert Runtime.of(Sections(TS, 1.0, (), ()), precision, limits).limits == (-largest, largest)


@pytest.mark.parametrize("limits", [(1.0, 1.0), (1.0, -1.0), (float("nan"), 1.0), (0.0, float("nan"))])
def test_limits_that_are_empty_are_refused(limits: tuple[float, float]) -> None:
    with pytest.raises(DomainError, match="smaller than the upper"):
        Runtime.of(Sections(TS, 1.0, (), ()), Precision.FLOAT64, limits)


def test_limits_that_hold_no_two_float32_are_refused() -> None:
    for limits in ((1.0 + 1e-9, 1.0 + 2e-9), (1e300, 1e301)):
        with pytest.raises(DomainError, match="widen them"):
            Runtime.of(Sections(TS, 1.0, (), ()), Precision.FLOAT32, limits)


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        (Sections(TS, 1.0, (1.0, 1.0 - 1e-9), (0.1, 0.1)), "outside the unit circle"),
        (Sections(TS, 1.0, (1.0 - 1e-9,), (0.1,)), "outside the unit circle"),
        (Sections(TS, 1.0, (0.5, -1.5), (0.1, 0.1)), "outside the unit circle"),
        (Sections(TS, 1e39, (), ()), "beyond the range"),
        (Sections(TS, 1.0, (1.0,), (1e-60,)), "residue is 0"),
    ],
)
def test_a_controller_that_rounding_spoils_is_refused(sections: Sections, message: str) -> None:
    with pytest.raises(DomainError, match=message):
        Runtime.of(sections, Precision.FLOAT32)


# -- anti-windup and hand-over ---------------------------------------------------------------------------------------


def observer(poles: np.ndarray, weights: np.ndarray, gain: float) -> np.ndarray:
    """Eigenvalues of P (I - g w 1')."""
    return np.linalg.eigvals(np.diag(poles) - gain * np.outer(poles * weights, np.ones(len(poles))))


@pytest.mark.parametrize("precision", Precision)
def test_weights_sum_to_one_and_the_observers_are_stable(precision: Precision) -> None:
    for runtime in random_runtimes(precision):
        # each weight is rounded to float32: by 2^-24 of its size
        assert sum(runtime.weights) == pytest.approx(1.0, abs=1e-7 * np.abs(runtime.weights).sum())
        assert 0.0 < runtime.tracking_gain <= 1.0
        for gain in (runtime.tracking_gain, 1.0):
            assert np.abs(observer(np.array(runtime.poles), np.array(runtime.weights), gain)).max() < 1.0


def test_positive_weights_put_the_eigenvalues_between_neighbouring_poles() -> None:
    tried = 0
    for runtime in random_runtimes(Precision.FLOAT64):
        weights, poles = np.array(runtime.weights), np.array(runtime.poles)
        if np.any(weights < 0.0):
            continue
        tried += 1
        # the others feed nothing back: their poles stay
        ascending = np.sort(poles[weights > 0.0])
        values: np.ndarray = np.sort_complex(observer(poles[weights > 0.0], weights[weights > 0.0], 1.0))
        # the eigenvalues of a matrix that is not symmetric, in double
        assert np.abs(np.imag(values)).max() < 1e-7
        assert abs(values[0]) < 1e-7
        assert np.all(np.real(values[1:]) > ascending[:-1] - 1e-9)
        assert np.all(np.real(values[1:]) < ascending[1:] + 1e-9)
    assert tried > 20


def test_sections_none_of_which_takes_a_correction_have_no_weights() -> None:
    for sections in (Sections(TS, 1.0, (-0.5,), (0.1,)), Sections(TS, 1.0, (0.5,), (0.0,)), Sections(TS, 1.0, (), ())):
        runtime = Runtime.of(sections, Precision.FLOAT64, (-1.0, 1.0))
        assert set(runtime.weights) <= {0.0}
        assert runtime.tracking_gain == 0.0


def test_residues_that_cancel_have_positive_weights() -> None:
    runtime = Runtime.of(Sections(TS, 1.0, (1.0, 0.9), (0.1, -0.1)), Precision.FLOAT64)
    assert runtime.weights == (0.5, 0.5)


def test_states_stay_bounded_in_a_long_saturation() -> None:
    for runtime in random_runtimes(Precision.FLOAT64)[:12]:
        # an error that alone asks for the fivefold limit
        error = 5.0 / sum(abs(number) for number in (runtime.direct, *runtime.residues))
        early = held_at(runtime, init(runtime), error, 4000)
        late = held_at(runtime, early, error, 4000)
        size = np.abs(early.x).max()
        assert early.output == late.output == 1.0
        assert np.abs(late.x).max() < 1.2 * size + 1.0
        # without a correction the integrator alone would have grown by 4000 r_0 e
        assert abs(late.x[0] - early.x[0]) < 0.05 * 4000 * abs(runtime.residues[0] * error) + 0.2


def test_the_output_leaves_a_limit_as_the_error_changes_sign() -> None:
    for controller in designs():
        for runtime in both(controller):
            if not runtime.has_integrator:
                continue
            error = 5.0 / runtime.direct
            state = held_at(runtime, init(runtime), error, 6000)
            assert state.output == 1.0
            # a fifth of the error, the other way
            assert step(runtime, state, -0.2 * error, 0.0).output < 1.0


def test_noise_at_a_limit_costs_the_loop_little() -> None:
    """A first-order plant held at 0.9 of what the actuator can do, with noise that reaches the limit all the time."""
    sections = made(2.0, 1.0, 1.0).sections
    own = Runtime.of(sections, Precision.FLOAT64, (0.0, 1.0))
    biases = []
    for runtime in (own, replace(own, tracking_gain=1.0)):
        state, y, sum_y, decay = init(runtime), 0.0, 0.0, float(np.exp(-TS / 2.25))
        for k, noise in enumerate(np.random.default_rng(4).normal(size=4000) * 0.1):
            state = step(runtime, state, 0.9, y + noise)
            y = decay * y + (1.0 - decay) * float(state.output)
            sum_y += y * (k >= 1000)
        biases.append(0.9 - sum_y / 3000)
    # measured 0.024 against 0.119
    assert 0.0 < biases[0] < 0.3 * biases[1]


@pytest.mark.parametrize("error", [0.0, 0.3])
def test_a_hand_over_with_the_same_error_does_not_move_the_output(error: float) -> None:
    for controller in designs():
        for runtime in both(controller):
            if not runtime.has_integrator:
                continue
            state = init(runtime)
            for _ in range(300):
                state = track(runtime, state, error, 0.0, 0.4)
                assert state.output == runtime.stored.limited(runtime.precision.dtype(0.4))
            # rounding of the sum, whose largest term is the direct path's
            room = 8.0 * float(np.finfo(runtime.precision.dtype).eps) * (1.0 + abs(runtime.direct) * error)
            assert abs(float(step(runtime, state, error, 0.0).output) - 0.4) <= room


@pytest.mark.thinned(3)
@pytest.mark.parametrize("alpha", [0.3, 0.8, 1.2, 1.6, 1.9])
@pytest.mark.parametrize("method", ["oustaloup", "fit"])
def test_what_is_taken_over_at_no_error_stays(alpha: float, method: str) -> None:
    # without float32's check: whether a fit of order 1.9 passes it depends on the last digits of the linear algebra
    sections = sections_of(FoPi(0.4, 0.3, alpha), DigitalSpec(0.2, method, 7, (10**-2.5, 1e3)))
    runtime = Runtime.of(sections, Precision.FLOAT64, None)
    state = track(runtime, init(runtime), 0.0, 0.0, 5.0)
    for _ in range(5000):
        state = step(runtime, state, 0.0, 0.0)
        assert state.output == 5.0


def test_a_hand_over_at_rest_moves_nothing() -> None:
    for controller in designs():
        for runtime in both(controller):
            if not runtime.has_integrator:
                continue
            state = reset(runtime, 0.4)
            for _ in range(200):
                state = track(runtime, state, 0.7, 0.7, 0.4)
            assert step(runtime, state, 0.7, 0.7).output == runtime.precision.dtype(0.4)


def test_errors_of_somebody_elses_time_are_not_remembered() -> None:
    """After minutes at a large error under another hand, the controller that takes over at no error stays put."""
    for runtime in both(made(0.4, 0.4, 0.8)):
        state = init(runtime)
        for _ in range(3000):
            state = track(runtime, state, 10.0, 0.0, 0.5)
        state = track(runtime, state, 0.0, 0.0, 0.5)
        for _ in range(3000):
            state = step(runtime, state, 0.0, 0.0)
        assert float(state.output) == pytest.approx(0.5, abs=1e-5)


# -- rest ------------------------------------------------------------------------------------------------------------

#: sections that forget fast enough to become subnormal in float64 within REST samples, one for each kind of weights
FORGETFUL = {
    "positive weights": Sections(TS, 0.5, (1.0, 0.7, 0.2, -0.5), (0.1, 0.3, 0.2, 0.1)),
    "weights of both signs": Sections(TS, 0.5, (1.0, 0.7, 0.3), (0.4, -0.1, 0.2)),
    "weights by size": Sections(TS, 0.5, (1.0, 0.6), (0.1, -0.1)),
    "no integrator": Sections(TS, 0.5, (0.7, 0.5), (0.1, 0.3)),
    "no weights": Sections(TS, 0.5, (-0.7, -0.3), (0.1, 0.2)),
}
REST = 2500


def unflushed(runtime: Runtime) -> Runtime:
    """The same controller, whose states keep whatever they hold."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Precision, "flush_below", 0.0)
        same = replace(runtime)
        assert same.stored.flush_below == 0.0
    return same


def subnormal(values: np.ndarray) -> np.ndarray:
    return (values != 0.0) & (np.abs(values) < np.finfo(values.dtype).smallest_normal)


def stirred(runtime: Runtime, seed: int = 5) -> State:
    state = init(runtime)
    for e in np.random.default_rng(seed).normal(size=60).tolist():
        state = step(runtime, state, e, 0.0)
    return state


def test_the_cases_have_every_kind_of_weights() -> None:
    weights = {name: np.array(Runtime.of(each, Precision.FLOAT64).weights) for name, each in FORGETFUL.items()}
    for name in ("positive weights", "no integrator"):
        assert weights[name].min() >= 0.0
        assert weights[name].max() > 0.0
    assert weights["weights of both signs"].min() < 0.0
    assert weights["weights by size"].tolist() == [0.5, 0.5]
    assert not np.any(weights["no weights"])


@pytest.mark.thinned(9)
@pytest.mark.parametrize("limits", [None, (-1.0, 1.0), (0.0, 1.0), (-1.0, 0.0)])
@pytest.mark.parametrize("name", FORGETFUL)
def test_no_state_stays_subnormal_at_rest_or_while_tracking(name: str, limits: tuple[float, float] | None) -> None:
    busy = np.random.default_rng(6).normal(size=REST).tolist()
    for precision in Precision:
        runtime = Runtime.of(FORGETFUL[name], precision, limits)
        endings = []
        for one in (runtime, unflushed(runtime)):
            resting = tracking = stirred(one)
            for e in busy:
                resting = step(one, resting, 0.25, 0.25)
                tracking = track(one, tracking, e, 0.0, 0.5)
            endings.append((resting, tracking))
        for flushed, kept in zip(*endings, strict=True):
            assert np.any(subnormal(kept.x))
            assert not np.any(subnormal(flushed.x))
            # what the integrator holds, and the output, are what they were
            assert flushed.output == (kept.output if abs(kept.output) > precision.absorbs_flushed else 0.0)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("limits", [None, (-1.0, 1.0), (0.0, 1.0), (-0.1, 0.7)])
def test_no_output_of_an_ordinary_run_has_another_bit_for_it(limits: tuple[float, float] | None) -> None:
    draw, flushed = np.random.default_rng(7), 0
    noise, level = draw.normal(size=900), np.repeat([0.0, 3.0, -0.4, -0.4, 0.0, 1e-6], 150)
    errors = np.where(np.arange(900) % 300 < 100, level + 0.1 * noise, np.where(level == -0.4, level, 0.0)).tolist()
    for controller in designs():
        for runtime in both(controller, limits):
            plain = unflushed(runtime)
            one, two = init(runtime), init(plain)
            for k, e in enumerate(errors):
                if k % 450 >= 400:
                    one, two = track(runtime, one, e, 0.0, 0.3), track(plain, two, e, 0.0, 0.3)
                else:
                    one, two = step(runtime, one, e, 0.0), step(plain, two, e, 0.0)
                assert one.output.tobytes() == two.output.tobytes()
                flushed += bool(np.any(one.x != two.x))
    assert flushed > 100


@pytest.mark.parametrize("precision", Precision)
def test_an_integrator_loses_no_error_from_the_threshold_on(precision: Precision) -> None:
    least = precision.flush_below
    for scale in (1.0, 1.5, 2.0**10, 2.0**40, 1.0 / least):
        for residue in (1.0, 2.0**-5, 0.3):
            # a slow section beside it, and errors that a rounded residue times which is below the threshold as well
            runtime = Runtime.of(Sections(TS, 0.5, (1.0, 0.999), (residue, 0.1)), precision)
            plain = unflushed(runtime)
            one, two = init(runtime), init(plain)
            for k in range(200):
                error = scale * least * (1.0 if k % 3 else -1.0)
                one, two = step(runtime, one, error, 0.0), step(plain, two, error, 0.0)
                assert one.x.tobytes() == two.x.tobytes()
            assert one.x[0] != 0.0


@pytest.mark.parametrize("precision", Precision)
def test_below_the_threshold_an_integrator_at_zero_stays_and_one_at_work_is_untouched(precision: Precision) -> None:
    runtime = Runtime.of(Sections(TS, 0.0, (1.0,), (0.5,)), precision)
    error = float(np.nextafter(precision.dtype(precision.flush_below), precision.dtype(0.0)))
    assert held_at(runtime, init(runtime), error, 50).x[0] == 0.0
    at_work = State(np.array([precision.absorbs_flushed], dtype=precision.dtype), precision.dtype(0.0))
    for one in (runtime, unflushed(runtime)):
        assert held_at(one, at_work, error, 50).x.tobytes() == at_work.x.tobytes()


@pytest.mark.parametrize("precision", Precision)
def test_what_is_flushed_would_be_lost_in_sums_from_the_stated_size_on(precision: Precision) -> None:
    dtype, smallest = precision.dtype, np.finfo(precision.dtype).smallest_normal
    assert precision.flush_below == {"float64": 2.0**-970, "float32": 2.0**-103}[precision.value]
    # a last place of a state that is kept is a normal number
    assert np.spacing(dtype(precision.flush_below)) >= smallest
    least, tiny = dtype(precision.absorbs_flushed), np.nextafter(dtype(precision.flush_below), dtype(0.0))
    for number in (least, *(least * np.random.default_rng(10).uniform(1.0, 1e9, 1000).astype(dtype))):
        for sign in (1.0, -1.0):
            assert number + dtype(sign) * tiny == number
    assert least / dtype(4.0) - tiny != least / dtype(4.0)


#: runs busy, at rest and tracking, and prints the states; then the states after two million samples at rest
REST_MAIN = r"""
#include <stdio.h>
#include "fopi_brake_1_2_f32.h"
#include "fopi_brake_1_2_f64.h"

static double busy(int k) { return (k * 37 % 64 - 20) / 32.0; }

#define SHOW(s) for (k = 0; k < (int)(sizeof s.x / sizeof s.x[0]); ++k) printf("%a ", (double)s.x[k]); \
    printf("%a\n", (double)s.output)
#define RUN(suffix, type) { \
    fopi_brake_1_2_##suffix##_state s; int k; \
    fopi_brake_1_2_##suffix##_init(&s); \
    for (k = 0; k < 100; ++k) (void)fopi_brake_1_2_##suffix##_step(&s, (type)busy(k), 0); \
    SHOW(s); \
    for (k = 0; k < 2500; ++k) (void)fopi_brake_1_2_##suffix##_step(&s, (type)0.25, (type)0.25); \
    SHOW(s); \
    for (k = 0; k < 100; ++k) (void)fopi_brake_1_2_##suffix##_step(&s, (type)busy(k), 0); \
    for (k = 0; k < 2500; ++k) (void)fopi_brake_1_2_##suffix##_track(&s, (type)busy(k), 0, (type)0.5); \
    SHOW(s); \
    for (k = 0; k < 100; ++k) (void)fopi_brake_1_2_##suffix##_step(&s, (type)busy(k), 0); \
    for (k = 0; k < 2000000; ++k) (void)fopi_brake_1_2_##suffix##_step(&s, 0, 0); \
    SHOW(s); }

int main(void) { RUN(f64, double) RUN(f32, float) return 0; }
"""


def rest_in_python(runtime: Runtime) -> list[list[float]]:
    """The first three rows of what REST_MAIN prints."""
    error = [(k * 37 % 64 - 20) / 32.0 for k in range(REST)]
    state, rows = init(runtime), []
    for kind in (Op.STEP, Op.TRACK):
        for e in error[:100]:
            state = step(runtime, state, e, 0.0)
        if kind is Op.STEP:
            rows.append([*state.x.tolist(), float(state.output)])
        for e in error:
            state = step(runtime, state, 0.25, 0.25) if kind is Op.STEP else track(runtime, state, e, 0.0, 0.5)
        rows.append([*state.x.tolist(), float(state.output)])
    return rows


@needs_compiler
@pytest.mark.parametrize("step", [3, pytest.param(1, marks=pytest.mark.long)])
def test_states_in_c_are_pythons_bit_for_bit_and_normal_after_two_million_samples_at_rest(
    tmp_path: Path, step: int
) -> None:
    of_brake = of_gains(PUBLISHED_BRAKE)
    cases: list[tuple[DigitalController, tuple[float, float] | None]] = [(of_brake, None)]
    for sections, limits in zip(FORGETFUL.values(), [(0.0, 1.0), (-1.0, 0.0), None, None, (-1.0, 1.0)], strict=True):
        cases.append((replace(of_brake, sections=sections), limits))
    for i, (controller, limits) in enumerate(cases[::step]):
        files = export_c(export(controller, limits)) | {"main.c": REST_MAIN}
        done = run(compiled(written(files, tmp_path / str(i)), "-O1"))
        rows = [[float.fromhex(word) for word in line.split()] for line in done.stdout.splitlines()]
        assert len(rows) == 8
        for runtime, found in zip(both(controller, limits), (rows[:4], rows[4:]), strict=True):
            expected = rest_in_python(runtime)
            assert [[x.hex() for x in row] for row in found[:3]] == [[x.hex() for x in row] for row in expected]
            if limits is None:
                # all but the integrator have forgotten; at a limit the last places may feed each other
                assert not np.any(found[3][int(runtime.has_integrator) : -1])
            assert not np.any(subnormal(np.array(found[3], dtype=runtime.precision.dtype)))


# -- the compiled controller -----------------------------------------------------------------------------------------


@needs_compiler
@pytest.mark.parametrize("mixed", [1_000, pytest.param(10_500, marks=pytest.mark.long)])
def test_thousands_of_operations_are_equal_bit_for_bit(tmp_path: Path, mixed: int) -> None:
    limits = [(-1.0, 1.0), (0.0, 1.0), None, (-0.1, 0.7), (0.2, 5.0)]
    total = 0
    for k, controller in enumerate(designs()):
        files = export_c(export(controller, limits[k % len(limits)]))
        runtimes = both(controller, limits[k % len(limits)])
        operations = standard_operations(runtimes[0], seed=k, mixed=mixed)
        files["test_vectors.csv"] = vector_table(runtimes[0], runtimes[1], operations)
        done = run(compiled(written(files, tmp_path / str(k)), "-O2"))
        assert done.returncode == 0, done.stdout + done.stderr
        assert done.stdout.startswith(f"{len(operations)} rows are equal bit for bit")
        total += len(operations)
    assert total >= 10 * mixed


@pytest.mark.thinned(slow=["O0", "O3"])
@needs_compiler
@with_each_compiler
@pytest.mark.parametrize("level", ["-O0", "-O2", "-O3", "-Os"])
def test_no_level_of_optimisation_changes_a_bit_or_warns(tmp_path: Path, compiler: str, level: str) -> None:
    written(export_c(export(made(0.4, 0.4, 0.8))), tmp_path)
    assert run(compiled(tmp_path, level, *STRICTER, compiler=compiler)).returncode == 0


@needs_compiler
@pytest.mark.parametrize("ki", [0.4, 0.0])
def test_the_sanitizers_find_nothing(tmp_path: Path, ki: float) -> None:
    written(export_c(export(made(0.4, ki, 0.8))), tmp_path)
    (tmp_path / "probe.c").write_text("int main(void) { return 0; }\n", encoding="ascii")
    probe = [COMPILERS[0], *SANITIZE, "-o", "probe", "probe.c"]
    if subprocess.run(probe, cwd=tmp_path, capture_output=True, check=False).returncode:
        pytest.skip("the compiler has no sanitizers")
    (tmp_path / "probe.c").unlink()
    done = run(compiled(tmp_path, *SANITIZE))
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


@pytest.mark.thinned(2)
@needs_compiler
@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("table", ["poles", "residues", "weights"])
def test_a_coefficient_wrong_by_one_last_place_is_found(tmp_path: Path, precision: str, table: str) -> None:
    files = export_c(export(made(0.4, 0.4, 0.8)))
    name = f"fopi_brake_1_2_{precision}.c"
    # the third of the table, a slow section
    rows = files[name].partition(f"{table}[SECTIONS] = {{\n")[2].splitlines()
    found = rows[2].split(",")[0].strip().rstrip("f")
    value = float.fromhex(found)
    other = float(np.nextafter(np.float32(value), np.float32(2.0))) if precision == "f32" else np.nextafter(value, 2.0)
    suffix = "f" if precision == "f32" else ""
    spoiled = files[name].replace(literal(value, suffix), literal(float(other), suffix))
    assert spoiled != files[name]
    written({**files, name: spoiled}, tmp_path)
    done = run(compiled(tmp_path))
    assert done.returncode == 1
    assert re.match(r"line \d+, (step|track): double -?\d\S* instead of -?\d", done.stdout)


@needs_compiler
def test_a_table_that_cannot_be_read_is_told_from_one_that_differs(tmp_path: Path) -> None:
    files = export_c(export(made(0.7, 0.0, 0.8)))
    program = compiled(written(files, tmp_path))
    lines = files["test_vectors.csv"].splitlines(keepends=True)
    tables = {
        "empty": "",
        "header only": lines[0],
        "no header": "".join(lines[1:]),
        "short row": lines[0] + lines[1] + "step,0x0p+0,0x0p+0\n",
        "long row": lines[0] + lines[1].replace("\n", ",0x0p+0\n"),
        "unknown operation": lines[0] + lines[1].replace("init", "stop"),
        "no number": lines[0] + "step,,0x0p+0,0x0p+0,0x0p+0,0x0p+0\n",
        "text": lines[0] + "step,setpoint,0x0p+0,0x0p+0,0x0p+0,0x0p+0\n",
        "nan expected": lines[0] + "init,0x0p+0,0x0p+0,0x0p+0,nan,0x0p+0\n",
        "endless line": lines[0] + "step," * 4000,
    }
    for name, table in tables.items():
        (tmp_path / "other.csv").write_text(table, encoding="ascii")
        done = run(program, "other.csv")
        assert (done.returncode, name) == (2, name)
        assert done.stderr
    assert run(program, "missing.csv").returncode == 2
    (tmp_path / "other.csv").write_text("".join(lines).replace("\n", "\r\n"), encoding="ascii", newline="")
    assert run(program, "other.csv").returncode == 0


@needs_compiler
def test_fast_math_does_not_compile(tmp_path: Path) -> None:
    written(export_c(export(made(0.4, 0.4, 0.8))), tmp_path)
    for flag in ("-ffast-math", "-ffinite-math-only"):
        command = [COMPILERS[0], "-std=c99", flag, "-c", "fopi_brake_1_2_f64.c"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode != 0
        assert "compile without -ffast-math" in done.stderr


@pytest.mark.thinned(2)
@needs_compiler
@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_header_and_source_of_two_exports_do_not_compile_together(tmp_path: Path, precision: str) -> None:
    """As a run that was killed between them leaves them: the state may be of another size."""
    one, other = (written(export_c(export(made(0.3, 0.5, 1.0, poles=n))), tmp_path / str(n)) for n in (5, 7))
    name = f"fopi_brake_1_2_{precision}"
    (one / f"{name}.h").write_bytes((other / f"{name}.h").read_bytes())
    command = [COMPILERS[0], *FLAGS, "-c", f"{name}.c"]
    done = subprocess.run(command, cwd=one, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert f"{name}.h is of another export" in done.stderr
    assert subprocess.run(command, cwd=other, capture_output=True, check=False).returncode == 0


@needs_compiler
def test_the_headers_can_be_included_from_cpp_and_twice(tmp_path: Path) -> None:
    written(export_c(export(made(0.4, 0.4, 0.8))), tmp_path)
    include = "".join(f'#include "fopi_brake_1_2_{p}.h"\n' for p in ("f64", "f32", "f64"))
    main = "int main() { fopi_brake_1_2_f64_state s; fopi_brake_1_2_f64_init(&s); return s.output != 0.0; }\n"
    (tmp_path / "user.cpp").write_text(include + main, encoding="ascii")
    compiler = COMPILERS[0]
    flags = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
    for command in (
        [compiler, *FLAGS, "-c", "fopi_brake_1_2_f64.c"],
        [compiler, "-x", "c++", "-std=c++11", *flags, "-c", "user.cpp", "-o", "user.o"],
        [compiler, "-o", "user", "user.o", "fopi_brake_1_2_f64.o"],
        ["./user"],
    ):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        if "cc1plus" in done.stderr:
            pytest.skip("the compiler has no C++")
        assert done.returncode == 0, done.stderr


@needs_compiler
def test_the_objects_call_nothing(tmp_path: Path) -> None:
    if not shutil.which("nm"):
        pytest.skip("nm is not found")
    written(export_c(export(made(0.4, 0.4, 0.8))), tmp_path)
    for suffix in ("f64", "f32"):
        # a compiler may turn any loop into memcpy, which every target has
        command = [COMPILERS[0], *FLAGS, "-O1", "-c", f"fopi_brake_1_2_{suffix}.c", "-o", "c.o"]
        subprocess.run(command, cwd=tmp_path, check=True)
        done = subprocess.run(["nm", "-u", "c.o"], cwd=tmp_path, capture_output=True, text=True, check=True)
        assert set(done.stdout.split()) - {"U", "memcpy", "memset", "__stack_chk_fail"} == set()


@needs_compiler
@pytest.mark.skipif(not shutil.which("make"), reason="make is not found")
def test_make_test_replays_the_vectors(tmp_path: Path) -> None:
    written(export_c(export(made(0.4, 0.4, 0.8))), tmp_path)
    command = ["make", "test", f"CC={COMPILERS[0]}"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "rows are equal bit for bit" in done.stdout


# -- the texts -------------------------------------------------------------------------------------------------------


@pytest.mark.thinned(6)
@needs_compiler
@pytest.mark.parametrize("text", HOSTILE)
def test_nothing_of_a_text_leaves_the_comment(tmp_path: Path, text: str) -> None:
    plain = export(made(0.7, 0.0, 0.8))
    hostile = replace(plain, description=text, spec_sha256=text, tool=text, units=Units(text, text))
    # -trigraphs: C99 has them in any case, and -Wall would warn of one
    folders = [written(export_c(one), tmp_path / name) for one, name in ((plain, "plain"), (hostile, "hostile"))]
    for suffix in ("f64", "f32"):
        seen = []
        for folder in folders:
            command = [COMPILERS[0], *FLAGS, "-Wcomment", "-trigraphs", "-E", "-P", f"fopi_brake_1_2_{suffix}.c"]
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
            assert done.stderr == ""
            seen.append(done.stdout)
        assert seen[0] == seen[1]


@pytest.mark.parametrize("text", [*HOSTILE, "", " \n ", "x" * 10_000, "".join(map(chr, range(0x300)))])
def test_a_harmless_text_is_printable_short_and_without_marks(text: str) -> None:
    found = sanitized(text, 200)
    assert len(found) <= 200
    assert re.fullmatch("[ -~]*", found)
    assert not re.search(r"\*/|/\*|\?\?|\\", comment(found).replace("\n", ""))
    assert all(line.startswith(" *") and len(line) < 120 for line in comment(found).splitlines())


@pytest.mark.parametrize("name", ["", "../x", "a/b", "a b", ".a", "a" * 65, "é", "a\n", "*/"])
def test_a_name_that_is_no_file_name_is_refused(name: str) -> None:
    with pytest.raises(DomainError, match="cannot name files"):
        export_c(export(made(0.7, 0.0, 0.8), name=name))


@pytest.mark.parametrize(
    ("name", "identifier"), [("Brake-1.2", "brake_1_2"), ("9", "9"), ("a..b-", "a_b"), ("int", "int")]
)
def test_names_become_parts_of_identifiers(name: str, identifier: str) -> None:
    files = export_c(export(made(0.7, 0.0, 0.8), name=name))
    stems = [f"fopi_{identifier}_{suffix}.{kind}" for suffix in ("f64", "f32") for kind in ("c", "h")]
    assert set(files) == {*stems, "main.c", "Makefile", "test_vectors.csv"}
    assert f"#ifndef FOPI_{identifier.upper()}_F64_H\n" in files[stems[1]]


def test_the_header_says_what_the_controller_is() -> None:
    controller = made(0.4, 0.4, 0.8)
    header = export_c(export(controller))["fopi_brake_1_2_f32.h"]
    text = re.sub(r"\s+", " ", header.replace("\n *", " "))
    measured = next(r.error for r in controller.realisations if (r.form, r.precision) == ("parallel", "float32"))
    omega, error = controller.errors[0]
    for said in (
        "Brake-1.2",
        SHA256,
        "A car's brake.",
        "fopi-tune 0",
        "Sample time: 0.2 s",
        "kp = 0.4, ki = 0.4, alpha = 0.8",
        "km/h, the measurement too",
        "part of full brake, limits: -1.0 to 1.0",
        "oustaloup, sampled by tustin, 7 poles for 0.001 to 1000 rad/s",
        f"at most {100 * error:.3g} % up to {omega:.4g} rad/s",
        f"largest error over largest output {measured:.2g}",
        "-ffp-contract=off",
    ):
        assert said in text


def test_equal_inputs_give_equal_bytes() -> None:
    assert export_c(export(made(0.4, 0.4, 0.8))) == export_c(export(made(0.4, 0.4, 0.8)))


def test_the_vectors_meet_every_kind_of_operation_and_both_limits() -> None:
    table = export_c(export(made(0.4, 0.4, 0.8)))["test_vectors.csv"]
    rows = [line.split(",") for line in table.splitlines()[1:]]
    assert 2000 <= len(rows) <= 3000
    assert {row[0] for row in rows} == set(Op)
    for column in (4, 5):
        outputs = [float.fromhex(row[column]) for row in rows]
        assert min(outputs) == -1.0
        assert max(outputs) == 1.0
        assert sum(abs(output) < 1.0 for output in outputs) > 500
    inputs = {row[k] for row in rows for k in (1, 2, 3)}
    assert {"nan", "inf", "-inf"} <= inputs
    # both precisions read the same numbers
    finite = np.array([float.fromhex(text) for text in inputs - {"nan", "inf", "-inf"}])
    assert np.array_equal(finite.astype(np.float32).astype(float), finite)


def test_literals_are_exact() -> None:
    values = [0.0, -0.0, 1.0, 0.1, -5e-324, 1.7976931348623157e308, *np.random.default_rng(6).normal(size=100).tolist()]
    for value in values:
        assert float.fromhex(literal(value)).hex() == value.hex()
        assert re.fullmatch(r"-?0x[01](\.[0-9a-f]*[1-9a-f])?p[+-]\d+f", literal(value, "f"))
