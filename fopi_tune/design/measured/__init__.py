"""The search for gains of measured responses: the same rays, program and exchange, on the curves."""
