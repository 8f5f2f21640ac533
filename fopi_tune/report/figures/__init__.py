"""Figures drawn from results, each with a description in words."""
