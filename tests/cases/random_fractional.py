"""Random fractional plants and controllers for them."""

from __future__ import annotations

import numpy as np

from fopi_tune.core.controller import FoPi, FoPid
from fopi_tune.core.fractional_plants.family import FractionalFamily
from fopi_tune.core.plant import Uncertain

#: coefficient and order of each term
Side = tuple[tuple[float, float], ...]


def random_sides(rng: np.random.Generator, q: int | None = None) -> tuple[Side, Side]:
    """Numerator and denominator, proper; with q all orders are multiples of 1/q, at most 2.4."""

    def orders(most: float, count: int) -> list[float]:
        if q is None:
            found = [0.0]
            while len(found) < count:
                order = float(rng.uniform(0.15, most))
                if min(abs(order - other) for other in found) > 0.1:
                    found.append(order)
            return found
        every = np.arange(1, max(int(most * q), 2))
        steps = rng.choice(every, min(count - 1, len(every)), replace=False)
        return [0.0, *(float(k) / q for k in steps)]

    def side(orders: list[float], negative: float) -> Side:
        signs = np.where(rng.random(len(orders)) < negative, -1.0, 1.0)
        sizes = 10.0 ** rng.uniform(-1.0, 1.0, len(orders))
        return tuple((float(s * c), e) for s, c, e in zip(signs, sizes, orders, strict=True))

    bottom_orders = orders(2.4, int(rng.integers(2, 5)))
    while all(e == int(e) for e in bottom_orders):
        bottom_orders = orders(2.4, int(rng.integers(2, 5)))
    highest = max(bottom_orders)
    top_orders = [e for e in orders(2.4, int(rng.integers(1, 3))) if e <= highest]
    if rng.random() < 0.15:
        # an integral of the plant's own
        bottom_orders = [e for e in bottom_orders if e > 0.0]
    return side(top_orders, 0.15), side(bottom_orders, 0.15)


def random_controller(rng: np.random.Generator, q: int | None = None) -> FoPi:
    """Gains of a size around 1, some with a derivative."""
    kp, ki = (float(rng.choice([1.0, -0.3, 0.0], p=[0.8, 0.1, 0.1]) * 10.0 ** rng.uniform(-1.5, 1.0)) for _ in range(2))
    kp = kp or 0.1
    alpha, mu = (float(rng.uniform(0.2, 1.8)), float(rng.uniform(0.15, 1.0)))
    if q is not None:
        alpha, mu = float(rng.integers(1, 2 * q)) / q, float(rng.integers(1, q + 1)) / q
    if rng.random() < 0.5:
        return FoPi(kp, ki, alpha)
    kd = float(10.0 ** rng.uniform(-2.0, 1.0))
    return FoPid(kp, ki, alpha, kd, mu, float(10.0 ** rng.uniform(-3.0, 0.0)))


def family_of(
    sides: tuple[Side, Side], dead_time_s: float = 0.0, width: float = 0.0, axes: int = 0
) -> FractionalFamily:
    """The family whose first `axes` terms and dead time are uncertain by a part `width` each way."""
    left = axes

    def number(value: float) -> Uncertain:
        nonlocal left
        if left <= 0 or width == 0.0 or value == 0.0:
            return Uncertain.exactly(value)
        left -= 1
        return Uncertain(value, *sorted((value * (1.0 - width), value * (1.0 + width))))

    top, bottom = ([(number(c), e) for c, e in side] for side in sides)
    return FractionalFamily.of(top, bottom, number(dead_time_s))


def published() -> FractionalFamily:
    """66.16 e^{-1.93 s}/(12.72 s^0.5 + 1)."""
    return family_of((((66.16, 0.0),), ((12.72, 0.5), (1.0, 0.0))), 1.93)
