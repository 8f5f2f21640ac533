"""Fractional plants:  quotients of sums of real powers of s."""
