"""Noise: against published words of Philox, SciPy's quantiles, and in the compiled kernel bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.special

from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Sections
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.simulation.sampled.noise import normal_deviates, normal_quantile, philox
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import Mode, Scenario, Sensor, Signals

TS = 0.2


def test_philox_gives_the_published_words() -> None:
    # Random123's table of known answers: nothing, everything, and the digits of pi
    pi = (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344), (0xA4093822, 0x299F31D0)
    known = {
        ((0,) * 4, (0,) * 2): (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8),
        ((2**32 - 1,) * 4, (2**32 - 1,) * 2): (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD),
        pi: (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    }
    assert {given: philox(*given) for given in known} == known


@pytest.mark.parametrize("first", [0, 2**32 - 7, 10**12])
def test_the_kernel_s_noise_is_made_of_these_words_bit_for_bit(first: int) -> None:
    # a plant at rest at 0: the measurement is the noise
    controller = Runtime.of(Sections(TS, 0.0, (), ()), Precision.FLOAT64, (-1.0, 1.0))
    seed, plants = 2**63 + 5, Plants(np.ones((20, 1)), np.ones((20, 2)), np.zeros(20))
    scenario = Scenario(TS, Signals(np.zeros(43)), Sensor(noise_std=1.0, seed=seed))
    traces = simulate([Mode(controller, plants)], scenario, first_index=first)
    for i in range(20):
        plant = first + i
        words = [philox((j, 0, plant % 2**32, plant // 2**32), (seed % 2**32, seed // 2**32)) for j in range(22)]
        pairs = np.array(words, dtype=np.uint64).reshape(44, 2)[:43]
        u = ((pairs[:, 0] * 2**20 + pairs[:, 1] // 2**12).astype(float) + 0.5) * 2.0**-52
        # of the logarithms in the tails the last bits may differ
        np.testing.assert_allclose(traces.measured[i], scipy.special.ndtri(u), rtol=2e-14, atol=2e-15)
        central = np.abs(u - 0.5) <= 0.425
        np.testing.assert_array_equal(traces.measured[i, central], normal_quantile(u)[central])


def test_the_normal_quantile_is_scipy_s_out_to_the_last_word() -> None:
    u = np.concatenate([np.linspace(0.001, 0.999, 998), 10.0 ** -np.arange(4.0, 16.0), [2.0**-53, 1.0 - 2.0**-53]])
    np.testing.assert_allclose(normal_quantile(u), scipy.special.ndtri(u), rtol=5e-15, atol=1e-15)


def test_the_noise_is_normal_and_differs_from_plant_to_plant() -> None:
    noise = np.array([normal_deviates(3, plant, 500) for plant in range(40)])
    # 20,000 deviates: the mean's standard error is 0.007, the deviation's 0.005; four of them
    assert abs(noise.mean()) < 0.03
    assert abs(noise.std() - 1.0) < 0.02
    assert np.abs(np.corrcoef(noise) - np.eye(40)).max() < 0.25
