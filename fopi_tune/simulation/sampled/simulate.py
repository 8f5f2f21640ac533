"""Simulation of many sampled loops, exact at the samples:  controllers, plants, scenario -> traces or measures.

`simulation.scenario` defines a sample; `reference` is a plain implementation of it.  Plants are computed in chunks,
each by one thread, and results depend on neither chunks nor threads: noise is a function of plant and sample.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import fields

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError
from fopi_tune.simulation.sampled.coefficients import (
    controller_coefficients,
    derivatives_of,
    filter_order_of,
    mode_coefficients,
)
from fopi_tune.simulation.sampled.layout import (
    BAND,
    BEFORE,
    BEGINS,
    DIRECTION,
    FED_STATIC,
    LOAD_BEGINS,
    REFERENCE_BEGINS,
    RESULTS,
    RISES_FROM,
    RISES_TO,
    SECTIONS,
    STEP_ROWS,
    TRACES,
    VALUE,
    WIDTH,
    Settings,
    scratch_layout,
)
from fopi_tune.simulation.sampled.mode_plants import Segments, discretize_modes
from fopi_tune.simulation.sampled.plants import DiscretePlants, discretize_plants
from fopi_tune.simulation.scenario import Horizon, Hybrid, Measures, Mode, Scenario, Traces

#: plants per chunk and thread; bounds the memory, and makes what is not compiled a small part of the time
CHUNK = 16384


def simulate(
    modes: Sequence[Mode], scenario: Scenario, count: int | None = None, first_index: int = 0, *,
    held: DiscretePlants | None = None,
) -> Traces:  # fmt: skip
    """All signals of a few plants; keeps 8 numbers per plant and sample.

    Args:
        modes: one, or two of a hybrid loop.
        scenario: everything else.
        count: number of plants; needed when a function supplies them.
        first_index: of the first plant, for functions and for the noise.
        held: the plants of one mode as `discretize_plants` has them, where they are driven again and again.

    Raises:
        DomainError: modes, plants and scenario do not belong together, or a plant cannot be simulated.
    """
    total = _count(modes, scenario, count)
    discretized = _discretized_all(modes, scenario, first_index, total) if held is None else ([held], None)
    kept = _run(modes, *discretized, scenario, Horizon(0.0), first_index, keep=True)[1]
    time_s = np.asarray(scenario.sample_time_s * np.arange(len(scenario.signals)), dtype=float)
    signals = dict(zip(TRACES[:6], kept, strict=False))
    return Traces(time_s, **signals, mode=kept[6].astype(np.int64) + 1, rate_after=kept[7])


def measure(
    modes: Sequence[Mode], scenario: Scenario, horizon: Horizon, count: int | None = None, *,
    chunk: int = CHUNK, threads: int | None = None,
) -> Measures:  # fmt: skip
    """The measures of every plant; `measure_chunks` bounds the memory of the results as well."""
    parts = list(measure_chunks(modes, scenario, horizon, count, chunk=chunk, threads=threads))
    if not parts:
        return _measures(np.zeros((len(RESULTS), 0)), scenario)
    names = [field.name for field in fields(Measures)]
    return Measures(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def measure_chunks(
    modes: Sequence[Mode], scenario: Scenario, horizon: Horizon, count: int | None = None, *,
    first: int = 0, chunk: int = CHUNK, threads: int | None = None,
) -> Iterator[Measures]:  # fmt: skip
    """The measures of chunks of plants, in order; memory depends on the chunks at work, not on the number of plants.

    Args:
        modes: one, or two of a hybrid loop.
        scenario: everything else.
        horizon: which samples count.
        count: number of plants; needed when functions supply them, which are called in order from this thread.
        first: index of the first plant, for functions and for the noise.
        chunk: plants per chunk.
        threads: number of threads; None: one per core.

    Raises:
        DomainError: modes, plants, scenario and horizon do not belong together, or a plant cannot be simulated.
    """
    total = _count(modes, scenario, count)
    if first and any(isinstance(mode.plants, Plants) for mode in modes):
        raise DomainError(f"plants that are given are counted from 0, not from {first!r}")
    workers = threads if threads is not None else available_threads()
    if chunk < 1 or workers < 1:
        raise DomainError(f"chunk {chunk!r} and threads {workers!r} must be at least 1")
    if horizon.first >= len(scenario.signals):
        raise DomainError(
            f"the horizon starts at sample {horizon.first}; the scenario has {counted(len(scenario.signals), 'sample')}"
        )
    return _chunks(modes, scenario, horizon, range(first, first + total, chunk), first + total, workers)


def _chunks(
    modes: Sequence[Mode], scenario: Scenario, horizon: Horizon, begins: range, end: int, workers: int
) -> Iterator[Measures]:
    def work(parts: list[Plants], begin: int) -> Measures:
        return _measures(_run(modes, *_discretized(parts, scenario), scenario, horizon, begin)[0], scenario)

    if workers == 1:
        for begin in begins:
            yield work(_plants_between(modes, begin, min(begin + begins.step, end)), begin)
        return
    waiting: deque[Future[Measures]] = deque()
    with ThreadPoolExecutor(workers) as pool:
        for begin in begins:
            parts = _plants_between(modes, begin, min(begin + begins.step, end))
            waiting.append(pool.submit(work, parts, begin))
            if len(waiting) > workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _count(modes: Sequence[Mode], scenario: Scenario, count: int | None) -> int:
    """Number of plants, after checking that modes and scenario fit together."""
    if len(modes) != (1 if scenario.hybrid is None else 2):
        raise DomainError(f"{counted(len(modes), 'mode')}: one without `hybrid`, two with it")
    if scenario.hybrid is not None and not all(mode.controller.can_take_turns for mode in modes):
        raise DomainError("two controllers that take turns have setpoint_weight: 1 and no measurement_filter")
    given = {len(mode.plants) for mode in modes if isinstance(mode.plants, Plants)}
    if count is not None:
        given.add(count)
    if len(given) != 1:
        raise DomainError(f"the modes have {sorted(given)} plants; give one number of them, with `count` for functions")
    (total,) = given
    if total < 0:
        raise DomainError(f"count {total!r} must be at least 0")
    return total


def _plants_between(modes: Sequence[Mode], begin: int, end: int) -> list[Plants]:
    parts = []
    for mode in modes:
        given = mode.plants
        part = given.take(np.arange(begin, end)) if isinstance(given, Plants) else given(begin, end)
        if len(part) != end - begin:
            raise DomainError(f"the plants of indices {begin} to {end - 1} are {len(part)}, not {end - begin}")
        parts.append(part)
    return parts


def _discretized_all(
    modes: Sequence[Mode], scenario: Scenario, begin: int, total: int
) -> tuple[list[DiscretePlants], Segments | None]:
    parts = [mode.plants for mode in modes if isinstance(mode.plants, Plants)]
    if len(parts) < len(modes):
        parts = _plants_between(modes, begin, begin + total)
    return _discretized(parts, scenario)


def _discretized(parts: Sequence[Plants], scenario: Scenario) -> tuple[list[DiscretePlants], Segments | None]:
    delay, hybrid = scenario.actuator.delay_samples, scenario.hybrid
    if hybrid is None:
        return [discretize_plants(part, scenario.sample_time_s, delay) for part in parts], None
    if hybrid.delay_samples and delay:
        raise DomainError("delays of the modes' own stand in place of the actuator's; make that 0")
    one, two = hybrid.delay_samples or (delay, delay)
    held, segments = discretize_modes(parts, scenario.sample_time_s, (one, two), scenario.signals.load is not None)
    if hybrid.hold_below and any(part.order > 1 for part in held):
        raise DomainError("a standstill needs plants of first order")
    return held, segments


def _run(
    modes: Sequence[Mode],
    held: list[DiscretePlants],
    segments: Segments | None,
    scenario: Scenario,
    horizon: Horizon,
    begin: int,
    keep: bool = False,
) -> tuple[Array, Array]:
    """Results, shape (19, m), and traces, shape (8, m, steps) when they are kept."""
    from fopi_tune.simulation.sampled.kernel import run_blocks

    m, count = len(held[0]), len(scenario.signals)
    blocks = -(-m // WIDTH)
    delay = np.zeros((2, blocks * WIDTH), dtype=np.int64)
    delay[0, :m], delay[1, :m] = held[0].control.delay, held[0].load.delay
    table = _table(held, segments, scenario, blocks * WIDTH)
    settings = _settings(modes, held, scenario, horizon, begin, keep)
    if segments is not None:
        delay = np.zeros((4 * len(segments), blocks * WIDTH), dtype=np.int64)
        delay[:, :m] = np.concatenate([segments.control, segments.load], axis=1).reshape(-1, m)
        settings = settings._replace(segments=len(segments), ring=int(segments.control.max(initial=0)) + 1)
    offsets = scratch_layout(
        settings.order, len(table) - 1 - settings.order, settings.sections, settings.derivatives,
        settings.filter_order,
    )  # fmt: skip
    signal = scenario.signals.load if scenario.signals.load is not None else np.zeros(0)
    results = np.empty((len(RESULTS), blocks * WIDTH))
    traces = np.zeros(len(TRACES) * count * blocks * WIDTH if keep else 0)
    controllers = np.array([controller_coefficients(mode.controller, settings) for mode in modes])
    controllers[:, FED_STATIC:SECTIONS] = mode_coefficients(scenario.hybrid, len(modes))
    scratch, jumps = _aligned(offsets.size + 2 * max(settings.ring, 1) * WIDTH), np.zeros(count, dtype=np.int64)
    reference, steps = scenario.signals.reference, _step_rows(scenario, horizon)
    run_blocks(
        0, blocks, settings, offsets, table, delay, controllers, reference, signal, steps, results, traces, scratch,
        jumps,
    )  # fmt: skip
    kept = traces.reshape(len(TRACES), count if keep else 0, blocks * WIDTH)[:, :, :m].transpose(0, 2, 1)
    return results[:, :m], kept


def _aligned(count: int) -> Array:
    """Doubles aligned to a cache line: vectors that cross lines are slow to read back after a write."""
    room = np.zeros(count + 8)
    first = -(room.ctypes.data // 8) % 8
    return room[first : first + count]


def _table(held: list[DiscretePlants], segments: Segments | None, scenario: Scenario, width: int) -> Array:
    """One column per plant: the input before the start, the states, and the coefficients that `plant_stages` uses."""
    first = held[scenario.hybrid.first - 1 if scenario.hybrid else 0]
    m, n = len(first), first.order
    states, past = first.initial_state(scenario.start)
    if scenario.hybrid is None:
        transition, new, old = first.control.whole
        plant = [transition.reshape(m, n * n), new, old, first.output, first.rate_state]
        plant += [first.direct[:, None], first.rate_input[:, None], first.rate_step[:, None]]
        at_samples = first.acts_at_samples.all()
        # what no sample uses is left out: most chunks have neither a load nor an arrival between samples
        if scenario.signals.load is not None or not at_samples:
            plant += first.load.whole[1:]
        if not at_samples:
            plant += [first.acts_at_samples[:, None], first.arrivals.reshape(m, 2 * (n + 4))]
    else:
        plant = []
        for part in held:
            for segment in (0, 1):
                whole = part.control.transition[segment].reshape(m, n * n)
                plant += [whole, part.control.weight[segment]]
            plant += [part.rate_state, part.rate_input[:, None]]
    for segment, mode in np.ndindex(0 if segments is None else len(segments), 2):
        assert segments is not None
        whole = segments.transition[segment, mode].reshape(m, n * n)
        plant += [whole, segments.weight[segment, mode], segments.arrives[segment, mode][:, None]]
    columns = [past[:, None], states, *plant]
    table = np.empty((sum(column.shape[1] for column in columns), width))
    np.concatenate([column.T for column in columns], out=table[:, :m])
    table[:, m:] = 0.0
    return table


def _settings(
    modes: Sequence[Mode], held: list[DiscretePlants], scenario: Scenario, horizon: Horizon, begin: int, keep: bool
) -> Settings:
    sensor, Ts = scenario.sensor, scenario.sample_time_s
    hybrid = scenario.hybrid or Hybrid(0.0)
    up, down, coast_above, coast_below = hybrid.lines.numbers
    own = hybrid.delay_samples or (0, 0)
    delay = max(int(held[0].control.delay.max(initial=0)), *own)
    # of delays that differ, which are whole, every control acts at a sample
    delayed = (delay > 0 and not hybrid.delay_samples) or any(
        bool(np.any(part.control.weight[0] != 0.0)) for part in held
    )
    load_delayed = bool(np.any(held[0].load.delay > 0))
    return Settings(
        noise_std=float(sensor.noise_std),
        quantum=float(sensor.quantum),
        most_change=float(scenario.actuator.rate_per_s * Ts),
        up=up[0],
        down=down[0],
        coast_above=coast_above[0],
        coast_below=coast_below[0],
        seed=np.uint64(sensor.seed),
        first_index=int(begin),
        order=held[0].order,
        sections=max(len(mode.controller.poles) for mode in modes),
        hybrid=int(scenario.hybrid is not None),
        up_absolute=int(up[1]),
        down_absolute=int(down[1]),
        coasts=int(hybrid.lines.coasts),
        coast_above_absolute=int(coast_above[1]),
        coast_below_absolute=int(coast_below[1]),
        inactive=int(hybrid.inactive),
        limits_rate=int(any(mode.controller.limits_rate for mode in modes)),
        fed=int(bool(hybrid.fed)),
        stands=int(bool(hybrid.hold_below)),
        weighted=int(any(mode.controller.proportional != 0.0 for mode in modes)),
        derivatives=max(derivatives_of(mode.controller) for mode in modes),
        starts_at_first_sample=int(any(mode.controller.starts_at_first_sample for mode in modes)),
        filter_order=max(filter_order_of(mode.controller) for mode in modes),
        first_mode=int(hybrid.first) - 1,
        most_switches=int(hybrid.most_switches),
        window=int(np.floor(hybrid.window_s / Ts + 1e-9)),
        dwell=int(hybrid.min_dwell_samples),
        horizon=int(horizon.first),
        judged=horizon.steps_of(scenario)[0].first,
        bumpless=int(scenario.start.bumpless),
        delayed=int(delayed),
        ring=delay + 1 if delay else 0,
        own_delays=int(bool(hybrid.delay_samples)),
        first_delay=int(own[0]),
        second_delay=int(own[1]),
        segments=0,
        same_delay=int(np.all(held[0].control.delay == delay)),
        loaded=int(scenario.signals.load is not None),
        load_delayed=int(load_delayed),
        acts_at_samples=int(all(part.acts_at_samples.all() for part in held)),
        steps=len(scenario.signals),
        width=-(-len(held[0]) // WIDTH) * WIDTH,
        keep=int(keep),
    )


def _step_rows(scenario: Scenario, horizon: Horizon) -> Array:
    """What is judged at each sample, in the order of `layout`."""
    steps, count = horizon.steps_of(scenario), len(scenario.signals)
    rows = np.zeros((STEP_ROWS, count))
    for step in steps:
        judged = np.array([step.value, step.direction, step.band, step.before])
        rows[[VALUE, DIRECTION, BAND, BEFORE], step.first :] = judged[:, None]
        rows[BEGINS, step.first] = LOAD_BEGINS if step.of_load else REFERENCE_BEGINS
        if not step.of_load:
            rows[[RISES_FROM, RISES_TO], step.first :] = np.array(step.rise_levels)[:, None]
    return rows.ravel()


def _measures(rows: Array, scenario: Scenario) -> Measures:
    """The kernel's results, in the measures' units."""
    Ts, steps = scenario.sample_time_s, len(scenario.signals)
    found = dict(zip(RESULTS, rows, strict=True))
    finite = found["finite"] == 1.0

    def known(values: Array) -> Array:
        return values if finite.all() else np.where(finite, values, np.nan)

    outside, at_end, before = found["outside"], found["final_error"], found["step_error"]
    lasted = np.where(outside >= steps - 1, np.inf, outside + 1.0 - found["begun"])
    settled = Ts * np.maximum(found["settled"], lasted)
    risen = found["risen"]
    with np.errstate(over="ignore"):  # of outputs that are finite, but hardly
        jerk = found["peak_jerk"] / (Ts * Ts)
    rise = Ts * np.maximum(found["rise"], risen - np.where(np.isinf(risen), 0.0, found["reached"]))
    return Measures(
        peak_rate=known(found["peak_rate"]),
        peak_jerk=known(jerk),
        overshoot=known(found["overshoot"]),
        undershoot=known(found["undershoot"]),
        settling_s=np.where(finite, settled, np.inf),
        rise_s=np.where(finite, rise, np.inf),
        iae=known(found["iae"] * Ts),
        ise=known(found["ise"] * Ts),
        saturated_s=known(found["saturated"] * Ts),
        peak_control=known(found["peak_control"]),
        switches=found["switches"].astype(np.int64),
        longest_run=found["longest_run"].astype(np.int64),
        chattering=found["chattering"] == 1.0,
        final_error=known(np.where(np.abs(before) > np.abs(at_end), before, at_end)),
        finite=finite,
    )


#: environment variable with the number of threads; 1 where many processes share a machine, as workers of a study
THREADS_VARIABLE = "FOPI_THREADS"


def available_threads() -> int:
    """Number of threads to use, at least 1; a variable that is no positive number is ignored."""
    wanted = os.environ.get(THREADS_VARIABLE, "")
    if wanted.isdecimal() and int(wanted) > 0:
        return int(wanted)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
