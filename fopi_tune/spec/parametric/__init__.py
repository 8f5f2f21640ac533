"""Plants by named parameters: expressions, and the polynomials that they make of a plant's coefficients."""
