"""Commented specs that `fopi init` writes:  one a plant model, and those of fitted plants."""
