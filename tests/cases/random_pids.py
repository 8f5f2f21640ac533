"""Random PID loops:  gains about as large as a plant's crossover asks for, signs, vanishing and dominating terms."""

from __future__ import annotations

import math

import numpy as np
from cases.plants import lag, pole, transfer_function

from fopi_tune.core.controller import Pid
from fopi_tune.core.parallel_form import Sections
from fopi_tune.core.plant import PlantFamily, Uncertain


def sized(rng: np.random.Generator, low: float, high: float) -> float:
    """A positive number, evenly on a logarithmic scale."""
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def plants_of(rng: np.random.Generator) -> PlantFamily:
    """A plant of order 1 to 4: lags, poles on either side, resonances, zeros, direct paths; half of them late."""
    late = float(rng.choice([0.0, sized(rng, 0.02, 1.0)]))
    kind = int(rng.integers(6))
    if kind == 0:
        return lag(sized(rng, 0.3, 5.0), sized(rng, 0.3, 3.0), late)
    if kind == 1:
        return pole(sized(rng, 0.3, 5.0), float(rng.choice([sized(rng, 0.05, 2.0), 0.0, -sized(rng, 0.05, 1.0)])), late)
    if kind == 2:
        omega, damping = sized(rng, 0.5, 2.0), sized(rng, 0.02, 0.7)
        return transfer_function([sized(rng, 0.1, 3.0)], [1.0, 2.0 * damping * omega, omega * omega], late)
    roots = [-sized(rng, 0.2, 5.0) for _ in range(int(rng.integers(1, 5)))]
    if kind == 3:
        roots[0] = 0.0
    denominator = np.poly(roots)
    zeros = [sized(rng, 0.5, 20.0) * float(rng.choice([-1.0, 1.0], p=[0.7, 0.3]))] if kind >= 4 else []
    numerator = np.poly(zeros) / math.prod(max(abs(zero), 1e-3) for zero in zeros)
    gain = sized(rng, 0.3, 3.0) * abs(math.prod(root or 1.0 for root in roots))
    return transfer_function((gain * np.atleast_1d(numerator)).tolist(), denominator.tolist(), late)


def uncertain(rng: np.random.Generator, plants: PlantFamily, least: int = 0) -> PlantFamily:
    """The same with `least` up to two numbers that are known to some percent; nominal not in the middle."""
    names = [n for n, number in plants.parameters.items() if number.nominal != 0.0 and n != "denominator[0]"]
    numbers = dict(plants.parameters)
    for name in rng.permutation(names)[: int(rng.integers(least, 3))]:
        nominal, width = numbers[name].nominal, sized(rng, 1.02, 1.4)
        low, high = sorted((nominal / width ** float(rng.uniform(0.2, 1.0)), nominal * width))
        numbers[name] = Uncertain(nominal, low, high)
    return PlantFamily(plants.model, numbers)


def pid_for(rng: np.random.Generator, plants: PlantFamily) -> Pid:
    """Gains for a crossover somewhere; a term is missing at times, of the other sign, or the derivative dominates."""
    omega = sized(rng, 0.2, 5.0)
    plant = plants.member(plants.nominal_point)
    at = np.polyval(plant.numerator, 1j * omega) / np.polyval(plant.denominator, 1j * omega)
    size = sized(rng, 0.1, 1.0) / float(abs(at)) * float(np.sign(plant.numerator[-1]))
    kp, ki, kd = (sized(rng, 0.2, 1.5) for _ in range(3))
    kind = int(rng.integers(8))
    kp *= 0.0 if kind == 0 else -0.3 if kind == 1 else 1.0
    ki *= 0.0 if kind == 2 else 1.0
    kd *= 5.0 if kind in (3, 4) else -0.3 if kind == 5 else 1.0
    return Pid(size * kp, size * ki * omega, size * kd / omega, sized(rng, 0.02, 1.0) / omega)


def mirrored(plants: PlantFamily, pid: Pid) -> tuple[PlantFamily, Pid]:
    """The same loop by a negative plant and negative gains."""
    numbers = {
        name: Uncertain(-n.nominal, -n.max, -n.min) if name in ("static_gain", "gain") or name.startswith("num") else n
        for name, n in plants.parameters.items()
    }
    return PlantFamily(plants.model, numbers), Pid(-pid.kp, -pid.ki, -pid.kd, pid.derivative_filter_time_constant_s)


def on_samples(pid: Pid, sample_time_s: float) -> Sections:
    """A PID by Tustin's rule, written down by hand:  s = (2/Ts) (z - 1)/(z + 1)."""
    ts, filter_s = sample_time_s, pid.derivative_filter_time_constant_s
    pole_of_filter = (2.0 * filter_s - ts) / (2.0 * filter_s + ts)
    derivative = 2.0 * pid.kd / (2.0 * filter_s + ts)
    direct = pid.kp + 0.5 * pid.ki * ts + derivative
    found = ((1.0, pid.ki * ts), (pole_of_filter, derivative * (pole_of_filter - 1.0)))
    poles, residues = zip(*(found if pid.ki else found[1:]), strict=True)
    return Sections(ts, direct, poles, residues)
