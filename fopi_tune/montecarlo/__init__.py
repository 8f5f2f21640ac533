"""Plants drawn from a family -> Evidence:  how often everything holds, with exact binomial intervals."""
