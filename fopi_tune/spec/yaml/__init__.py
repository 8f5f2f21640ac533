"""YAML with positions:  text -> nodes -> values, read by shapes; every mistake is reported with line and column.

Nothing here depends on the words of the spec language.
"""
