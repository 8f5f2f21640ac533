"""Monte Carlo validation:  plants drawn from a family -> Evidence, with exact binomial confidence intervals."""
