"""YAML with the place of everything in it:  text -> nodes -> values by shapes, and every mistake with line and column.

Nothing here knows what a word of the spec language means.
"""
