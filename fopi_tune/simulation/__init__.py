"""Simulation of loops in the time domain:  scenario, controllers, plants -> signals and measures.

`sampled` simulates the digital controller with its plant on samples, `fractional` the ideal controller in continuous
time, and `hybrid` two switched loops in continuous time.
"""
