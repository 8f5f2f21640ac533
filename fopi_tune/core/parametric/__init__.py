"""Families whose coefficients are polynomials in named parameters, each of which may occur in several of them."""
