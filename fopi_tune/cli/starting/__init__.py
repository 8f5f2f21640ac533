"""What people begin with:  `fopi init`, the examples that ship, and the schemas."""
