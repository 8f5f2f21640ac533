"""Gains for what scenarios measure, on the loop as it runs:  simulations with derivatives, convex steps, exchange.

The objective and the limits are measures of simulations over the whole family, beside requirements on the frequency
response of the loop on samples.  Ipopt has no part in it: simulations have kinks.
"""

from fopi_tune.design.time_domain.search import design_for_scenarios

__all__ = ["design_for_scenarios"]
