"""Distributions of uncertain numbers, and correlations between them."""
