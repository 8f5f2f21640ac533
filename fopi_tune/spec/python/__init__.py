"""Specs written in Python: mappings, plants and requirements as objects, read with the checks of the YAML language."""
