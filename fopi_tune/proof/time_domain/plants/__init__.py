"""Plants of a box behind a zero-order hold:  family, box -> polynomials in the delay of one sample."""
