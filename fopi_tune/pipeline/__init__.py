"""The sequences of stages, one module for each public function:  `tune` is in `fopi_tune.pipeline.tune`."""
