"""Loops driven through scenarios in time:  what they do, and the measures that are read off.

`sampled` is the digital controller with its plant on samples, `fractional` the ideal controller in continuous time, and
`hybrid` two loops that take turns in continuous time.
"""
