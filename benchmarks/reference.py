"""The best gains of a spec by means that share nothing with the search:  three optimisers of SciPy.

Differential evolution finds places, Nelder and Mead and SLSQP the best gains there.

The loop is evaluated on a dense table of its own, its stability by the winding of 1 + L along an arc and the imaginary
axis; the verification judges what is found, and the plants at which it objects join the table.
"""

# pyright: reportAttributeAccessIssue=false, reportCallIssue=false, reportArgumentType=false
from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import differential_evolution, minimize

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.proof import verify
from fopi_tune.quantities.objectives import default_horizon_s
from fopi_tune.spec.model import DesignSpec, Requirement, Scope

_NEPER = math.log(10.0) / 20.0
#: points a decade of the table, and on the arc around the origin
_PER_DECADE, _ARC = 40, 24
#: natural units by which finalists are kept inside
_INSIDE = 2e-6
_UNSTABLE = 1e3
#: differential evolutions, each with its own seed
_RUNS = 2
_POPULATION, _GENERATIONS = 20, 120


@dataclass
class Dense:
    """A spec's plants on a dense grid.

    Args:
        spec: the spec.
        points: plants of the box, the nominal one first, shape (m, p).
        evaluations: of the loop so far.
    """

    spec: DesignSpec
    points: np.ndarray
    evaluations: int = field(default=0)

    @classmethod
    def of(cls, spec: DesignSpec) -> Dense:
        """The nominal plant and a grid of three values of each uncertain number."""
        family = spec.plant
        axes = [np.linspace(a, b, 3) for a, b in zip(family.low, family.high, strict=True)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(axes)) if axes else np.zeros((0, 0))
        return cls(spec, np.vstack([family.nominal_point.reshape(1, -1), grid]))

    def __post_init__(self) -> None:
        self.plants = Plants.members(self.spec.plant, self.points)
        roots = np.concatenate([self.plants.poles.ravel(), self.plants.zeros.ravel()])
        roots = roots[np.isfinite(roots) & (np.abs(roots) > 0)]
        delays = self.plants.dead_time_s
        named = [w for r in self.spec.requirements for w in (r.from_rad_s, r.to_rad_s) if 0 < w < math.inf]
        named += [r.limits[0] for r in self.spec.requirements if r.quantity == "crossover_rad_s"]
        corners = np.concatenate([np.abs(roots), 1.0 / delays[delays > 0], named])
        low, high = corners.min() * 1e-3, corners.max() * 1e3
        self.unit = float(np.exp(np.mean(np.log(np.abs(corners)))))
        light = roots[(np.abs(roots.real) < 0.5 * np.abs(roots.imag)) & (roots.imag > 0)]
        around = [abs(r) * (1.0 + abs(r.real) / abs(r) * np.linspace(-8, 8, 33)) for r in light]
        ripple = [np.arange(0.15, 60.0, 0.15) / delays.max()] if delays.max() > 0 else []
        grid = np.geomspace(low, high, int(_PER_DECADE * math.log10(high / low)))
        omega = np.unique(np.concatenate([grid, named, *around, *ripple]))
        self.omega = omega[omega > 0]
        self.s = np.concatenate([self.omega[0] * np.exp(0.5j * np.pi * np.linspace(0, 1, _ARC)), 1j * self.omega[1:]])
        self.p = self._response(self.s)
        self.gain = float(np.abs(self._response(np.array([1j * self.unit]))[0, 0]))
        self.horizon = (self.spec.objective.horizon_s if self.spec.objective else None) or default_horizon_s(
            self.spec.plant
        )
        self.at_horizon = self._response(np.array([1.0 / self.horizon + 0j])).real

    def _response(self, s: np.ndarray) -> np.ndarray:
        top = np.array([np.polyval(row, s) for row in self.plants.numerator])
        bottom = np.array([np.polyval(row, s) for row in self.plants.denominator])
        return top / bottom * np.exp(-np.outer(self.plants.dead_time_s, s))

    def exact(self, rows: np.ndarray, omega: np.ndarray, gains: FoPi) -> np.ndarray:
        """L of some plants at frequencies of their own."""
        s = 1j * omega
        p = self.plants.response(rows, omega) * np.exp(-s * self.plants.dead_time_s[rows])
        return (gains.kp + gains.ki * s**-gains.alpha) * p

    def slacks(self, gains: FoPi) -> tuple[np.ndarray | None, np.ndarray]:
        """(slacks of the requirements, the objective's members, smaller is better); None where a plant is unstable."""
        self.evaluations += 1
        c = gains.kp + gains.ki * self.s**-gains.alpha
        loop = c * self.p
        turned = np.unwrap(np.angle(1.0 + loop), axis=1)
        wound = (turned[:, -1] - turned[:, 0]) / np.pi
        unstable = self.plants.unstable_poles - wound
        if np.any(np.abs(unstable) > 0.4) or np.abs(1.0 + loop).min() < 1e-3:
            return None, np.array([np.abs(unstable).max()])
        axis, c = loop[:, _ARC:], c[_ARC:]
        found = _Crossings(self, gains, axis)
        slack = [self._slack(r, axis, c, found) for r in self.spec.requirements]
        if any(each is None for each in slack):
            return None, np.array([0.5])
        members = self._members(gains, axis, c, found)
        return (None, np.array([0.5])) if members is None else (np.concatenate([*slack, np.zeros(0)]), members)

    def _band(self, quantity: str, loop: np.ndarray, c: np.ndarray) -> np.ndarray:
        sensitivity = -np.log(np.abs(1.0 + loop))
        extra = {"sensitivity_db": 0.0, "complementary_sensitivity_db": np.log(np.abs(loop))}
        extra |= {"control_sensitivity_db": np.log(np.abs(c)), "loop_gain_db": np.log(np.abs(loop)) - sensitivity}
        return sensitivity + extra[quantity]

    def _slack(self, r: Requirement, loop: np.ndarray, c: np.ndarray, found: _Crossings) -> np.ndarray | None:
        rows = slice(0, 1) if r.scope is Scope.NOMINAL else slice(None)
        if r.quantity.endswith("_db") and r.quantity != "gain_margin_db":
            omega = self.omega[1:]
            inside = (omega >= r.from_rad_s * (1 - 1e-9)) & (omega <= r.to_rad_s * (1 + 1e-9))
            value = _peaks(np.log(omega[inside]), self._band(r.quantity, loop[rows], c)[:, inside])
            return r.upper * _NEPER - value
        value = found.values(r.quantity, loop, rows)
        if value is None:
            return None
        factor = {"phase_margin_deg": math.pi / 180.0, "gain_margin_db": _NEPER}.get(r.quantity, 1.0 / r.limits[0])
        parts = [] if r.lower == -math.inf else [value - r.lower]
        parts += [] if r.upper == math.inf else [r.upper - value]
        return np.minimum(np.concatenate(parts) * factor, 5.0)

    def _members(self, gains: FoPi, loop: np.ndarray, c: np.ndarray, found: _Crossings) -> np.ndarray | None:
        quantity = self.spec.objective.quantity if self.spec.objective else "ki"
        if quantity == "ki":
            return np.array([-gains.ki * self.gain / self.unit**gains.alpha])
        if quantity == "iae_disturbance":
            controller = gains.kp + gains.ki * self.horizon**gains.alpha
            return np.log(np.abs(self.at_horizon / (1.0 + controller * self.at_horizon)))[:, 0]
        if quantity == "phase_margin_spread_deg":
            value = found.values("phase_margin_deg", loop, slice(None))
            return None if value is None else np.concatenate([value - value[0], value[0] - value]) * math.pi / 180.0
        if quantity == "crossover_spread_db":
            at = found.values("crossover_rad_s", loop, slice(0, 1))
            if at is None:
                return None
            every = np.arange(len(self.points))
            value = np.log(np.abs(self.exact(every, np.full(len(every), at[0]), gains)))
            return np.concatenate([value, -value])
        name = "sensitivity_db" if quantity == "sensitivity_peak_db" else "control_sensitivity_db"
        return _peaks(np.log(self.omega[1:]), self._band(name, loop, c)) + (
            0.0 if name == "sensitivity_db" else math.log(self.gain)
        )


class _Crossings:
    """Gain crossings of all plants, refined by the secant method on the exact response."""

    def __init__(self, dense: Dense, gains: FoPi, loop: np.ndarray) -> None:
        log, omega = np.log(np.abs(loop)), dense.omega[1:]
        self.dense, self.gains = dense, gains
        self.rows, j = np.nonzero(np.signbit(log[:, :-1]) != np.signbit(log[:, 1:]))
        a, b = np.log(omega[j]), np.log(omega[j + 1])
        ya, yb = log[self.rows, j], log[self.rows, j + 1]
        for _ in range(4):
            c = a - ya * (b - a) / np.where(yb == ya, 1.0, yb - ya)
            yc = np.log(np.abs(dense.exact(self.rows, np.exp(c), gains)))
            same = np.signbit(yc) == np.signbit(ya)
            a, ya, b, yb = np.where(same, c, a), np.where(same, yc, ya), np.where(same, b, c), np.where(same, yb, yc)
        self.omega = np.exp(np.where(np.abs(ya) < np.abs(yb), a, b))
        self.lag = (np.angle(dense.exact(self.rows, self.omega, gains)) + np.pi) % (2.0 * np.pi)

    def values(self, quantity: str, loop: np.ndarray, rows: slice) -> np.ndarray | None:
        """A margin or the crossover of each plant in its public unit; None where there is none."""
        wanted = range(len(self.dense.points))[rows]
        if quantity == "gain_margin_db":
            return self._gain_margins(loop[rows])
        values = []
        for i in wanted:
            mine = self.rows == i
            if not mine.any():
                return None
            lag = self.lag[mine]
            by_name = {
                "phase_margin_deg": float(np.degrees(np.minimum(lag, 2.0 * np.pi - lag)).min()),
                "delay_margin_s": float((lag / self.omega[mine]).min()),
                "crossover_rad_s": float(self.omega[mine].max()),
            }
            values.append(by_name[quantity])
        return np.array(values)

    def _gain_margins(self, loop: np.ndarray) -> np.ndarray:
        real, imag, values = loop.real, loop.imag, []
        for i in range(len(loop)):
            j = np.nonzero((np.signbit(imag[i, :-1]) != np.signbit(imag[i, 1:])) & (real[i, 1:] < 0))[0]
            part = imag[i, j] / (imag[i, j] - imag[i, j + 1])
            at = np.exp(
                np.log(self.dense.omega[1:][j]) + part * np.log(self.dense.omega[1:][j + 1] / self.dense.omega[1:][j])
            )
            size = np.abs(self.dense.exact(np.full(len(j), i), at, self.gains).real)
            values.append(-np.log(size[size < 1.0].max()) / _NEPER if np.any(size < 1.0) else 1e3)
        return np.array(values)


def _peaks(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The largest value of each row, by a parabola where it lies inside."""
    j = np.argmax(y, axis=1)
    best = y[np.arange(len(y)), j]
    for i in np.flatnonzero((j > 0) & (j < len(x) - 1)):
        k = j[i]
        h, g = x[k] - x[k - 1], x[k + 1] - x[k]
        left, right = (y[i, k] - y[i, k - 1]) / h, (y[i, k + 1] - y[i, k]) / g
        bend = (right - left) / (h + g)
        if bend < 0:
            best[i] -= (left + bend * h) ** 2 / (4.0 * bend)
    return best


def reference(spec: DesignSpec, seed: int = 0) -> tuple[FoPi | None, float | None]:
    """The best gains that the verification accepts, and their objective; None where none were found."""
    dense, box = Dense.of(spec), spec.controller
    signs = (1.0 if box.kp.max > 0 else -1.0, 1.0 if box.ki.max > 0 else -1.0)
    best: tuple[FoPi | None, float | None] = None, None
    sense = -1.0 if spec.objective is not None and spec.objective.sense.value == "maximize" else 1.0

    def gains_of(z: np.ndarray) -> FoPi:
        kp = signs[0] * math.exp(min(z[0], 60.0)) / dense.gain
        ki = signs[1] * math.exp(min(z[1], 60.0)) / dense.gain * dense.unit ** z[2]
        return FoPi(*(min(max(v, r.min), r.max) for v, r in ((kp, box.kp), (ki, box.ki), (z[2], box.alpha))))

    fixed = next(
        (r.limits[0] for r in spec.requirements if r.quantity == "crossover_rad_s" and r.relation.value == "equals"),
        None,
    )

    def on_crossover(z: np.ndarray) -> np.ndarray:
        if fixed is None:
            return z
        size = math.log(abs(dense.exact(np.array([0]), np.array([fixed]), gains_of(z))[0]))
        return np.array([z[0] - size, z[1] - size, z[2]])

    def penalised(z: np.ndarray, inside: float = 0.02) -> float:
        slack, members = dense.slacks(gains_of(on_crossover(z)))
        if slack is None:
            return _UNSTABLE + float(members[0])
        missed = float(np.maximum((inside if fixed is None else -1e-6) - slack, 0.0).sum())
        return 50.0 + missed if missed > 0 else float(members.max())

    def walked(z: np.ndarray) -> np.ndarray:
        """Nelder and Mead, from smaller and smaller simplices: slow, but it needs no slopes."""
        for size in (0.1, 0.03, 0.01, 1e-3):
            simplex = np.vstack([z, z + size * np.diag([1.0, 1.0, 0.3])])
            options = {"initial_simplex": simplex, "maxfev": 300, "xatol": 1e-9, "fatol": 1e-10}
            z = minimize(penalised, z, (_INSIDE,), "Nelder-Mead", options=options).x
        return z

    bounds = [(-7.0, 4.5), (-7.0, 4.5), (box.alpha.min, box.alpha.max + 1e-12)]
    starts = []
    for turn in range(_RUNS):
        found = differential_evolution(
            penalised, bounds, popsize=_POPULATION, maxiter=_GENERATIONS, seed=seed + turn, polish=False, tol=1e-8
        )
        starts.append(found.x)
    for _ in range(3):
        finalists = [gains_of(on_crossover(z)) for z in starts]
        finalists += [gains_of(on_crossover(walked(z))) for z in starts]
        finalists += [g for z in starts if (g := _polished(dense, on_crossover(z), gains_of, fixed)) is not None]
        for gains in finalists:
            judged = verify(spec, gains)
            if (
                judged.all_met
                and judged.objective is not None
                and (best[1] is None or sense * judged.objective < sense * best[1])
            ):
                best = gains, judged.objective
            worst = [r.worst.point for r in judged.requirements if r.worst is not None and not r.is_met]
            if worst and dense.points.shape[1]:
                dense = replace(dense, points=np.vstack([dense.points, np.array(worst)]))
        if best[0] is not None:
            break
    return best


def _polished(dense: Dense, z: np.ndarray, gains_of, fixed: float | None) -> FoPi | None:
    """SLSQP on (ln kp, ln ki, alpha, t), t at least each of the objective's members."""
    box = dense.spec.controller
    slack, members = dense.slacks(gains_of(z))
    if slack is None:
        return None
    count, best = (len(slack), len(members)), None

    def rows(x: np.ndarray) -> np.ndarray:
        gains = gains_of(x)
        s, m = dense.slacks(gains)
        if s is None or (len(s), len(m)) != count:
            return np.full(count[0] + count[1] + 1, -1.0)
        on = math.log(abs(dense.exact(np.array([0]), np.array([fixed]), gains)[0])) if fixed is not None else 0.0
        return np.concatenate([s - _INSIDE, x[3] - m, [on]])

    keep = np.array([i for i, r in enumerate(_owners(dense)) if not (fixed is not None and r == "equal")], dtype=int)
    constraints = [
        {"type": "ineq", "fun": lambda x: np.concatenate([rows(x)[: count[0]][keep], rows(x)[count[0] : -1]])}
    ]
    if fixed is not None:
        constraints.append({"type": "eq", "fun": lambda x: rows(x)[-1:]})
    x = np.array([*z, members.max()])
    limits = [(-14.0, 8.0), (-14.0, 8.0), (box.alpha.min, box.alpha.max), (None, None)]
    for step in (1e-6, 1e-7):
        found = minimize(
            lambda x: x[3],
            x,
            jac=lambda _: np.array([0.0, 0.0, 0.0, 1.0]),
            bounds=limits,
            constraints=constraints,
            method="SLSQP",
            options={"maxiter": 80, "ftol": 1e-11, "eps": step},
        )
        if np.all(np.isfinite(found.x)):
            x, best = found.x, gains_of(found.x)
    return best


def _owners(dense: Dense) -> list[str]:
    """Of each slack, whether it belongs to an equality."""
    owners = []
    for r in dense.spec.requirements:
        rows = 1 if r.scope is Scope.NOMINAL else len(dense.points)
        is_equal = r.relation.value == "equals"
        owners += ["equal" if is_equal else ""] * (rows * (2 if is_equal or r.relation.value == "between" else 1))
    return owners
