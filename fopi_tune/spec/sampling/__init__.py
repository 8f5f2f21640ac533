"""How plants are drawn: distributions of uncertain numbers, and correlations between them."""
