"""What the cells of a study are made of: values of axes, systems in one document, and the check of each cell."""
