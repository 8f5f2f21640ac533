"""Objects of other packages as plants."""
