"""Loops with fractional plants over boxes."""
