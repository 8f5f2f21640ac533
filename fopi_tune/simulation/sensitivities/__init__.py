"""A sampled loop simulated together with its derivatives by kp, ki and alpha:  controller, plants, scenario -> signals.

`trajectories` checks and prepares; the recursions are in `kernel`, compiled by Numba.
"""

from fopi_tune.simulation.sensitivities.trajectories import Trajectories, trajectories

__all__ = ["Trajectories", "trajectories"]
