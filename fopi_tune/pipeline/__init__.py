"""The sequences of stages, a module a public verb:  `tune` is in `fopi_tune.pipeline.tune`."""
